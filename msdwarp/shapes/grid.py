"""Grids: number the points of a regular lattice, join neighbours, find cells, pieces and surfaces.

A grid is given by a mask, True for points that are particles, shape [nx, ny] or [nx, ny, nz]. Particles are
numbered without gaps, x fastest, then y, then z.
"""

import itertools
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from .. import checks
from ..bodies import CORNER_STEPS, Surface, pieces

_PEAK = {2: (62, 112), 4: (271, 271), 8: (271, 310), 6: (85, 197), 26: (277, 788)}
"""Bytes of memory per particle that a lattice was measured to take at most while it is made, by the number of
neighbors: without and with a material."""
_BENDING = 850
"""Bytes per particle that springs to second neighbours take beside them, measured likewise."""


def check_memory(
    name: str, value: object, count: int, neighbors: int, material: object = None, bending: object = None
) -> None:
    """Raise ValueError if a lattice of `count` particles takes more memory while it is made than is free."""
    count = min(count, 10**300)  # floats overflow at about 10**308
    size = count * (_PEAK[neighbors][material is not None] + _BENDING * (bending is not None))
    what = f"{count:.3g} particles with {count * neighbors // 2:.3g} connections"
    checks.fits(f"{name} is {checks.repr_short(value)}", what, size)


def lattice_directions(dim: int, *, diagonals: bool) -> dict[str, tuple[int, ...]]:
    """Return the steps from a lattice point to half of its neighbours, by name.

    Axes come first, then face diagonals, then space diagonals: by length, as in the 2014 report. Without
    `diagonals` there are `dim` steps, with diagonals (3^dim − 1)/2. The name of (1, −1, 0) is "x-y".
    """
    steps = [step for step in itertools.product((1, 0, -1), repeat=dim) if step > (0,) * dim]
    steps.sort(key=lambda step: (sum(map(abs, step)), tuple(-s for s in step)))
    named = {}
    for step in steps[: None if diagonals else dim]:
        parts = (("+" if s > 0 else "-") + axis for axis, s in zip("xyz", step, strict=False) if s)
        named["".join(parts).removeprefix("+")] = step
    return named


def particle_numbers(shape: Sequence[int], mask: NDArray[np.bool_] | None = None) -> NDArray[np.int32]:
    """Return each point's particle index, shape [nx, ny, nz]; values where the mask is False are meaningless."""
    if mask is None:
        return np.arange(np.prod(shape), dtype=np.int32).reshape(shape[::-1]).T
    return (np.cumsum(mask.T, dtype=np.int32) - 1).reshape(shape[::-1]).T


def lattice_connections(
    shape: Sequence[int],
    directions: dict[str, tuple[int, ...]],
    mask: NDArray[np.bool_] | None = None,
    whole: NDArray[np.bool_] | None = None,
) -> tuple[NDArray[np.int32], dict[str, slice]]:
    """Join every particle of a grid with its neighbour in each direction; return (connections, slices).

    Connections have shape [connection_count, 2], direction by direction; `slices` has the slice of each. Without
    a mask every point is a particle. Given `whole` cells, only particles of a common whole cell are joined.
    """
    index = particle_numbers(shape, mask).T  # z, y, x
    ends = {}
    for name, step in directions.items():
        here, there = ends_of(step, shape)
        first, second = index[here[::-1]], index[there[::-1]]
        if mask is not None:
            both = mask[here] & mask[there] if whole is None else _cells_of(whole, step) > 0
            first, second = first[both.T], second[both.T]
        ends[name] = first, second
    connections = np.empty((sum(first.size for first, _ in ends.values()), 2), dtype=np.int32)
    slices, start = {}, 0
    for name, (first, second) in ends.items():
        slices[name] = slice(start, start + first.size)
        start += first.size
        pairs = connections[slices[name]].reshape(*first.shape, 2)  # a view that is written in place
        pairs[..., 0], pairs[..., 1] = first, second
    return connections, slices


def ends_of(step: Sequence[int], shape: Sequence[int]) -> tuple[tuple[slice, ...], tuple[slice, ...]]:
    """Return (points of a grid that have a neighbour one step further, these neighbours) as slices."""
    here = tuple(slice(max(0, -s), min(n, n - s)) for s, n in zip(step, shape, strict=True))
    there = tuple(slice(max(0, s), min(n, n + s)) for s, n in zip(step, shape, strict=True))
    return here, there


