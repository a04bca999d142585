"""Facets of sheets whose drawn surface is much finer than their lattice: for contact the cells of the lattice."""

import numpy as np
from numpy.typing import NDArray

from .facets import open_edges
from .selection import mask_of

FINE = 2.0
"""A surface with more vertices per particle than this is much finer than its lattice."""
ROUNDING = 1e-9
"""Weights up to this are rounding errors."""


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
    alone = np.zeros((len(own), particle.shape[1]))
    alone[:, 0] = 1.0
    repeated = np.repeat(own[:, None], particle.shape[1], axis=1)
    return (
        np.concatenate([particle[kept], repeated]),
        np.concatenate([weight[kept], alone]),
        np.concatenate([triangles, halves]),
    )


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
