"""Checks: an error names what the user gave, a number as a number and an array's entry as an entry."""

import numpy as np
import pytest

import msdwarp as msd
from msdwarp import checks

POSITIVE = (lambda values: values > 0, "above 0")


@pytest.mark.parametrize(
    ("given", "shape", "message"),
    [
        (-3.0, (4,), r"^k is -3; it must be above 0$"),
        (-3, (1,), r"^k is -3; it must be above 0$"),
        (-0.25, (4,), r"^k is -0.25; it"),
        (1e300 * -1e10, (4,), r"^k is -inf; it"),
        ([1.0, -3.0, 1.0], (3,), r"^k\[1\] is -3.0; it"),
        ([-3.0] * 3, (3,), r"^k\[0\] is -3.0; it"),  # an array was given, though of one number
        ([1.0, 2.0, -3.0], (5, 3), r"^k\[2\] is -3.0; it"),  # a row for all
        ([[1.0, 1.0, 1.0], [1.0, 1.0, -3.0]], (2, 3), r"^k\[1, 2\] is -3.0; it"),
        ([[1.0], [-2.0]], (2, 3), r"^k\[1\] is -2.0; it"),
    ],
)
def test_what_was_given_is_named(given, shape, message):
    with pytest.raises(ValueError, match=message):
        checks.within("k", checks.broadcast("k", given, shape), POSITIVE)


def test_an_entry_is_named_where_it_alone_may_not_be_what_all_are():
    # The same velocity for all, and the second particle may not have it.
    values = np.broadcast_to([0.0, 3.0], (3, 2))
    holds = np.array([[True, True], [True, False], [True, True]])
    with pytest.raises(ValueError, match=r"^velocity\[1, 1\] is 3.0; it must be 0: it is pinned$"):
        checks.every("velocity", values, holds, "0: it is pinned")


def test_bodies_name_their_numbers():
    with pytest.raises(ValueError, match=r"^stiffness is -3; it must be at least 0$"):
        msd.box((2, 2, 2), stiffness=-3.0)
    with pytest.raises(ValueError, match=r"^mass\[1\] is -1.0; it must be above 0"):
        msd.chain(3, mass=[1.0, -1.0, 1.0])
