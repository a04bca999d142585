"""Numbers that a precision has not: named when a scene is built, not lost on the way to the device."""

import re

import numpy as np
import pytest

from msdwarp import Box, Capsule, Cone, Plane, Simulation, Sphere, System, checks

ONE = System(position=[[0.0, 0.0, 1.0]])


def simulate(system: System = ONE, *, precision: str = "float32", **options) -> Simulation:
    return Simulation(system, device="cpu", precision=precision, **options)


# Colliders


@pytest.mark.parametrize("length", [1e200, 1.7e308, 1e-200, 5e-324, 3.0])
def test_a_direction_may_have_any_length(length):
    assert checks.direction("normal", (0, 0, length)) == (0.0, 0.0, 1.0)
    np.testing.assert_allclose(
        checks.direction("n", (length, -length)), np.array([1, -1]) / np.sqrt(2), rtol=4e-16
    )
    floor = Plane(normal=(0, 0, length), restitution=0.0)
    simulation = simulate(System(position=[[0.0, 0.0, 0.1]]), colliders=[floor])
    simulation.step(60)
    assert simulation.frame().position[0, 2] == 0.0  # the floor is still there


@pytest.mark.parametrize("length", [1e200, 1e-200])
def test_an_axis_may_have_any_length(length):
    turned = ONE.rotate(np.pi / 2, axis=(length, 0, 0), about=(0, 0, 0))
    np.testing.assert_allclose(turned.position, [[0, -1, 0]], atol=1e-15)


@pytest.mark.parametrize(
    ("collider", "message"),
    [
        (Sphere((0, 0, -1e39), 1e39), "colliders[1].position[2] is -1e+39; it must be at most 4.6e+18 in float32"),
        (Sphere((0, 0, -9), 1e19), "colliders[1].radius is 1e+19; it must be at most 4.6e+18 in float32"),
        (Sphere((0, 0, -9), 1e-46), "colliders[1].radius is 1e-46; it must be at least 1.2e-38 in float32"),
        (Plane(offset=-1e39), "colliders[1].offset is -1e+39; it must be at most 3.4e+38 in float32"),
        (Plane(rest_speed=1e39), "colliders[1].rest_speed is 1e+39; it must be at most 3.4e+38 in float32"),
        (Box((0, 0, -9), (1, 1, 1e20)), "colliders[1].size[2] is 1e+20"),
        (Capsule((1e6, 0, 0), (1e6 + 1e-3, 0, 0), 0.1), "colliders[1].end is (1000000.001, 0.0, 0.0); it must be"),
        (
            Cone((0, 0, 1e-30), (0, 0, 0), 0.1),
            "colliders[1].base is (0.0, 0.0, 0.0); it must be further from apex",
        ),
    ],
)
def test_a_colliders_number_that_float32_has_not_is_named(collider, message):
    with pytest.raises(ValueError, match=re.escape(message)):
        simulate(colliders=[Plane(offset=-9), collider])


@pytest.mark.parametrize(
    "collider",
    [
        Sphere((0, 0, -4e18), 4e18, restitution=0),
        Box((0, 0, -2e18), (4e18, 4e18, 4e18), restitution=0),
        Capsule((-4e18, 0, -4e18), (4e18, 0, -4e18), 4e18, restitution=0),
        Cone((0, 0, -4e18), (0, 0, 0), 4e18, restitution=0),
    ],
    ids=lambda one: type(one).__name__,
)
def test_the_largest_solids_keep_particles_out(collider):
    # From as far as numbers of this size can tell: where solids are 4e18 m large, they are 5e11 m apart.
    falls = System(position=[[0.0, 0.0, 1e17]], velocity=(0, 0, -3e17))
    simulation = simulate(falls, gravity=0.0, colliders=[collider])
    simulation.step(60)
    assert abs(simulation.frame().position[0, 2]) < 1e13


def test_a_box_larger_than_kernels_know_is_named_in_float64():
    with pytest.raises(
        ValueError, match=r"colliders\[0\]\.size\[0\] is 1e\+31; it must be at most 1e\+30 in float64"
    ):
        simulate(precision="float64", colliders=[Box((0, 0, -1), (1e31, 1e31, 1e31))])


def test_a_motion_out_of_range_is_named():
    flees = Plane(offset=-9, motion=lambda t: (0, 0, -1e20 * t))
    simulation = simulate(colliders=[flees])
    with pytest.raises(
        ValueError, match=r"colliders\[0\] has no place at .* s: displacement\[2\] is -.*; it must be at most"
    ):
        simulation.step(60)


# Masses and gravity


@pytest.mark.parametrize(
    ("precision", "mass", "message"),
    [
        ("float32", [1.0, 1e46], r"mass\[1\] is 1e\+46; it must be from 2.9e-39 to 8.5e\+37 in float32, or inf"),
        ("float32", [np.inf, 1e38], r"mass\[1\] is 1e\+38; it"),
        ("float32", 1e46, r"mass is 1e\+46; it must be from"),
        ("float32", [1e-40, np.inf], r"mass\[0\] is 1e-40; it must be from"),
        ("float64", [1.0, 1e308], r"mass\[1\] is 1e\+308; it must be from 5.6e-309 to 4.5e\+307 in float64"),
        ("float64", 5e-324, r"mass is 5e-324; it must be from"),
    ],
)
def test_a_mass_without_an_inverse_is_named(precision, mass, message):
    pair = System(position=[[0.0, 0.0, 1.0], [1.0, 0.0, 1.0]], mass=mass)
    with pytest.raises(ValueError, match=message):
        simulate(pair, precision=precision)


@pytest.mark.parametrize(("precision", "mass"), [("float32", 8e37), ("float32", 3e-39), ("float64", 1e300)])
def test_what_is_free_falls_beside_what_is_pinned(precision, mass):
    pair = System(position=[[0.0, 0.0, 1.0], [1.0, 0.0, 1.0]], mass=[mass, np.inf])
    simulation = simulate(pair, precision=precision, energy_limit=np.inf)
    simulation.step(10)
    # Ten frames of semi-implicit Euler: g h² (1 + 2 + ... + 10).
    np.testing.assert_allclose(simulation.frame().position[:, 2], [1 - 9.82 / 3600 * 55, 1], rtol=1e-6)


def test_gravity_out_of_range_is_named():
    with pytest.raises(ValueError, match=r"gravity\[2\] is -1e\+39; it must be at most 3.4e\+38 in float32"):
        simulate(gravity=1e39)
