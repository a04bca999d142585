"""Surfaces for contact: vertices, points and facets of the bodies of a system."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .connectivity import pieces
from .facets import FINE, different_vertices, open_edges, sides_of, with_lattice_facets, with_particles
from .selection import mask_of
from .system import System

CORDS = 2.0
"""A body without surface is a rope or a net if it has at most so many springs per particle; otherwise a heap of
spheres. Springs that resist bending do not count."""
SPACING = 0.75
"""Ratio of a lattice's spacing to the mean length of its springs, many of which are diagonals."""
SOLID_RADIUS, SHEET_RADIUS, ROPE_RADIUS = 0.25, 0.125, 0.25
"""Radius of the shell around the contact mesh of a solid body, a sheet, and a rope or sphere, over the spacing.

The mesh of a solid body lies so far below its surface."""
NEAR, FAR, HOPS = 0.6, 2.4, 3
"""Distances in spacings, and the number of springs, within which a vertex finds a particle to be moved towards."""
LEAST_COSINE, GOOD_COSINE, SHORTER = 0.3, 0.975, 0.02
"""The least cosine of its direction with the normal; with which it looks no further; for how much less cosine a
particle may be a spacing nearer."""
LARGEST_WEIGHT = 0.6
"""Largest weight of the particle towards which a vertex is moved."""
AT_A_TIME = 2**12
"""Vertices that are moved at a time: what is computed for them fits a processor's cache."""
DETERMINED = 0.05
"""Least fraction of the area around a vertex that determines a direction: a flat face only its normal."""


