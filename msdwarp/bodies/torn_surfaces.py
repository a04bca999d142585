"""Surfaces of tearing bodies: triangles that part, and faces that become visible inside lattice solids."""

import itertools
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .cells import FACES
from .connectivity import body_cells, connection_of
from .selection import mask_of
from .system import System


class Edges:
    """The connections along the edges of a system's surface triangles.

    There are none at vertices that are weighted means of particles, so such triangles never part.
    """

    def __init__(self, system: System) -> None:
        surface = system.surface
        self._of: NDArray[np.int64] = np.full((0 if surface is None else len(surface.triangles), 3), -1)
        if surface is None or not system.connection_count:
            return
        corners = surface.particle_alone[surface.triangles]
        self._of = connection_between(system, np.stack([corners, np.roll(corners, -1, axis=1)], axis=-1))

    def parted_at(self, broken_at: NDArray) -> NDArray:
        """Return the time at which each triangle parted, inf if it has not, shape [triangle_count].

        A triangle parts when its corners are no longer joined: when the second of its three edges breaks, or the
        first if one edge has no connection. `broken_at` is as in `System`.
        """
        absent = self._of < 0
        times = np.sort(np.where(absent, -np.inf, np.append(broken_at, np.inf)[self._of]), axis=1)
        missing = absent.sum(axis=1)
        parted = np.take_along_axis(times, np.clip(missing, 1, 2)[:, None], axis=1)[:, 0]
        return np.where(missing == 3, np.inf, parted)


def connection_between(system: System, pairs: NDArray) -> NDArray[np.int64]:
    """Return the connection that joins each pair of particles, −1 if none does.

    The system must have a connection. `pairs` has shape [..., 2], the result [...].
    """
    return connection_of(system.connections, pairs)


def broken_before(broken_at: NDArray, time: float) -> NDArray[np.bool_]:
    """Return a mask of connections that are broken in a frame at `time` [s]: before this time, or at the start.

    A connection that breaks at the frame's time does so in the next substep. Times are compared as
    float32, the type of times on devices and in files.
    """
    when = np.asarray(broken_at, dtype=np.float32)
    return (when < np.float32(time)) | (when <= 0)


class Bare(NamedTuple):
    """The visible parts of a torn solid, and the times at which they are visible."""

    parted_at: NDArray[np.float64]
    """Time when each surface triangle disappears with its cell [s], NaN without a cell, shape [triangle_count]."""
    triangles: NDArray[np.int32]
    """Particles of the triangles that become visible inside, shape [any, 3]."""
    since: NDArray[np.float64]
    """Time when each of these triangles becomes visible [s], shape [any]."""
    until: NDArray[np.float64]
    """Time when each of these triangles disappears with its own cell [s], inf if it stays, shape [any]."""


def cells_of(system: System, among: NDArray[np.bool_] | None = None) -> NDArray[np.int64]:
    """Return the corners of the cells of a system's lattice solids, shape [cell_count, 8], as in `Cells`.

    A cell has a particle at each corner, and connections along x, y and z. In two dimensions cells are those of
    sheets, shape [cell_count, 4]. With a mask `among` of particles only lattices that have some of these.
    """
    axes = 3 if system.dim == 3 else 2
    found = [np.empty((0, 2**axes), dtype=np.int64)]
    for body in system.directions:
        if set("xyz"[:axes]) <= body.keys():
            corners = body_cells(system.connections, system.particle_count, body, axes)
            if among is None or among[corners].any():
                found.append(corners)
    return np.concatenate(found)


def cells_parted_at(system: System, cells: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return the time when the corners of each cell cease to be joined by unbroken connections [s], or inf.

    Only connections within a cell count. Two corners are joined until the longest-lasting path between them
    breaks: these are widest paths, by the Floyd-Warshall algorithm.
    """
    parted_at = np.full(len(cells), np.inf)
    touched = _at_broken(system)[cells].any(axis=1)
    first, second = np.triu_indices(8, 1)
    between = connection_between(system, cells[touched][:, np.stack([first, second], axis=-1)])
    until = np.full((len(between), 8, 8), np.inf)
    until[:, first, second] = np.where(between < 0, -np.inf, system.broken_at[between])
    until[:, second, first] = until[:, first, second]
    for k in range(8):
        until = np.maximum(until, np.minimum(until[:, :, k, None], until[:, None, k, :]))
    parted_at[touched] = until.min(axis=(1, 2))
    return parted_at


def laid_bare(system: System) -> Bare:
    """Return the visible parts of lattice solids that tear at the system's times `broken_at`.

    When a cell parts (see `cells_parted_at`), its surface triangles disappear, and faces common to it and other
    cells become visible.
    """
    assert system.surface is not None
    alone = system.surface.particle_alone.astype(np.int64)
    corners, cells = alone[system.surface.triangles], np.empty((0, 8), dtype=np.int64)
    if system.dim == 3:
        cells = cells_of(system, mask_of(alone[alone >= 0], system.particle_count))
    parted_at = cells_parted_at(system, cells)
    beside = _at_broken(system)  # where triangles have lost edges, or faces may become visible
    beside[cells[np.isfinite(parted_at)]] = True
    near = np.flatnonzero(beside[cells].any(axis=1))
    faces = cells[near][:, FACES].reshape(-1, 4)
    own = parted_at[near].repeat(6)

    # A face is between two cells, or between a cell and the outside.
    order, same = _alike(np.sort(faces, axis=1))
    other = np.full(len(faces), -np.inf)
    other[order[:-1][same]], other[order[1:][same]] = own[order[1:][same]], own[order[:-1][same]]
    outside = np.isneginf(other)
    bare = ~outside & (other < own)
    triangles = faces[bare][:, [(0, 1, 2), (0, 2, 3)]].reshape(-1, 3)

    # A triangle of the surface uses three corners of a face.
    threes = faces[outside][:, list(itertools.combinations(range(4), 3))].reshape(-1, 3)
    order, same = _alike(np.sort(np.concatenate([threes, corners]), axis=1))
    same &= order[:-1] < len(threes)
    face, triangle = order[:-1][same], order[1:][same] - len(threes)
    goes_at = np.full(len(corners), np.nan)
    goes_at[triangle] = own[outside].repeat(4)[face]
    return Bare(goes_at, triangles.astype(np.int32), other[bare].repeat(2), own[bare].repeat(2))


def _at_broken(system: System) -> NDArray[np.bool_]:
    """Return the mask of particles with a broken connection, shape [particle_count]."""
    return mask_of(system.connections[system.broken], system.particle_count)


def _alike(rows: NDArray[np.int64]) -> tuple[NDArray[np.intp], NDArray[np.bool_]]:
    """Return (a stable order in which equal rows are adjacent, mask: whether a row equals the next one)."""
    order = np.lexsort(rows.T)
    return order, (rows[order[:-1]] == rows[order[1:]]).all(axis=1)
