"""What a system's methods return: moved, turned, pinned, changed and added."""

import math

import numpy as np
import pytest
from problems import triangle

from msdwarp import System, box, chain, sheet

NAN, INF = math.nan, math.inf


@pytest.mark.parametrize(
    ("method", "changed"),
    [
        (lambda s: s.translate((1.0, 2.0, 3.0)), {"position"}),
        (lambda s: s.rotate(1.0), {"position", "velocity"}),
        (lambda s: s.spin((1.0, 2.0, 3.0)), {"velocity"}),
        (lambda s: s.with_velocity((1.0, 2.0, 3.0)), {"velocity"}),
        (lambda s: s.pin(0), {"mass", "velocity"}),
        (lambda s: s.replace(stiffness=7.0), {"stiffness"}),
        (lambda s: s.set_rest_shape(), {"rest_length", "original_length"}),
    ],
    ids=["translate", "rotate", "spin", "with_velocity", "pin", "replace", "set_rest_shape"],
)
def test_what_does_not_change_is_shared(method, changed):
    system = box((2, 2, 3))
    made = method(system)
    for name, values in vars(system).items():
        assert (getattr(made, name) is values) == (name not in changed), name


def test_what_is_shared_must_still_fit():
    fewer = {"position": [[0.0, 0.0], [1.0, 0.0]], "velocity": 0.0}
    with pytest.raises(ValueError, match=r"mass has shape \(3,\).*2 numbers"):
        triangle().replace(**fewer)
    with pytest.raises(ValueError, match=r"connections\[1, 1\] is 2.*0 to 1"):
        triangle().replace(**fewer, mass=1.0)
    with pytest.raises(ValueError, match=r"rest_length has shape \(3,\).*2 numbers"):
        triangle().replace(connections=[[0, 1], [1, 2]])
    with pytest.raises(ValueError, match=r"surface.particle\[1\] is 2.*0 to 1"):
        sheet((2, 2), dim=2).replace(**fewer, mass=1.0, connections=(), rest_length=1, stiffness=1, damping=0)
    with pytest.raises(ValueError, match=r"velocity\[1, \d\] is .*pinned"):
        triangle(velocity=(0.0, 3.0)).replace(mass=[1.0, INF, 1.0])


def test_translate_moves_positions_only():
    system = triangle(velocity=(1.0, 0.0))
    moved = system.translate((2.0, -1.0))
    np.testing.assert_array_equal(moved.position, [[2, -1], [5, -1], [2, 3]])
    np.testing.assert_array_equal(moved.velocity, system.velocity)
    np.testing.assert_array_equal(system.position[0], 0)  # the first is as it was


def test_rotate():
    system = System(position=[[1.0, 0, 0], [-1.0, 0, 0]], velocity=[0, 1.0, 0])
    # A quarter turn about z takes x to y and y to −x; cos(π/2) = 6e-17 is not quite 0.
    turned = system.rotate(math.pi / 2)
    np.testing.assert_allclose(turned.position, [[0, 1, 0], [0, -1, 0]], rtol=0, atol=1e-15)
    np.testing.assert_allclose(turned.velocity, [[-1, 0, 0], [-1, 0, 0]], rtol=0, atol=1e-15)
    # A third of a turn about (1, 1, 1), of any length, takes x to y.
    turned = system.rotate(2 * math.pi / 3, axis=(5, 5, 5))
    np.testing.assert_allclose(turned.position, [[0, 1, 0], [0, -1, 0]], rtol=0, atol=1e-15)
    # In the plane, about the centre of mass (2, 0).
    turned = System(position=[[1.0, 0.0], [3.0, 0.0]]).rotate(math.pi / 2)
    np.testing.assert_allclose(turned.position, [[2, -1], [2, 1]], rtol=0, atol=1e-15)
    # About another point.
    turned = system.rotate(math.pi, about=(1.0, 0.0, 0.0))
    np.testing.assert_allclose(turned.position, [[1, 0, 0], [3, 0, 0]], rtol=0, atol=1e-15)


def test_centre_of_mass_weighs_and_leaves_out_pinned_particles():
    np.testing.assert_allclose(triangle().center_of_mass, [1, 2], rtol=1e-15)  # (0+6+0)/6, (0+0+12)/6
    np.testing.assert_allclose(triangle().pin(2).center_of_mass, [2, 0], rtol=1e-15)
    np.testing.assert_allclose(triangle().pin(slice(None)).center_of_mass, [1, 4 / 3], rtol=1e-15)


def test_spin_adds_a_rigid_rotation_without_momentum():
    omega = np.array([0.5, -1.0, 2.0])
    system = box((3, 2, 2), mass=np.linspace(1, 2, 12)).translate((5, 6, 7)).with_velocity((1, 0, 0))
    spun = system.spin(omega)
    momentum = (spun.mass[:, None] * (spun.velocity - system.velocity)).sum(axis=0)
    np.testing.assert_allclose(momentum, 0, rtol=0, atol=1e-13)  # sums of 12 terms of up to 40 kg m/s
    # Angular momentum L = I ω with the inertia tensor about the centre of mass.
    arm = system.position - system.center_of_mass
    m = system.mass[:, None]
    inertia = (m * arm**2).sum() * np.eye(3) - (m * arm).T @ arm
    found = np.cross(arm, m * (spun.velocity - system.velocity)).sum(axis=0)
    np.testing.assert_allclose(found, inertia @ omega, rtol=1e-12)  # rounding of sums
    np.testing.assert_array_equal(spun.position, system.position)
    spun = System(position=[[1.0, 0.0], [-1.0, 0.0]]).spin(2.0)  # in the plane counter-clockwise
    np.testing.assert_array_equal(spun.velocity, [[0, 2], [0, -2]])


