"""The watch over a run: every way to diverge is found, named and survived, and nothing else is taken for one."""

import math
import re

import modes
import numpy as np
import problems
import pytest

from msdwarp import (
    RK4,
    Leapfrog,
    Plane,
    Simulation,
    SimulationDiverged,
    SymplecticEuler,
    System,
    UnstableStep,
    box,
    stability_limit,
)
from msdwarp.engine import Found

OPTIONS = {"device": "cpu", "precision": "float64"}
every_integrator = pytest.mark.parametrize(
    "integrator",
    [SymplecticEuler(), Leapfrog(), Leapfrog(damper_extrapolation=0.5), RK4()],
    ids=["euler", "leapfrog", "leapfrog extrapolated", "rk4"],
)


def spinner(**changes) -> System:
    return box((3, 3, 3), stiffness=5000.0).spin((0.3, 1.0, 0.2)).replace(**changes)


def near_limit(system: System, integrator, share: float, **options) -> Simulation:
    """Return a simulation at `share` of the exact linear limit, ten substeps a frame."""
    mode = modes.Mode(system)
    h = share * modes.limit(integrator, mode.p, mode.q)
    return Simulation(
        system,
        integrator=integrator,
        fps=1 / (10 * h),
        substeps=10,
        allow_unstable=True,
        **({"gravity": 0.0} | OPTIONS | options),
    )


def run_to_divergence(simulation: Simulation):
    """Return the exception, and the frame before the one in which it was raised."""
    for _ in range(2000):
        before = simulation.frame()
        try:
            simulation.step()
        except SimulationDiverged as error:
            return error, before
    pytest.fail("it did not diverge")


# What is found


@pytest.mark.parametrize("part", ["x", "v"])
@pytest.mark.parametrize("value", [math.nan, math.inf])
@pytest.mark.each_value
def test_number_that_is_not_finite_is_found(device, part, value):
    simulation = Simulation(spinner(), gravity=0.0, device=device, precision="float64")
    simulation.step(3)
    array = getattr(simulation.state, part)
    numbers = array.numpy().copy()
    numbers[13, 1] = value
    array.assign(numbers)
    with pytest.raises(SimulationDiverged) as caught:
        simulation.step()
    error = caught.value
    # Seen after the first substep. A velocity has by then moved its particle, a position its neighbours,
    # which in a 3³ block with diagonals are all, and the first of all is 0.
    assert error.substep == 1
    assert error.time == pytest.approx(3 / 60 + simulation.dt, rel=1e-14)
    assert error.particle == (13 if part == "v" else 0)
    np.testing.assert_array_equal(getattr(simulation.state, part).numpy(), numbers)  # back, with what was put in


@every_integrator
def test_growth_is_found_where_it_happens(integrator):
    # The most that kinetic and gravitational energy together may be, from the documented scale.
    system = spinner()
    simulation = near_limit(system, integrator, 1.05)
    start = simulation.measure()
    most = start.energy + 10 * (start.kinetic_energy + start.elastic_energy)
    error, before = run_to_divergence(simulation)
    # The same by hand, from the start, substep by substep.
    run = modes.Run(system, integrator, simulation.dt)
    kinetic, good_substeps = [], 10 * round(before.time * simulation.fps)
    for _ in range(good_substeps + error.substep):
        previous = run.state.x.numpy().copy()
        run.step()
        kinetic.append(0.5 * (run.state.v.numpy() ** 2).sum())
    # Frames are looked at as they end, the last one substep by substep.
    assert max(kinetic[9:good_substeps:10]) <= most
    assert max(kinetic[good_substeps:-1], default=0.0) <= most < kinetic[-1]
    assert error.time == pytest.approx(len(kinetic) * simulation.dt, rel=1e-12)
    speed = (run.state.v.numpy() ** 2).sum(axis=1)
    assert speed[error.particle] == pytest.approx(speed.max(), rel=1e-9)  # ties of a symmetric body
    then = system.replace(position=previous)
    own = np.flatnonzero((system.connections == error.particle).any(axis=1))
    assert error.connection in own
    assert error.strain == pytest.approx(then.strain[error.connection], rel=1e-9)
    assert abs(error.strain) == pytest.approx(np.abs(then.strain[own]).max(), rel=1e-9)


