"""Bodies that start inside obstacles are led out of them; corners between obstacles hold."""

import math

import numpy as np
import pytest
from collisions import simulate

from msdwarp import Box, Cone, Plane, Sphere, StartWarning, System, box

G = 9.82
F = {"restitution": 0.3, "friction": 0.5}
BLOCK = Box((0.0, 0.0, 0.25), (0.5, 0.5, 0.5), **F)
AWAY = [Box((0.0, 0.0, -99.0)), Cone((0.0, 0.0, -98.0), (0.0, 0.0, -99.0), 9.0), Sphere((0.0, 0.0, -99.0))]
"""Far off: with them all scenes have the same kinds, and the same kernels."""


def body(place, **changes) -> System:
    """Return a cube of 0.3 m whose lowest corner is at a place."""
    cube = box((4, 4, 4), 0.1, mass=0.01, stiffness=200.0, damping=0.2)
    return cube.translate(tuple(np.array(place) - cube.position.min(axis=0))).replace(**changes)


# What starts inside


@pytest.mark.slow
@pytest.mark.parametrize(
    ("place", "colliders", "lifted"),
    [
        ((0.0, 0.0, -0.05), [Plane(**F)], 0.05),
        ((0.0, 0.0, -0.15), [Plane(**F)], 0.15),
        ((-0.15, -0.15, 0.45), [Plane(**F), BLOCK], 0.05),
        ((0.2, -0.15, 0.0), [Plane(**F), BLOCK], 0.0),
        ((0.2, -0.15, -0.05), [BLOCK, Plane(**F)], 0.05),
        ((-0.15, -0.15, 0.4), [Plane(**F), Sphere((0.0, 0.0, 0.25), 0.25, **F)], 0.1),
    ],
    ids=["in the floor", "half in the floor", "on a block", "beside a block", "in the corner", "in a ball"],
)
@pytest.mark.parametrize("h", [1 / 600, 1 / 2400])
@pytest.mark.each_value
def test_what_starts_inside_is_led_out_without_a_jump(device, place, colliders, lifted, h):
    with pytest.warns(StartWarning):
        simulation = simulate(body(place), [*colliders, *AWAY], device, h=h, substeps=round(1 / (60 * h)))
    start = simulation.measure().energy
    most, fastest = start, 0.0
    for _ in range(60):
        simulation.step()
        most = max(most, simulation.measure().energy)
        fastest = max(fastest, float(np.abs(simulation.frame().velocity).max()))
    # It gains its weight times the way that it is lifted, and little else: put out at once it gained 5 J and more.
    assert most - start < 0.64 * G * lifted + 0.1
    # Half a second for up to 15 cm, and as much again for what swings about that.
    assert fastest < 1.0
    now = simulation.frame().position
    assert now[:, 2].min() > -1e-12  # roundings of 1 m, in 2400 substeps
    beside = np.abs(now[:, :2]).max(axis=1) < 0.25 - 1e-3
    if BLOCK in colliders:
        assert not (beside & (now[:, 2] < 0.5 - 1e-3)).any()


# Corners


@pytest.mark.parametrize("order", [1, -1])
@pytest.mark.parametrize("friction", [0.0, 0.5])
@pytest.mark.parametrize("angle", [0.3, 0.8, 2.2])
def test_a_wedge_holds_whatever_its_angle(plain_device, angle, friction, order):
    # A floor and a ceiling that meet in x = 0: put out of one by the shortest way the particle came into the
    # other, and stayed there, 46 mm deep.
    ceiling = np.array([math.sin(angle), 0.0, -math.cos(angle)])
    planes = [Plane(restitution=0.0, friction=friction), Plane(tuple(ceiling), restitution=0.0, friction=friction)]
    start = System(position=[[0.5, 0.0, 0.05]], velocity=(-3.0, 0.0, -0.3))
    simulation = simulate(start, planes[::order], plain_device, h=1 / 240)
    for _ in range(240):
        simulation.step()
        x = simulation.frame().position[0]
        # What is less deep than a thousandth of a substep's way, 13 mm, waits for the next one.
        assert min(x[2], x @ ceiling) > -1.3e-5
    assert np.linalg.norm(simulation.frame().velocity) < 4.0


@pytest.mark.slow
@pytest.mark.parametrize("order", [1, -1])
@pytest.mark.parametrize("friction", [0.0, 0.5])
@pytest.mark.each_value
@pytest.mark.parametrize("block", [BLOCK, Cone((0.0, 0.0, 1.0), (0.0, 0.0, 0.0), 0.25, **F)], ids=["box", "cone"])
def test_what_slides_on_a_plane_meets_the_side_of_what_stands_there(plain_device, block, friction, order):
    # Between both it once came in from beneath: the underside of a box is nearer than its side.
    rows = np.arange(-0.1, 0.11, 0.05)
    start = System(position=[[0.4, y, 0.0] for y in rows], velocity=(-4.0, 0.0, 0.0))
    colliders = [Plane(restitution=0.0, friction=friction), block][::order]
    simulation = simulate(start, [*colliders, *AWAY], plain_device, h=1 / 240)
    for _ in range(120):
        simulation.step()
        x = simulation.frame().position
        inside = np.abs(x[:, 0]) < 0.25 - 1e-6 if block is BLOCK else np.hypot(x[:, 0], x[:, 1]) < 0.25 - 1e-6
        assert not inside.any()