def test_pin_stops_the_selected_particles():
    system = chain(5, dim=2).with_velocity((1.0, 1.0)).replace(groups={"ends": [0, 1]})
    for selection in (slice(0, 2), [0, 1], np.array([True, True, False, False, False]), [-5, -4], "ends"):
        pinned = system.pin(selection)
        np.testing.assert_array_equal(pinned.pinned, [True, True, False, False, False])
        np.testing.assert_array_equal(pinned.velocity, [[0, 0], [0, 0], [1, 1], [1, 1], [1, 1]])
    assert not system.pinned.any()


def test_pinned_particles_stay_still():
    pinned = sheet((3, 3), dim=2).pin(0)
    for moving in (pinned.spin(3.0), pinned.with_velocity((1.0, 2.0)), pinned.with_velocity(np.ones((9, 2)))):
        assert not moving.velocity[0].any()
        assert moving.velocity[1:].any(axis=1).all()


def test_freeze_makes_the_present_shape_the_rest_shape():
    stretched = sheet((3, 3)).replace(position=sheet((3, 3)).position * (2, 1, 1))
    assert stretched.strain.any()
    frozen = stretched.set_rest_shape()
    assert not frozen.strain.any()
    np.testing.assert_array_equal(frozen.position, stretched.position)
    np.testing.assert_array_equal(frozen.rest_length, stretched.length)


def test_replace_validates():
    with pytest.raises(ValueError, match=r"damping is -1"):
        triangle().replace(damping=-1.0)
    with pytest.raises(TypeError, match="color"):
        triangle().replace(color="red")


@pytest.mark.parametrize("dim", [1, 2, 3])
def test_adding_puts_the_second_behind_the_first(dim):
    a = chain(3, dim=dim, mass=1.0, stiffness=10.0, damping=0.1)
    b = chain(2, spacing=2.0, dim=dim, mass=4.0, stiffness=20.0, damping=0.1).with_velocity(1.0)
    both = a + b
    np.testing.assert_array_equal(both.position, np.concatenate([a.position, b.position]))
    np.testing.assert_array_equal(both.velocity[:3], 0)
    np.testing.assert_array_equal(both.velocity[3:], 1)
    np.testing.assert_array_equal(both.mass, [1, 1, 1, 4, 4])
    np.testing.assert_array_equal(both.connections, [[0, 1], [1, 2], [3, 4]])
    np.testing.assert_array_equal(both.rest_length, [1, 1, 2])
    np.testing.assert_array_equal(both.stiffness, [10, 10, 20])
    np.testing.assert_array_equal(both.damping, [0.1] * 3)
    assert both.direction("x", body=0) == slice(0, 2)
    assert both.direction("x", body=1) == slice(2, 3)


def test_adding_joins_surfaces():
    a, b, bare = sheet((2, 3)), box((2, 2, 2)), chain(3)
    both = (a + b).surface
    np.testing.assert_array_equal(both.particle, np.concatenate([a.surface.particle, b.surface.particle + 6]))
    np.testing.assert_array_equal(both.uv, np.concatenate([a.surface.uv, b.surface.uv]))
    expected = np.concatenate([a.surface.triangles, b.surface.triangles + len(a.surface.particle)])
    np.testing.assert_array_equal(both.triangles, expected)
    assert (bare + chain(2)).surface is None
    np.testing.assert_array_equal((a + bare).surface.particle, a.surface.particle)
    np.testing.assert_array_equal((bare + a).surface.particle, a.surface.particle + 3)
    np.testing.assert_array_equal((bare + a).surface.triangles, a.surface.triangles)


def test_adding_needs_as_many_coordinates():
    with pytest.raises(ValueError, match="2 coordinates to one of 3"):
        chain(2, dim=3) + chain(2, dim=2)
    with pytest.raises(TypeError):
        chain(2) + 1


@pytest.mark.parametrize(
    ("method", "message"),
    [
        (lambda s: s.pin(7), "selection does not index 3 particles.*7"),
        (lambda s: s.pin([True, False]), "selection does not index 3 particles"),
        (lambda s: s.pin("first"), "selection is 'first'; it must be one of those that exist: there are none"),
        (
            lambda s: s.translate((1.0, 2.0, 3.0)),
            "it must be 2 finite numbers",
        ),
        (lambda s: s.translate((NAN, 0.0)), "nan"),
        (lambda s: s.with_velocity((1.0, 2.0, 3.0)), r"velocity has shape \(3,\)"),
        (lambda s: s.rotate(1.0, about=(0.0, 0.0, 0.0)), r"about has shape \(3,\)"),
        (lambda s: s.spin((1.0, 2.0, 3.0)), r"angular_velocity has shape \(3,\)"),
        (lambda s: chain(2).rotate(1.0, axis=(0, 0, 0)), r"axis is \(0, 0, 0\)"),
        (lambda s: chain(2).rotate(1.0, axis=(0, NAN, 0)), r"axis is \(0, nan, 0\)"),
        (lambda s: chain(2).rotate(1.0, axis=(1, 0)), r"axis has shape \(2,\)"),
        *((lambda s, wrong=wrong: chain(2).rotate(wrong), "angle is") for wrong in (NAN, INF, "a", [1, 2, 3])),
        (lambda s: chain(2, dim=1).rotate(1.0), "one-dimensional system cannot be rotated"),
        (lambda s: chain(2, dim=1).spin(1.0), "one-dimensional system cannot spin"),
    ],
)
def test_bad_input_to_methods_is_named(method, message):
    with pytest.raises(ValueError, match=message):
        method(triangle())