@every_integrator
def test_last_good_frame_is_kept_bit_for_bit_and_can_be_gone_on_from(integrator):
    simulation = near_limit(spinner(damping=2.0), integrator, 1.05)
    error, before = run_to_divergence(simulation)
    now = simulation.frame()
    assert now.time == before.time < error.time <= before.time + 10 * simulation.dt * (1 + 1e-12)
    np.testing.assert_array_equal(now.position, before.position)
    np.testing.assert_array_equal(now.velocity, before.velocity)
    with pytest.raises(SimulationDiverged) as again:  # nothing else was left behind either
        simulation.step()
    assert str(again.value) == str(error)
    # The number of substeps that is told is enough, and so are softer springs.
    limit = stability_limit(simulation.snapshot(), integrator)
    assert error.substeps_needed == max(math.ceil(1 / (simulation.fps * limit)), simulation.choice.least)
    assert f"at least {error.substeps_needed} substeps" in str(error)
    options = {"gravity": 0.0, "fps": simulation.fps, "integrator": integrator} | OPTIONS
    Simulation(simulation.snapshot(), substeps=error.substeps_needed, **options).step(50)
    simulation.change(stiffness=500.0, damping=0.2)
    energy = simulation.measure().energy
    simulation.step(200)
    assert simulation.measure().energy < energy  # damped


def test_growth_watch_can_be_turned_off():
    simulation = near_limit(spinner(), SymplecticEuler(), 1.05, energy_limit=math.inf)
    start = simulation.measure().energy
    error, before = run_to_divergence(simulation)
    assert np.abs(before.velocity).max() > 1e100 * start  # only numbers that are not finite stop it
    assert math.isfinite(error.time)


# What is not taken for divergence


@every_integrator
def test_stable_runs_raise_no_alarm(integrator):
    simulation = near_limit(spinner(damping=1.0), integrator, 0.98)
    simulation.step(300)
    assert simulation.frame_index == 300


@pytest.mark.filterwarnings("ignore:.*turned inside out:msdwarp.InvertedWarning")  # at 44 m/s it is
@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_long_fall_raises_no_alarm(device, precision):
    # A hundred times its own size: its kinetic energy is the height's, no growth.
    body = box((2, 2, 2), stiffness=1000.0, damping=5.0).translate((0, 0, 100.5))
    simulation = Simulation(body, colliders=[Plane()], device=device, precision=precision)
    fastest = 0.0
    for _ in range(6):
        simulation.step(60)
        fastest = max(fastest, -float(simulation.frame().velocity[:, 2].min()))
    assert fastest > 30.0


@pytest.mark.parametrize("precision", ["float32", "float32-compensated", "float64"])
def test_body_at_rest_raises_no_alarm(precision):
    # Turned, it has the energy of roundings alone, and rounds ever anew.
    body = box((3, 3, 3), stiffness=5000.0).rotate(0.4, axis=(1, 2, 3)).translate((40, 0, 0))
    simulation = Simulation(body, gravity=0.0, device="cpu", precision=precision)
    simulation.step(600)
    assert simulation.frame_index == 600


# Substeps that are refused, chosen and chosen anew


@every_integrator
def test_forced_substeps_are_refused_with_a_number_that_is_accepted(integrator):
    stiff = spinner(stiffness=1e6, damping=20.0)
    with pytest.raises(UnstableStep, match="substeps is 1; at least") as caught:
        Simulation(stiff, integrator=integrator, substeps=1, **OPTIONS)
    least, safe = map(int, re.search(r"at least (\d+) a frame .* (\d+) with a margin", str(caught.value)).groups())
    for substeps in (least, safe):
        Simulation(stiff, integrator=integrator, substeps=substeps, **OPTIONS).step(5)
    with pytest.raises(UnstableStep):
        Simulation(stiff, integrator=integrator, substeps=least - 1, **OPTIONS)
    limit = stability_limit(stiff, integrator)
    assert least == math.ceil(1 / (60 * limit))
    assert abs(safe - Simulation(stiff, integrator=integrator, **OPTIONS).substeps) <= 1  # it rounds up twice
    assert Simulation(stiff, integrator=integrator, substeps=1, allow_unstable=True, **OPTIONS).substeps == 1


