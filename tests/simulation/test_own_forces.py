"""Forces that are functions of one's own: what bounds the step, and the velocity at which they are taken."""

import math
from typing import Any

import numpy as np
import pytest
import warp as wp
from problems import EPS64, two_quick

from msdwarp import (
    RK4,
    Ensemble,
    Force,
    Leapfrog,
    LinearlyImplicitEuler,
    Simulation,
    SymplecticEuler,
    System,
    UnstableStep,
)

FIELD, PUSH = 10.0, 3.0


@wp.func
def charged(x: Any, v: Any, t: Any, i: int):
    """A magnetic field along z; on particle 1 also an electric one along y."""
    push = type(t)(0.0)
    if i == 1:
        push = type(t)(3.0)
    zero = type(t)(0.0)
    return type(v)(zero, push, zero) + wp.cross(v, type(v)(zero, zero, type(t)(10.0)))


@wp.func
def resisted(x: Any, v: Any, t: Any, i: int):
    """Linear drag of 500 N s/m; on particle 1 quadratic drag."""
    drag = type(t)(500.0)
    if i == 1:
        drag = type(t)(2.0) * wp.length(v)
    return -drag * v


@wp.func
def stiff(x: Any, v: Any, t: Any, i: int):
    """A spring to the origin that is 40 000 N/m stiff; on particle 1 from 0.505 s on."""
    stiffness = type(t)(4e4)
    if i == 1 and t < type(t)(0.505):
        stiffness = type(t)(0.0)
    return -stiffness * x


@wp.func
def runaway(x: Any, v: Any, t: Any, i: int):
    """A push away from x = 1 m beyond it, which grows beyond all numbers."""
    force, beyond = type(x)(), wp.max(x[0] - type(t)(1.0), type(t)(0.0))
    force[0] = type(t)(1e3) * beyond * wp.exp(type(t)(60.0) * beyond)
    return force


@wp.func
def floor(x: Any, v: Any, t: Any, i: int):
    """The push of a floor at z = 0, a million newtons for each metre of depth."""
    force = type(x)()
    force[2] = -type(t)(1e6) * wp.min(x[2], type(t)(0.0))
    return force


@wp.func
def hollow(x: Any, v: Any, t: Any, i: int):
    """A force that grows as the cube of the distance, and is not defined below z = 0."""
    return -type(t)(1e6) * wp.dot(x, x) * x + type(x)(wp.min(wp.sqrt(x[2]), type(t)(0.0)))


def alone(force, position, velocity, **options) -> Simulation:
    """Return particles of 1 kg that nothing else acts on."""
    system = System(position=np.atleast_2d(position), velocity=np.atleast_2d(velocity), mass=1.0)
    how = {"gravity": 0.0, "precision": "float64", "device": "cpu", **options}
    return Simulation(system, loads=[Force(force)], **how)


LAGGING = two_quick([SymplecticEuler(), Leapfrog(), Leapfrog(0.5), LinearlyImplicitEuler(2)])


@pytest.mark.parametrize("method", LAGGING, ids=str)
def test_a_magnetic_force_keeps_the_speed_and_does_no_work(method):
    # 3000 turns of 25 substeps. A kick is a rotation to rounding, whose errors at worst add up.
    frames, substeps = round(3000 * 2 * math.pi / FIELD / 10), 400
    one = alone(charged, (0, 0, 0), (1, 0, 0), integrator=method, substeps=substeps, fps=0.1)
    one.step(frames)
    error = 4 * frames * substeps * EPS64
    assert np.linalg.norm(one.frame().velocity) == pytest.approx(1.0, rel=0, abs=error)
    assert one.measure().external_work == pytest.approx(0.0, abs=error)


def drift(time: float) -> np.ndarray:
    """Return where a charge at rest drifts in both fields: a cycloid."""
    w, u = FIELD, PUSH / FIELD
    return np.array([u * (time - math.sin(w * time) / w), u / w * (1 - math.cos(w * time)), 0.0])


