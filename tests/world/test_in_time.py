"""Functions of time, and motions, give the same whether they are asked once for all times, or for each."""

import math

import numpy as np
import pytest

from msdwarp.world.motion import pose, poses
from msdwarp.world.time_functions import sampled

TIMES = np.linspace(0.3, 2.2, 40)


def branching(t):
    return (0.0, 0.0, -t) if t < 1 else (0.0, 0.0, -1.0)


@pytest.mark.parametrize(
    ("function", "calls"),
    [
        (lambda t: 2.0, 4),
        (lambda t: t**2, 4),
        (lambda t: (0.0, 0.0, -t), 4),
        (lambda t: (0.0, np.interp(t, (0, 1), (0, 3)), 1), 4),
        (lambda t: ((0.0, t, 1.0), (0.0, 0.0, 2 * t)), 4),
        (lambda t: (np.zeros(3), t), 4),
        (lambda t: np.stack([t, np.sin(t)]), 4),
        (lambda t: np.array([0.0, 0.0, float(t)]), 44),
        (lambda t: (math.sin(t), 0.0), 44),
        (branching, 44),
        (lambda t: (t, t) if np.ndim(t) == 0 else t, 44),  # not as many numbers
        (lambda t: 3.0 * np.max(t), 44),  # other numbers
    ],
)
def test_all_at_once_is_each_in_turn(function, calls):
    called = []

    def counted(t):
        called.append(t)
        return function(t)

    found = sampled(counted, TIMES)
    expected = [np.concatenate([np.atleast_1d(part) for part in _parts(function(float(t)))]) for t in TIMES]
    # NumPy may compute a function of an array another unit in the last place than that of a number.
    np.testing.assert_allclose(found, expected, rtol=1e-15, atol=1e-15)
    assert len(called) == calls


def _parts(value):
    return value if isinstance(value, tuple) else (value,)


@pytest.mark.parametrize("count", [1, 2, 3, 4, 5])
def test_few_times_are_not_taken_for_coordinates(count):
    # Three times and three coordinates: np.zeros(3) is no array over time.
    found = sampled(lambda t: (np.arange(3.0), t), TIMES[:count])
    np.testing.assert_array_equal(found[:, :3], np.tile(np.arange(3.0), (count, 1)))
    np.testing.assert_array_equal(found[:, 3], TIMES[:count])


def test_an_array_is_the_functions_to_change():
    def spoils(t):
        t -= 1.0
        return t

    np.testing.assert_array_equal(sampled(spoils, TIMES)[:, 0], TIMES - 1.0)


def test_what_goes_wrong_is_said():
    with pytest.raises(ZeroDivisionError):
        sampled(lambda t: 1 / 0, TIMES)
    with pytest.raises(ValueError, match="gives 1 numbers, and at another time 2"):
        sampled(lambda t: (1.0,) if t < 1 else (1.0, 2.0), TIMES)


INSTANTS = np.linspace(0.0, 1.3, 42)
CENTRE = {1: np.array([0.3]), 2: np.array([0.3, -1.7]), 3: np.array([0.3, -1.7, 5.1])}


@pytest.mark.parametrize(
    ("dim", "motion", "turns"),
    [
        (1, lambda t: math.sin(t), False),
        (2, lambda t: (math.sin(t), 0.1), False),
        (2, lambda t: ((math.sin(t), 0.1), math.cos(t)), True),
        (3, lambda t: [math.sin(t), 0, 1], False),
        (3, lambda t: ((math.sin(t), 0, 1), None), False),
        (3, lambda t: ((math.sin(t), 0, 1), (t, math.exp(t), -t)), True),
        (3, lambda t: (np.zeros(3), np.array([0, 1e-200 * float(t), 0])), True),
        (3, lambda t: (0, 0, math.sin(t)) if t < 1 else ((0, 0, math.sin(t)), (0, t, 0)), True),
    ],
)
def test_many_poses_are_each_to_the_last_bit(dim, motion, turns):
    matrices, shifts = poses("it", motion, CENTRE[dim], INSTANTS, 1e9)
    for k, time in enumerate(map(float, INSTANTS)):
        R, o = pose(motion, CENTRE[dim], time)
        np.testing.assert_array_equal(shifts[k], o)
        np.testing.assert_array_equal(matrices[k], R)
    assert (matrices.strides[0] != 0) == turns  # one identity is stored for all times


@pytest.mark.parametrize(
    ("motion", "message"),
    [
        (lambda t: (0.0, 0.0, 0 * t), r"it has no place at 0 s: .* must be 2 finite numbers"),
        (lambda t: (0.0, math.nan if t > 1 else 0.0), r"it has no place at 1.* s: motion\(1.*\) is \(0.0, nan\)"),
        (lambda t: (0.0, t * 1e9), r"it has no place at .* s: displacement\[1\] is .* at most 1e\+06"),
        (lambda t: ((0.0, 0.0), math.inf if t > 1 else 0.0), r"it has no place at 1.* s: turn of motion"),
        (lambda t: ("0", "1"), r"it has no place at 0 s: motion\(0\) must be an array of numbers"),
        (lambda t: 1 / (t - INSTANTS[3]), r"it has no place at 0 s: motion\(0\) is"),
    ],
)
def test_what_is_no_pose_is_named_with_its_time(motion, message):
    with pytest.raises(ValueError, match=message):
        poses("it", motion, CENTRE[2], INSTANTS, 1e6)
