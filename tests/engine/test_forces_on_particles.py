"""Forces on particles: given, of time, and of place, by every algorithm and method."""

import math
from typing import Any

import numpy as np
import pytest
import warp as wp
from problems import EPS64

from msdwarp import (
    RK4,
    RKC2,
    Force,
    Leapfrog,
    LinearlyImplicitEuler,
    Plane,
    Simulation,
    SymplecticEuler,
    System,
    box,
)

OMEGA, STEP = 3.0, 0.01


def free(dim: int = 3, count: int = 3) -> System:
    """Return particles of 1 and 2 kg that nothing joins, at rest."""
    position = np.arange(1.0, 1.0 + count * dim).reshape(count, dim)
    return System(position=position, mass=[1.0, 2.0, 1.0][:count]).named("all")


def options(device, **more):
    return {"gravity": 0.0, "precision": "float64", "fps": 10.0, "substeps": 10, "device": device, **more}


@pytest.mark.parametrize("blocks", ["auto", None], ids=["one launch", "launches"])
@pytest.mark.parametrize("dim", [1, 2, 3])
@pytest.mark.each_value
def test_a_constant_force_accelerates(plain_device, dim, blocks):
    # Leapfrog is exact for a constant acceleration: x = F t² / 2m.
    force = np.arange(1.0, 1.0 + dim)
    simulation = Simulation(
        free(dim), loads=[Force(force, on=[0, 1])], integrator=Leapfrog(), blocks=blocks, **options(plain_device)
    )
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


METHODS = [(SymplecticEuler(), 1), (Leapfrog(), 2), (RK4(), 4), (RKC2(), 2), (LinearlyImplicitEuler(2), 1)]


@pytest.mark.slow
@pytest.mark.parametrize(("method", "order"), METHODS, ids=lambda one: str(one).split("(")[0])
def test_a_force_of_time_is_taken_where_the_method_wants_it(method, order, plain_device):
    # m x'' = cos ωt, from rest: x = (1 − cos ωt) / mω², v = sin(ωt) / mω. Halved steps show the order.
    errors = []
    for substeps in (2, 4):
        load = Force(lambda t: (np.cos(OMEGA * t), 0.0, 0.0))
        start, light = free(), {"stiffness": 1e-14, "damping": 1e-14}  # so that RKC2 has a step
        system = System(position=start.position, mass=start.mass, connections=[(0, 1)], **light)
        how = options(plain_device, substeps=substeps, allow_unstable=True)
        simulation = Simulation(system, loads=[load], integrator=method, **how)
        simulation.step(10)
        moved, v = (simulation.frame().position - system.position)[0, 0], simulation.frame().velocity[0, 0]
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
@pytest.mark.parametrize("precision", ["float32-compensated", "float64"])
def test_a_force_of_place_is_compiled_in(device, precision):
    # x'' = −4 x / m: swings with ω = 2 rad/s for 1 kg. RK4 errs by (hω)⁴ ωt / 120.
    start = free()
    how = options(device, precision=precision)
    simulation = Simulation(start, loads=[Force(towards_origin)], integrator=RK4(), **how)
    simulation.step(10)
    expected = start.position * np.cos(2 * np.sqrt(1 / start.mass))[:, None]
    rounding = 1e-6 if precision != "float64" else 1e-13  # of 10 m, some hundred times
    np.testing.assert_allclose(
        simulation.frame().position, expected, rtol=0, atol=9 * 0.02**4 * 2 / 120 + 10 * rounding
    )


def test_it_knows_time_and_number(plain_device):
    # v = i t² / 2 / m, of which leapfrog has (t_n − h/2) at each kick: exact for a force linear in time.
    simulation = Simulation(
        free(), loads=[Force(pull_32)], integrator=Leapfrog(), **options(plain_device, precision="float32")
    )
    simulation.step(10)
    expected = np.zeros((3, 3))
    expected[:, 2] = [0.0, 0.25, 1.0]
    np.testing.assert_allclose(simulation.frame().velocity, expected, rtol=0, atol=2e-5)  # 100 sums in float32


@pytest.mark.slow
@pytest.mark.parametrize("blocks", ["auto", None], ids=["one launch", "launches"])
@pytest.mark.parametrize("method", [SymplecticEuler(), RK4()], ids=["euler", "rk4"])
@pytest.mark.each_value
def test_all_routes_carry_it(plain_device, method, blocks):
    body = box((4, 4, 4), 0.1, mass=0.01, stiffness=40.0, damping=0.02).named("jelly")
    loads = [Force(lambda t: (np.sin(9 * t), 0, 0.3), on="jelly", total=True), Force((0.01, 0, 0), on=[3, 5])]
    frames = []
    for force_algorithm in ("scatter", "gather", "stencil"):
        how = options(plain_device, fps=60.0, substeps=20)
        simulation = Simulation(
            body, loads=loads, force_algorithm=force_algorithm, integrator=method, blocks=blocks, **how
        )
        simulation.step(20)
        frames.append(simulation.frame().position)
    for other in frames[1:]:
        np.testing.assert_allclose(frames[0], other, rtol=0, atol=1e-11)  # other orders of sums, 400 substeps
    # All inner forces cancel: the centre of mass moves as one particle.
    t = np.linspace(0, 20 / 60, 4001)
    force = np.stack([np.sin(9 * t) + 0.02, 0 * t, 0.3 + 0 * t], axis=1)
    v = np.concatenate([[np.zeros(3)], np.cumsum((force[1:] + force[:-1]) / 2, axis=0) * (t[1] - t[0])]) / 0.64
    x = ((v[1:] + v[:-1]) / 2).sum(axis=0) * (t[1] - t[0])
    moved = frames[0].mean(axis=0) - body.position.mean(axis=0)
    # Symplectic Euler is first order: h/2 times the final speed.
    np.testing.assert_allclose(
        moved, x, rtol=0, atol=np.abs(v[-1]).max() / 2400 * 0.6 if method != RK4() else 1e-7
    )


