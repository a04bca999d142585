"""Velocities that change on the run."""

import numpy as np
import pytest
from problems import EPS64

from msdwarp import (
    RK4,
    RKC2,
    Force,
    Leapfrog,
    LinearlyImplicitEuler,
    Plane,
    PrescribedMotion,
    Simulation,
    SymplecticEuler,
    Wind,
    at,
    box,
)

METHODS = [
    SymplecticEuler(),
    Leapfrog(),
    Leapfrog(damper_extrapolation=0.5),
    RK4(),
    RKC2(),
    LinearlyImplicitEuler(iterations=4),
]
EACH = [(one, "float64") for one in METHODS[1:]] + [(SymplecticEuler(), "float32-compensated")]
"""Every method, and a single precision: what a throw changes does not depend on both."""
TOP = np.arange(18, 27)


def block():
    body = box((3, 3, 3), 0.1, stiffness=2000.0, damping=5.0).named("block")
    return body.replace(groups={**body.groups, "top": TOP})


def simulated(device, system=None, **more):
    options = {"colliders": [Plane(offset=-0.15)], "precision": "float64", "substeps": 20, "device": device}
    return Simulation(block() if system is None else system, **options | more)


@pytest.mark.slow
@pytest.mark.parametrize(("method", "precision"), EACH, ids=str)
def test_what_is_thrown_goes_on_as_from_a_start_with_that_velocity(device, method, precision):
    how = {"integrator": method, "precision": precision}
    thrown = simulated(device, **how)
    thrown.step(6)
    start = thrown.snapshot()
    velocity = np.array(start.velocity)
    velocity[TOP] = (0.5, 0.1, 2.0)
    stepping, graph = thrown.stepping, thrown.stepping.graph
    thrown.change(velocity=(0.5, 0.1, 2.0), group="top")
    assert (thrown.stepping is stepping, thrown.stepping.graph is graph) == (True, True)  # nothing is built anew
    eps = EPS64 if precision == "float64" else 2.0**-23
    anew = simulated(device, start.replace(velocity=velocity), **how)
    for one in (thrown, anew):
        np.testing.assert_allclose(one.frame().velocity, velocity, rtol=0, atol=4 * 8 * eps)  # roundings of 4 m/s
    for one in (thrown, anew):
        one.step(4)
    # 80 substeps of roundings of velocities near 2 m/s, as much again from sums in another order on a GPU;
    # h√λ < 1, so they grow no faster than their number.
    atol = 80 * 20 * eps
    np.testing.assert_allclose(thrown.frame().velocity, anew.frame().velocity, rtol=0, atol=100 * atol)
    np.testing.assert_allclose(thrown.frame().position, anew.frame().position, rtol=0, atol=atol)
    assert np.ptp(thrown.frame().velocity[:, 2]) > 0.1


def test_a_schedule_throws_too_and_beside_other_changes(device):
    by_hand, planned = simulated(device), simulated(device, schedule=[at(0.1, velocity=(0, 0, 3.0), group="top")])
    by_hand.step(6)
    by_hand.change(velocity=(0, 0, 3.0), group="top")
    by_hand.step(6)
    planned.step(12)
    atol = 0 if device == "cpu" else 1e-9  # scattered sums on a GPU are made in another order
    np.testing.assert_allclose(planned.frame().position, by_hand.frame().position, rtol=0, atol=atol)
    both = simulated(device)
    both.step(6)
    both.change(velocity=(0, 0, 3.0), mass=2.0, group="top")
    np.testing.assert_allclose(both.frame().velocity[TOP], np.tile([0, 0, 3.0], (9, 1)), rtol=0, atol=1e-12)


def test_velocities_before_a_step_are_the_given_ones(device):
    # Leapfrog kicks them back by half a substep; dampers would change them by 6e-4 m/s on the way there and back.
    body = block().with_velocity(np.random.default_rng(0).normal(size=(27, 3)))
    simulation = simulated(device, body, integrator=Leapfrog())

    def check(velocity: np.ndarray) -> None:
        # Atomics of a GPU may add forces in another order: a rounding of 1 m/s.
        np.testing.assert_allclose(simulation.frame().velocity, velocity, rtol=0, atol=EPS64)
        kinetic = 0.5 * (simulation.system.mass[:, None] * velocity**2).sum()
        assert simulation.measure().kinetic_energy == pytest.approx(kinetic, rel=1e-14)

    check(body.velocity)
    simulation.change(gravity=3.0)
    check(body.velocity)
    simulation.step(2)
    now = simulation.frame().velocity
    simulation.change(stiffness=1500.0)  # makes everything anew
    check(now)
    simulation.change(velocity=2 * now)
    check(2 * now)
    simulation.change(velocity=lambda v: v / 2)
    check(now)
    simulation.change(velocity=2 * now)
    with pytest.raises(ZeroDivisionError):
        simulation.change(velocity=lambda v: v * (1 / 0))
    check(2 * now)
    other = simulated(device, body, integrator=Leapfrog())
    other.step(3)
    other.restore(*simulation.checkpoint())
    assert np.abs(other.frame().velocity - simulation.frame().velocity).max() <= EPS64


