"""Cloths: sheets of any outline, embedded in a lattice."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import checks
from ..bodies import Material, System
from .skin import SAMPLED, Skin, cell_centres, cells_along, embedded, fine_enough, held

_FINER = 4
"""Ratio of a cloth's lattice spacing to the spacing of its drawn grid."""
_CORNER = math.radians(15)
"""Where an outline turns by more than this angle, the drawn margin has a corner."""


def cloth(
    outline: ArrayLike,
    spacing: float,
    *,
    neighbors: int = 8,
    material: Material | None = None,
    thickness: float | None = None,
    mass: ArrayLike | None = None,
    total_mass: float | None = None,
    stiffness: ArrayLike | None = None,
    damping: ArrayLike | None = None,
    bending: float | str | None = None,
    dim: int = 3,
) -> System:
    """Return a sheet with any outline in the x-y plane, facing up.

    The particles are the corners of the lattice cells whose centre is inside the outline. Parts narrower than a
    cell are also filled, one cell wide, so that they stay connected. The drawn surface is a grid four times as
    fine, its border moved onto the outline. Texture coordinates grow with x and y from 0 to 1 over the bounding
    box.

    Parameters
    ----------
    outline
        Corners of a simple polygon, clockwise or counter-clockwise [m], shape [n, 2].
    spacing
        Distance of neighbouring particles along an axis [m].
    neighbors
        8 or 4, as for `sheet`.
    material, thickness, mass, total_mass, stiffness, damping
        A material and the thickness [m], or the constants of each particle [kg] and each connection [N/m],
        [N s/m]; see `lattice`.
    bending
        Bending resistance: the flexural rigidity [N m], "material", or None, as for `sheet`.
    dim
        Number of coordinates: 2 or 3.

    Raises
    ------
    ValueError
        If the outline crosses or touches itself, or the spacing is too large.
    """
    corners = _polygon(outline)
    low, high = corners.min(axis=0), corners.max(axis=0)
    spacing = fine_enough(
        spacing, {"longest extent of the outline": (high - low).max()}, high - low, np.prod(high - low)
    )
    centre, extent = (low + high) / 2, (high - low) / spacing
    corners = (corners - centre) / spacing
    shape = np.array(cells_along(extent, 1.0))
    cells = _cells_of(corners, shape)
    points, triangles = _fitted(corners * _FINER, _cells_of(corners * _FINER, shape * _FINER))
    skin = Skin(points * (spacing / _FINER), np.clip(points / _FINER / extent + 0.5, 0, 1), triangles)
    constants = {"mass": mass, "total_mass": total_mass, "stiffness": stiffness, "damping": damping}
    constants |= {"material": material, "thickness": thickness, "bending": bending}
    area = abs(_cross(corners, np.roll(corners, -1, axis=0)).sum()) / 2 * spacing**2
    body = embedded(cells, spacing, skin, area, neighbors=neighbors, dim=dim, **constants)
    return body.translate(np.resize([*centre, 0.0], body.dim))


def _polygon(outline: ArrayLike) -> NDArray[np.float64]:
    """Return the corners of a simple polygon, shape [n, 2]; raise ValueError if the polygon is not simple."""
    corners = checks.array("outline", outline)
    if corners.ndim != 2 or corners.shape[1] != 2:
        raise ValueError(f"outline has shape {corners.shape}; it must be (n, 2)")
    checks.within("outline", corners, checks.FINITE)
    if len(corners) > 1 and (corners[0] == corners[-1]).all():
        corners = corners[:-1]  # the last corner repeats the first
    if len(corners) < 3:
        raise ValueError(f"outline has {len(corners)} corners; it must have at least 3")
    side = np.roll(corners, -1, axis=0) - corners
    if not side.any(axis=1).all():
        raise ValueError(f"outline[{np.argmin(side.any(axis=1))}] is the same corner as the next")
    before = np.roll(side, 1, axis=0)
    back = (_cross(before, side) == 0) & ((before * side).sum(axis=1) < 0)
    if back.any():
        raise ValueError(f"outline turns back on itself at outline[{np.argmax(back)}]")
    for i in range(len(corners) - 2):
        j = np.arange(i + 2, len(corners) - (i == 0))  # sides without a common corner with side i
        a, b = corners[i], corners[i] + side[i]
        c, d = corners[j], corners[(j + 1) % len(corners)]
        # Sides cross if each separates the other's ends; if they are in line, if their bounding boxes meet.
        parted = _cross(b - a, c - a) * _cross(b - a, d - a) > 0
        parted |= _cross(d - c, a - c) * _cross(d - c, b - c) > 0
        parted |= ((np.minimum(a, b) > np.maximum(c, d)) | (np.maximum(a, b) < np.minimum(c, d))).any(axis=1)
        if not parted.all():
            raise ValueError(
                f"outline crosses or touches itself: its sides from outline[{i}] and "
                f"outline[{j[np.argmin(parted)]}] do"
            )
    return corners


