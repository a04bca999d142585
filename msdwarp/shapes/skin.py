"""Skins: drawn surfaces embedded in a lattice of cells."""

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import checks
from ..bodies import Surface, System
from .grid import (
    check_memory,
    count_pieces,
    lattice_connections,
    lattice_directions,
    particle_numbers,
    whole_cells,
)
from .lattices import lattice


def embed(
    points: ArrayLike, number: NDArray, whole: NDArray[np.bool_], spacing: float, corner: ArrayLike
) -> tuple[NDArray[np.int32], NDArray[np.float64]]:
    """Return points as weighted means of lattice cells' corners: (particle, weights), shape [any, 2^d] each.

    A point is interpolated, linearly along each axis, in the cell that contains it. If a particle is missing at a
    corner of this cell, the point is extrapolated from the nearest whole cell. Raises ValueError if no cell is
    whole, or a point is not finite.

    `number` is the particle at each lattice point, shape [nx, ny] or [nx, ny, nz]; `corner` is the position of the
    first lattice point [m]. `whole` is the mask of cells with a particle at each corner, one fewer per axis.
    If points [m] have more coordinates than the lattice, only the first ones are used.
    """
    dim = number.ndim
    place = (np.asarray(points, dtype=np.float64)[:, :dim] - np.asarray(corner)) / spacing
    checks.within("points", place, checks.FINITE)
    if not whole.any():
        raise ValueError("whole is False everywhere; there must be a cell to embed points in")
    cell, _ = nearest_cells(place, whole)
    inside = place - cell  # relative position in the cell, 0 … 1
    particle = np.empty((len(place), 2**dim), dtype=np.int32)
    weights = np.ones((len(place), 2**dim))
    for k, step in enumerate(itertools.product((0, 1), repeat=dim)):
        particle[:, k] = number[tuple((cell + step).T)]
        for axis, s in enumerate(step):
            weights[:, k] *= inside[:, axis] if s else 1 - inside[:, axis]
    return particle, weights


def nearest_cells(
    place: NDArray[np.float64], cells: NDArray[np.bool_], within: float = np.inf, enough: float = 0.0
) -> tuple[NDArray[np.intp], NDArray[np.float64]]:
    """Return (cell nearest to each place, shape [any, d]; the place's distance from it in cells, shape [any]).

    The distance is 0 inside a cell, and inf if no cell was found. Beyond `within` a nearer cell may exist, as it
    may if one was found at most `enough` away.

    Cells around a place's own cell are searched in shells. Cells in shell r + 1 are at least r away, so a cell
    found within r is the nearest. For a place outside the grid the search starts at the margin.
    """
    last = np.array(cells.shape) - 1
    own = np.clip(np.floor(place), 0, last).astype(np.intp)
    best = np.zeros_like(own)
    distance = np.full(len(place), np.inf)
    left = np.arange(len(place))
    shell = 0
    while len(left) and shell <= last.max() and shell < within + 1:
        steps = itertools.product(range(-shell, shell + 1), repeat=place.shape[1])
        steps = (one for one in steps if max(map(abs, one)) == shell)
        for step in sorted(steps, key=np.linalg.norm if enough else None):
            cell = own[left] + step
            in_grid = np.clip(cell, 0, last)
            there = np.all(cell == in_grid, axis=1) & cells[tuple(in_grid.T)]
            outside = place[left] - np.clip(place[left], cell, cell + 1)
            apart = np.where(there, np.linalg.norm(outside, axis=1), np.inf)
            nearer = apart < distance[left]
            best[left[nearer]], distance[left[nearer]] = cell[nearer], apart[nearer]
            left = left[distance[left] > enough]
        left = left[distance[left] > shell]
        shell += 1
    return best, distance


_OF_A_CELL, _OF_SKIN = 16, 9400
"""Bytes that each shape needs at least for a cell, inside or not, while it finds out which are inside; and at most
(measured 7900 of a mesh, 9400 of a cloth) for a square of its skin with sides of a spacing."""
SAME = 1e-6
"""Lengths are equal if they differ by less than this fraction of a body's longest side; float32 errors do."""
_AT_ONCE = 1 << 17
"""Number of samples of a skin whose nearest cells are found at once: a few tens of MB."""
AWAY, SAMPLED = 0.6, 0.4
"""Largest distance of the skin from the nearest cell; distance between samples of the skin; in cells."""


@dataclass(frozen=True, eq=False)
class Skin:
    """A surface to draw, before it is embedded in a lattice."""

    points: NDArray[np.float64]
    """Vertices [m], shape [vertex_count, d]."""
    uv: NDArray[np.float64]
    """Texture coordinates, shape [vertex_count, 2]."""
    triangles: NDArray[np.int64]
    """Vertices of each triangle, shape [triangle_count, 3]."""
    normal_of: NDArray[np.int64] | None = None
    """The vertex whose normal each vertex uses, shape [vertex_count]."""


