"""Colliders that move: they push, carry and throw as they do in their own frame."""

import math

import numpy as np
import pytest
from collisions import INTEGRATORS, G, every_step, particle, simulate
from problems import EPS64, two_quick

from msdwarp import Box, Leapfrog, Plane, Simulation, SymplecticEuler, System, box, chain


def moving(motion, **fields) -> dict:
    return {"motion": motion, "restitution": 0.4, "friction": 0.3} | fields


# What a method makes of an obstacle that moves: methods take turns, as of a drive in test_drives.py.
@pytest.mark.slow
@pytest.mark.parametrize("integrator", two_quick(INTEGRATORS[1:4:2]), ids=str)
def test_what_moves_evenly_is_as_what_stands(plain_device, integrator):
    # Galilei: a box that moves at w, seen by somebody who moves with it. With gravity, so that it bounces, slides
    # and comes to rest; compared at 1.5 s.
    w, start, v = np.array([0.7, -0.4, 0.2]), np.array([0.0, 0.1, 0.8]), np.array([1.0, 0.3, -1.0])
    fields = {"position": (0.2, 0, 0), "size": (4, 4, 0.5), "turn": (0.05, 0.1, 0.3)}
    found = []
    for motion, velocity in ((None, v), (lambda t: t * w, v + w)):
        simulation = simulate(
            particle(start, [velocity]),
            Box(**fields, **moving(motion)),
            plain_device,
            h=1 / 400,
            substeps=50,
            integrator=integrator,
        )
        simulation.step(12)
        found.append(simulation.frame())
    fixed, moved = found
    # 600 substeps that round places of 2 m; a velocity of the obstacle has such a rounding over h.
    np.testing.assert_allclose(moved.position - 1.5 * w, fixed.position, rtol=0, atol=600 * 2 * EPS64)
    np.testing.assert_allclose(moved.velocity - w, fixed.velocity, rtol=0, atol=400 * 20 * EPS64)
    assert abs(fixed.velocity[0, 2]) < 0.5  # it has long hit


@pytest.mark.parametrize("integrator", [SymplecticEuler(), Leapfrog()], ids=str)
@every_step
@pytest.mark.each_value
def test_what_gathers_speed_is_as_gravity(device, integrator, h):
    # Einstein: a floor that is accelerated by −g, seen by somebody on it. Its speed in the substep before the
    # first is −a h/2, which is what somebody on it takes for rest.
    a, w = np.array([2.0, -1.0, 12.0]), np.array([[1.0, 0.5, -2.0]])
    block = box((2, 2, 2), spacing=0.2, mass=0.2, stiffness=60.0, damping=0.3).rotate(0.4, axis=(1, 2, 0))
    block = block.translate((0, 0, 0.5))
    common = {"h": h, "substeps": round(0.1 / h), "integrator": integrator}
    fixed = simulate(block.with_velocity(w), Plane(restitution=0.6, friction=0.4), device, gravity=-a, **common)
    floor = Plane(restitution=0.6, friction=0.4, motion=lambda t: a * t**2 / 2)
    moved = simulate(block.with_velocity(w - a * h / 2), floor, device, gravity=0.0, **common)
    if isinstance(integrator, Leapfrog):  # which takes velocities back by half a substep itself
        moved = simulate(block.with_velocity(w), floor, device, gravity=0.0, **common)
    for _ in range(10):
        fixed.step()
        moved.step()
    assert fixed.frame().position[:, 2].min() == 0.0
    # Roundings of 6 m, of which velocities of the floor have one over h, and the swinging block makes more: ω/γ
    # times as many at most.
    t = moved.time
    np.testing.assert_allclose(
        moved.frame().position - a * t**2 / 2, fixed.frame().position, rtol=0, atol=1000 * 6 * EPS64 / h
    )


@pytest.mark.slow
@every_step
def test_a_shaking_floor_carries_and_throws(plain_device, h):
    # A ω² = 0.8 g carries. At 1.5 g it lets go where A ω² sin ω t = g, and what flies does so by itself.
    omega, g = 10.0, 10.0
    for strength in (0.8, 1.5):
        A = strength * g / omega**2
        floor = Plane(motion=lambda t, A=A: (0, 0, A * math.sin(omega * t)), restitution=0.0)
        start = particle((0, 0, 0), [[0, 0, A * omega]])
        simulation = simulate(start, floor, plain_device, h=h, gravity=g)
        flight = []
        while simulation.time < 0.3:
            simulation.step()
            z, t = simulation.frame().position[0, 2], simulation.time
            gap = z - A * math.sin(omega * t)
            if strength < 1:
                assert abs(gap) < 4 * EPS64
            else:
                flight.append((t, z, gap))
        if strength > 1:
            phase = math.asin(1 / strength)
            leaves, speed = phase / omega, A * omega * math.cos(phase)
            for t, z, gap in flight:
                s = t - leaves
                if s < -h:
                    assert abs(gap) < 4 * EPS64
                elif s > h:  # speed and place to half a substep of g and of speed
                    flown = A / strength + speed * s - g * s**2 / 2
                    assert z == pytest.approx(flown, abs=h * (g * s + speed + 1))
            assert max(gap for *_, gap in flight) > 0.02


