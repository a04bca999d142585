"""Facets: the triangles of a system's surface, with distinct vertices that are weighted means of particles."""

import functools
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from .connectivity import pieces
from .selection import mask_of
from .surface import Surface
from .system import System

FINE = 2.0
"""A surface with more vertices per particle than this is much finer than its lattice."""
ROUNDING = 1e-9
"""Weights up to this are rounding errors."""


class Facets(NamedTuple):
    """Triangles of a surface; vertices that pictures duplicate for sharp edges or seams are merged."""

    particle: NDArray[np.int64]
    """The particles whose weighted mean is each vertex, shape [vertex_count, k]."""
    weight: NDArray[np.float64]
    """The weights of these particles, which sum to 1."""
    corner: NDArray[np.int32]
    """The vertices of each triangle, shape [triangle_count, 3]."""
    closed: NDArray[np.bool_]
    """Whether each triangle belongs to a surface that has an inside, shape [triangle_count]."""
    mixed: bool
    """Whether any vertex is not a particle; otherwise vertex i is particle i."""

    def points(self, x: NDArray) -> NDArray[np.float64]:
        """Return a quantity at the vertices, given values at the particles, shape [particle_count, d]."""
        values = np.asarray(x, dtype=np.float64)
        return np.einsum("vk,vkd->vd", self.weight, values[self.particle]) if self.mixed else values

    def spread(self, values: NDArray[np.float64], count: int) -> NDArray[np.float64]:
        """Return Wᵀ y, shape [particle_count, …], with the weights W and numbers or vectors y at the vertices."""
        if not self.mixed:
            return values
        result = np.zeros((count, *values.shape[1:]))
        weights = self.weight.reshape(*self.weight.shape, *[1] * (values.ndim - 1))
        np.add.at(result, self.particle, weights * values[:, None])
        return result

    def bound(self, sums: NDArray[np.float64], count: int) -> NDArray[np.float64]:
        """Return bounds of the row sums of |WᵀAW| by particle, given row sums of |A| by vertex."""
        size = np.abs(self.weight)
        most = float(size.sum(axis=1).max(initial=0.0))
        return self._replace(weight=most * size).spread(sums, count)

    def of(self, chosen: NDArray[np.bool_]) -> Self:
        """Return the triangles that only use particles in a mask of shape [particle_count]."""
        mine = (chosen[self.particle] | (self.weight == 0)).all(axis=1)[self.corner].all(axis=1)
        return self._replace(corner=self.corner[mine], closed=self.closed[mine])


def facets_of(system: System) -> Facets:
    """Return the triangles of a system's surface; none without a surface, or in one or two dimensions."""
    if system.surface is None or system.dim < 3:
        none = np.zeros((0, 1))
        return Facets(none.astype(np.int64), none, np.zeros((0, 3), np.int32), np.zeros(0, bool), False)
    return _facets(system.surface, system.particle_count)


@functools.lru_cache(maxsize=4)
def _facets(surface: Surface, particle_count: int) -> Facets:
    """Return the facets of a surface."""
    particle, weight, corner = different_vertices(surface)
    single = np.count_nonzero(weight, axis=1) == 1
    mixed = not single.all()
    if not mixed:
        own = particle[np.arange(len(particle)), np.argmax(np.abs(weight), axis=1)]
        corner, particle = own[corner], np.arange(particle_count)[:, None]
        weight = np.ones((particle_count, 1))
    # A part is closed if each of its edges occurs once in each direction.
    part = pieces(len(particle), directed_edges(corner).astype(np.int32))
    is_open = mask_of(part[open_edges(corner)[:, 0]], len(particle))
    return Facets(particle, weight, corner.astype(np.int32), ~is_open[part[corner[:, 0]]], mixed)


def different_vertices(surface: Surface) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.int64]]:
    """Return a surface's distinct vertices, as particles and weights, and the triangles of these vertices."""
    particle, weights = surface.mixture
    rows = np.hstack([particle, np.round(1e9 * weights).astype(np.int64)])
    _, chosen, number = np.unique(rows, axis=0, return_index=True, return_inverse=True)
    triangles = number.reshape(-1)[surface.triangles]
    whole = (triangles != np.roll(triangles, 1, axis=1)).all(axis=1)  # some triangles at a pole are degenerate
    return particle[chosen].astype(np.int64), weights[chosen], triangles[whole]


def directed_edges(corner: NDArray[np.integer]) -> NDArray[np.integer]:
    """Return the directed edges of triangles: all from corner 0 to 1, then from 1 to 2, then from 2 to 0."""
    return np.concatenate([corner[:, [k, (k + 1) % 3]] for k in range(3)])


