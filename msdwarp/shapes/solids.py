"""Solids of revolution: a lattice inside, and a smooth surface around it that the lattice carries along."""

import itertools
import math
from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import checks
from ..bodies import Material, System
from .skin import Skin, cell_centres, embedded

_AROUND = 64
"""Least number of vertices around a solid, so that a coarse one looks round too."""


def ball(
    radius: float,
    spacing: float,
    *,
    neighbours: int = 26,
    material: Material | None = None,
    mass: ArrayLike | None = None,
    stiffness: ArrayLike | None = None,
    damping: ArrayLike | None = None,
) -> System:
    """Return a ball, its centre at the origin.

    Its particles are the corners of the lattice cells whose centre is inside. Its texture is like a map of the
    globe: u is the longitude, 0 and 1 at −x, ½ at +x, growing eastwards, and v the latitude, 0 at the south pole
    (−z) and 1 at the north pole.

    Parameters
    ----------
    radius
        Radius [m].
    spacing
        Distance of neighbouring particles along an axis [m], at most the radius.
    neighbours
        26 or 6, as for `box`.
    material, mass, stiffness, damping
        A material, or the constants of each particle [kg] and each connection [N/m], [N s/m]; see `lattice`.

    Raises
    ------
    ValueError
        If an argument is out of range.
    """
    radius = checks.positive("radius", radius)
    spacing = _fine_enough(spacing, radius=radius)
    columns = _columns(radius, spacing)
    latitude = np.linspace(-math.pi / 2, math.pi / 2, columns // 2 + 1)
    ring = radius * np.cos(latitude)
    ring[[0, -1]] = 0.0  # the poles, which rounding would miss
    skin = _revolved(ring, radius * np.sin(latitude), columns, (0, 1, 0, 1), smooth=True)

    def inside(x: NDArray, y: NDArray, z: NDArray) -> NDArray[np.bool_]:
        return x**2 + y**2 + z**2 < radius**2

    cells = _cells_inside(inside, [math.ceil(_cells(2 * radius, spacing))] * 3, spacing)
    constants = {"mass": mass, "stiffness": stiffness, "damping": damping}
    return embedded(cells, spacing, skin, neighbours=neighbours, material=material, **constants)


def cylinder(
    radius: float,
    height: float,
    spacing: float,
    *,
    neighbours: int = 26,
    material: Material | None = None,
    mass: ArrayLike | None = None,
    stiffness: ArrayLike | None = None,
    damping: ArrayLike | None = None,
) -> System:
    """Return an upright cylinder, its centre at the origin.

    Its particles are the corners of the lattice cells whose centre is inside. The lower half of its texture shows
    the side: u goes around eastwards, 0 and 1 at −x, and v from 0 at the bottom to ½ at the top. The upper half
    has two discs, the bottom on the left (u along y, v along x) and the top on the right (u along x, v along y).
    The rims are sharp.

    Parameters
    ----------
    radius, height
        Radius and height [m].
    spacing
        Distance of neighbouring particles along an axis [m], at most the radius and the height.
    neighbours
        26 or 6, as for `box`.
    material, mass, stiffness, damping
        A material, or the constants of each particle [kg] and each connection [N/m], [N s/m]; see `lattice`.

    Raises
    ------
    ValueError
        If an argument is out of range.
    """
    radius, height = checks.positive("radius", radius), checks.positive("height", height)
    spacing = _fine_enough(spacing, radius=radius, height=height)
    columns, half = _columns(radius, spacing), height / 2
    across, along = _steps(radius, spacing), _steps(height, spacing)
    skin = _together(
        _disc(radius, -half, across, columns, up=False),
        _revolved(np.full(along + 1, radius), np.linspace(-half, half, along + 1), columns, (0, 1, 0, 0.5)),
        _disc(radius, half, across, columns, up=True),
    )

    def inside(x: NDArray, y: NDArray, z: NDArray) -> NDArray[np.bool_]:
        return (x**2 + y**2 < radius**2) & (np.abs(z) < half)

    wide, high = math.ceil(_cells(2 * radius, spacing)), math.ceil(_cells(height, spacing))
    cells = _cells_inside(inside, (wide, wide, high), spacing)
    constants = {"mass": mass, "stiffness": stiffness, "damping": damping}
    return embedded(cells, spacing, skin, neighbours=neighbours, material=material, **constants)


def cone(
    radius: float,
    height: float,
    spacing: float,
    *,
    neighbours: int = 26,
    material: Material | None = None,
    mass: ArrayLike | None = None,
    stiffness: ArrayLike | None = None,
    damping: ArrayLike | None = None,
) -> System:
    """Return an upright cone, its apex up, the centre of its height at the origin.

    Its particles are the corners of the lattice cells whose centre is inside. One column of cells is centred on
    the axis and ends less than a spacing below the apex. The lower half of its texture shows the side: u goes
    around eastwards, 0 and 1 at −x, and v from 0 at the base to ½ at the apex. The upper half has the base, a disc
    on the left (u along y, v along x). Rim and apex are sharp.

    Parameters
    ----------
    radius, height
        Radius of the base, and height [m].
    spacing
        Distance of neighbouring particles along an axis [m], at most the radius and the height.
    neighbours
        26 or 6, as for `box`.
    material, mass, stiffness, damping
        A material, or the constants of each particle [kg] and each connection [N/m], [N s/m]; see `lattice`.

    Raises
    ------
    ValueError
        If an argument is out of range.
    """
    radius, height = checks.positive("radius", radius), checks.positive("height", height)
    spacing = _fine_enough(spacing, radius=radius, height=height)
    columns, half = _columns(radius, spacing), height / 2
    along = _steps(math.hypot(radius, height), spacing)
    ring, z = np.linspace(radius, 0, along + 1), np.linspace(-half, half, along + 1)
    skin = _together(
        _disc(radius, -half, _steps(radius, spacing), columns, up=False),
        _revolved(ring, z, columns, (0, 1, 0, 0.5)),
    )

    def inside(x: NDArray, y: NDArray, z: NDArray) -> NDArray[np.bool_]:
        return (np.hypot(x, y) < radius * (half - z) / height) & (np.abs(z) < half)

    wide = 2 * math.ceil((_cells(2 * radius, spacing) - 1) / 2) + 1  # odd: with cells on the axis
    cells = _cells_inside(inside, (wide, wide, math.ceil(_cells(height, spacing))), spacing)
    constants = {"mass": mass, "stiffness": stiffness, "damping": damping}
    return embedded(cells, spacing, skin, neighbours=neighbours, material=material, **constants)


def _cells_inside(inside: Callable[..., NDArray[np.bool_]], shape: ArrayLike, spacing: float) -> NDArray[np.bool_]:
    """Return which cells of a grid around the origin have their centre inside, shape [nx, ny, nz]."""
    return inside(*cell_centres(shape, spacing))


def _fine_enough(spacing: float, **sizes: float) -> float:
    """Return the spacing; raise ValueError unless it is at most each of the sizes."""
    spacing = checks.positive("spacing", spacing)
    for name, size in sizes.items():
        if spacing > size:
            raise ValueError(f"spacing is {spacing:g}; it must be at most {size:g}, the {name}")
    return spacing


def _cells(length: float, spacing: float) -> float:
    """Return how many cells fit into a length, less what rounding adds: ten tenths are no more than one."""
    return length / spacing * (1 - 1e-12)


def _steps(length: float, spacing: float) -> int:
    """Return into how many steps of a spacing at most a length of the skin is divided."""
    return math.ceil(_cells(length, spacing))


def _columns(radius: float, spacing: float) -> int:
    """Return how many vertices go around: a multiple of 4, no more than a spacing apart."""
    return max(_AROUND, 4 * math.ceil(math.tau * radius / spacing / 4))


def _revolved(
    ring: NDArray,
    z: NDArray,
    columns: int,
    tile: tuple[float, float, float, float],
    *,
    smooth: bool = False,
) -> Skin:
    """Return the surface that a line sweeps around the z axis, facing outwards where it rises.

    Parameters
    ----------
    ring, z
        Distance from the axis and height of the line's points [m], shape [rows + 1] each. Only the first and
        the last may be on the axis: there every column has a vertex of its own, halfway between its sides.
    columns
        Number of vertices around.
    tile
        The part of the texture that it takes: u from and to, v from and to.
    smooth
        Whether the vertices on the axis have a common normal.
    """
    angle = math.tau * np.arange(columns) / columns - math.pi
    cosine, sine = (np.append(values, values[0]) for values in (np.cos(angle), np.sin(angle)))  # exactly closed
    points, uv, index, normal_of, count = [], [], [], [], 0
    for r, (radius, height) in enumerate(zip(ring, z, strict=True)):
        pole = radius == 0
        u = (np.arange(columns) + 0.5 if pole else np.arange(columns + 1)) / columns
        vertex = np.arange(len(u))
        points.append(np.stack([radius * cosine[vertex], radius * sine[vertex], np.full(len(u), height)], axis=1))
        uv.append(np.stack([u, np.full(len(u), r / (len(ring) - 1))], axis=1))
        own = vertex if not pole else 0 * vertex if smooth else vertex
        normal_of.append(count + (own if pole else vertex % columns))  # the seam: the last is the first
        index.append(count + vertex)
        count += len(u)
    triangles = []
    for r, (low, high) in enumerate(itertools.pairwise(index)):
        if ring[r + 1] == 0:
            triangles.append(np.stack([low[:-1], low[1:], high], axis=1))
        elif ring[r] == 0:
            triangles.append(np.stack([low, high[1:], high[:-1]], axis=1))
        else:
            triangles.append(np.stack([low[:-1], low[1:], high[1:]], axis=1))
            triangles.append(np.stack([low[:-1], high[1:], high[:-1]], axis=1))
    scale, start = np.array([tile[1] - tile[0], tile[3] - tile[2]]), np.array([tile[0], tile[2]])
    return Skin(
        np.concatenate(points),
        start + scale * np.concatenate(uv),
        np.concatenate(triangles),
        np.concatenate(normal_of),
    )


def _disc(radius: float, z: float, rows: int, columns: int, *, up: bool) -> Skin:
    """Return a disc that faces up or down, seen from outside in the upper right or left of the texture."""
    ring = np.linspace(radius, 0, rows + 1) if up else np.linspace(0, radius, rows + 1)
    flat = _revolved(ring, np.full(rows + 1, z), columns, (0, 1, 0, 1), smooth=True)
    seen = flat.points[:, [0, 1]] if up else flat.points[:, [1, 0]]
    return Skin(
        flat.points,
        np.array([0.5 if up else 0.0, 0.5]) + 0.25 * (1 + seen / radius),
        flat.triangles,
        flat.normal_of,
    )


def _together(*skins: Skin) -> Skin:
    """Return several skins as one, with sharp edges where they meet."""
    first = np.cumsum([0] + [len(skin.points) for skin in skins])
    return Skin(
        np.concatenate([skin.points for skin in skins]),
        np.concatenate([skin.uv for skin in skins]),
        np.concatenate([skin.triangles + k for skin, k in zip(skins, first, strict=False)]),
        np.concatenate([skin.normal_of + k for skin, k in zip(skins, first, strict=False)]),
    )
