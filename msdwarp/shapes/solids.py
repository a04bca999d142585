"""Solids of revolution: a lattice with an embedded smooth surface."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import checks
from ..bodies import Material, System
from .skin import Skin, cell_centres, cells_along, embedded, fine_enough

_AROUND, _AROUND_BALL = 64, 32
"""Minimal number of vertices around a solid, and around a ball, so that coarse solids look round, too. Chords of
the circle are nearer to the axis by at most 0.12 % and 0.5 % of the radius. Effective friction of a rope around a
cylinder of 32 sides is too high by 0.06, around one of 64 by 0.02. Contact of a ball takes a fifth of the time of
one with 64 vertices around."""


def ball(
    radius: float,
    spacing: float,
    *,
    neighbors: int = 26,
    material: Material | None = None,
    mass: ArrayLike | None = None,
    total_mass: float | None = None,
    stiffness: ArrayLike | None = None,
    damping: ArrayLike | None = None,
) -> System:
    """Return a ball with its centre at the origin.

    Particles are the corners of the lattice cells whose centre is inside. With a material the mass is that of a
    round ball, though the cells of a coarse one fill a volume that differs by some percent. Obstacles collide with
    particles. With `Contact(surface_colliders=True)` they collide with the drawn surface, so that the ball rolls,
    and the force is nearer to Hertz's. Where balls touch bodies, `from_mesh(icosphere(radius, 2), across=6)` is
    faster, since its surface has a third of the triangles.

    The texture is like a map of the globe: u is the longitude, 0 and 1 at −x, ½ at +x, growing eastwards; v is the
    latitude, 0 at the south pole (−z), 1 at the north pole.

    Parameters
    ----------
    radius
        Radius [m].
    spacing
        Distance of neighbouring particles along an axis [m], at most the radius.
    neighbors, material, mass, total_mass, stiffness, damping
        As for `box`.
    """
    radius = checks.positive("radius", radius, checks.ONE_SIZE)
    spacing = fine_enough(spacing, {"radius": radius}, [2 * radius] * 3)
    columns = _columns(radius, spacing, _AROUND_BALL)
    latitude = np.linspace(-math.pi / 2, math.pi / 2, columns // 2 + 1)
    ring = radius * np.cos(latitude)
    ring[[0, -1]] = 0.0  # exactly 0 at the poles, despite rounding
    skin = _revolved(ring, radius * np.sin(latitude), columns, (0, 1, 0, 1), smooth=True)

    x, y, z = cell_centres(cells_along([2 * radius] * 3, spacing), spacing)
    cells = x**2 + y**2 + z**2 < radius**2
    constants = {"mass": mass, "total_mass": total_mass, "stiffness": stiffness, "damping": damping}
    volume = 4 / 3 * math.pi * radius**3
    return embedded(cells, spacing, skin, volume, neighbors=neighbors, material=material, **constants)


def cylinder(
    radius: float,
    height: float,
    spacing: float,
    *,
    neighbors: int = 26,
    material: Material | None = None,
    mass: ArrayLike | None = None,
    total_mass: float | None = None,
    stiffness: ArrayLike | None = None,
    damping: ArrayLike | None = None,
) -> System:
    """Return an upright cylinder with its centre at the origin.

    Particles are the corners of the lattice cells whose centre is inside. The lower half of the texture shows the
    side: u goes around eastwards, 0 and 1 at −x, and v from 0 at the bottom to ½ at the top. The upper half
    has two discs, the bottom on the left (u along y, v along x) and the top on the right (u along x, v along y).
    The rims are sharp.

    Parameters
    ----------
    radius, height
        Radius and height [m].
    spacing
        Distance of neighbouring particles along an axis [m], at most the radius and the height.
    neighbors, material, mass, total_mass, stiffness, damping
        As for `box`.
    """
    radius, height = checks.positive("radius", radius), checks.positive("height", height)
    spacing = fine_enough(spacing, {"radius": radius, "height": height}, (2 * radius, 2 * radius, height))
    columns, half = _columns(radius, spacing), height / 2
    wide, _, along = shape = cells_along([2 * radius, 2 * radius, height], spacing)
    across = (wide + 1) // 2
    skin = _together(
        _disc(radius, -half, across, columns, up=False),
        _revolved(np.full(along + 1, radius), np.linspace(-half, half, along + 1), columns, (0, 1, 0, 0.5)),
        _disc(radius, half, across, columns, up=True),
    )

    x, y, z = cell_centres(shape, spacing)
    cells = (x**2 + y**2 < radius**2) & (np.abs(z) < half)
    constants = {"mass": mass, "total_mass": total_mass, "stiffness": stiffness, "damping": damping}
    volume = math.pi * radius**2 * height
    return embedded(cells, spacing, skin, volume, neighbors=neighbors, material=material, **constants)


def cone(
    radius: float,
    height: float,
    spacing: float,
    *,
    neighbors: int = 26,
    material: Material | None = None,
    mass: ArrayLike | None = None,
    total_mass: float | None = None,
    stiffness: ArrayLike | None = None,
    damping: ArrayLike | None = None,
) -> System:
    """Return an upright cone with apex up; the origin is at half its height.

    Particles are the corners of the lattice cells whose centre is inside. One column of cells is centred on the
    axis and ends less than a spacing below the apex. The lower half of the texture shows the side: u goes around
    eastwards, 0 and 1 at −x, and v from 0 at the base to ½ at the apex. The upper half has the base, a disc on the
    left (u along y, v along x). Rim and apex are sharp.

    Parameters
    ----------
    radius, height
        Radius of the base, and height [m].
    spacing
        Distance of neighbouring particles along an axis [m], at most the radius and the height.
    neighbors, material, mass, total_mass, stiffness, damping
        As for `box`.
    """
    radius, height = checks.positive("radius", radius), checks.positive("height", height)
    spacing = fine_enough(spacing, {"radius": radius, "height": height}, (2 * radius, 2 * radius, height))
    columns, half = _columns(radius, spacing), height / 2
    wide, slant, along = cells_along([2 * radius, math.hypot(radius, height), height], spacing)
    ring, z = np.linspace(radius, 0, slant + 1), np.linspace(-half, half, slant + 1)
    skin = _together(
        _disc(radius, -half, (wide + 1) // 2, columns, up=False),
        _revolved(ring, z, columns, (0, 1, 0, 0.5)),
    )

    x, y, z = cell_centres((wide | 1, wide | 1, along), spacing)  # odd, so that a column is on the axis
    cells = (np.hypot(x, y) < radius * (half - z) / height) & (np.abs(z) < half)
    constants = {"mass": mass, "total_mass": total_mass, "stiffness": stiffness, "damping": damping}
    volume = math.pi * radius**2 * height / 3
    return embedded(cells, spacing, skin, volume, neighbors=neighbors, material=material, **constants)


def _columns(radius: float, spacing: float, least: int = _AROUND) -> int:
    """Return the number of vertices around a solid: a multiple of 4, at most a spacing apart."""
    return max(least, 4 * math.ceil(math.tau * radius / spacing / 4))


def _revolved(
    ring: NDArray, z: NDArray, columns: int, tile: tuple[float, float, float, float], *, smooth: bool = False
) -> Skin:
    """Return the surface that a line sweeps around the z axis, facing outwards where the line goes up.

    Points of the line are at distances `ring` from the axis [m] and at heights z. Only the first and the last may
    be on the axis: there each column has its own vertex, halfway between its sides; if the surface is `smooth`
    these have a common normal. `tile` is the part of the texture: u from and to, v from and to.
    """
    angle = math.tau * np.arange(columns) / columns - math.pi
    cosine, sine = (np.append(values, values[0]) for values in (np.cos(angle), np.sin(angle)))  # closes exactly
    points, uv, index, normal_of, count = [], [], [], [], 0
    for r, (radius, height) in enumerate(zip(ring, z, strict=True)):
        pole = radius == 0
        u = (np.arange(columns) + 0.5 if pole else np.arange(columns + 1)) / columns
        vertex = np.arange(len(u))
        points.append(np.stack([radius * cosine[vertex], radius * sine[vertex], np.full(len(u), height)], axis=1))
        uv.append(np.stack([u, np.full(len(u), r / (len(ring) - 1))], axis=1))
        own = vertex * (not smooth) if pole else vertex % columns  # seam: the last has the first's normal
        normal_of.append(count + own)
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
    """Return a disc facing up (upper right quarter of the texture) or down (upper left quarter)."""
    ring = np.linspace(radius, 0, rows + 1) if up else np.linspace(0, radius, rows + 1)
    flat = _revolved(ring, np.full(rows + 1, z), columns, (0, 1, 0, 1), smooth=True)
    seen = flat.points[:, [0, 1]] if up else flat.points[:, [1, 0]]
    return replace(flat, uv=np.array([0.5 if up else 0.0, 0.5]) + 0.25 * (1 + seen / radius))


def _together(*skins: Skin) -> Skin:
    """Return several skins as one; edges where they meet are sharp."""
    first = np.cumsum([0] + [len(skin.points) for skin in skins])
    return Skin(
        np.concatenate([skin.points for skin in skins]),
        np.concatenate([skin.uv for skin in skins]),
        np.concatenate([skin.triangles + k for skin, k in zip(skins, first, strict=False)]),
        np.concatenate([skin.normal_of + k for skin, k in zip(skins, first, strict=False)]),
    )
