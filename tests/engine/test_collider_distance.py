"""How far away solids are, and which way: against brute force."""

import math

import numpy as np
import pytest
from collisions import distances, level
from problems import EPS64

from msdwarp import Box, Capsule, Cone, Plane, Sphere
from msdwarp.engine.collision.penetration_depth import start_depths
from msdwarp.world.colliders import Collider


def on_surface(collider: Collider, dim: int, rng: np.random.Generator) -> np.ndarray:
    """Return points all over the surface: where rays from inside leave it, by bisection."""
    ways = rng.normal(size=(4000, dim))
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    inside = {
        Plane: lambda c: (c.offset - 1) * c.unit_normal(dim),
        Sphere: lambda c: c.position,
        Box: lambda c: c.position,
        Capsule: lambda c: (np.array(c.start) + c.end) / 2,
        Cone: lambda c: 0.3 * np.array(c.apex) + 0.7 * np.array(c.base),
    }[type(collider)](collider)
    low, high = np.zeros(len(ways)), np.full(len(ways), 40.0)
    for _ in range(60):
        middle = (low + high) / 2
        outside = level(collider, np.array(inside) + middle[:, None] * ways) > 0
        low, high = np.where(outside, low, middle), np.where(outside, middle, high)
    points = np.array(inside) + high[:, None] * ways
    return points[high < 39]


SOLIDS = {
    1: [Plane((-1.0,), offset=0.2), Sphere((0.1,), 0.4), Box((-0.7,), (0.5,))],
    2: [
        Plane((3.0, 4.0), offset=0.2),
        Sphere((0.1, -0.2), 0.4),
        Box((-0.2, 0.1), (0.7, 1.1), 0.6),
        Capsule((-0.3, 0.2), (0.5, -0.1), 0.3),
        Cone((0.2, 0.7), (-0.1, -0.4), 0.5),
    ],
    3: [
        Plane((2.0, -1.0, 2.0), offset=-0.2),
        Sphere((0.1, -0.2, 0.3), 0.4),
        Box((-0.2, 0.1, 0.0), (0.7, 1.1, 0.5), (0.6, -0.9, 0.4)),
        Capsule((-0.3, 0.2, 0.4), (0.5, -0.1, -0.3), 0.3),
        Cone((0.2, 0.7, 0.1), (-0.1, -0.4, 0.3), 0.6),
        Cone((0.0, 0.0, 0.2), (0.0, 0.0, 0.0), 0.9),  # flat: its base is often the nearest
        Box((0.0, 0.0, 0.0), (1.0, 0.2, 0.6)),
    ],
}
every_solid = pytest.mark.parametrize(("dim", "p"), [(dim, p) for dim in SOLIDS for p in range(len(SOLIDS[dim]))])


@every_solid
def test_distances_are_those_of_the_nearest_point_of_the_surface(dim, p):
    collider, rng = SOLIDS[dim][p], np.random.default_rng(dim)
    x = rng.uniform(-1.2, 1.2, (150, dim))
    n, d = distances(SOLIDS[dim], x, p)
    np.testing.assert_allclose(np.linalg.norm(n, axis=1), 1.0, rtol=0, atol=8 * EPS64)  # roundings of a root
    assert np.abs(d).min() > 1e-6  # no place is so near that roundings could choose its side
    np.testing.assert_array_equal(d < 0, level(collider, x) < 0)
    # From above: going by the distance against the normal ends on the surface, to roundings of 1.2 m.
    assert np.abs(level(collider, x - d[:, None] * n)).max() < 20 * EPS64
    # The host computes the same, to roundings of some operations with numbers of 1.2 m.
    np.testing.assert_allclose(-start_depths(x, SOLIDS[dim])[p], d, rtol=0, atol=20 * EPS64)
    # From below: of thousands of points of the surface none is nearer.
    points = on_surface(collider, dim, rng)
    for place, distance in zip(x, d, strict=True):
        assert np.linalg.norm(points - place, axis=1).min() > abs(distance) - 20 * EPS64


@pytest.mark.parametrize("dim", [2, 3])
def test_where_all_ways_out_are_alike_one_is_taken(dim):
    # Centres, axes and corners: a unit normal and the right distance, whatever the direction.
    up = np.eye(dim)[-1]
    for collider, place, depth in (
        (Sphere(tuple(0 * up), 0.4), 0 * up, -0.4),
        (Capsule(tuple(-up), tuple(up), 0.3), 0.2 * up, -0.3),
        (Cone(tuple(up), tuple(0 * up), 1.0), 0.5 * up, -math.sqrt(0.125)),  # 0.5 m below an apex of 45°
        (Cone(tuple(up), tuple(0 * up), 1.0), 0.1 * up, -0.1),
        (Cone(tuple(up), tuple(0 * up), 1.0), 3.0 * up, 2.0),
        (Box(tuple(0 * up), (1.0,) * dim), 0 * up, -0.5),
    ):
        n, d = distances([collider, *SOLIDS[dim]], np.array([place]), 0)  # of all kinds, as above
        assert np.linalg.norm(n) == pytest.approx(1.0, abs=4 * EPS64)
        assert d[0] == pytest.approx(depth, abs=4 * EPS64)
