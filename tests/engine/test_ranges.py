"""Numbers that a precision has not: named when a scene is built, not lost on the way to the device."""

import re

import numpy as np
import pytest

from msdwarp import Box, Capsule, Cone, Plane, Simulation, System, checks

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


@pytest.mark.slow
@pytest.mark.parametrize(
    "collider",
    [
        Box((0, 0, -5e17), (1e18, 1e18, 1e18), restitution=0),
        Cone((0, 0, -1e18), (0, 0, 0), 1e18, restitution=0),
    ],
    ids=lambda one: type(one).__name__,
)
def test_the_largest_solids_keep_particles_out(collider):
    # From as far as numbers of this size can tell: where solids are 1e18 m large, they are 1e11 m apart.
    falls = System(position=[[0.0, 0.0, 1e17]], velocity=(0, 0, -3e17))
    simulation = simulate(falls, gravity=0.0, colliders=[collider])
    simulation.step(60)
    assert abs(simulation.frame().position[0, 2]) < 1e13


def test_a_motion_out_of_range_is_named():
    flees = Plane(offset=-9, motion=lambda t: (0, 0, -1e20 * t))
    simulation = simulate(colliders=[flees])
    with pytest.raises(
        ValueError, match=r"colliders\[0\] has no place at .* s: .* it must be 3 finite numbers, at most"
    ):
        simulation.step(60)


# Masses


@pytest.mark.parametrize(("precision", "mass"), [("float32", 1e18), ("float32", 1e-18), ("float64", 1e18)])
def test_what_is_free_falls_beside_what_is_pinned(precision, mass):
    pair = System(position=[[0.0, 0.0, 1.0], [1.0, 0.0, 1.0]], mass=[mass, np.inf])
    simulation = simulate(pair, precision=precision, energy_limit=np.inf)
    simulation.step(10)
    # Ten frames of semi-implicit Euler: g h² (1 + 2 + ... + 10).
    np.testing.assert_allclose(simulation.frame().position[:, 2], [1 - 9.82 / 3600 * 55, 1], rtol=1e-6)