def test_crossed_fields_let_a_charge_drift_to_second_order():
    errors = []
    for substeps in (4, 8):
        how = {"integrator": Leapfrog(), "substeps": substeps}
        one = alone(charged, np.zeros((2, 3)), np.zeros((2, 3)), **how)
        one.step(60)
        errors.append(np.linalg.norm(one.frame().position[1] - drift(1.0)))
    assert math.log2(errors[0] / errors[1]) == pytest.approx(2.0, abs=0.05)  # hω is 0.04: its square is 0.2 %


def test_leapfrog_takes_drag_to_second_order():
    # v' = −2 |v| v: v = v₀ / (1 + 2 v₀ t), and x = log(1 + 2 v₀ t) / 2.
    speed, errors = 10.0, []
    for substeps in (20, 40):
        how = {"integrator": Leapfrog(), "substeps": substeps, "allow_unstable": True}
        one = alone(resisted, np.zeros((2, 3)), [(0, 0, 0), (speed, 0, 0)], **how)
        np.testing.assert_allclose(one.frame().velocity[1], (speed, 0, 0), rtol=1e-12)  # before the first step
        one.step(60)
        found = one.frame().position[1, 0], one.frame().velocity[1, 0]
        right = math.log(1 + 2 * speed) / 2, speed / (1 + 2 * speed)
        errors.append([abs(a - b) for a, b in zip(found, right, strict=True)])
    coarse, fine = np.array(errors)
    np.testing.assert_allclose(np.log2(coarse / fine), 2.0, atol=0.05)  # the next terms are 1/120 of these


def test_by_default_a_stiff_drag_stops_a_particle_where_it_should():
    # It goes on by v m/c. Symplectic Euler's velocities are half a substep old: that is too short by v h/2.
    one = alone(resisted, [(0.1, 0, 0), (0, 0, 0)], [(1, 0, 0), (0, 0, 0)])
    begun = one.dt
    assert begun <= 0.5 / 500
    one.step(60)
    assert one.frame().position[0, 0] == pytest.approx(0.102, rel=0, abs=begun / 2)
    assert one.measure().external_work == pytest.approx(-0.5, rel=1e-12)  # the kinetic energy it had


@pytest.mark.parametrize("method", two_quick([SymplecticEuler(), Leapfrog(), RK4()]), ids=str)
@pytest.mark.parametrize("start", ["displaced", "thrown"])
def test_by_default_an_oscillator_keeps_its_energy(method, start):
    x, v = ((0.1, 0, 0), (0, 0, 0)) if start == "displaced" else ((0, 0, 0), (1, 0, 0))
    right = 200.0 if start == "displaced" else 0.5
    one = alone(stiff, [x, (0, 0, 0)], [v, (0, 0, 0)], integrator=method)
    begun = one.substeps
    assert one.dt <= 0.08 / 200
    for _ in range(60):
        one.step()
        energy = one.measure().kinetic_energy + 2e4 * (one.frame().position[0] ** 2).sum()
        # Symplectic Euler's is between 1/(1 + r) and 1/(1 − r) of it, r = hω/2 (`StepChoice.energy_swing`).
        assert energy == pytest.approx(right, rel=0.04 / (1 - 0.04))
    assert one.substeps <= 4 * begun  # the balance of energies takes no half kick for a rise: that took 64 times


@pytest.mark.slow
@pytest.mark.parametrize("method", [Leapfrog(), RK4()], ids=str)
def test_a_particle_bounces_off_a_floor_that_it_meets_within_a_frame(method):
    # It is in the floor for π ms. A floor's edge met within a substep changes the energy by (hω)²/4 at most.
    one = alone(floor, (0, 0, 0.5), (0, 0, 0), gravity=9.82, integrator=method)
    assert one.substeps == 1
    for bounce in range(1, 31):
        one.step(4)
        frame = one.frame()
        depth = min(frame.position[0, 2], 0.0)
        energy = 0.5 * frame.velocity[0, 2] ** 2 + 9.82 * frame.position[0, 2] + 5e5 * depth**2
        assert energy == pytest.approx(4.91, rel=0.02 + 0.01 * bounce / 8)
    assert max(count for _, count in one.substep_history) > 60


