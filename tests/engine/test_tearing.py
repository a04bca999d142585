"""Fracture: which connections break and when, and that what is broken is not there."""

import math

import numpy as np
import pytest
from problems import EPS64
from springs import pair, simulate

from msdwarp import RK4, Leapfrog, Probe, Simulation, System, box, chain
from msdwarp.engine.springs import force_algorithms as forces


def bursting(**fields) -> System:
    """Return a block whose particles fly apart, so that most of its connections break at once."""
    body = box((4, 3, 3), 0.1, mass=0.01, stiffness=200.0, damping=0.02)
    velocity = np.random.default_rng(1).normal(size=body.position.shape) * 8.0
    return body.with_velocity(velocity).replace(**({"break_strain": 0.25} | fields))


def burst(device: str, body: System | None = None, **options) -> Simulation:
    options = {"gravity": 0.0, "precision": "float64", "substeps": 40} | options
    return Simulation(bursting() if body is None else body, device=device, **options)


def test_it_breaks_beyond_its_strain_and_not_at_it(device):
    for length, broken in (
        (1.5, False),
        (np.nextafter(1.5, 2.0), True),
    ):  # squares of both are exact enough to tell
        simulation = simulate(pair(length, 1, break_strain=0.5), device, h=0.01)
        simulation.step()
        assert simulation.snapshot().broken[0] == broken


def test_a_force_is_a_stretch(device):
    # k (l − l0) = 12.5 N where l/l0 − 1 = ¼: numbers without rounding, so that all is the same to the last bit.
    swinging = {"mass": 1.0, "damping": 0.5, "velocity": [[-2.0], [2.0]]}
    ends = []
    for limit in ({"break_strain": 0.25}, {"break_force": 12.5}):
        simulation = simulate(pair(1.0, 1, **swinging, **limit), device, h=1 / 512)
        simulation.step(60)
        ends.append(simulation.snapshot())
    assert ends[0].broken[0]
    for name in ("position", "velocity", "broken_at"):
        np.testing.assert_array_equal(getattr(ends[0], name), getattr(ends[1], name))


def test_an_oscillator_breaks_when_it_is_so_long(device):
    # e = v/ω sin ωt reaches ¼ m at t = asin(ω/4v)/ω; it is found out at the start of the substep behind that.
    k, m, v, h = 50.0, 1.0, 4.0, 1e-4
    omega = math.sqrt(2 * k / m)
    body = pair(1.0, 1, mass=m, stiffness=k, velocity=[[-v / 2], [v / 2]], break_strain=0.25)
    simulation = simulate(body, device, h=h, substeps=10, integrator=RK4())
    simulation.step(100)
    expected = math.asin(0.25 * omega / v) / omega
    # RK4 errs by less than rounding does; times are float32.
    assert 0.0 <= simulation.snapshot().broken_at[0] - expected <= h * (1 + 1e-3)
    # Half of the relative kinetic energy ½ (m/2) v² has gone into the spring, and with it.
    speed = math.sqrt(v**2 - 2 * k / m * 0.25**2)
    rate = np.ptp(simulation.frame().velocity)
    assert rate == pytest.approx(speed, rel=2 * k / m * 0.25 * h / speed)  # the force of one substep


@pytest.mark.slow
def test_the_same_break_at_the_same_time_by_every_route(plain_device):
    # How forces are summed depends neither on the method nor on how a stage is launched.
    times = []
    for force_algorithm, blocks in (("scatter", "auto"), ("gather", None), ("stencil", "auto")):
        simulation = burst(plain_device, force_algorithm=force_algorithm, blocks=blocks, integrator=RK4())
        simulation.step(6)
        times.append(simulation.snapshot().broken_at)
    assert 0.3 < np.isfinite(times[0]).mean() < 1.0
    assert len(np.unique(times[0])) > 10
    for one in times[1:]:
        np.testing.assert_array_equal(one, times[0])


def without(system: System, gone: np.ndarray) -> System:
    """Return a lattice built without some of its connections, with no word of tearing."""
    directions = tuple(
        {
            name: slice(*(int((~gone)[:end].sum()) for end in (part.start, part.stop)))
            for name, part in body.items()
        }
        for body in system.directions
    )
    names = ("rest_length", "stiffness", "damping")
    fields = {name: getattr(system, name)[~gone] for name in names}
    moving = {name: getattr(system, name) for name in ("position", "velocity", "mass")}
    return System(**moving, **fields, connections=system.connections[~gone], directions=directions)


@pytest.mark.slow
@pytest.mark.parametrize("blocks", ["auto", None], ids=["one launch", "launches"])
@pytest.mark.parametrize("precision", ["float32", "float64"])
@pytest.mark.parametrize("force_algorithm", ["gather", "stencil"])
@pytest.mark.each_value
def test_a_torn_lattice_moves_as_one_built_so(plain_device, force_algorithm, precision, blocks, monkeypatch):
    # What cannot tear has several threads to a particle on a GPU, which sum in another order.
    monkeypatch.setattr(forces, "lanes", lambda model, tears: 1)
    body = box((6, 4, 3), 0.1, mass=0.01, stiffness=200.0, damping=0.05)
    left = body.position[:, 0] < 0.0
    seam = left[body.connections[:, 0]] != left[body.connections[:, 1]]
    pulled = body.with_velocity(np.where(left, -1.0, 1.0)[:, None] * (12.0, 2.0, 0.0))
    pulled = pulled.replace(break_strain=np.where(seam, 0.1, np.inf))
    options = {"force_algorithm": force_algorithm, "blocks": blocks, "precision": precision}
    torn = burst(plain_device, pulled, **options)
    torn.step(6)
    np.testing.assert_array_equal(torn.snapshot().broken, seam)
    built = burst(plain_device, without(torn.snapshot(), seam), **options)
    cut = burst(plain_device, torn.snapshot().replace(break_strain=np.inf), **options)  # broken from the start
    for other in (torn, built, cut):
        other.step(8)
    for other in (built, cut):
        for one, wanted in zip(torn.frame()[1:], other.frame()[1:], strict=True):
            np.testing.assert_array_equal(one, wanted)
    assert torn.measure().elastic_energy == pytest.approx(built.measure().elastic_energy, rel=1e-12)


