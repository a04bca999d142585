"""Voxels: bodies of cells, each of one of several materials, as in soft robots and images of tissue."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import checks
from ..bodies import CORNER_STEPS, FACES, Cells, Material, Surface, System, cell_part, corner_pairs, pieces
from .grid import lattice_directions

SOFT = Material(density=1000.0, youngs_modulus=1e5, damping_ratio=0.1)
STIFF = Material(density=1000.0, youngs_modulus=1e6, damping_ratio=0.1)
MATERIALS = {1: STIFF, 2: SOFT, 3: SOFT, 4: SOFT, 5: STIFF}
"""Materials of evogym's codes: rigid, soft, muscles along the first and the second axis, fixed."""
FIXED = 5
"""The code of cells that are pinned, unless `materials` has it."""
TILES = 4
"""Tiles of a texture along each side: code c shows tile c, from the lower left, row by row (`textures.voxels`)."""
_INSET = 0.02
"""Margin of a tile that is not drawn, so that neighbouring tiles do not show at its rim."""
_BYTES = {2: 700, 3: 1500}
"""Bytes of memory per cell that a body was measured to take at most while it is made, by number of axes."""
_AXIS_OF = ((2, 0), (2, 1), (1, 0), (0, 1), (1, 1), (0, 0))
"""Axis and side (0 lower, 1 upper) of each of `FACES`."""


def voxels(
    cells: ArrayLike,
    spacing: float = 1.0,
    *,
    materials: Mapping[int, Material] | None = None,
    connections: ArrayLike | None = None,
    thickness: float | None = None,
) -> System:
    """Return a body of cells, each of the material that its code names, centred at the origin.

    `cells` has squares or cubes, not points: a gap of one cell stays a gap. Neighbours with a common side have its
    corners in common, cells that meet in an edge or a corner alone do not. Springs, dampers, masses and `Cells`
    sum what each cell contributes (see `Material`), so that the forces between two materials are those of a solid.

    Particles are numbered with x varying fastest, then y, then z. Each code names a group of all corners of its
    cells, such as "3"; `voxel_corners` has the corners of single cells. The body's texture coordinates show each
    cell the tile of its code: `Look(texture=msdwarp.textures.voxels())` colors them.

    Parameters
    ----------
    cells
        Code of each cell, 0 for none: whole numbers, shape [nx, ny] for a body in the plane (`dim` 2, y points up)
        or [nx, ny, nz].
    spacing
        Edge of a cell [m].
    materials
        Material of each code. Codes that it does not name are those of evogym: 1 stiff (1 MPa); 2 soft (0.1 MPa);
        3 and 4 soft, meant for muscles along x and y; 5 stiff, with all its corners pinned.
    connections
        Pairs of neighbouring cells that are joined, shape [any, 2], as indices into `cells.ravel()`; other
        neighbours stay apart. By default all neighbours are joined.
    thickness
        Thickness of a body in the plane [m]; by default the spacing. In a solid it must be left out.

    Raises
    ------
    ValueError
        If an argument is out of range, a code has no material, a pair are no neighbours, or the body is in pieces.

    Reference for codes and connections: Bhatia et al., Evolution Gym, NeurIPS 2021. evogym's arrays have the top
    row first: `cells = body[::-1].T`.
    """
    codes, spacing = _codes(cells), checks.positive("spacing", spacing)
    axes = codes.ndim
    if axes == 3 and thickness is not None:
        raise ValueError(f"thickness is {thickness!r}; for a solid body it must be left out")
    section = 1.0
    if axes == 2:
        section = spacing if thickness is None else checks.positive("thickness", thickness)
    kinds = _materials(codes, materials)
    place, joined = _neighbours(codes, connections)
    corners, point = _particles(place, joined)
    code = codes[tuple(place.T)]
    length = spacing * float(np.ptp(place, axis=0).max() + 1)
    parts = [cell_part(one, axes, spacing, section, length, diagonals=True) for one in kinds.values()]
    which = np.searchsorted(list(kinds), code)
    mass, stiffness, time, modulus, damping = (np.array(values)[which] for values in zip(*parts, strict=True))
    system = System(
        position=spacing * (point - np.array(codes.shape) / 2),
        mass=np.bincount(corners.ravel(), np.repeat(mass, 2**axes)),
        surface=_surface(corners, code, joined, place),
        groups={str(c): np.unique(corners[code == c]) for c in kinds},
        **_springs(corners, point, spacing, stiffness, time),
    )
    own = np.argsort(corners[:, 0])
    own = own[modulus[own] != 0]
    if len(own):
        numbers = {"modulus": modulus[own], "damping": damping[own], "rest_volume": spacing**axes}
        system = system.replace(cells=Cells(corners=corners[own], **numbers))
    return system.pin(str(FIXED)) if FIXED in kinds and FIXED not in (materials or {}) else system


