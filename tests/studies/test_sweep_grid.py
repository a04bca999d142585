"""What lists and ranges of a sweep stand for, and those that stand for nothing."""

import re

import numpy as np
import pytest

from msdwarp.studies.grid import checked_grid, points, values_of


@pytest.mark.parametrize(
    ("text", "values"),
    [
        ("1,2,5", ["1", "2", "5"]),
        ("0:4", ["0", "1", "2", "3"]),
        ("-2:1", ["-2", "-1", "0"]),
        ("1:3:5", ["1", "1.5", "2", "2.5", "3"]),
        ("3:1:3", ["3", "2", "1"]),
        ("1e3:1e5:log:3", ["1000", "10000", "100000"]),
        ("7,10:12,20:40:3", ["7", "10", "11", "20", "30", "40"]),
        ("rk4,leapfrog", ["rk4", "leapfrog"]),
        ("cuda:0,cuda:1", ["cuda:0", "cuda:1"]),
        ("5", None),
        ("cuda:0", None),
        ("out/sweep", None),
    ],
)
def test_what_a_text_stands_for(text, values):
    assert values_of("it", text) == values


def test_ranges_that_share_values_share_them_to_the_last_bit():
    coarse, fine = values_of("it", "1e3:1e5:log:5"), values_of("it", "1e3:1e5:log:9")
    assert coarse is not None
    assert fine is not None
    assert fine[::2] == coarse
    np.testing.assert_allclose(
        [float(one) for one in fine], np.geomspace(1e3, 1e5, 9), rtol=1e-11
    )  # twelve digits


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("1:", "stiffness is '1:'; it must be a value, a list such as 1,2,5"),
        ("1:2:lg:3", "stiffness is '1:2:lg:3'; it must be"),
        ("1,,2", "it must be a value"),
        ("0.5:3", "it must be a value"),
        ("5:2", "5:2 holds no number"),
        ("3:3:4", "must be at least 2 values between two numbers"),
        ("-1:1:log:3", "both ends of -1:1:log:3 must be above 0"),
        ("0:1e999:4", "must be at least 2 values between two numbers"),
        ("0:10000000", "stiffness has 10000000 values; a sweep has at most 1000000 points"),
        ("1,2,1", "stiffness has the value 1 twice"),
    ],
)
def test_what_stands_for_nothing_is_named(text, said):
    with pytest.raises(ValueError, match=re.escape(said)):
        values_of("stiffness", text)


def test_a_grid_of_python_is_one_of_json():
    grid = checked_grid({"a": np.array([1.0, 2.5]), "b": "0:2", "c": [True, None], "d": "rk4", "e": range(2)})
    assert grid == {"a": [1, 2.5], "b": [0, 1], "c": [True, None], "d": ["rk4"], "e": [0, 1]}
    made = list(points({"a": [1, 2], "b": [3, 4]}))
    assert made == [{"a": 1, "b": 3}, {"a": 1, "b": 4}, {"a": 2, "b": 3}, {"a": 2, "b": 4}]


@pytest.mark.parametrize(
    ("grid", "said"),
    [
        (3, "grid is 3; it must be a mapping"),
        ({}, "nothing is swept"),
        ({"a": []}, "grid['a'] is empty"),
        ({"a": 3}, "grid['a'] is 3; it must be a sequence of values"),
        ({"a": [1, float("nan")]}, "grid['a'][1] is nan; it must be a finite number"),
        ({"a": [[1, 2]]}, "grid['a'][0] is [1, 2]; it must be a finite number"),
        ({"a": [1, 1.0]}, "grid['a'] has the value 1 twice"),
        ({"a": range(2000), "b": range(2000)}, "grid has 4000000 points"),
        ({3: [1]}, "a name in grid is 3; it must be a str"),
    ],
)
def test_what_is_no_grid_is_named(grid, said):
    with pytest.raises(ValueError, match=re.escape(said)):
        checked_grid(grid)