def test_substeps_follow_a_force_to_where_it_is_steep():
    one = alone(hollow, (0, 0, 0), (1, 0, 0), integrator=Leapfrog())
    begun = one.substeps
    one.step(60)
    energy = one.measure().kinetic_energy + 2.5e5 * (one.frame().position ** 2).sum() ** 2
    assert energy == pytest.approx(0.5, rel=0.01)  # (hω)²/24 of a spring, at 0.08
    assert one.substeps > 2 * begun

    first, rest = (alone(hollow, (0, 0, 0), (1, 0, 0), integrator=Leapfrog()) for _ in range(2))
    first.step(23)
    rest.restore(*first.checkpoint())
    rest.step(37)
    np.testing.assert_array_equal(rest.frame().position, one.frame().position)
    assert rest.substep_history == one.substep_history


def test_fixed_substeps_that_a_force_makes_unstable_are_refused():
    with pytest.raises(UnstableStep, match="substeps is 1; at least 2 a frame are stable here"):
        alone(stiff, np.zeros((2, 3)), np.zeros((2, 3)), substeps=1)


def test_each_world_has_its_own_slopes():
    system = System(position=[(0.1, 0, 0), (0, 0, 0)], mass=1.0)
    how = {"gravity": 0.0, "precision": "float64", "device": "cpu"}
    worlds = Ensemble(system, 2, loads=[Force(stiff)], mass=[1.0, 0.25], **how)
    found = [one.rates.stiffness for one in worlds.stepping.choices]
    np.testing.assert_allclose(found, [4e4, 16e4], rtol=1e-9)  # slopes by differences, of a linear force
    assert 1 / (60 * worlds.substeps) <= 0.08 / 400
    worlds.step(30)
    for k, mass in enumerate((1.0, 0.25)):
        one = Simulation(system.replace(mass=mass), loads=[Force(stiff)], substeps=worlds.substeps, **how)
        one.step(30)
        np.testing.assert_array_equal(worlds.frame().position[k], one.frame().position)


def test_a_stopped_world_asks_for_no_substeps():
    system = System(position=[(0, 0, 0)], velocity=[(1, 0, 0)], mass=1.0)
    start = {"position": [[(0.9, 0, 0)], [(-5, 0, 0)]], "mass": [1.0, 2.0]}
    worlds = Ensemble(system, 2, loads=[Force(runaway)], **start, gravity=0.0, precision="float64", device="cpu")
    worlds.step(20)
    assert list(worlds.status) == ["not finite", "running"]
    assert worlds.substeps > 100
    worlds.step(50)  # beyond the sixtieth frame, where substeps may become fewer
    assert worlds.substeps == 1
    np.testing.assert_allclose(worlds.frame().position[1, 0, 0], -5 + 70 / 60, rtol=1e-11)  # 4e4 roundings


def test_a_world_that_no_substeps_can_follow_stops_no_other():
    # The light particle would need 1e6 substeps a frame in the floor; the other is far above it.
    system = System(position=[(0, 0, 0)], velocity=[(0, 0, -1)], mass=1.0)
    start = {"position": [[(0, 0, 0.1)], [(0, 0, 5)]], "mass": [1e-9, 1.0]}
    worlds = Ensemble(system, 2, loads=[Force(floor)], **start, gravity=0.0, precision="float64", device="cpu")
    worlds.step(30)
    np.testing.assert_allclose(worlds.frame().position[1, 0, 2], 5 - 30 / 60, rtol=1e-12)  # rounding of sums
    assert worlds.status[1] == "running"
    sunk = {"position": [[(0, 0, -0.1)], [(0, 0, 5)]], "mass": [1e-9, 1.0]}
    with pytest.raises(UnstableStep, match="in world 0"):  # at the start it is an error
        Ensemble(system, 2, loads=[Force(floor)], **sunk, gravity=0.0, precision="float64", device="cpu")