def voxel_corners(
    cells: ArrayLike, code: int | None = None, *, connections: ArrayLike | None = None
) -> NDArray[np.int32]:
    """Return the particles at the corners of the cells of `voxels`, shape [cell_count, 4] or [cell_count, 8].

    Cells are in the order of `numpy.argwhere(cells)`, corners as in `Cells`. With a `code` they are those of its
    cells only, which `Actuator(strain, cells=...)` makes a muscle.

    Raises ValueError as `voxels` does, and if no cell has the code.
    """
    codes = _codes(cells)
    place, joined = _neighbours(codes, connections)
    corners, _ = _particles(place, joined)
    if code is None:
        return corners
    chosen = codes[tuple(place.T)] == code
    if not chosen.any():
        raise ValueError(f"code is {code!r}; it must be one of {', '.join(map(str, np.unique(codes[codes > 0])))}")
    return corners[chosen]


def _codes(cells: ArrayLike) -> NDArray[np.int64]:
    """Return the codes of cells as an array; raise ValueError if they are no body's."""
    given = np.asarray(cells)
    if given.dtype.kind == "f" and (given == np.round(given)).all():  # as evogym has them
        given = given.astype(np.int64)
    codes = checks.whole_numbers("cells", given, "(nx, ny) or (nx, ny, nz)", lambda shape: len(shape) in (2, 3))
    checks.within("cells", codes, (lambda code: code >= 0, "a code of at least 0 (0 is no cell)"))
    count = int(np.count_nonzero(codes))
    if not count:
        raise ValueError("cells is 0 everywhere; there must be a cell at least")
    checks.fits(f"cells has shape {codes.shape}", f"{count:.3g} cells", count * _BYTES[codes.ndim])
    return codes.astype(np.int64)


def _materials(codes: NDArray[np.int64], materials: Mapping[int, Material] | None) -> dict[int, Material]:
    """Return the material of each code in a body, in order."""
    given = {} if materials is None else materials
    checks.instance("materials", given, Mapping, "{1: msdwarp.RUBBER}")
    for code, material in given.items():
        if isinstance(code, bool) or not isinstance(code, int | np.integer) or code < 1:
            raise ValueError(f"materials has the code {code!r}; it must be a whole number of at least 1")
        checks.instance(f"materials[{code}]", material, Material, "msdwarp.RUBBER")
    known = MATERIALS | dict(given)
    for code in np.unique(codes[codes > 0]).tolist():
        if code not in known:
            raise ValueError(
                f"cells has the code {code}; materials must have its material (it has {sorted(known)})"
            )
    return {code: known[code] for code in np.unique(codes[codes > 0]).tolist()}


def _neighbours(
    codes: NDArray[np.int64], connections: ArrayLike | None
) -> tuple[NDArray[np.intp], list[NDArray[np.intp]]]:
    """Return (places of the cells, shape [cell_count, axes]; joined pairs of cells along each axis, [any, 2])."""
    place = np.argwhere(codes)
    number = np.full(codes.shape, -1)
    number[tuple(place.T)] = np.arange(len(place))
    joined = []
    for axis in range(codes.ndim):
        pairs = np.stack([np.delete(number, -1, axis).ravel(), np.delete(number, 0, axis).ravel()], axis=1)
        joined.append(pairs[(pairs >= 0).all(axis=1)])
    if connections is not None:
        given = np.sort(checks.indices("connections", connections, 2, codes.size), axis=1)
        pairs = number.ravel()[given]
        key = pairs @ (len(place), 1)
        known = [each @ (len(place), 1) for each in joined]
        wrong = (pairs < 0).any(axis=1) | ~np.isin(key, np.concatenate(known))
        if wrong.any():
            k = int(np.argmax(wrong))
            one, other = (tuple(map(int, np.unravel_index(n, codes.shape))) for n in given[k])
            raise ValueError(
                f"connections[{k}] joins {one} and {other}; they must be neighbouring cells of the body"
            )
        joined = [each[np.isin(of, key)] for each, of in zip(joined, known, strict=True)]
    count = len(np.unique(pieces(len(place), np.concatenate(joined).astype(np.int32))))
    if count > 1:
        raise ValueError(
            f"cells is {count} pieces of which no cells are joined; it must be one (cells are joined by a common "
            "side; systems can be added)"
        )
    return place, joined


