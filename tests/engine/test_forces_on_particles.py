"""Forces on particles: given, of time, and of place, by every algorithm and method."""

import math
from typing import Any

import numpy as np
import pytest
import warp as wp
from problems import EPS64

from msdwarp import (
    RK4,
    Force,
    Leapfrog,
    Simulation,
    System,
    box,
)

OMEGA = 3.0


def free(dim: int = 3, count: int = 3) -> System:
    """Return particles of 1 and 2 kg that nothing joins, at rest."""
    position = np.arange(1.0, 1.0 + count * dim).reshape(count, dim)
    return System(position=position, mass=[1.0, 2.0, 1.0][:count]).named("all")


def options(device, **more):
    return {"gravity": 0.0, "precision": "float64", "fps": 10.0, "substeps": 10, "device": device, **more}


@pytest.mark.parametrize("dim", [1, 2, 3])
def test_a_constant_force_accelerates(plain_device, dim):
    # Leapfrog is exact for a constant acceleration: x = F t² / 2m.
    force = np.arange(1.0, 1.0 + dim)
    load = Force(force, on=[0, 1])
    simulation = Simulation(free(dim), loads=[load], integrator=Leapfrog(), **options(plain_device))
    simulation.step(10)
    moved = simulation.frame().position - free(dim).position
    expected = np.outer([0.5, 0.25, 0.0], force)
    np.testing.assert_allclose(moved, expected, rtol=0, atol=100 * 20 * EPS64)
    np.testing.assert_allclose(simulation.frame().velocity, 2 * expected, rtol=0, atol=100 * 20 * EPS64)


@pytest.mark.slow
def test_forces_add_up_and_can_be_shared(plain_device):
    loads = [
        Force((1.0, 0.0, 0.0), on=[0]),
        Force((0.0, 2.0, 0.0), on=[0, 1], total=True),
        Force(lambda t: (0.0, 0.0, 4.0), on=[0, 1, 2]),
    ]
    simulation = Simulation(free(), loads=loads, integrator=Leapfrog(), **options(plain_device))
    simulation.step(10)
    expected = np.array([[1.0, 1.0, 4.0], [0.0, 0.5, 2.0], [0.0, 0.0, 4.0]])  # F / m, after a second
    np.testing.assert_allclose(simulation.frame().velocity, expected, rtol=0, atol=100 * 8 * EPS64)


# What is given by stage comes from the same tables as muscles do, which test_actuators.py tries with each method.
METHODS = [(Leapfrog(), 2), (RK4(), 4)]


@pytest.mark.slow
@pytest.mark.parametrize(("method", "order"), METHODS, ids=lambda one: str(one).split("(")[0])
def test_a_force_of_time_is_taken_where_the_method_wants_it(method, order, plain_device):
    # m x'' = cos ωt, from rest: x = (1 − cos ωt) / mω², v = sin(ωt) / mω. Halved steps show the order.
    errors = []
    for substeps in (2, 4):
        load = Force(lambda t: (np.cos(OMEGA * t), 0.0, 0.0))
        simulation = Simulation(
            free(), loads=[load], integrator=method, **options(plain_device, substeps=substeps)
        )
        simulation.step(10)
        moved, v = (simulation.frame().position - free().position)[0, 0], simulation.frame().velocity[0, 0]
        expected = (1 - math.cos(OMEGA)) / OMEGA**2, math.sin(OMEGA) / OMEGA
        errors.append(max(abs(moved - expected[0]), abs(v - expected[1])))
    found = math.log2(errors[0] / errors[1])
    # The next order's term is a share of about ωh of the error, h ω = 0.15 at most.
    assert found > order - 0.2, errors


@wp.func
def towards_origin(x: Any, v: Any, t: Any, i: int):
    return -x * type(t)(4.0)


@wp.func
def pull_32(x: wp.vec3, v: wp.vec3, t: float, i: int):
    return wp.vec3(0.0, 0.0, float(i)) * t


@pytest.mark.slow
def test_a_force_of_place_is_compiled_in(plain_device):
    # x'' = −4 x / m: swings with ω = 2 rad/s for 1 kg. RK4 errs by (hω)⁴ ωt / 120; sums by 1e-12 of 10 m.
    start = free()
    simulation = Simulation(start, loads=[Force(towards_origin)], integrator=RK4(), **options(plain_device))
    simulation.step(10)
    expected = start.position * np.cos(2 * np.sqrt(1 / start.mass))[:, None]
    np.testing.assert_allclose(simulation.frame().position, expected, rtol=0, atol=9 * 0.02**4 * 2 / 120 + 1e-12)


def test_it_knows_time_and_number(plain_device):
    # v = i t² / 2 / m, of which leapfrog has (t_n − h/2) at each kick: exact for a force linear in time.
    simulation = Simulation(
        free(), loads=[Force(pull_32)], integrator=Leapfrog(), **options(plain_device, precision="float32")
    )
    simulation.step(10)
    expected = np.zeros((3, 3))
    expected[:, 2] = [0.0, 0.25, 1.0]
    np.testing.assert_allclose(simulation.frame().velocity, expected, rtol=0, atol=2e-5)  # 100 sums in float32


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: [Force((0.0, 1.0))], r"loads\[0\]\.force has 2 numbers; it must have 3 numbers"),
        (lambda: [Force((0.0, 0.0, 1.0), on="tail")], r"loads\[0\]\.on is 'tail'"),
        (lambda: [Force((0.0, 0.0, 1.0), on=[])], r"loads\[0\]\.on is \[\]; it must name one particle"),
        (lambda: [Force(lambda t: (0.0, 1 / 0, 0.0))], r"loads\[0\]\.force has no value .* division by zero"),
        (lambda: [Force(lambda t: next(iter(())))], r"loads\[0\]\.force has no value .* s: StopIteration$"),
        (lambda: [Force(lambda t: (0.0, np.inf, 0.0))], r"loads\[0\]\.force is .*inf.* at 0 s; it must be finite"),
        (lambda: [Force(towards_origin, total=True)], "acts on each particle by itself"),
        (lambda: [(0, 0, 1)], r"loads\[0\] is \(0, 0, 1\); it must be a Load"),
        (lambda: (0, 0, 1), r"loads\[0\] is 0; it must be a Load"),
    ],
)
def test_bad_forces_are_named(make, message):
    with pytest.raises(ValueError, match=message):
        Simulation(free(), loads=make(), device="cpu")


def test_work_goes_on_over_a_change_and_a_restart(plain_device):
    def make():
        body = box((3, 3, 3), 0.1, mass=0.01, stiffness=40.0, damping=0.02)
        how = {"device": plain_device, "integrator": Leapfrog(), "gravity": 0.0}
        return Simulation(body, loads=[Force((0, 0, 1.0), on=[3])], **how)

    simulation, other = make(), make()
    simulation.step(5)
    before = simulation.measure().external_work
    assert before > 0
    simulation.change(damping=0.01)
    assert simulation.measure().external_work == before
    simulation.step(5)
    other.restore(*simulation.checkpoint())
    assert other.measure().external_work == simulation.measure().external_work > before
    other.reset()
    assert abs(other.measure().external_work) < 1e-7  # f·x less what that was at the start, in float32
