"""Connectivity: pieces that connections form, cells of lattices, and connections by their ends."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

_BLOCK = 1 << 20  # connections per step: most later ones join particles that are already in one piece
_SQUARE = ((0, 0), (1, 0), (1, 1), (0, 1))
CORNER_STEPS = {
    1: np.array([(0,), (1,)]),
    2: np.array(_SQUARE),
    3: np.array([(*corner, z) for z in (0, 1) for corner in _SQUARE]),
}
"""Steps from a cell's first corner to its corners, in the order of `Cells`, by number of axes."""
_OPPOSITE = {2: 2, 3: 6}
"""The corner opposite a cell's first, by number of axes."""
_BASE = 1 << 32
"""More than any particle's index: two of them are one number."""


def pieces(particle_count: int, connections: NDArray[np.int32]) -> NDArray[np.int32]:
    """Return the lowest particle index in each particle's piece, shape [particle_count].

    Every particle points to the lowest known particle of its piece. If a connection joins two pieces, the higher
    of their two lowest particles is made to point to the lower.
    """
    lowest = np.arange(particle_count, dtype=np.int32)
    for start in range(0, len(connections), _BLOCK):
        first, second = lowest[connections[start : start + _BLOCK].T]
        while (apart := first != second).any():
            first, second = first[apart], second[apart]
            low, high = np.minimum(first, second), np.maximum(first, second)
            lowest[high] = low  # of several writes any may win: pointers only go down, so they form no loops
            while not np.array_equal(further := lowest[lowest], lowest):
                lowest = further
            first, second = lowest[low], lowest[high]
    return lowest


def corner_pairs(axes: int) -> dict[int, NDArray[np.intp]]:
    """Return the pairs of a cell's corners, shape [any, 2], by the number of axes that they span."""
    steps = CORNER_STEPS[axes]
    pairs = np.stack(np.triu_indices(len(steps), 1), axis=1)
    span = np.abs(steps[pairs[:, 0]] - steps[pairs[:, 1]]).sum(axis=1)
    return {k: pairs[span == k] for k in range(1, axes + 1)}


def body_cells(
    connections: NDArray[np.int32], count: int, body: Mapping[str, slice], axes: int
) -> NDArray[np.int64]:
    """Return the corners of the cells of a body with 1 to 3 axes, shape [cell_count, 2^axes], as in `Cells`.

    A cell has a particle at each corner, connections along the axes, and, in a body with diagonals, one through
    its middle: else it is a gap between cells. `body` is an entry of `System.directions`, `count` the number of
    particles.
    """
    following = np.full((axes, count + 1), count)  # next particle along each axis, `count` if there is none
    for along, name in zip(following, "xyz", strict=False):
        first, second = connections[body[name]].T
        along[first] = second
    corners = np.arange(count)[:, None]
    for k, along in enumerate(following):
        ahead = along[corners]
        corners = np.concatenate([corners, ahead[:, ::-1] if k == 1 else ahead], axis=1)
    corners = corners[(corners < count).all(axis=1)]
    diagonal = body.get("+".join("xyz"[:axes])) if axes > 1 else None
    if diagonal is None:
        return corners
    across = np.full(count, count)
    first, second = connections[diagonal].T
    across[first] = second
    return corners[across[corners[:, 0]] == corners[:, _OPPOSITE[axes]]]


def connection_of(connections: NDArray[np.int32], pairs: NDArray) -> NDArray[np.int64]:
    """Return the connection that joins each pair of particles, −1 if none does.

    There must be a connection. `pairs` has shape [..., 2], the result [...].
    """
    joined = np.sort(connections.astype(np.int64), axis=1) @ (_BASE, 1)
    order = np.argsort(joined, kind="stable")
    wanted = np.sort(np.asarray(pairs, dtype=np.int64), axis=-1) @ (_BASE, 1)
    found = order[np.minimum(np.searchsorted(joined, wanted, sorter=order), len(joined) - 1)]
    return np.where(joined[found] == wanted, found, -1)
