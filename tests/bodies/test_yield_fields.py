"""The fields of a system that say how its connections yield: kept, and refused where bad."""

import math

import numpy as np
import pytest
from springs import pair

FIELDS = ("yield_strain", "relaxation_time", "largest_plastic_strain", "original_length")


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
    for name, of_plain in zip(FIELDS, (math.inf, 0.1, 0.5, 1.0), strict=True):
        expected = [getattr(yielding, name)[0], of_plain]
        np.testing.assert_array_equal(getattr(both, name), expected)
        np.testing.assert_array_equal(getattr(plain + yielding, name), expected[::-1])
    for moved in (yielding.translate((1, 0, 0)), yielding.rotate(1.0), yielding.pin(0), yielding.named("it")):
        for name in (*FIELDS, "rest_length"):
            np.testing.assert_array_equal(getattr(moved, name), getattr(yielding, name))
    frozen = yielding.set_rest_shape()
    assert frozen.rest_length[0] == frozen.original_length[0] == yielding.length[0]
    assert frozen.yield_strain[0] == 0.1
    longer = yielding.replace(rest_length=1.3)
    assert longer.original_length[0] == 1.3
    assert yielding.replace(stiffness=1.0).original_length[0] == 1.0


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"yield_strain": -0.1}, r"yield_strain is -0.1; it must be at least 0 \(inf never yields\)"),
        ({"yield_strain": math.nan}, r"yield_strain is nan"),
        ({"relaxation_time": -1.0}, r"relaxation_time is -1"),
        ({"relaxation_time": math.inf}, r"relaxation_time is inf"),
        ({"largest_plastic_strain": 1.0}, r"largest_plastic_strain is 1; .* below 1"),
        ({"largest_plastic_strain": -0.1}, r"largest_plastic_strain is -0.1"),
        ({"original_length": 0.0}, r"original_length is 0; it must be above 0"),
        ({"yield_strain": [0.1, 0.2]}, r"yield_strain has shape \(2,\)"),
    ],
)
def test_bad_yield_fields_are_named(fields, message):
    with pytest.raises(ValueError, match=message):
        pair(1.0, **fields)