def _cross(a: NDArray, b: NDArray) -> NDArray:
    """Return the cross product of vectors in a plane, shape [..., 2]."""
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]


def _inside(corners: NDArray[np.float64], x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return the mask of a grid's points inside a polygon, shape [nx, ny]."""
    end = np.roll(corners, -1, axis=0)  # a ray from a point inside crosses an odd number of sides
    inside = np.empty((len(x), len(y)), dtype=bool)
    for j, height in enumerate(y):
        meets = (corners[:, 1] > height) != (end[:, 1] > height)
        (xa, ya), (xb, yb) = corners[meets].T, end[meets].T
        crossings = np.sort(xa + (height - ya) / (yb - ya) * (xb - xa))
        inside[:, j] = np.searchsorted(crossings, x) % 2 == 1
    return inside


def _cells_of(corners: NDArray[np.float64], shape: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Return the mask of unit cells around the origin that fill a polygon: centres inside, and those by `held`."""
    ends = np.append(corners, corners[:1], axis=0)
    along = np.insert(np.cumsum(np.linalg.norm(np.diff(ends, axis=0), axis=1)), 0, 0.0)
    samples = np.linspace(0, along[-1], math.ceil(along[-1] / SAMPLED) + 1)
    margin = np.stack([np.interp(samples, along, ends[:, k]) for k in range(2)], axis=1)
    return held(_inside(corners, *(axis.ravel() for axis in cell_centres(shape, 1.0))), margin)


def _fitted(
    corners: NDArray[np.float64], cells: NDArray[np.bool_]
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return (points, triangles) of the chosen unit cells; margin points are moved onto the polygon `corners`."""
    around = np.pad(cells, 1).astype(int)
    around = around[:-1, :-1] + around[1:, :-1] + around[:-1, 1:] + around[1:, 1:]  # number of cells at each point
    number = np.cumsum(around.ravel() > 0).reshape(around.shape) - 1
    place = np.argwhere(around > 0)
    points = place - np.array(cells.shape) / 2
    margin = np.flatnonzero(around[tuple(place.T)] < 4)
    points[margin] = _nearest_of(corners, points[margin])
    # Each corner of the polygon, sharpest first, takes the nearest of these points.
    side = np.roll(corners, -1, axis=0) - corners
    before = np.roll(side, 1, axis=0)
    turn = np.abs(np.arctan2(_cross(before, side), (before * side).sum(axis=1)))
    for k in np.argsort(-turn, kind="stable")[: np.count_nonzero(turn > _CORNER)]:
        distance = np.linalg.norm(points[margin] - corners[k], axis=1)
        if distance.min(initial=np.inf) < 2:
            points[margin[np.argmin(distance)]] = corners[k]
            margin = np.delete(margin, np.argmin(distance))
    i, j = np.nonzero(cells)
    a, b, c, d = number[i, j], number[i + 1, j], number[i + 1, j + 1], number[i, j + 1]
    # A square is halved along the diagonal for which the smaller triangle is larger.
    ways = np.array([[[a, b, c], [a, c, d]], [[a, b, d], [b, c, d]]])  # [way, triangle, corner, square]
    p, q, r = (points[ways[:, :, k]] for k in range(3))
    better = np.argmax(_cross(q - p, r - p).min(axis=1), axis=0)
    return points, np.concatenate([ways[better, k, :, np.arange(len(i))] for k in range(2)])


def _nearest_of(corners: NDArray[np.float64], points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the nearest point on a polygon's sides to each point, shape [any, 2]."""
    side = np.roll(corners, -1, axis=0) - corners
    result = np.empty_like(points)
    for start in range(0, len(points), 256):
        offset = points[start : start + 256, None] - corners
        fraction = np.clip((offset * side).sum(axis=-1) / (side**2).sum(axis=-1), 0, 1)
        foot = corners + fraction[..., None] * side
        nearest = np.argmin(np.linalg.norm(points[start : start + 256, None] - foot, axis=-1), axis=1)
        result[start : start + 256] = foot[np.arange(len(nearest)), nearest]
    return result
