"""System: what it stores, and that bad input is named."""

import math

import numpy as np
import pytest
from problems import triangle

from msdwarp import Surface, chain, sheet


def test_scalars_broadcast_and_are_stored_once():
    system = triangle(mass=2.0, stiffness=5.0, damping=0.1, velocity=(1.0, 2.0))
    np.testing.assert_array_equal(system.mass, [2, 2, 2])
    np.testing.assert_array_equal(system.stiffness, [5, 5, 5])
    np.testing.assert_array_equal(system.damping, [0.1, 0.1, 0.1])
    np.testing.assert_array_equal(system.velocity, [[1, 2]] * 3)
    assert all(a.strides == (0,) for a in (system.mass, system.stiffness, system.damping))


@pytest.mark.parametrize(
    "method",
    [
        lambda s: s.translate((1.0, 2.0, 3.0)),
        lambda s: s.with_velocity((1.0, 2.0, 3.0)),
        lambda s: s.set_rest_shape(),
        lambda s: s + s,
    ],
    ids=["translate", "with_velocity", "set_rest_shape", "+"],
)
def test_constants_stay_stored_once(method):
    system = method(chain(3, mass=2.0, stiffness=5.0, damping=0.1))
    assert all(a.strides == (0,) for a in (system.mass, system.stiffness, system.damping))
    assert system.velocity.strides[0] == 0


def test_rest_lengths_default_to_the_present_lengths():
    np.testing.assert_array_equal(triangle().rest_length, [3, 5, 4])  # Pythagorean: exact
    np.testing.assert_array_equal(triangle().strain, 0)
    strain = triangle(rest_length=2.5).strain  # 3/2.5 − 1 and so on, to a rounding
    np.testing.assert_allclose(strain, [0.2, 1.0, 0.6], rtol=0, atol=1e-15)


def test_arrays_are_read_only():
    system = sheet((3, 3))
    names = ("position", "velocity", "mass", "connections", "rest_length", "stiffness", "damping")
    arrays = [getattr(system, name) for name in names]
    arrays += [system.surface.particle, system.surface.uv, system.surface.triangles]
    for values in arrays:
        with pytest.raises(ValueError, match="read-only"):
            values[0] = 1
    with pytest.raises(AttributeError):
        system.mass = 2.0


def test_what_is_given_is_never_shared():
    given = {
        "position": np.arange(6.0).reshape(3, 2),
        "velocity": np.ones((3, 2)),
        "mass": np.ones(3),
        "connections": np.array([[0, 1], [1, 2]], dtype=np.int32),
        "rest_length": np.ones(2),
        "stiffness": np.ones(2),
        "damping": np.ones(2),
    }
    system = triangle(**given)
    for name, values in given.items():
        view = values.view()
        view.flags.writeable = False  # read-only, but not of what the user holds
        for made in (system, triangle(**(given | {name: view})), system.replace(**{name: view})):
            assert not np.shares_memory(getattr(made, name), values)
    assert not np.shares_memory(system.with_velocity(given["velocity"]).velocity, given["velocity"])


NAN, INF = math.nan, math.inf
BAD = [
    ({"position": [0.0, 1.0, 2.0]}, r"position has shape \(3,\)"),
    ({"position": np.zeros((3, 4))}, r"position has shape \(3, 4\)"),
    ({"position": np.zeros((0, 2)), "mass": 1.0, "connections": ()}, r"position has shape \(0, 2\)"),
    ({"position": [[0, 0], [1, NAN], [2, 2]]}, r"position\[1, 1\] is nan"),
    ({"position": None}, "position must be an array of numbers, not None"),
    ({"position": [[0.0, 0.0], [1.0]]}, "position must be an array of numbers"),
    ({"velocity": np.zeros((4, 2))}, r"velocity has shape \(4, 2\).*\(3, 2\)"),
    ({"velocity": [[0, 0], [0, 0], [NAN, 0]]}, r"velocity\[2, 0\] is nan"),
    ({"velocity": (INF, 0.0)}, r"velocity\[0\] is inf"),
    ({"mass": [1.0, 0.0, 1.0]}, r"mass\[1\] is 0"),
    ({"mass": [1.0, NAN, 1.0]}, r"mass\[1\] is nan"),
    ({"mass": [1.0, 2.0]}, r"mass has shape \(2,\).*3 numbers"),
    ({"mass": [1.0, INF, 1.0], "velocity": (0.0, 3.0)}, r"velocity\[1, \d\] is .*pinned"),
    ({"connections": [[0, 3]]}, r"connections\[0, 1\] is 3.*0 to 2"),
    ({"connections": [[0, 1], [-1, 2]]}, r"connections\[1, 0\] is -1"),
    ({"connections": [[0, 1], [2, 2]]}, r"connections\[1\] joins particle 2 with itself"),
    ({"connections": [[0.0, 1.0]]}, r"connections .*float64.*whole numbers"),
    ({"connections": None}, r"connections .*object.*whole numbers"),
    ({"connections": [0, 1]}, r"connections has shape \(2,\)"),
    ({"connections": [[0, 1, 2]]}, r"connections has shape \(1, 3\)"),
    ({"connections": [[0, 2**40]]}, r"connections\[0, 1\] is 1099511627776"),
    ({"rest_length": 0.0}, r"rest_length is 0"),
    ({"rest_length": [1.0, -1.0, 1.0]}, r"rest_length\[1\] is -1"),
    ({"rest_length": INF}, r"rest_length is inf"),
    ({"position": np.zeros((3, 2))}, r"rest_length\[0\] is 0"),  # coincident: the default is no length
    ({"stiffness": [1.0, 1.0, -0.5]}, r"stiffness\[2\] is -0.5"),
    ({"stiffness": INF}, r"stiffness is inf"),
    ({"stiffness": np.ones((3, 1))}, r"stiffness has shape \(3, 1\)"),
    ({"damping": -1e-9}, r"damping is -1e-09"),
    ({"damping": "much"}, "damping must be an array of numbers, not 'much'"),
]


@pytest.mark.parametrize(("changes", "message"), BAD, ids=[message for _, message in BAD])
def test_bad_input_is_named(changes, message):
    with pytest.raises(ValueError, match=message):
        triangle(**changes)


def test_connections_as_any_whole_numbers():
    for kind in (np.uint8, np.int64, list):
        given = [[0, 1]] if kind is list else np.array([[0, 1]], dtype=kind)
        assert triangle(connections=given).connections.dtype == np.int32


def test_surface_must_lie_on_the_particles():
    surface = Surface(particle=[0, 1, 5], uv=0.0, triangles=[[0, 1, 2]])
    with pytest.raises(ValueError, match=r"surface.particle\[2\] is 5.*0 to 2"):
        triangle(surface=surface)
