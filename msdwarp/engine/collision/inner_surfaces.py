"""Inner surfaces of closed bodies: bodies may overlap, but their inner surfaces may not cross.

An inner surface has the triangles of the drawn one. Each of its vertices lies on the chord from a drawn vertex to
the opposite side of the body. So it is a weighted mean of four drawn vertices, and moves with them.
"""

import numpy as np
import warp as wp
from numpy.typing import NDArray

from ...bodies import TouchingSurfaces
from ...kernels.filling import cast_rays
from .contact_rules import ContactRules

INSET = 0.25
"""Depth of inner surfaces, as a fraction of the spacing. So a corner goes at most half a spacing deep into another
body: not beyond the middle of a body of one cell."""
MOST_OF_CHORD = 0.3
"""Largest fraction of the chord to the opposite side: below a half, so that two sides do not meet."""
FLAT = 0.05
"""Directions in which the mean square of the normals around a vertex is below this are ignored."""
ABOVE = 0.02
"""Depth at which rays begin, over the depth of the inner vertex: they must not hit the surface there."""


def have_inner_surfaces(surfaces: TouchingSurfaces, rules: ContactRules) -> NDArray[np.bool_]:
    """Return which bodies have an inner surface: closed ones, if any two of them may touch."""
    count = np.bincount(rules.kind[surfaces.closed], minlength=len(rules.table))
    pairs = np.outer(count, count) - np.diag(count)
    return surfaces.closed & bool(((rules.table >= 0) & (pairs > 0)).any())


def chords(
    surfaces: TouchingSurfaces, x: NDArray[np.float64], bodies: NDArray[np.bool_]
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return the four surface vertices that each inner vertex is a mean of, and weights, [vertex_count, 4] each.

    They are the vertex itself and the three of the opposite facet; all −1 outside `bodies`. Surface vertices are
    at x [m], shape [vertex_count, 3].
    """
    chord, weight = np.full((len(x), 4), -1), np.zeros((len(x), 4))
    vertex = np.flatnonzero(bodies[surfaces.body])
    if not len(vertex):
        return chord, weight
    corner = surfaces.corner[bodies[surfaces.body[surfaces.corner[:, 0]]]]
    way = _inward(surfaces, x, corner)[vertex]
    origin = x[vertex].mean(axis=0)
    body = wp.array(surfaces.body[corner[:, 0]], dtype=int, device="cpu")
    points = wp.array(x - origin, dtype=wp.vec3, device="cpu")
    mesh = wp.Mesh(points, wp.array(corner.ravel(), dtype=int, device="cpu"), groups=body)
    start, along = (wp.array(one, dtype=wp.vec3, device="cpu") for one in (x[vertex] - origin + ABOVE * way, way))
    of = wp.array(surfaces.body[vertex], dtype=int, device="cpu")
    hit = wp.zeros(len(vertex), dtype=wp.vec4, device="cpu")  # facet, weights of its first two corners, distance
    wp.launch(cast_rays, len(vertex), [mesh.id, of, start, along], [hit], device="cpu")
    facet, first, second, length = hit.numpy().astype(np.float64).T
    # If a ray meets nothing, since the surface has a tiny hole, the inner vertex is the drawn one.
    share = np.where(facet >= 0, np.minimum(1.0 / (ABOVE + length), MOST_OF_CHORD), 0.0)
    chord[vertex] = np.column_stack([vertex, corner[facet.astype(int)]])
    opposite = np.column_stack([first, second, 1.0 - first - second])
    weight[vertex] = np.column_stack([1.0 - share, share[:, None] * opposite])
    return chord, weight


def _inward(surfaces: TouchingSurfaces, x: NDArray[np.float64], corner: NDArray[np.int32]) -> NDArray[np.float64]:
    """Return the displacement [m] of each vertex inwards; its length is that of the inset.

    The planes of all triangles around the vertex are equally far from the displaced vertex, or nearly so.
    """
    a, b, c = x[corner].transpose(1, 0, 2)
    area = np.cross(b - a, c - a)
    size = np.linalg.norm(area, axis=1)
    normal = area / np.maximum(size, 1e-300)[:, None]
    spread, mean, total = np.zeros((len(x), 3, 3)), np.zeros((len(x), 3)), np.zeros(len(x))
    for k in range(3):
        np.add.at(spread, corner[:, k], size[:, None, None] * normal[:, :, None] * normal[:, None, :])
        np.add.at(mean, corner[:, k], area)
        np.add.at(total, corner[:, k], size)
    values, axes = np.linalg.eigh(spread)
    along = np.einsum("vik,vi->vk", axes, mean)
    counts = values > FLAT * np.maximum(total, 1e-300)[:, None]
    inset = INSET * surfaces.spacing[surfaces.body]
    way = -np.einsum("vik,vk->vi", axes, np.where(counts, along / np.where(counts, values, 1.0), 0.0))
    return inset[:, None] * way / np.maximum(np.linalg.norm(way, axis=1), 1e-300)[:, None]


def inner_vertices(
    surfaces: TouchingSurfaces, chord: NDArray[np.int64], weight: NDArray[np.float64]
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]]:
    """Return how many particles each inner vertex is a mean of, these particles, and their weights."""
    vertex, k = np.nonzero(weight)
    drawn = chord[vertex, k]
    particle, share = surfaces.particle[drawn], surfaces.weight[drawn] * weight[vertex, k][:, None]
    present = share != 0
    keys, share = (vertex[:, None] * len(surfaces.body_of_particle) + particle)[present], share[present]
    different, which = np.unique(keys, return_inverse=True)
    vertex, particle = np.divmod(different, len(surfaces.body_of_particle))
    return (
        np.bincount(vertex, minlength=len(chord)),
        particle,
        np.bincount(which, weights=share).astype(np.float64),
    )