def test_a_scene_without_loads_has_nothing_of_them(plain_device):
    plain = Simulation(free(), device=plain_device).stepping.dynamics
    assert plain.composition.pieces == ()
    assert not {"effect_mask", "stage", "time", "work"} & set(plain.scene._cls.vars)


@pytest.mark.slow
def test_a_run_resumes_to_the_last_bit(device):
    def make():
        loads = [Force(lambda t: (math.sin(7 * t), 0, 0.1), on=[0, 1])]
        body = box((3, 3, 3), 0.1, mass=0.01, stiffness=40.0, damping=0.02).translate((0, 0, 0.2))
        return Simulation(
            body, loads=loads, colliders=[Plane()], integrator=Leapfrog(), device=device, force_algorithm="gather"
        )

    whole, first, rest = make(), make(), make()
    whole.step(12)
    first.step(5)
    rest.restore(*first.checkpoint())
    rest.step(7)
    np.testing.assert_array_equal(whole.frame().position, rest.frame().position)
    np.testing.assert_array_equal(whole.frame().velocity, rest.frame().velocity)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: [Force((0.0, float("nan"), 0.0))], "force is .*; it must be 1 to 3 finite numbers"),
        (lambda: [Force((0.0, 1.0))], r"loads\[0\]\.force has 2 numbers; it must have 3 numbers"),
        (lambda: [Force((0.0, 0.0, 1.0), on="tail")], r"loads\[0\]\.on is 'tail'"),
        (lambda: [Force((0.0, 0.0, 1.0), on=[])], r"loads\[0\]\.on is \[\]; it must name one particle"),
        (lambda: [Force(lambda t: (0.0, 1 / 0, 0.0))], r"loads\[0\]\.force has no value .* division by zero"),
        (lambda: [Force(lambda t: next(iter(())))], r"loads\[0\]\.force has no value .* s: StopIteration$"),
        (lambda: [Force(lambda t: (0.0, np.inf, 0.0))], r"loads\[0\]\.force is .*inf.* at 0 s; it must be finite"),
        (lambda: [Force((0, 0, 1), total="yes")], "total is 'yes'"),
        (lambda: [Force(towards_origin, total=True)], "acts on each particle by itself"),
        (lambda: [(0, 0, 1)], r"loads\[0\] is \(0, 0, 1\); it must be a Load"),
        (lambda: (0, 0, 1), r"loads\[0\] is 0; it must be a Load"),
    ],
)
def test_bad_forces_are_named(make, message):
    with pytest.raises(ValueError, match=message):
        Simulation(free(), loads=make(), device="cpu")


@pytest.mark.slow
@pytest.mark.parametrize("blocks", ["auto", None], ids=["one launch", "launches"])
@pytest.mark.parametrize("method", [SymplecticEuler(), RK4()], ids=["euler", "rk4"])
def test_work_is_what_energy_comes_from(plain_device, method, blocks):
    # Undamped and alone in the world, a body has the energy it had, and the work of the loads.
    body = box((4, 4, 4), 0.1, mass=0.01, stiffness=40.0)
    loads = [Force(lambda t: (0.3 * np.sin(9 * t), 0, 0.2), on=[0, 5, 9]), Force((0, 0.1, 0), on=[5])]
    found = []
    for substeps in (20, 40):
        how = options(plain_device, gravity=1.0, fps=60.0, substeps=substeps)
        simulation = Simulation(body, loads=loads, integrator=method, blocks=blocks, **how)
        before = simulation.measure()
        assert abs(before.external_work) < 1e-15
        simulation.step(30)
        after = simulation.measure()
        found.append(abs(after.energy - before.energy - after.external_work) / after.external_work)
    # Simpson's rule has work at order 4. Symplectic Euler conserves an energy that differs from this by up to hω/2
    # of what its fastest modes have, hω being 0.1 at most, which are excited by a percent or so.
    assert found[0] < (1e-6 if method == RK4() else 1e-3)
    assert found[1] < found[0] / (8 if method == RK4() else 1.4)


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


def test_a_strong_force_is_no_divergence(plain_device):
    # It makes a thousand times the energy that gravity could; fixed substeps are watched all the same.
    body = box((3, 3, 3), 0.1, mass=0.01, stiffness=40.0, damping=0.02)
    simulation = Simulation(body, loads=[Force((0, 0, 5.0))], device=plain_device, substeps=40)
    assert np.isfinite(simulation.stepping.watch.most)
    simulation.step(30)
    measures = simulation.measure()
    assert measures.kinetic_energy > 100 * simulation.stepping.watch.baseline.scale