def test_stiffer_springs_get_more_substeps():
    simulation = Simulation(spinner(), **OPTIONS)
    before = simulation.choice
    simulation.step(5)
    simulation.change(stiffness=5e5)
    assert simulation.choice.rates.stiffness > 90 * before.rates.stiffness
    # Ten times as many, but for rounding up; the body spins and so is stretched by a little.
    assert simulation.choice.limit == pytest.approx(before.limit / 10, rel=0.01)
    simulation.step(60)
    simulation.change(stiffness=5000.0)
    assert simulation.substeps == before.substeps


def test_change_that_forced_substeps_cannot_follow_changes_nothing():
    simulation, twin = (Simulation(spinner(), substeps=8, integrator=Leapfrog(), **OPTIONS) for _ in range(2))
    for each in (simulation, twin):
        each.step(5)
    kept = (simulation.system, simulation.choice, simulation.model)
    with pytest.raises(UnstableStep, match="substeps is 8"):
        simulation.change(stiffness=5e5)
    assert all(a is b for a, b in zip(kept, (simulation.system, simulation.choice, simulation.model), strict=True))
    for each in (simulation, twin):
        each.step(5)
    np.testing.assert_array_equal(simulation.frame().position, twin.frame().position)
    assert simulation.time == twin.time


@pytest.mark.slow
@pytest.mark.parametrize("integrator", [Leapfrog(damper_extrapolation=0.5), RK4()], ids=str)
def test_refresh_follows_the_stretching(integrator):
    # Flung apart it reaches about three times its size and comes back.
    calm = box((3, 3, 3), stiffness=1000.0, damping=5.0)
    flung = calm.with_velocity(150.0 * calm.position)
    options = {"gravity": 0.0, "integrator": integrator, "fps": 120, "safety": 0.1} | OPTIONS
    simulation, fixed = Simulation(flung, refresh=True, **options), Simulation(flung, **options)
    at_rest, counts, sizes = simulation.substeps, [], []
    assert at_rest == fixed.substeps
    for _ in range(400):
        limit = stability_limit(simulation.snapshot(), integrator)
        before, required = simulation.substeps, math.ceil(1 / (120 * limit * 0.1))  # computed in the same way
        simulation.step()
        # A number that is at most a tenth too large is kept: each change records the frame again.
        assert simulation.substeps == (before if 0.9 * before <= required < before else required)
        counts.append(simulation.substeps)
        sizes.append(np.ptp(simulation.frame().position[:, 0]) / 2.0)
    assert max(sizes) > 2.5
    assert max(counts) > 1.2 * at_rest
    assert 0.9 * counts[-1] <= at_rest <= counts[-1]
    energies = simulation.measure().energy, problems.energy(flung)
    assert energies[0] < 0.2 * energies[1]


@pytest.mark.gpu
@pytest.mark.parametrize("count", [1, 255, 257, 5000, 200_001])
def test_what_a_gpu_looks_over_in_blocks_is_what_numpy_adds_up(count):
    rng = np.random.default_rng(count)
    mass = rng.uniform(1, 2, count)
    position, velocity = rng.normal(size=(2, count, 3))
    system = System(position=position, mass=mass, velocity=velocity)
    simulation = Simulation(system, device="cuda:0", gravity=9.82, substeps=1)
    watch, state, found = simulation.stepping.watch, simulation.stepping.state, Found(simulation.model)
    for _ in range(2):  # what the first leaves behind is what the second begins with
        watch.look(found)
        found.mark()
        assert not watch.finds_trouble(found)
        kinetic = 0.5 * mass @ (state.v.numpy().astype(np.float64) ** 2).sum(axis=1)
        potential = 9.82 * mass @ state.x.numpy()[:, 2].astype(np.float64)
        # Each mass is the inverse of one that was rounded to float32; sums are in float64.
        assert watch.energy == pytest.approx(kinetic + potential, rel=1e-7, abs=1e-6 * kinetic)
    x = state.x.numpy()
    x[count // 2 :, 1] = np.nan
    state.x.assign(x)
    watch.look(found)
    found.mark()
    assert watch.finds_trouble(found)
    assert watch.worst_particle() == count // 2
