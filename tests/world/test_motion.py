"""Motions: where they put a thing at many times is where they put it at each."""

import math

import numpy as np
import pytest

from msdwarp.world.motion import pose, poses

TIMES = np.linspace(0.0, 1.3, 42)
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
    matrices, shifts = poses("it", motion, CENTRE[dim], TIMES, 1e9)
    for k, time in enumerate(map(float, TIMES)):
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
        (lambda t: 1 / (t - TIMES[3]), r"it has no place at 0 s: motion\(0\) is"),
    ],
)
def test_what_is_no_pose_is_named_with_its_time(motion, message):
    with pytest.raises(ValueError, match=message):
        poses("it", motion, CENTRE[2], TIMES, 1e6)