@pytest.mark.slow
def test_columns_of_a_lattice_tear(plain_device, request):
    ends = []
    for columns in (False, True):
        if columns:
            request.getfixturevalue("in_columns")
        simulation = burst(plain_device, force_algorithm="stencil", blocks=None)
        simulation.step(6)
        ends.append(simulation.snapshot())
    assert 0.3 < ends[0].broken.mean() < 1.0
    np.testing.assert_array_equal(ends[1].broken_at, ends[0].broken_at)
    # A column sums the forces on a particle in another order.
    np.testing.assert_allclose(ends[1].position, ends[0].position, rtol=0, atol=240 * 40 * EPS64)


def test_nothing_comes_from_tearing(device):
    simulation = burst(device)
    before = simulation.measure()
    energies = [before.energy]
    for _ in range(8):
        simulation.step()
        energies.append(simulation.measure().energy)
    now = simulation.measure()
    # Forces of two ends cancel to rounding, in 320 substeps of some ten forces each.
    most = np.abs(simulation.system.mass[:, None] * simulation.system.velocity).sum()
    np.testing.assert_allclose(now.momentum, before.momentum, rtol=0, atol=320 * 10 * EPS64 * most)
    assert (np.diff(energies) < 0).all()
    assert now.largest_strain < 0.3, "of what is whole: beyond its break strain by what a substep adds"
    np.testing.assert_array_equal(np.isinf(simulation.snapshot().broken_at), ~simulation.snapshot().broken)


@pytest.mark.slow
def test_automatic_substeps_bear_it():
    simulation = Simulation(bursting(), device="cpu", gravity=0.0)
    twin = Simulation(bursting(), device="cpu", gravity=0.0, force_algorithm="gather")
    for one in (simulation, twin):
        one.step(12)
    assert simulation.substep_history == twin.substep_history
    assert simulation.snapshot().broken.mean() > 0.3


def test_a_frame_can_be_taken_back(device):
    simulation = burst(device)
    simulation.step(2)
    before = simulation.snapshot().broken_at
    simulation.step()
    assert np.isfinite(simulation.snapshot().broken_at).sum() > np.isfinite(before).sum()
    simulation.stepping.go_back()
    np.testing.assert_array_equal(simulation.snapshot().broken_at, before)


def test_what_is_broken_stays_so_through_changes():
    simulation = burst("cpu")
    simulation.step(3)
    before = simulation.snapshot()
    simulation.change(stiffness=lambda k: 0.5 * k)
    np.testing.assert_array_equal(simulation.snapshot().broken_at, before.broken_at)
    assert simulation.model.stiffness.numpy()[before.broken].max() == 0.0
    simulation.step()
    assert (simulation.snapshot().broken_at[before.broken] == before.broken_at[before.broken]).all()


@pytest.mark.slow
def test_a_chain_breaks_at_its_weak_link(device):
    # At rest the link k from the top bears what hangs on it; a sudden load bears up to twice that.
    row = chain(9, 0.1, mass=0.1, stiffness=500.0, damping=2.0).pin(0)
    strength = np.full(row.connection_count, 100.0)
    strength[5] = 2.0  # three particles hang on it, of 3 · 0.1 · 9.82 = 2.9 N
    simulation = Simulation(
        row.rotate(math.pi / 2, (0, 1, 0), about=(0, 0, 0)).replace(break_force=strength),
        probes={"link": Probe([5, 6], "tension")},
        device=device,
    )
    simulation.step(60)
    assert np.flatnonzero(simulation.snapshot().broken).tolist() == [5]
    bears = simulation.readings["link"].values[:, 0]  # nothing, and no number, once it is broken
    assert not np.isnan(bears[0])
    assert np.isnan(bears[-1])


def test_only_the_start_of_a_substep_breaks(device):
    # Too long from the start, which a system on its way may be: reading velocities and energies breaks nothing.
    body = pair(1.0, 1, mass=1.0, break_strain=0.25).replace(position=[[0.0], [1.5]])
    simulation = simulate(body, device, h=0.01, integrator=Leapfrog())
    simulation.frame()
    assert simulation.measure().elastic_energy == pytest.approx(0.5 * 50 * 0.25)
    assert not simulation.snapshot().broken[0]
    simulation.step()
    assert simulation.snapshot().broken_at[0] == 0.0
    assert simulation.measure().elastic_energy == 0.0
    assert simulation.measure().largest_strain == 0.0


@pytest.mark.slow
def test_what_yields_tears_too(plain_device):
    # Springs give way up to a third; from the length that they have then, a tenth more breaks them.
    body = bursting(yield_strain=0.02, relaxation_time=0.005, largest_plastic_strain=0.3, break_strain=0.1)
    times = []
    for force_algorithm in ("scatter", "gather"):
        simulation = burst(plain_device, body, force_algorithm=force_algorithm)
        simulation.step(6)
        times.append(simulation.snapshot().broken_at)
        assert simulation.rest_length.max() > 1.05 * body.rest_length.max()
    assert 0.2 < np.isfinite(times[0]).mean() < 1.0
    np.testing.assert_array_equal(times[0], times[1])
