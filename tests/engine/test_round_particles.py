"""Particles that have a radius against obstacles: grains and ropes with a thickness."""

import numpy as np
import pytest

import msdwarp as msd
from msdwarp import Box, Capsule, Cone, Contact, Plane, Simulation, Sphere, System
from msdwarp.world import radii

R, MASS, G = 0.05, 0.01, 9.82
CONTACT = Contact(thickness=2 * R, stiffness=500.0)
SOLIDS = [
    Plane(offset=-0.5, restitution=0.0),
    Sphere((0, 0, -0.3), 0.3),
    Box((2, 0, -0.25), (1, 1, 0.5)),
    Capsule((4, -1, -0.1), (4, 1, -0.1), 0.1),
    Cone((6, 0, -0.5), (6, 0, 0), 0.5),
    Box((-3, 0, 0.5), (0.01, 2, 1), restitution=1.0),
]
"""All tops but that of the wall, the last, lie at z = 0."""
STARTS = [(0, 0, 0.1), (2, 0, 0.1), (4, 0, 0.1), (6, 0, 0.1), (2.52, 0, 0.1), (-2.5, 0, 0.9)]
"""Above each top; above the edge of the box, beyond it by less than the radius; and before the wall."""
SPEED = 200.0
"""At which a grain is shot at the wall [m/s]: in a frame 300 times the thickness of the wall."""


@pytest.fixture
def device(plain_device: str) -> str:
    """Each device once: grains have no springs."""
    return plain_device


def grains(places, velocity=0.0) -> System:
    return System(position=places, velocity=velocity, mass=MASS)


def test_grains_touch_every_solid_with_their_surface(device):
    velocity = np.zeros((len(STARTS), 3))
    velocity[-1, 0] = -SPEED
    simulation = Simulation(
        grains(STARTS, velocity), colliders=SOLIDS, contact=CONTACT, device=device, precision="float64"
    )
    nearest, x = np.inf, np.array(STARTS)
    for k in range(60):
        simulation.step()
        x = simulation.frame().position
        out = np.maximum(np.abs(x[4] - (2, 0, -0.25)) - (0.5, 0.5, 0.25), 0.0)
        nearest = min(nearest, float(np.linalg.norm(out)))
        if k == 5:
            # Back from a radius before the wall at the same speed; a bounce is in time to a substep.
            wall = -2.995 + R
            there = wall + SPEED * 0.1 - (STARTS[-1][0] - wall)
            assert x[5, 0] == pytest.approx(there, abs=2 * SPEED / 60 / simulation.substeps)
    np.testing.assert_allclose(x[:4], [(a, b, R) for a, b, _ in STARTS[:4]], rtol=0, atol=1e-12)
    assert R - 1e-12 < nearest < 1.05 * R  # around the edge, which it touches, perhaps not as a frame ends
    assert x[4, 2] == pytest.approx(R - 0.5, abs=1e-12)  # down to the plane


def test_a_grain_rides_on_what_lifts_it_and_a_rope_lies_on_it(device):
    rope = msd.chain(5, 0.1, mass=MASS, stiffness=300.0, damping=0.2)
    rope = rope.translate(-rope.position.mean(axis=0)).translate((1.0, 0, R))
    floor = Plane(motion=lambda t: (0.0, 0.0, 0.3 * t))
    system = grains([[0, 0, R]]) + rope
    simulation = Simulation(system, colliders=[floor], contact=CONTACT, device=device, precision="float64")
    simulation.step(30)
    np.testing.assert_allclose(simulation.frame().position[:, 2], R + 0.15, rtol=0, atol=1e-12)
    # The floor does the work of lifting them, and, in the first substep, m v² of setting them in motion.
    work = 6 * MASS * (G * 0.15 + 0.3**2)
    assert simulation.measure().external_work == pytest.approx(work, rel=1e-6)


def test_a_soft_obstacle_bears_a_grain_at_its_surface(device):
    stiffness, ramp = 400.0, 1e-4
    depth = MASS * G / stiffness + ramp / 2  # k (d − δ/2) = m g beyond the ramp
    floor = Plane(stiffness=stiffness, ramp=ramp)
    simulation = Simulation(
        grains([[0, 0, R - depth]]), colliders=[floor], contact=CONTACT, device=device, precision="float64"
    )
    before = simulation.measure()
    simulation.step(30)
    assert simulation.frame().position[0, 2] == pytest.approx(R - depth, abs=1e-12)
    stored = stiffness * (ramp**2 / 6 + (depth - ramp) * depth / 2)
    assert before.effect_energy == pytest.approx(stored, rel=1e-9)


def test_a_grain_that_starts_in_an_obstacle_by_its_radius_is_led_out(device):
    how = {"colliders": [Plane()], "contact": CONTACT, "device": device, "precision": "float64"}
    how["energy_limit"] = np.inf  # it is lifted, and each frame would be tried with more substeps
    with pytest.warns(
        msd.StartWarning, match=r"particle 0, of radius 0\.05 m, starts 0\.04 m inside colliders\[0\]"
    ):
        simulation = Simulation(grains([[0, 0, 0.2 * R], [0.5, 0, R]]), **how)
    heights = []
    for _ in range(45):
        simulation.step()
        heights.append(simulation.frame().position[0, 2])
    assert heights[14] == pytest.approx(0.6 * R, abs=0.05 * R)  # after half of the time
    np.testing.assert_allclose(heights[30:], R, rtol=0, atol=1e-9)  # and it stays there


def test_only_what_has_no_surface_has_the_radius_that_a_rule_gives_for_its_kind():
    block, rope = msd.box((2, 2, 2), 0.1).named("block"), msd.chain(2, 0.1).named("rope")
    sand, stone = grains([[1, 0, 0.0]]).named("sand"), grains([[2, 0, 0.0]]).named("stone")
    system = block + rope + sand + stone
    every, stones = Contact(thickness=0.02), Contact(groups=("stone", "stone"), thickness=0.3)
    apart = [Contact(groups=("stone", "sand"), thickness=0.16), Contact(groups=("sand", "sand"), exclude=True)]
    for rules, rope_has, sand_has, stone_has in (
        ([Contact()], 0, 0, 0),
        ([every], 0.01, 0.01, 0.01),
        ([every, stones, *apart], 0.01, 0.01, 0.15),
        ([stones, every], 0.01, 0.01, 0.01),
        (apart, 0, 0, 0),
    ):
        assert radii(rules, system).tolist() == [0.0] * 8 + [rope_has] * 2 + [sand_has, stone_has]