@every_step
def test_a_turning_disc_takes_a_particle_with_it(plain_device, h):
    # From rest it slips until friction has brought it to speed; then it turns with the disc and never creeps.
    omega, radius = 3.0, 0.5
    disc = Box(
        (0.2, 0.1, -0.1), (4, 4, 0.2), friction=0.9, motion=lambda t: ((0.0, 0.0, 0.0), (0.0, 0.0, omega * t))
    )
    centre = np.array([0.2, 0.1, 0.0])
    assert omega**2 * radius < 0.9 * G
    simulation = simulate(
        particle(centre + np.array([radius, 0, 0])), disc, plain_device, h=h, substeps=round(0.05 / h)
    )
    simulation.step()
    # μ g at first, along y: for 0.05 s, in which the disc turns its direction by less than 0.15.
    assert np.linalg.norm(simulation.frame().velocity[0]) == pytest.approx(0.9 * G * 0.05, rel=0.02)
    simulation.step(39)

    def on_disc() -> np.ndarray:
        angle, place = omega * simulation.time, simulation.frame().position[0] - centre
        return np.array([[math.cos(angle), math.sin(angle)], [-math.sin(angle), math.cos(angle)]]) @ place[:2]

    then = on_disc()
    simulation.step(20)
    np.testing.assert_allclose(on_disc(), then, rtol=0, atol=1.0 / h * 8 * EPS64)  # a rounding or two a substep
    # The way of a substep, which is the secant of an arc.
    speed = np.linalg.norm(simulation.frame().velocity[0])
    secant = 2 / h * math.sin(omega * h / 2) * np.linalg.norm(then)
    assert speed == pytest.approx(secant, rel=8 * EPS64 / h)  # roundings of places, over h
    assert np.linalg.norm(then) < 1.5


@pytest.mark.slow
@every_step
def test_a_paddle_in_the_plane_strikes(plain_device, h):
    # A rod that turns about its middle meets a particle at rest 1 m away, at ω · 1 m across the rod.
    omega = 2.0
    rod = Box((0.5, 0.0), (4.0, 0.1), restitution=0.5, friction=0.0, motion=lambda t: ((0.0, 0.0), omega * t))
    simulation = simulate(System(position=[[1.5, 0.3]]), rod, plain_device, h=h, gravity=0.0)
    simulation.step(round(0.5 / h))
    # e = 0.5: 1.5 times the speed of the place that is hit, along the normal there; the hit is known to a substep.
    hit = math.hypot(1.0, 0.3)
    speed = np.linalg.norm(simulation.frame().velocity[0])
    assert speed == pytest.approx(1.5 * omega * math.sqrt(hit**2 - 0.05**2), rel=omega * h)


@pytest.mark.parametrize("integrator", two_quick(INTEGRATORS[:4:3]), ids=str)
def test_pinned_particles_are_not_moved(plain_device, integrator):
    # A wall sweeps through a block: it takes along what is free, and passes what is pinned.
    block = box((2, 2, 2), spacing=0.2, mass=0.1, stiffness=100.0, damping=0.5).pin([0, 5])
    wall = Plane((1, 0, 0), offset=-0.5, restitution=0.0, motion=lambda t: (2.0 * t, 0, 0))
    simulation = simulate(block, wall, plain_device, h=1 / 1000, substeps=50, integrator=integrator, gravity=0.0)
    for _ in range(10):
        simulation.step()
    now = simulation.frame()
    np.testing.assert_array_equal(now.position[[0, 5]], block.position[[0, 5]])
    assert not now.velocity[[0, 5]].any()
    free = np.delete(now.position, [0, 5], axis=0)
    assert free[:, 0].min() > 0.5 - 1e-12  # where the wall is: roundings