class TouchingSurfaces(NamedTuple):
    """The contact meshes of all bodies of a system. A body is a set of particles joined by springs.

    That of a solid body is its drawn surface, moved inwards by its radius: the body touches where it is drawn.
    """

    particle: NDArray[np.int64]
    """The particles whose weighted mean is each vertex, shape [vertex_count, k]."""
    weight: NDArray[np.float64]
    """Weights of these particles, shape [vertex_count, k]."""
    ends: NDArray[np.int32]
    """The two vertices of each contact point, shape [point_count, 2]; equal if the point is a vertex."""
    fraction: NDArray[np.float64]
    """How far each point is from its first vertex to its second: the weight of the second, shape [point_count]."""
    corner: NDArray[np.int32]
    """Vertices of each facet, shape [facet_count, 3], some equal for segments and points; grouped by body."""
    body: NDArray[np.int32]
    """The body of each vertex, shape [vertex_count]."""
    body_of_particle: NDArray[np.int32]
    """The body of each particle, shape [particle_count]."""
    solid: NDArray[np.bool_]
    """Whether the surface of each body has an inside, shape [body_count]."""
    spacing: NDArray[np.float64]
    """Spacing of each body's particles, from the mean length of its springs [m]; 0 for a single particle."""
    radius: NDArray[np.float64]
    """Radius of the shell of each body around its facets, half of its thickness [m]."""
    stiffness: NDArray[np.float64]
    """Mean stiffness of each body's springs [N/m]; 0 without springs."""

    def points(self, x: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the positions of the vertices for particles at x [m], shape [vertex_count, 3]."""
        return np.einsum("vk,vkd->vd", self.weight, x[self.particle])


def contact_surfaces(system: System, shape: NDArray[np.float64] | None = None) -> TouchingSurfaces:
    """Return the surfaces that a system has for contact.

    `shape` has positions from which to find how far vertices lie inside [m], shape [particle_count, 3]; by default
    the system's. For all states of one motion it must be the same, so that these have the same vertices.
    """
    x = system.position if shape is None else shape
    lowest = pieces(system.particle_count, system.connections)
    _, body_of = np.unique(lowest, return_inverse=True)
    bodies = int(body_of.max()) + 1
    if system.surface is None:
        particle, weight = np.zeros((0, 1), dtype=np.int64), np.zeros((0, 1))
        triangles = np.zeros((0, 3), dtype=np.int64)
    else:
        vertices = different_vertices(system.surface)
        particle, weight, triangles = with_lattice_facets(system.connections, body_of, *vertices)
    body = body_of[particle[:, 0]]
    drawn = mask_of(body, bodies)
    # In bodies without a surface, particles touch instead.
    bare = np.flatnonzero(~drawn[body_of])
    first = len(particle)
    vertex_of = np.full(system.particle_count, -1)
    vertex_of[bare] = first + np.arange(len(bare))
    particle, weight = with_particles(particle, weight, bare)
    body = body_of[particle[:, 0]]
    near = system.between_neighbors
    pairs = system.connections if near is None else system.connections[near]
    between_bare = ~drawn[body_of[pairs[:, 0]]]
    count = np.bincount(body_of, minlength=bodies)
    joined = np.bincount(body_of[pairs[:, 0]], minlength=bodies)
    rope = ~drawn & (joined > 0) & (joined <= CORDS * count)
    segments = vertex_of[pairs[between_bare & rope[body_of[pairs[:, 0]]]]]
    spheres = vertex_of[bare[~rope[body_of[bare]]]]
    edges = np.concatenate([sides_of(triangles)[0], segments]).astype(np.int32)
    corner = np.concatenate([triangles, segments[:, [0, 1, 1]], np.repeat(spheres[:, None], 3, axis=1)])
    corner = corner[np.argsort(body[corner[:, 0]], kind="stable")]
    # Surfaces that are not much finer than their lattice also have a contact point in the middle of each edge.
    carried = np.bincount(body_of[np.unique(particle[weight != 0])], minlength=bodies)
    fine = np.bincount(body, minlength=bodies) > FINE * carried
    edges = edges[~fine[body[edges[:, 0]]]]
    ends = np.concatenate([np.repeat(np.arange(len(particle))[:, None], 2, axis=1), edges])
    fraction = np.repeat([0.0, 0.5], [len(particle), len(edges)])

    # From original lengths, so that motion and yielding do not change the thickness.
    spacing = spring_means(system, body_of, system.original_length) * np.where(rope, 1.0, SPACING)
    solid = drawn.copy()
    solid[body[open_edges(triangles)[:, 0]]] = False
    relative_radius = np.where(solid, SOLID_RADIUS, np.where(drawn, SHEET_RADIUS, ROPE_RADIUS))
    # By places, which worlds with other rest lengths share.
    apart = np.diff(x[system.connections], axis=1)[:, 0]
    placed = SPACING * spring_means(system, body_of, np.linalg.norm(apart, axis=1))[body]
    inset = np.where(solid[body], SOLID_RADIUS * placed, 0.0)
    particle, weight = _moved_inwards(system.connections, x, particle, weight, triangles, inset, placed)
    return TouchingSurfaces(
        particle,
        weight,
        ends.astype(np.int32),
        fraction,
        corner.astype(np.int32),
        body.astype(np.int32),
        body_of.astype(np.int32),
        solid,
        spacing,
        relative_radius * spacing,
        spring_means(system, body_of, system.stiffness),
    )


def _moved_inwards(
    connections: NDArray[np.integer],
    x: NDArray[np.float64],
    particle: NDArray[np.int64],
    weight: NDArray[np.float64],
    triangles: NDArray[np.int64],
    inset: NDArray[np.float64],
    spacing: NDArray[np.float64],
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return vertices moved inwards by `inset` [m], as particles and their weights; each has its body's `spacing`.

    Particles are at x [m]. Each vertex is moved towards a particle near its normal, a few springs away, which
    becomes one more particle of its mean. A vertex with no particle behind it stays, as in a hollow shell.
    """
    chosen = np.flatnonzero(inset > 0)
    if not len(chosen):
        return particle, weight
    y = np.einsum("vk,vkd->vd", weight, x[particle])
    inwards = _inward(y, triangles)
    closest = np.take_along_axis(particle, weight.argmax(axis=1)[:, None], axis=1)[:, 0]
    best, inner = np.full(len(y), LEAST_COSINE), np.zeros(len(y), dtype=np.int64)
    ends = np.concatenate([connections, connections[:, ::-1]])
    ends = ends[np.argsort(ends[:, 0], kind="stable")]
    begin = np.append(0, np.cumsum(np.bincount(ends[:, 0], minlength=len(x))))
    for vertex in np.array_split(chosen, -(-len(chosen) // AT_A_TIME)):
        there = closest[vertex]
        for _ in range(HOPS):
            left = best[vertex] < GOOD_COSINE
            vertex, there = vertex[left], there[left]
            first, last = begin[there], begin[there + 1]
            count = last - first
            start = np.repeat(first - (np.cumsum(count) - count), count)
            found = np.sort(np.repeat(vertex, count) * len(x) + ends[start + np.arange(len(start)), 1])
            vertex, there = np.divmod(found[np.diff(found, prepend=-1) > 0], len(x))
            towards = x[there] - y[vertex]
            length = np.linalg.norm(towards, axis=1)
            cosine = np.einsum("vd,vd->v", towards, inwards[vertex])
            cosine /= np.maximum(length * np.linalg.norm(inwards[vertex], axis=1), 1e-300)
            near = length < FAR * spacing[vertex]
            # Of equally good directions the nearest; which is last in order of score is written last.
            score = np.where(
                near & (length > NEAR * spacing[vertex]), cosine - SHORTER * length / spacing[vertex], -1.0
            )
            order = np.argsort(score, kind="stable")
            order = order[score[order] > best[vertex[order]]]
            best[vertex[order]], inner[vertex[order]] = score[order], there[order]
    moves = best > LEAST_COSINE
    towards = np.where(moves[:, None], x[inner] - y, 0.0)
    # As far along this displacement as the planes around it are to move.
    along = np.einsum("vd,vd->v", towards, inwards)
    inner_weight = inset * np.einsum("vd,vd->v", inwards, inwards) / np.maximum(along, 1e-300)
    inner_weight = np.where(moves, np.minimum(inner_weight, LARGEST_WEIGHT), 0.0)[:, None]
    particle = np.column_stack([particle, np.where(moves, inner, particle[:, 0])])
    return particle, np.column_stack([weight * (1.0 - inner_weight), inner_weight])


def _inward(y: NDArray[np.float64], triangles: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return the displacement of each vertex that moves all planes around it inwards by 1, shape [vertices, 3].

    It is the least-squares solution of n·w = −1 over the triangles around the vertex, weighted by area, in the
    directions that they determine.
    """
    spread, mean, total = facet_moments(y, triangles)
    values, axes = np.linalg.eigh(spread)
    along = np.einsum("vik,vi->vk", axes, mean)
    counts = values > DETERMINED * np.maximum(total, 1e-300)[:, None]
    return -np.einsum("vik,vk->vi", axes, np.where(counts, along / np.where(counts, values, 1.0), 0.0))


def facet_moments(
    y: NDArray[np.float64], triangles: NDArray[np.integer]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return Σ A n nᵀ, Σ A n and Σ A over the triangles around each vertex at y [m]; A is twice the area [m²]."""
    a, b, c = y[triangles].transpose(1, 0, 2)
    area = np.cross(b - a, c - a)
    size = np.linalg.norm(area, axis=1)
    normal = area / np.maximum(size, 1e-300)[:, None]
    spread, mean, total = np.zeros((len(y), 3, 3)), np.zeros((len(y), 3)), np.zeros(len(y))
    for k in range(3):
        np.add.at(spread, triangles[:, k], size[:, None, None] * normal[:, :, None] * normal[:, None, :])
        np.add.at(mean, triangles[:, k], area)
        np.add.at(total, triangles[:, k], size)
    return spread, mean, total


def behind_surfaces(system: System) -> NDArray[np.bool_]:
    """Return a mask of particles in bodies whose surface vertices are not particles, shape [particle_count].

    Vertices of such a surface are weighted means of particles, as in a ball cut from a lattice.
    """
    if system.surface is None:
        return np.zeros(system.particle_count, dtype=bool)
    particle, weight, _ = different_vertices(system.surface)
    body = pieces(system.particle_count, system.connections)
    return np.isin(body, body[particle[(weight != 0).sum(axis=1) > 1, 0]])


def without_surface(system: System) -> NDArray[np.bool_]:
    """Return a mask of particles in bodies that have no surface, shape [particle_count]."""
    if system.surface is None:
        return np.ones(system.particle_count, dtype=bool)
    particle, weight, _ = different_vertices(system.surface)
    body = pieces(system.particle_count, system.connections)
    return ~np.isin(body, body[particle[weight != 0]])


def spring_means(
    system: System, body_of_particle: NDArray[np.integer], values: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return for each body the mean of its springs' values; 0 for a body without springs."""
    near = system.between_neighbors  # springs that resist bending differ in length and are far softer
    near = slice(None) if near is None else near
    of, bodies = body_of_particle[system.connections[near, 0]], int(body_of_particle.max()) + 1
    count = np.bincount(of, minlength=bodies)
    return np.bincount(of, weights=values[near], minlength=bodies) / np.maximum(count, 1)
