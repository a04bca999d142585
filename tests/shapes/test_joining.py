"""Bodies joined by connections between their particles: which, how long, and what is refused."""

import numpy as np
import pytest
from problems import EPS64
from scipy.spatial import cKDTree

from msdwarp import System, box, chain, join, sheet
from msdwarp.shapes.joining import nearest

LEFT = box((2, 3, 2), 0.5, mass=0.1, stiffness=30.0, damping=0.2).named("left")
RIGHT = LEFT.replace(groups=None).named("right").translate((1.0, 0, 0))
K = {"stiffness": 8.0}


def ties(system: System, *bodies: System) -> np.ndarray:
    """Return what was joined: the connections behind those of the bodies."""
    return system.connections[sum(body.connection_count for body in bodies) :]


def test_named_pairs_are_joined_behind_the_bodies():
    made = join(LEFT, RIGHT, pairs=[(1, 0), (3, 2)], stiffness=[4.0, 5.0], damping=0.5)
    plain, count = LEFT + RIGHT, LEFT.connection_count
    assert ties(made, LEFT, RIGHT).tolist() == [[1, 12], [3, 14]]
    assert made.directions == plain.directions
    assert made.groups.keys() == {"left", "right"}
    for name in ("connections", "rest_length", "stiffness", "damping", "yield_strain"):
        np.testing.assert_array_equal(getattr(made, name)[: 2 * count], getattr(plain, name))
    assert made.stiffness[-2:].tolist() == [4.0, 5.0]
    assert made.damping[-2:].tolist() == [0.5, 0.5]
    np.testing.assert_allclose(made.rest_length[-2:], 0.5, rtol=8 * EPS64)
    assert made.original_length is made.rest_length
    assert join(LEFT, RIGHT, pairs=[(1, 0)], rest_length=0.2, **K).rest_length[-1] == 0.2


def test_neighbours_within_a_distance_are_joined_from_either_side():
    # The faces are six particles each, 0.5 m apart, as far as the distance says but for rounding.
    made = join(LEFT, RIGHT, within=0.5, **K)
    first = LEFT.position[:, 0] > 0
    assert ties(made, LEFT, RIGHT).tolist() == [[i, i + 12 - 1] for i in np.flatnonzero(first)]
    # A fine row above a coarse one: each fine particle has its nearest coarse one, and the other way round.
    fine, coarse = chain(5, 0.25), chain(3, 0.5).translate((0, 0, 0.1))
    pairs = {(0, 5), (1, 5), (2, 6), (3, 6), (4, 7)}
    assert set(map(tuple, ties(join(fine, coarse, within=0.3, **K), fine, coarse).tolist())) == pairs
    turned = ties(join(coarse, fine, within=0.3, **K), fine, coarse)
    assert {(j - 3, i + 5) for i, j in turned.tolist()} == pairs


def test_groups_say_what_is_joined():
    only = join(LEFT, RIGHT, within=0.6, on=([1, 3], "right"), **K)
    assert ties(only, LEFT, RIGHT).tolist() == [[1, 12], [3, 14]]


def test_a_body_is_joined_with_itself():
    # A strip bent to a ring: its ends are one spacing apart, and become a seam.
    strip = sheet((8, 2), 0.1)
    seam = join(strip, on=([0, 8], [7, 15]), within=0.8, **K)
    assert ties(seam, strip).tolist() == [[0, 7], [8, 15]]
    loop = join(chain(6, 0.1), pairs=[(0, 5)], rest_length=0.1, **K)
    assert loop.connections[-1].tolist() == [0, 5]
    assert loop.particle_count == 6


@pytest.mark.parametrize("dim", [1, 2, 3])
@pytest.mark.parametrize("within", [0.02, 0.2, 3.0])
def test_what_is_nearest_is_found(dim, within):
    random = np.random.default_rng(dim)
    x, y = random.random((150, dim)), random.random((120, dim)) * 1.5
    distance, which = cKDTree(y).query(x, distance_upper_bound=within)
    np.testing.assert_array_equal(nearest(x, y, within), np.where(np.isfinite(distance), which, -1))


def test_of_what_is_equally_near_the_first_is_taken():
    assert nearest(np.zeros((1, 2)), np.array([[1.0, 0], [0, 1], [-1, 0], [0, -1]]), 2.0).tolist() == [0]
    assert nearest(np.zeros((1, 1)), np.array([[1.0], [-1.0]]), 1.0).tolist() == [0]
    assert nearest(np.zeros((2, 3)), np.zeros((0, 3)), 1.0).tolist() == [-1, -1]


REFUSED = [
    (lambda: join(LEFT, RIGHT, **K), "within and pairs both select particles"),
    (lambda: join(LEFT, RIGHT, within=1.0, pairs=[(0, 0)], **K), "within and pairs both select particles"),
    (lambda: join(LEFT, 3, within=1.0, **K), "b is 3; it must be a System"),
    (lambda: join(LEFT, RIGHT, within=0.0, **K), "within is 0; it must be a number above 0"),
    (lambda: join(LEFT, RIGHT, within=0.4, **K), "within is 0.4 m; no particle of one body is that near"),
    (lambda: join(LEFT, RIGHT, pairs=[], **K), "pairs is empty"),
    (lambda: join(LEFT, RIGHT, pairs=[(0, 12)], **K), r"pairs\[0, 1\] is 12; it must be an index from 0 to 11"),
    (lambda: join(LEFT, chain(2), pairs=[(0, 2)], **K), r"pairs\[:, 1\]\[0\] is 2; .* from 0 to 1"),
    (lambda: join(LEFT, pairs=[(3, 3)], **K), r"pairs\[0\] is particle 3 with itself"),
    (lambda: join(LEFT, within=1.0, **K), "on must name two parts"),
    (lambda: join(LEFT, RIGHT, within=1.0, on="left", **K), "on is 'left'; it must be two"),
    (lambda: join(LEFT, RIGHT, within=1.0, on=("top", None), **K), r"on\[0\] is 'top'; it must be one of 'left'"),
    (lambda: join(LEFT, RIGHT, pairs=[(0, 0)], on=("left", None), **K), "on is .*; with pairs"),
    (lambda: join(LEFT, LEFT, within=0.1, **K), "particles 0 and 0 lie in one place, where a spring has no"),
    (lambda: join(LEFT, RIGHT, within=1.0, rest_length="then", **K), "rest_length is 'then'"),
    (lambda: join(LEFT, RIGHT, within=1.0, rest_length=0.0, **K), "rest_length is 0; it must be above 0"),
    (lambda: join(LEFT, RIGHT, within=1.0, stiffness=-1.0), "stiffness is -1; it must be at least 0"),
    (lambda: join(LEFT, RIGHT, within=1.0, damping=np.nan, **K), "damping is nan"),
    (lambda: join(LEFT, chain(2, dim=2), pairs=[(0, 0)], **K), "cannot add a system of 2 coordinates"),
]


@pytest.mark.parametrize(("make", "message"), REFUSED, ids=[message for _, message in REFUSED])
def test_what_cannot_be_joined_is_refused(make, message):
    with pytest.raises(ValueError, match=message):
        make()