@pytest.mark.parametrize("substeps", [1, 2, 5])
def test_a_motion_is_known_from_time_zero_on(plain_device, substeps):
    # What is hit in the very first substep moves as it does later, though its motion has no past: 2 m/s come in
    # upon a floor that comes up at 1 m/s, and e = 0.5.
    seen = []

    def rise(t):
        seen.extend(np.ravel(t))
        return 0, 0, t

    h = 0.01
    floor = Plane(motion=rise, restitution=0.5, friction=0.0)
    start = particle((0, 0, h), [[0.3, 0, -1.0]])
    simulation = simulate(start, floor, plain_device, h=h, substeps=substeps, gravity=0.0)
    simulation.step()
    np.testing.assert_allclose(simulation.frame().velocity[0], (0.3, 0, 2.0), rtol=0, atol=8 * EPS64 / h)
    assert min(seen) == 0.0


def test_a_change_does_not_disturb_what_moves(plain_device):
    # Another stiffness of no connection: the collider goes on from where it is.
    floor = Plane(motion=lambda t: (0.3 * t, 0, 2.0 * t * t))
    simulation = simulate(particle((0, 0, 0)), floor, plain_device, h=1 / 100, substeps=10)
    simulation.step(3)
    simulation.change(stiffness=10.0)
    simulation.step(3)
    assert simulation.frame().position[0, 2] == pytest.approx(2.0 * 0.6**2, rel=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("substeps", [5, "auto"])
def test_many_frames_at_once_are_as_one_by_one(device, substeps):
    # The next frame is prepared while one runs; its poses are the same numbers, whether steps are repeated or not.
    def shake(t):
        return (0.1 * np.sin(9 * t), 0 * t, 0.05 * np.sin(25 * t)), (0.3 * t, 0 * t, 0.2 * np.sin(5 * t))

    block = box((2, 2, 2), spacing=0.2, mass=0.1, stiffness=100.0, damping=0.5).translate((0, 0, 0.1))
    floor, wall = Plane(motion=shake, friction=0.4), Plane((1, 0, 0), offset=-1.0)
    common = {"colliders": [floor, wall], "precision": "float64", "device": device, "fps": 50.0}
    many, one = (Simulation(block, substeps=substeps, **common) for _ in range(2))
    many.step(30)
    for _ in range(30):
        one.step()
    np.testing.assert_array_equal(many.frame().position, one.frame().position)
    np.testing.assert_array_equal(many.frame().velocity, one.frame().velocity)


def test_what_the_host_changes_between_steps_counts_at_once(plain_device):
    # A motion may read what the caller changes between two calls of `step`: nothing is prepared across them.
    speed = {"up": 1.0}
    floor = Plane(motion=lambda t: (0 * t, 0 * t, speed["up"] * t), restitution=0.0)
    simulation = simulate(particle((0, 0, 0)), floor, plain_device, h=0.01, substeps=10)
    simulation.step(2)
    speed["up"] = 2.0
    simulation.step(2)
    assert simulation.frame().position[0, 2] == pytest.approx(2.0 * 0.4, rel=1e-12)


@pytest.mark.parametrize("frames", [[2, 1], [3]])
def test_a_motion_that_ends_is_told_by_the_frame_that_needs_it(plain_device, frames):
    # Prepared or not: the frames before it stand, and one that never comes is no error.
    def ends(t):
        if np.max(t) > 0.2 + 1e-9:
            raise RuntimeError("off the rails")
        return 0.1 * t, 0 * t, 0 * t

    floor = Plane(motion=ends)
    simulation = simulate(particle((0, 0, 0)), floor, plain_device, h=0.01, substeps=10)
    for count in frames[:-1]:
        simulation.step(count)
    with pytest.raises(ValueError, match=r"colliders\[0\] has no place at 0.21 s: RuntimeError: off the rails"):
        simulation.step(frames[-1])
    assert simulation.frame_index == 2


@pytest.mark.parametrize("automatic", [False, True])
def test_a_motion_that_exits_leaves_the_last_frame(plain_device, automatic):
    # The frame after the next is prepared in the next: what is no Exception ends it, and it never was.
    def exits(t):
        if np.max(t) > 0.2 + 1e-9 and not mended:
            raise SystemExit
        return 0.1 * t, 0 * t, 0 * t

    mended, substeps = False, "auto" if automatic else 10
    simulation, usual = (
        Simulation(chain(2), colliders=[Plane(motion=one)], fps=10, substeps=substeps, device=plain_device)
        for one in (exits, lambda t: (0.1 * t, 0 * t, 0 * t))
    )
    with pytest.raises(SystemExit):
        simulation.step(4)
    mended = True
    usual.step(simulation.frame_index)
    for _ in range(2):
        for one, other in zip(simulation.frame(), usual.frame(), strict=True):
            np.testing.assert_array_equal(one, other)
        simulation.step()
        usual.step()