@pytest.mark.slow
@pytest.mark.parametrize("speed", [300.0, 0.0])
def test_the_energy_that_it_gets_is_no_divergence(device, speed):
    loads = [Force(lambda t: (0.0, 1.0, 0.0))]
    # At rest on the ground there is next to no energy: 300 m/s are some 10⁵ times as much.
    simulation = simulated(device, substeps="auto", loads=loads)
    simulation.step(120)
    before, taken = simulation.measure(), len(simulation.substep_history)
    simulation.change(velocity=(0.0, 0.0, speed))
    after = simulation.measure()
    kinetic = 0.5 * simulation.system.mass.sum() * speed**2
    assert after.kinetic_energy == pytest.approx(kinetic, rel=1e-12, abs=1e-20)
    # The last force's work on the old velocities has been counted, and velocities that jump are none of its doing.
    assert after.external_work == pytest.approx(before.external_work, rel=1e-9, abs=1e-12)
    simulation.step(120)
    counts = [count for _, count in simulation.substep_history[taken - 1 :]]
    assert max(counts) == counts[0], "no substep was found too long"
    start = simulation.checkpoint()
    other = simulated(device, substeps="auto", loads=loads)
    other.restore(*start)
    for one in (simulation, other):
        one.step(30)
    np.testing.assert_allclose(
        other.frame().position, simulation.frame().position, rtol=0, atol=0 if device == "cpu" else 1e-9
    )


@pytest.mark.parametrize(
    "way", [(0.0, 0.0, -6.0), (0.0, 0.0, 6.0), (6.0, 0.0, 0.0)], ids=["down", "up", "sideways"]
)
@pytest.mark.parametrize("method", [SymplecticEuler(), Leapfrog()], ids=["euler", "leapfrog"])
def test_what_falls_is_thrown_on_any_way(method, way):
    # In float32: rounding of m g z, with z of 3 m, is 1e-6 J; a half kick of 0.004 m/s at 6 m/s would be 0.01 J.
    body = box((3, 3, 3), 0.1, mass=0.02, stiffness=2000.0, damping=1.0).translate((0, 0, 3))
    simulation = Simulation(body, colliders=[Plane()], integrator=method, device="cpu")
    simulation.step(12)
    simulation.change(velocity=way)
    numbers = simulation.checkpoint()[1]
    assert numbers["pace.least"] == pytest.approx(simulation.stepping.balance().energy, abs=1e-5)
    assert numbers["pace.scale"] > 0.04 * 0.27 * 6.0**2  # what moves now counts from now on
    simulation.step(60)


@pytest.mark.parametrize("direction", [-1.0, 1.0])
def test_another_load_on_what_falls_brings_in_no_energy(direction):
    body = box((3, 3, 3), 0.1, mass=0.02, stiffness=2000.0, damping=1.0).translate((0, 0, 9))
    weak, strong = Force((0.0, 0.0, 0.0)), Force((0.0, 0.0, direction * 50.0))
    simulation = Simulation(body, loads=[weak], device="cpu", precision="float64")
    simulation.step(30)
    simulation.change(loads=[strong])
    least = simulation.checkpoint()[1]["pace.least"]
    assert least == pytest.approx(simulation.stepping.balance().energy, abs=1e-9)  # rounding
    simulation.step(30)


@pytest.mark.slow
def test_what_is_held_keeps_its_velocity(device):
    system = block().pin([0])
    drive = PrescribedMotion([26], lambda t: (0.5 * t, 0.0, 0.0))
    simulation = simulated(device, system, loads=[drive])
    simulation.step(3)
    simulation.change(velocity=(0.0, 2.0, 0.0))
    velocity = simulation.frame().velocity
    np.testing.assert_array_equal(velocity[0], 0.0)
    np.testing.assert_allclose(velocity[26], [0.5, 0.0, 0.0], rtol=0, atol=1e-9)  # of differences of places
    np.testing.assert_array_equal(velocity[1:26], np.tile([0.0, 2.0, 0.0], (25, 1)))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"velocity": (1.0, 2.0)},
            r"velocity has shape \(2,\); it must be one number or have shape \(3,\) or \(27, 3\)",
        ),
        ({"velocity": (np.nan, 0, 0)}, "velocity.*finite"),
        ({"velocity": 1.0, "group": "tip"}, "tip"),
        ({"velocity": 1.0, "group": [0]}, "velocity is given to group .*0.*, whose particles are all pinned"),
        ({"velocity": 1.0, "group": [26]}, "velocity is given to group .*26.*, whose particles are all pinned"),
        ({"velocity": 1e300}, "velocity.*at most 1e[+]18"),
        ({"velocity": 1.0, "loads": []}, "loads takes the place of all loads; nothing but loads and contact"),
        ({"velocity": (0.0, 1e9, 0.0)}, "substeps is 20; at least"),
    ],
    ids=["shape", "nan", "group", "pinned", "driven", "range", "loads", "step"],
)
def test_what_cannot_be_thrown_is_refused_by_name_and_stays_as_it_is(changes, message):
    drive, wind = PrescribedMotion([26], lambda t: (0.5 * t, 0.0, 0.0)), Wind((0.0, 0.0, 0.0), area=0.01, on=[5])
    simulation = simulated("cpu", block().pin([0]), loads=[drive, wind], precision="float32")
    simulation.step(2)
    before = simulation.frame()
    with pytest.raises(ValueError, match=message):
        simulation.change(**changes)
    for one, other in zip(simulation.frame(), before, strict=True):
        np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("method", [Leapfrog(), RK4()], ids=str)
def test_a_run_is_compared_with_what_a_throw_gives(plain_device, method):
    simulation = simulated(plain_device, block().replace(damping=0.0).pin([0]), integrator=method)
    simulation.step(2)
    before, chosen = simulation.measure().kinetic_energy, np.arange(27) % 2 == 1
    baseline = simulation.stepping.watch.baseline.energy
    simulation.stepping.set_velocity(simulation.frame().velocity.astype(float) + 1.5, chosen)
    added = simulation.stepping.watch.baseline.energy - baseline
    # Rounding of 13 kinetic energies of 1 J each.
    assert added == pytest.approx(simulation.measure().kinetic_energy - before, rel=1e-12)
    assert added > 10.0
