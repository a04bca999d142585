"""What of a system can touch: vertices, points and facets of its bodies, by the numbers of their particles."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .connectivity import pieces
from .facets import different_vertices, run_back
from .surface import Surface
from .system import System

SAMPLES = 1
"""Points on each edge of a surface, beside those at its ends."""
FINE = 2.0
"""Where a surface has more vertices for each particle that carries it, only these are points."""
ROPE = 2.5
"""What has no surface, and fewer connections than this a particle, is a rope; else a heap of spheres."""
SPACING = 0.75
"""The spacing of a lattice by the mean length of its connections, of which many are diagonals."""
SHEET_RADIUS, ROPE_RADIUS = 0.125, 0.25
"""Half the thickness of a sheet, and of a rope or a sphere, by its spacing."""


class TouchingSurfaces(NamedTuple):
    """The surfaces of all bodies of a system. What hangs together by connections is a body."""

    particle: NDArray[np.int64]
    """The particles that each vertex is a mixture of, shape [vertex_count, k]."""
    weight: NDArray[np.float64]
    """Their shares."""
    ends: NDArray[np.int32]
    """The two vertices that each point lies between, shape [point_count, 2]; twice the same in a vertex."""
    share: NDArray[np.float64]
    """The second one's share in it."""
    corner: NDArray[np.int32]
    """The vertices of each facet, shape [facet_count, 3]; of segments and points some are equal. Body by body."""
    body: NDArray[np.int32]
    """The body of each vertex, shape [vertex_count]."""
    body_of_particle: NDArray[np.int32]
    """The body of each particle, shape [particle_count]."""
    closed: NDArray[np.bool_]
    """Whether the surface of each body has an inside, shape [body_count]."""
    sided: NDArray[np.bool_]
    """Whether each body is a sheet whose sides can be told apart: no two triangles run alike through an edge."""
    spacing: NDArray[np.float64]
    """How far its particles are apart, by the mean length of its connections [m]; 0 of a single particle."""
    radius: NDArray[np.float64]
    """Half its thickness [m]."""
    stiffness: NDArray[np.float64]
    """Mean stiffness of its connections [N/m]; 0 where it has none."""


def contact_surfaces(system: System) -> TouchingSurfaces:
    """Return what of a system can touch."""
    lowest = pieces(system.particle_count, system.connections)
    _, body_of = np.unique(lowest, return_inverse=True)
    bodies = int(body_of.max()) + 1
    particle, weight, triangles = _vertices(system)
    body = body_of[particle[:, 0]]
    drawn = np.zeros(bodies, dtype=bool)
    drawn[body] = True
    # What has no surface touches by its particles.
    bare = np.flatnonzero(~drawn[body_of])
    first = len(particle)
    vertex_of = np.full(system.particle_count, -1)
    vertex_of[bare] = first + np.arange(len(bare))
    alone = np.zeros((len(bare), particle.shape[1]))
    alone[:, 0] = 1.0
    particle = np.concatenate([particle, np.repeat(bare[:, None], particle.shape[1], axis=1)])
    weight = np.concatenate([weight, alone])
    body = body_of[particle[:, 0]]
    pairs = system.connections
    between_bare = ~drawn[body_of[pairs[:, 0]]]
    count = np.bincount(body_of, minlength=bodies)
    joined = np.bincount(body_of[pairs[:, 0]], minlength=bodies)
    rope = ~drawn & (joined > 0) & (2 * joined < ROPE * count)
    segments = vertex_of[pairs[between_bare & rope[body_of[pairs[:, 0]]]]]
    spheres = vertex_of[bare[~rope[body_of[bare]]]]
    edges = np.unique(np.sort(np.concatenate([triangles[:, [k, k - 1]] for k in range(3)]), axis=1), axis=0)
    edges = np.concatenate([edges, segments]).astype(np.int32)
    corner = np.concatenate([triangles, segments[:, [0, 1, 1]], np.repeat(spheres[:, None], 3, axis=1)])
    corner = corner[np.argsort(body[corner[:, 0]], kind="stable")]
    # A surface that is finer than what carries it has points enough at its vertices.
    carried = np.bincount(body_of[np.unique(particle[weight != 0])], minlength=bodies)
    fine = np.bincount(body, minlength=bodies) > FINE * carried
    edges = edges[~fine[body[edges[:, 0]]]]
    vertices = np.arange(len(particle))
    shares = [(k + 1) / (SAMPLES + 1) for k in range(SAMPLES)]
    ends = np.concatenate([np.stack([vertices, vertices], axis=1), *[edges] * SAMPLES])
    share = np.concatenate([np.zeros(len(vertices)), *[np.full(len(edges), one) for one in shares]])

    # From lengths as they were made, so that a body that has moved, or yielded, touches as it did before.
    of_connections = body_of[pairs[:, 0]]
    near = system.between_neighbours  # springs that resist bending are of other lengths and far softer
    near = slice(None) if near is None else near
    spacing = _means(system.original_length[near], of_connections[near], bodies) * np.where(rope, 1.0, SPACING)
    closed = drawn & ~_open(triangles, body, bodies)
    sided = drawn & ~closed & ~_turned_over(triangles, body, bodies)
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
        sided,
        spacing,
        share_of_spacing * spacing,
        mean_stiffness(system, body_of, system.stiffness),
    )


def mean_stiffness(
    system: System, body_of_particle: NDArray[np.integer], stiffness: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the mean stiffness of the connections of each body [N/m], if they have these; 0 where it has none.

    Parameters
    ----------
    system
        What they connect.
    body_of_particle
        The body of each particle, shape [particle_count].
    stiffness
        That of each connection [N/m], shape [connection_count].
    """
    near = system.between_neighbours
    near = slice(None) if near is None else near
    of_connections = body_of_particle[system.connections[:, 0]]
    return _means(stiffness[near], of_connections[near], int(body_of_particle.max()) + 1)


def _vertices(system: System) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.int64]]:
    """Return the different vertices of the surface as particles and weights, and its triangles by them."""
    surface: Surface | None = system.surface
    if surface is None:
        return np.zeros((0, 1), dtype=np.int64), np.zeros((0, 1)), np.zeros((0, 3), dtype=np.int64)
    return different_vertices(surface)


def _open(triangles: NDArray[np.int64], body: NDArray, bodies: int) -> NDArray[np.bool_]:
    """Return which bodies have an edge that is not run through once in either direction, shape [body_count]."""
    found = np.zeros(bodies, dtype=bool)
    if len(triangles):
        runs = _runs(triangles)
        found[body[runs[~run_back(runs, int(triangles.max()) + 1), 0]]] = True
    return found


def _turned_over(triangles: NDArray[np.int64], body: NDArray, bodies: int) -> NDArray[np.bool_]:
    """Return which bodies have an edge that triangles run through in the same direction, shape [body_count]."""
    found = np.zeros(bodies, dtype=bool)
    runs, count = np.unique(_runs(triangles), axis=0, return_counts=True)
    found[body[runs[count > 1, 0]]] = True
    return found


def _runs(triangles: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the directed edges of triangles, shape [3 triangle_count, 2]."""
    return np.concatenate([triangles[:, [k, (k + 1) % 3]] for k in range(3)])


def _means(values: NDArray[np.float64], of: NDArray, bodies: int) -> NDArray[np.float64]:
    """Return the mean over what belongs to each body; 0 of nothing."""
    count = np.bincount(of, minlength=bodies)
    return np.bincount(of, weights=values, minlength=bodies) / np.maximum(count, 1)