def embedded(cells: NDArray[np.bool_], spacing: float, skin: Skin, size: float, **kind: Any) -> System:
    """Return a lattice with particles at the corners of cells, centred at the origin, with an embedded skin.

    `cells` is a mask of shape [nx, ny] or [nx, ny, nz], `size` the body's volume [m³], or a sheet's area [m²]:
    with a material the mass is that of this size, though the cells fill another. `kind` are keyword arguments of
    `lattice`. Raises ValueError as `lattice` does, and if there is no cell or there are several pieces.
    """
    if not cells.any():
        raise ValueError(f"spacing is {spacing:g}; it must be smaller: no cell of that size has its centre inside")
    mask = cells
    for axis in range(cells.ndim):
        mask = np.insert(mask, 0, False, axis) | np.insert(mask, mask.shape[axis], False, axis)
    checks.one_of("neighbors", kind["neighbors"], (26, 6) if mask.ndim == 3 else (8, 4))
    check_memory("spacing", spacing, int(np.count_nonzero(mask)), kind["neighbors"], kind["material"])
    whole = whole_cells(mask)
    # A cell's particles are joined along its edges, so connections along the axes determine the pieces.
    joined, _ = lattice_connections(mask.shape, lattice_directions(mask.ndim, diagonals=False), mask, whole)
    pieces = count_pieces(int(np.count_nonzero(mask)), joined)
    if pieces > 1:
        raise ValueError(
            f"with a spacing of {spacing:g} the body is {pieces} pieces that do not touch; it must be one "
            "(make each by itself: systems can be added)"
        )
    low = [-spacing * (n - 1) / 2 for n in mask.shape]
    particle, weights = embed(skin.points, particle_numbers(mask.shape, mask), whole, spacing, low)
    drawn = {"uv": skin.uv, "triangles": skin.triangles, "normal_of": skin.normal_of}
    body = lattice(mask, spacing, surface=Surface(particle=particle, weights=weights, **drawn), **kind)
    if kind["material"] is None:
        return body
    return body.replace(mass=body.mass * (size / (np.count_nonzero(whole) * spacing**mask.ndim)))


def cell_centres(shape: ArrayLike, spacing: float) -> list[NDArray[np.float64]]:
    """Return x, y (and z) of the centres of cells around the origin, broadcastable to the grid's shape."""
    axes = [spacing * (np.arange(n) - (n - 1) / 2) for n in np.asarray(shape)]
    return list(np.meshgrid(*axes, indexing="ij", sparse=True))


def fine_enough(
    spacing: float,
    sizes: Mapping[str, float],
    extent: Sequence[float],
    skin: float = 0.0,
    given: str | None = None,
) -> float:
    """Return the spacing; raise ValueError unless it is positive, and at most each named size.

    Also raise ValueError if the cells that fill an extent [m], with a skin of this area [m²], do not fit into
    memory. The message says what was `given`, by default the spacing.
    """
    spacing = checks.positive("spacing", spacing)
    for name, size in sizes.items():
        if spacing > size * (1 + SAME):
            raise ValueError(f"spacing is {spacing:g}; it must be at most {size:g}, the {name}")
    count = math.prod(max(1.0, length / spacing) for length in extent)
    size = _OF_A_CELL * count + _OF_SKIN * skin / spacing / spacing
    checks.fits(given or f"spacing is {spacing:g}", f"{count:.3g} cells and their surface", size)
    return spacing


def cells_along(sides: ArrayLike, spacing: float) -> list[int]:
    """Return the number of cells that cover each side of a body, at least one.

    Rounding errors of points in single precision do not add a cell.
    """
    lengths = np.asarray(sides, dtype=np.float64)
    return [max(math.ceil(one), 1) for one in (lengths - SAME * lengths.max()) / spacing]


def held(cells: NDArray[np.bool_], samples: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return unit cells around the origin, with further cells that keep thin parts of a body connected.

    First, cells are added at samples of the body's skin that are further than AWAY from every cell (where the body
    is thick, a plane skin is at most ½ from a cell with its centre inside). Then a sample's cell is added if the
    cells around it would not be connected without it.

    Cells that share a corner are connected, as are the cells of two samples less than a cell apart. Samples, shape
    [any, d], are SAMPLED apart, and AWAY + SAMPLED is 1, so that no gap remains.
    """
    shape, dim = np.array(cells.shape), cells.ndim
    touched, filled = np.zeros_like(cells), cells.copy()
    for place in np.array_split(samples + shape / 2, len(samples) // _AT_ONCE + 1):
        _, distance = nearest_cells(place, cells, within=1, enough=AWAY)
        at = np.clip(np.floor(place), 0, shape - 1).astype(int)
        touched[tuple(at.T)] = True
        filled[tuple(at[distance > AWAY].T)] = True

    steps = np.array(list(np.ndindex((3,) * dim)))  # steps to the surrounding cells, in a grid with a margin
    adjacent = (np.abs(steps[:, None] - steps) <= 1).all(axis=-1).astype(np.float32)
    left = np.argwhere(touched & ~filled)
    around = np.pad(filled, 1)[tuple(np.moveaxis(left[:, None] + steps, -1, 0))]  # [cell left, cell around it]
    reached = around & (np.cumsum(around, axis=1) == 1)  # starting with the first of them
    for _ in steps:
        reached = around & (reached.astype(np.float32) @ adjacent > 0)
    filled[tuple(left[(reached != around).any(axis=1)].T)] = True
    return filled