def open_edges(corner: NDArray[np.integer]) -> NDArray[np.integer]:
    """Return the directed edges of triangles that do not occur once in each direction, shape [any, 2]."""
    runs = directed_edges(corner)
    _, edge, forwards = (one.T.ravel() for one in sides_of(corner))
    times, ahead = np.bincount(edge), np.bincount(edge, weights=forwards)
    return runs[(times[edge] != 2) | (ahead[edge] != 1)]


def sides_of(triangles: NDArray[np.integer]) -> tuple[NDArray[np.intp], NDArray[np.intp], NDArray[np.bool_]]:
    """Return (edges of triangles, [any, 2]; edge of each side; whether the side has the edge's direction).

    The sides of a triangle run from corner 0 to 1, 1 to 2, 2 to 0; arrays of sides: shape [triangle_count, 3].
    """
    start, end = triangles.astype(np.int64), np.roll(triangles, -1, axis=1)
    count = int(triangles.max(initial=0)) + 1
    key, edge = np.unique(np.minimum(start, end) * count + np.maximum(start, end), return_inverse=True)
    return np.stack(np.divmod(key, count), axis=1), edge.reshape(triangles.shape), start < end


def with_lattice_facets(
    connections: NDArray[np.integer],
    body_of: NDArray[np.integer],
    particle: NDArray[np.int64],
    weight: NDArray[np.float64],
    triangles: NDArray[np.int64],
) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.int64]]:
    """Return vertices, as particles and weights, and triangles: of fine open surfaces those of their lattice.

    There each cell that the surface passes becomes two triangles of particles. So a cloth touches as far as its
    particles reach, up to half a cell beyond or within the drawn border. A surface stays as it is if its triangles
    lie in no such cells, which are found by four particles and the connections between them.
    """
    body, bodies = body_of[particle[:, 0]], int(body_of.max()) + 1
    used = np.abs(weight) > ROUNDING
    carried = np.bincount(body_of[np.unique(particle[used])], minlength=bodies)
    fine = mask_of(body[open_edges(triangles)[:, 0]], bodies)
    fine &= np.bincount(body, minlength=bodies) > FINE * carried
    if not fine.any():
        return particle, weight, triangles
    cell = _cells(np.where(used, particle, -1)[triangles[fine[body[triangles[:, 0]]]]], connections, len(body_of))
    fine &= np.bincount(body_of[np.unique(cell)], minlength=bodies) == carried
    cell = cell[fine[body_of[cell[:, 0]]]]
    kept, own = ~fine[body], np.unique(cell)
    number, vertex_of = np.cumsum(kept) - 1, np.zeros(len(body_of), dtype=np.int64)
    vertex_of[own] = np.count_nonzero(kept) + np.arange(len(own))
    triangles = number[triangles[~fine[body[triangles[:, 0]]]]]
    halves = vertex_of[cell[:, [[0, 1, 3], [0, 3, 2]]]].reshape(-1, 3)
    particle, weight = with_particles(particle[kept], weight[kept], own)
    return particle, weight, np.concatenate([triangles, halves])


def with_particles(
    particle: NDArray[np.int64], weight: NDArray[np.float64], added: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return vertices, as particles and their weights, followed by particles that are vertices themselves."""
    own = np.zeros((len(added), particle.shape[1]))
    own[:, 0] = 1.0
    repeated = np.repeat(added[:, None], particle.shape[1], axis=1)
    return np.concatenate([particle, repeated]), np.concatenate([weight, own])


def _cells(particles: NDArray[np.int64], connections: NDArray[np.integer], count: int) -> NDArray[np.int64]:
    """Return the cells with four joined corners in which triangles lie, at (0, 0), (1, 0), (0, 1), (1, 1).

    `particles` are those of the triangles' corners, -1 for none, shape [triangle_count, 3, k].
    """
    those = np.sort(particles.reshape(len(particles), -1), axis=1)
    first = np.diff(those, axis=1, prepend=-1) > 0
    four = first.sum(axis=1) == 4
    cell = np.unique(those[four][first[four]].reshape(-1, 4), axis=0)
    sides = cell[:, [[0, 1], [0, 2], [1, 3], [2, 3]]]
    joined = np.sort(connections.astype(np.int64), axis=1) @ np.array([count, 1])
    return cell[np.isin(sides @ np.array([count, 1]), joined).all(axis=1)]
