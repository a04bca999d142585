"""Surfaces for contact: vertices, points and facets of the bodies of a system."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .connectivity import pieces
from .facets import different_vertices, open_edges, sides_of
from .selection import mask_of
from .system import System

FINE = 2.0
"""A surface with more vertices per particle than this gets no contact points on its edges."""
CORDS = 2.0
"""A body without surface is a rope or a net if it has at most so many springs per particle; otherwise a heap of
spheres. Springs that resist bending do not count."""
SPACING = 0.75
"""Ratio of a lattice's spacing to the mean length of its springs, many of which are diagonals."""
SHEET_RADIUS, ROPE_RADIUS = 0.125, 0.25
"""Half the thickness of a sheet, and of a rope or sphere, as fractions of the spacing."""


class TouchingSurfaces(NamedTuple):
    """The surfaces of all bodies of a system. A body is a set of particles joined by springs."""

    particle: NDArray[np.int64]
    """The particles whose weighted mean is each vertex, shape [vertex_count, k]."""
    weight: NDArray[np.float64]
    """Weights of these particles, shape [vertex_count, k]."""
    ends: NDArray[np.int32]
    """The two vertices of each contact point, shape [point_count, 2]; equal if the point is a vertex."""
    share: NDArray[np.float64]
    """Weight of the second vertex in each point, shape [point_count]."""
    corner: NDArray[np.int32]
    """Vertices of each facet, shape [facet_count, 3], some equal for segments and points; grouped by body."""
    body: NDArray[np.int32]
    """The body of each vertex, shape [vertex_count]."""
    body_of_particle: NDArray[np.int32]
    """The body of each particle, shape [particle_count]."""
    closed: NDArray[np.bool_]
    """Whether the surface of each body has an inside, shape [body_count]."""
    spacing: NDArray[np.float64]
    """Spacing of each body's particles, from the mean length of its springs [m]; 0 for a single particle."""
    radius: NDArray[np.float64]
    """Half the thickness of each body [m]."""
    stiffness: NDArray[np.float64]
    """Mean stiffness of each body's springs [N/m]; 0 without springs."""


def contact_surfaces(system: System) -> TouchingSurfaces:
    """Return the surfaces that a system has for contact."""
    lowest = pieces(system.particle_count, system.connections)
    _, body_of = np.unique(lowest, return_inverse=True)
    bodies = int(body_of.max()) + 1
    if system.surface is None:
        particle, weight = np.zeros((0, 1), dtype=np.int64), np.zeros((0, 1))
        triangles = np.zeros((0, 3), dtype=np.int64)
    else:
        particle, weight, triangles = different_vertices(system.surface)
    body = body_of[particle[:, 0]]
    drawn = mask_of(body, bodies)
    # In bodies without a surface, particles touch instead.
    bare = np.flatnonzero(~drawn[body_of])
    first = len(particle)
    vertex_of = np.full(system.particle_count, -1)
    vertex_of[bare] = first + np.arange(len(bare))
    alone = np.zeros((len(bare), particle.shape[1]))
    alone[:, 0] = 1.0
    particle = np.concatenate([particle, np.repeat(bare[:, None], particle.shape[1], axis=1)])
    weight = np.concatenate([weight, alone])
    body = body_of[particle[:, 0]]
    near = system.between_neighbours
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
    # Other surfaces also have a contact point in the middle of each edge.
    carried = np.bincount(body_of[np.unique(particle[weight != 0])], minlength=bodies)
    fine = np.bincount(body, minlength=bodies) > FINE * carried
    edges = edges[~fine[body[edges[:, 0]]]]
    ends = np.concatenate([np.repeat(np.arange(len(particle))[:, None], 2, axis=1), edges])
    share = np.repeat([0.0, 0.5], [len(particle), len(edges)])

    # From original lengths, so that motion and yielding do not change the thickness.
    spacing = spring_means(system, body_of, system.original_length) * np.where(rope, 1.0, SPACING)
    closed = drawn.copy()
    closed[body[open_edges(triangles)[:, 0]]] = False
    share_of_spacing = np.where(closed, 0.0, np.where(drawn, SHEET_RADIUS, ROPE_RADIUS))
    return TouchingSurfaces(
        particle,
        weight,
        ends.astype(np.int32),
        share,
        corner.astype(np.int32),
        body.astype(np.int32),
        body_of.astype(np.int32),
        closed,
        spacing,
        share_of_spacing * spacing,
        spring_means(system, body_of, system.stiffness),
    )


def behind_surfaces(system: System) -> NDArray[np.bool_]:
    """Return a mask of particles in bodies whose surface vertices are not particles, shape [particle_count].

    Vertices of such a surface are weighted means of particles, as in a ball cut from a lattice.
    """
    if system.surface is None:
        return np.zeros(system.particle_count, dtype=bool)
    particle, weight, _ = different_vertices(system.surface)
    body = pieces(system.particle_count, system.connections)
    return np.isin(body, body[particle[(weight != 0).sum(axis=1) > 1, 0]])


def spring_means(
    system: System, body_of_particle: NDArray[np.integer], values: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return for each body the mean of its springs' values; 0 for a body without springs."""
    near = system.between_neighbours  # springs that resist bending differ in length and are far softer
    near = slice(None) if near is None else near
    of, bodies = body_of_particle[system.connections[near, 0]], int(body_of_particle.max()) + 1
    count = np.bincount(of, minlength=bodies)
    return np.bincount(of, weights=values[near], minlength=bodies) / np.maximum(count, 1)