def _particles(
    place: NDArray[np.intp], joined: list[NDArray[np.intp]]
) -> tuple[NDArray[np.int32], NDArray[np.intp]]:
    """Return (particles at the corners of cells, shape [cell_count, 2^axes]; lattice point of each particle).

    Joined cells have the corners of their common side in common.
    """
    axes = place.shape[1]
    steps = CORNER_STEPS[axes]
    corner = np.arange(len(place) * len(steps)).reshape(-1, len(steps))
    same = [np.empty((0, 2), dtype=np.intp)]
    for axis, pairs in enumerate(joined):
        here = np.flatnonzero(steps[:, axis] == 1)
        there = [int(np.argmax((steps == steps[k] - np.eye(axes, dtype=int)[axis]).all(axis=1))) for k in here]
        same.append(np.stack([corner[pairs[:, :1], here], corner[pairs[:, 1:], there]], axis=-1).reshape(-1, 2))
    lowest = pieces(corner.size, np.concatenate(same).astype(np.int32))
    first, particle = np.unique(lowest, return_inverse=True)
    point = (place[:, None] + steps).reshape(-1, axes)[first]
    order = np.lexsort(point.T)  # the last coordinate counts most
    number = np.empty(len(order), dtype=np.int32)
    number[order] = np.arange(len(order))
    return number[particle].reshape(corner.shape), point[order]


def _springs(
    corners: NDArray[np.int32], point: NDArray[np.intp], spacing: float, stiffness: NDArray, time: NDArray
) -> dict[str, Any]:
    """Return connections between the corners of cells, with their constants and directions.

    `stiffness` is what each cell contributes, by the number of axes spanned, shape [cell_count, axes]; `time` is
    its b/k, shape [cell_count].
    """
    axes, count = point.shape[1], len(point)
    steps = CORNER_STEPS[axes]
    parts: dict[str, list] = {name: [] for name in ("connections", "rest_length", "stiffness", "damping")}
    slices, start = {}, 0
    for name, step in lattice_directions(axes, diagonals=True).items():
        span = int(np.abs(step).sum())
        pairs = corner_pairs(axes)[span]
        pairs = np.concatenate([pairs, pairs[:, ::-1]])
        pairs = pairs[(steps[pairs[:, 1]] - steps[pairs[:, 0]] == step).all(axis=1)]
        ends = corners[:, pairs].astype(np.int64) @ (count, 1)
        joined, which = np.unique(ends, return_inverse=True)
        k = np.repeat(stiffness[:, span - 1], len(pairs))
        b = k * np.repeat(time, len(pairs))
        parts["connections"].append(np.stack(np.divmod(joined, count), axis=1))
        parts["rest_length"].append(np.full(len(joined), spacing * np.sqrt(span)))
        for name_of, each in (("stiffness", k), ("damping", b)):
            parts[name_of].append(np.bincount(which.ravel(), each))
        slices[name] = slice(start, start + len(joined))
        start += len(joined)
    return {name: np.concatenate(values) for name, values in parts.items()} | {"directions": (slices,)}


def _surface(
    corners: NDArray[np.int32], code: NDArray[np.int64], joined: list[NDArray[np.intp]], place: NDArray[np.intp]
) -> Surface:
    """Return the faces of cells that no other cell is joined to; in the plane the cells themselves, facing up."""
    axes = place.shape[1]
    if axes == 2:
        cell, face, squares = np.arange(len(corners)), np.zeros(len(corners), dtype=int), corners
    else:
        free = np.ones((len(corners), len(FACES)), dtype=bool)
        for f, (axis, side) in enumerate(_AXIS_OF):
            free[joined[axis][:, 1 - side], f] = False
        cell, face = np.nonzero(free)
        squares = corners[cell[:, None], FACES[face]]
    tile = np.stack([code[cell] % TILES, code[cell] // TILES % TILES], axis=1)
    within = _INSET + (1 - 2 * _INSET) * CORNER_STEPS[2]
    vertex = np.arange(squares.size).reshape(-1, 4)
    # Faces in a plane have one normal at a particle, those around an edge have their own.
    _, first, same = np.unique(
        squares.astype(np.int64) * len(FACES) + face[:, None], return_index=True, return_inverse=True
    )
    return Surface(
        particle=squares.ravel(),
        uv=((tile[:, None] + within) / TILES).reshape(-1, 2),
        triangles=vertex[:, [(0, 1, 2), (0, 2, 3)]].reshape(-1, 3),
        normal_of=first[same.ravel()],
    )
