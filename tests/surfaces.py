"""What is drawn of a body: its triangles, what they enclose, and the cells behind them."""

import itertools

import numpy as np

from msdwarp import System


def areas(system: System) -> np.ndarray:
    """Return the area vector of each triangle [triangle_count, 3] of a surface whose vertices are particles."""
    corners = system.position[system.surface.particle[system.surface.triangles]]
    return np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) / 2


def triangles_of(system: System) -> np.ndarray:
    """Return the corners of the triangles that are drawn, shape [triangle_count, 3, d]."""
    return system.surface.points(system.position)[system.surface.triangles]


def area_vectors(system: System) -> np.ndarray:
    """Return the area vector of each triangle that is drawn, shape [triangle_count, 3]."""
    a, b, c = triangles_of(system).transpose(1, 0, 2)
    return np.cross(b - a, c - a) / 2


def area(system: System) -> float:
    return np.linalg.norm(area_vectors(system), axis=1).sum()


def volume(system: System) -> float:
    """Return the volume that a surface which faces outwards encloses, by the divergence theorem."""
    return np.linalg.det(triangles_of(system)).sum() / 6


def normals(system: System) -> np.ndarray:
    """Return the normal of each vertex as it is drawn: of the triangles around all that share it."""
    surface = system.surface
    sums = np.zeros((len(surface.uv), 3))
    own = np.arange(len(sums)) if surface.normal_of is None else surface.normal_of
    for k in range(3):
        np.add.at(sums, own[surface.triangles[:, k]], area_vectors(system))
    return sums[own] / np.linalg.norm(sums[own], axis=1, keepdims=True)


def assert_closed(system: System) -> None:
    """Check that vertices in one place are exactly there, and each edge is walked once in either direction."""
    _, place = np.unique(system.surface.points(system.position), axis=0, return_inverse=True)
    corners = place.ravel()[system.surface.triangles]
    edges = np.concatenate([corners[:, [0, 1]], corners[:, [1, 2]], corners[:, [2, 0]]])
    there = {tuple(edge) for edge in edges.tolist()}
    assert len(there) == len(edges)
    assert {(b, a) for a, b in there} == there


def cells_of(system: System, spacing: float) -> np.ndarray:
    """Return the corners of all whole cells as particles, shape [cell_count, 2^d], from their positions alone."""
    places = np.rint((system.position - system.position.min(axis=0)) / spacing).astype(int)
    flat = not np.ptp(places[:, -1])
    key = (1, 10**4, 10**8)[: system.dim]  # more than there are particles along an axis
    particle = np.argsort(places @ key)
    known = (places @ key)[particle]
    steps = itertools.product((0, 1), repeat=system.dim)
    sought = np.stack([(places + step) @ key for step in steps if not (flat and step[-1])], axis=1)
    found = np.clip(np.searchsorted(known, sought), 0, len(known) - 1)
    return particle[found][(known[found] == sought).all(axis=1)]


def nearest_distances(p: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Return the distances [n] of points from triangles [n, 3, 3], by the least over their inside and their sides.

    Inside: the foot on the plane, by least squares, where all weights are positive. Sides: the foot on the line,
    clamped to it. No region of the plane around the triangle is told from another. Triangles may be flat.
    """
    best = np.full(len(p), np.inf)
    for i, j in itertools.combinations(range(3), 2):
        a, way = corners[:, i], corners[:, j] - corners[:, i]
        length = (way**2).sum(axis=1)
        t = np.clip(((p - a) * way).sum(axis=1) / np.where(length > 0, length, 1), 0, 1)
        best = np.minimum(best, np.linalg.norm(p - a - t[:, None] * way, axis=1))
    edges = np.stack([corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]], axis=2)
    to = (p - corners[:, 0])[:, :, None]
    weights = np.linalg.pinv(edges) @ to
    inside = (weights[:, 0, 0] > 0) & (weights[:, 1, 0] > 0) & (weights.sum(axis=(1, 2)) < 1)
    return np.where(inside, np.minimum(best, np.linalg.norm(to - edges @ weights, axis=(1, 2))), best)


def winding_number(triangles: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Return how many times a closed surface, triangles [triangle_count, 3, 3], goes around each point.

    Reference: Van Oosterom and Strackee, The solid angle of a plane triangle (1983).
    """
    a, b, c = (triangles[None, :, k] - points[:, None] for k in range(3))
    la, lb, lc = (np.linalg.norm(one, axis=2) for one in (a, b, c))
    volume = (a * np.cross(b, c)).sum(axis=2)
    rest = la * lb * lc + (a * b).sum(axis=2) * lc + (b * c).sum(axis=2) * la + (c * a).sum(axis=2) * lb
    return (2 * np.arctan2(volume, rest)).sum(axis=1) / (4 * np.pi)
