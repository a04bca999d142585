"""The fields of a system that say how its connections break: kept, and refused where bad."""

import math

import numpy as np
import pytest
from springs import pair

FIELDS = ("break_strain", "break_force", "broken_at")


def test_systems_keep_their_break_fields():
    weak = pair(1.2, break_strain=0.5, break_force=30.0, broken_at=1.5)
    plain = pair(1.1)
    both = weak + plain
    assert both.tears
    assert not plain.tears
    assert both.broken.tolist() == [True, False]
    for name in FIELDS:
        np.testing.assert_array_equal(getattr(both, name), [getattr(weak, name)[0], math.inf])
    for moved in (
        weak.translate((1, 0, 0)),
        weak.rotate(1.0),
        weak.pin(0),
        weak.named("it"),
        weak.set_rest_shape(),
    ):
        for name in FIELDS:
            np.testing.assert_array_equal(getattr(moved, name), getattr(weak, name))


@pytest.mark.parametrize("fields", [{"break_strain": 0.1}, {"break_force": 1.0}, {"broken_at": 0.0}])
def test_each_of_them_tears(fields):
    assert pair(1.0, **fields).tears


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"break_strain": -0.1}, r"break_strain is -0.1; it must be at least 0 \(inf never breaks\)"),
        ({"break_force": -1.0}, r"break_force is -1; it must be at least 0 \(inf never breaks\)"),
        ({"broken_at": -1.0}, r"broken_at is -1; it must be at least 0 \(inf is whole\)"),
        ({"broken_at": math.nan}, r"broken_at is nan"),
        ({"break_strain": [0.1, 0.2]}, r"break_strain has shape \(2,\)"),
        (
            {"break_strain": 0.3},
            r"break_strain\[0\] is 0.3; it must be at least 0.5, with which the connection starts",
        ),
        (
            {"break_force": 20.0},
            r"break_force\[0\] is 20; it must be at least 25, with which the connection starts",
        ),
    ],
)
def test_bad_break_fields_are_named(fields, message):
    with pytest.raises(ValueError, match=message):
        pair(1.5, **fields)
    with pytest.raises(ValueError, match=message):
        pair(1.5).replace(**fields)


def test_what_is_broken_need_not_bear_the_start():
    assert pair(1.5, break_strain=0.3, broken_at=0.0).broken[0]
    # Nor does a system on its way: it breaks as it goes on.
    assert pair(1.0, break_strain=0.3).replace(position=[[0, 0, 0], [1.5, 0, 0]]).strain[0] == 0.5
