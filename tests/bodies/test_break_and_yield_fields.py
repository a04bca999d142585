"""The fields of a system that say how its connections break and yield: kept, and refused where bad."""

import math

import numpy as np
import pytest
from springs import pair

FIELDS = ("break_strain", "break_force", "broken_at")
YIELD_FIELDS = ("yield_strain", "relaxation_time", "largest_plastic_strain", "original_length")


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


def test_systems_keep_their_yield_fields():
    yielding = pair(
        1.4,
        rest_length=1.2,
        original_length=1.0,
        yield_strain=0.1,
        relaxation_time=0.3,
        largest_plastic_strain=0.4,
    )
    plain = pair(1.1)
    both = yielding + plain
    assert both.yields
    assert not plain.yields
    for name, of_plain in zip(YIELD_FIELDS, (math.inf, 0.1, 0.5, 1.0), strict=True):
        expected = [getattr(yielding, name)[0], of_plain]
        np.testing.assert_array_equal(getattr(both, name), expected)
        np.testing.assert_array_equal(getattr(plain + yielding, name), expected[::-1])
    for moved in (yielding.translate((1, 0, 0)), yielding.rotate(1.0), yielding.pin(0), yielding.named("it")):
        for name in (*YIELD_FIELDS, "rest_length"):
            np.testing.assert_array_equal(getattr(moved, name), getattr(yielding, name))
    frozen = yielding.set_rest_shape()
    assert frozen.rest_length[0] == frozen.original_length[0] == yielding.length[0]
    assert frozen.yield_strain[0] == 0.1
    longer = yielding.replace(rest_length=1.3)
    assert longer.original_length[0] == 1.3
    assert yielding.replace(stiffness=1.0).original_length[0] == 1.0


@pytest.mark.parametrize("fields", [{"break_strain": 0.1}, {"break_force": 1.0}, {"broken_at": 0.0}])
def test_each_of_them_tears(fields):
    assert pair(1.0, **fields).tears


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"break_strain": -0.1}, r"break_strain is -0.1; it must be at least 0 \(inf never breaks\)"),
        ({"break_force": -1.0}, r"break_force is -1; it must be at least 0 \(inf never breaks\)"),
        ({"broken_at": -1.0}, r"broken_at is -1; it must be at least 0 \(inf is whole\)"),
        ({"yield_strain": -0.1}, r"yield_strain is -0.1; it must be at least 0 \(inf never yields\)"),
        ({"yield_strain": math.nan}, r"yield_strain is nan"),
        ({"relaxation_time": -1.0}, r"relaxation_time is -1"),
        ({"relaxation_time": math.inf}, r"relaxation_time is inf"),
        ({"largest_plastic_strain": 1.0}, r"largest_plastic_strain is 1; .* below 1"),
        ({"largest_plastic_strain": -0.1}, r"largest_plastic_strain is -0.1"),
        ({"original_length": 0.0}, r"original_length is 0; it must be above 0"),
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
def test_bad_fields_are_named(fields, message):
    with pytest.raises(ValueError, match=message):
        pair(1.5, **fields)
    with pytest.raises(ValueError, match=message):
        pair(1.5).replace(**fields)


def test_what_is_broken_need_not_bear_the_start():
    assert pair(1.5, break_strain=0.3, broken_at=0.0).broken[0]
    # Nor does a system on its way: it breaks as it goes on.
    assert pair(1.0, break_strain=0.3).replace(position=[[0, 0, 0], [1.5, 0, 0]]).strain[0] == 0.5