def whole_cells(mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return the mask of cells with particles at all corners, shape [nx − 1, ny − 1, nz − 1]."""
    for axis in range(mask.ndim):
        mask = np.delete(mask, -1, axis) & np.delete(mask, 0, axis)
    return mask


def cell_corners(mask: NDArray[np.bool_], whole: NDArray[np.bool_]) -> NDArray[np.int32]:
    """Return the particles at the corners of whole cells in VTK's order, shape [cell_count, 8], or 4 in a sheet.

    Cells are in the order of their first corners.
    """
    index = particle_numbers(mask.shape, mask)
    first = np.argwhere(whole.T)[:, ::-1]
    return np.stack([index[tuple((first + step).T)] for step in CORNER_STEPS[mask.ndim]], axis=1).astype(np.int32)


def _cells_of(whole: NDArray[np.bool_], step: Sequence[int]) -> NDArray[np.uint8]:
    """Return the number of whole cells around each connection along a step, ordered as by `ends_of`.

    The step 0 gives the number around each point.
    """
    count = whole.astype(np.uint8)
    for axis, s in enumerate(step):
        if s == 0:  # between the cells on both sides; along other axes the connection spans one cell
            count = np.insert(count, 0, 0, axis) + np.insert(count, count.shape[axis], 0, axis)
    return count


def cell_fractions(whole: NDArray[np.bool_], step: Sequence[int]) -> NDArray[np.float64]:
    """Return the fraction of whole cells among those around each connection along a step, from 0 to 1.

    Connections are ordered as by `lattice_connections` with whole cells; the step 0 gives the particles instead.
    """
    count = _cells_of(whole, step).T
    return count[count > 0] / 2.0 ** (len(step) - np.count_nonzero(step))


def first_loose(mask: NDArray[np.bool_], whole: NDArray[np.bool_]) -> tuple[int, ...] | None:
    """Return the first point of a mask that is no corner of a whole cell; None if there is none."""
    loose = mask & (_cells_of(whole, (0,) * mask.ndim) == 0)
    return tuple(map(int, np.argwhere(loose.T)[0][::-1])) if loose.any() else None


def count_pieces(particle_count: int, connections: NDArray[np.int32]) -> int:
    """Return the number of pieces that particles and connections form."""
    return int(np.count_nonzero(pieces(particle_count, connections) == np.arange(particle_count)))


def grid_surface(shape: Sequence[int], mask: NDArray[np.bool_] | None = None) -> Surface | None:
    """Return the outward squares between whole cells and missing cells; None if there is no whole cell.

    In three dimensions one texture contains the six faces in three columns and two rows: −x, +x, −y in the lower
    row and +y, −z, +z in the upper one, each a plane view of the whole grid. In two dimensions cells themselves
    face up, and share one view.
    """
    index = particle_numbers(shape, mask)
    whole = np.ones([n - 1 for n in shape], dtype=bool) if mask is None else whole_cells(mask)
    if not whole.any():
        return None
    if len(shape) == 2:
        particle, uv, triangles = _squares(index[None], whole[None])
        return Surface(particle=particle, uv=uv, triangles=triangles)
    parts, vertices = [], 0
    for k in range(6):
        axis, outwards = k // 2, k % 2  # towards −x, +x, −y, +y, −z, +z
        first, second = (axis + 1) % 3, (axis + 2) % 3
        order = (axis, first, second) if outwards else (axis, second, first)  # seen from outside: a × b
        points, cells = index.transpose(order), whole.transpose(order)
        if mask is None:  # squares exist only in the outermost layer
            points, squares = points[-1:] if outwards else points[:1], cells[:1]
        else:
            # Each layer of particles has a layer of squares, which separate the cells on both sides.
            cells = np.pad(cells, ((1, 1), (0, 0), (0, 0)))
            squares = cells[:-1] & ~cells[1:] if outwards else cells[1:] & ~cells[:-1]
        particle, uv, triangle = _squares(points, squares)
        parts.append((particle, (uv + np.array([k % 3, k // 3])) / (3, 2), triangle + vertices))
        vertices += len(particle)
    particle, uv, triangles = map(np.concatenate, zip(*parts, strict=True))
    return Surface(particle=particle, uv=uv, triangles=triangles)


def _squares(index: NDArray, squares: NDArray[np.bool_]) -> tuple[NDArray, NDArray, NDArray]:
    """Return (particle, uv, triangles) of squares in layers of points [layer, a, b], facing a × b."""
    _, a, b = index.shape
    layer, i, j = np.nonzero(squares)
    corners = [np.ravel_multi_index((layer, i + di, j + dj), index.shape) for di in (0, 1) for dj in (0, 1)]
    points, vertex = np.unique(np.concatenate(corners), return_inverse=True)
    corner, along_b, along_a, across = vertex.reshape(4, -1)
    triangles = np.concatenate(
        [np.stack([corner, along_a, across], axis=-1), np.stack([corner, across, along_b], axis=-1)]
    )
    layer, i, j = np.unravel_index(points, index.shape)
    uv = np.stack([np.linspace(0, 1, a)[i], np.linspace(0, 1, b)[j]], axis=1)
    return index[layer, i, j], uv, triangles
