"""Bodies of any shape: a closed mesh as surface, filled with a lattice whose particles move it."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from os import PathLike
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import checks
from ..bodies import Material, System, sides_of
from .skin import SAME, SAMPLED, Skin, cells_along, embedded, fine_enough, held

Mesh = tuple[NDArray[np.float64], NDArray[np.float64] | None, NDArray[np.intp]]
"""(points [m], texture coordinates or None, triangles)."""
_MORE = 1.05
"""A body says that it is thinner than its cells if these fill more than this times its volume."""
_SHARP = math.cos(math.radians(30))
"""If triangles at a point meet at more than this angle, coincident vertices keep separate normals."""


def from_mesh(
    mesh: Any,
    spacing: float | None = None,
    *,
    across: int | None = None,
    neighbors: int = 26,
    material: Material | None = None,
    mass: ArrayLike | None = None,
    total_mass: float | None = None,
    stiffness: ArrayLike | None = None,
    damping: ArrayLike | None = None,
) -> System:
    """Return a body that fills a closed mesh with particles, at the position of the mesh.

    The particles are the corners of the lattice cells whose centre is inside the mesh. Parts thinner than a cell
    are also filled, one cell thick, so that they stay connected. Gaps narrower than a cell may be filled or
    bridged by connections. With a material the mass is density times the volume of the mesh; the stiffness is that
    of the cells, whose volume differs from it the more, the coarser they are. The mesh is drawn as the surface;
    its edges are halved until none is longer than two spacings, so that it can bend.

    Texture coordinates of the mesh are kept. Without them u is |angle| / π around the vertical axis through the
    middle of the bounding box, 0 at +x and 1 at −x, and v is the height, from 0 at the bottom to 1 at the top.
    Coincident vertices, such as along the seam of a texture, have a common normal, unless the surface bends there
    by more than 30°.

    Parameters
    ----------
    mesh
        A PyVista surface, or (points [m] of shape [n, 3], triangles of shape [m, 3]). Every edge must have two
        triangles, and all triangles must have the same orientation, inwards or outwards.
    spacing
        Distance of neighbouring particles along an axis [m]. Give either `spacing` or `across`.
    across
        Number of cells along the mesh's longest extent.
    neighbors, material, mass, total_mass, stiffness, damping
        As for `box`.

    Raises
    ------
    ValueError
        If an argument is out of range; the mesh is empty, open, not finite, without volume, or inconsistently
        oriented; or the body has several pieces; or it takes more memory than is free.

    Warns
    -----
    StartWarning
        If the mesh is thinner than its cells, so that with a material it is too stiff.
    """
    points, uv, triangles = read_mesh(mesh)
    low, high = points.min(axis=0), points.max(axis=0)
    extent = high - low
    centre = (low + high) / 2
    points, uv, triangles, place = merged(points - centre, uv, triangles)
    triangles = _facing_out(points, triangles, place)
    longest = float(extent.max())
    if (across is None) == (spacing is None):
        raise ValueError(f"spacing is {spacing} and across is {across}; one of them must be given, not both")
    h = longest / checks.count("across", across, 1) if across is not None else spacing
    a, b, c = points[triangles].transpose(1, 0, 2)
    doubled = np.cross(b - a, c - a)
    area, volume = np.linalg.norm(doubled, axis=1).sum() / 2, np.einsum("td,td->", a, doubled) / 6
    given = None if across is None else f"across is {across}"
    h = fine_enough(cast(float, h), {"longest extent of the mesh": longest}, extent, area, given)
    shape = cells_along(extent, h)
    samples, _, _ = _subdivided(points / h, None, triangles, SAMPLED)
    cells = held(_filled(points / h, triangles, shape), samples)
    points, uv, triangles = _subdivided(points, uv, triangles, 2 * h)
    if uv is None:
        around = np.abs(np.arctan2(points[:, 1], points[:, 0])) / math.pi
        uv = np.stack([around, points[:, 2] / extent[2] + 0.5], axis=1)
    skin = Skin(points, np.asarray(uv), triangles, shared_normals(points, triangles))
    constants = {"mass": mass, "total_mass": total_mass, "stiffness": stiffness, "damping": damping}
    body = embedded(cells, h, skin, volume, neighbors=neighbors, material=material, **constants)
    thickness, times = 2 * volume / area, np.count_nonzero(cells) * h**3 / volume
    if material is not None and thickness < h and times > _MORE:
        checks.warn(
            f"the mesh is thinner than its cells of {h:.3g} m: its mean thickness (twice the volume over the "
            f"area) is {thickness:.3g} m, and the cells fill {times:.3g} times its volume. The body's mass is "
            f"that of the mesh, but it is too stiff; with across={math.ceil(2 * longest / thickness)} it is two "
            "cells thick",
            checks.StartWarning,
        )
    return body.translate(centre)


def read_mesh(mesh: Any) -> Mesh:
    """Return a mesh without unused points; raise ValueError if it is invalid."""
    uv = None
    if hasattr(mesh, "triangulate") and hasattr(mesh, "points"):
        surface = mesh.triangulate()
        if not hasattr(surface, "regular_faces"):
            raise ValueError(f"mesh is a {type(mesh).__name__}; it must be a surface: try mesh.extract_surface()")
        uv = surface.active_texture_coordinates
        given = surface.points, surface.regular_faces
    elif isinstance(mesh, tuple | list) and len(mesh) == 2:
        given = mesh
    else:
        file = (
            "; from_volume makes a solid of a file, pyvista.read a mesh"
            if isinstance(mesh, str | PathLike)
            else ""
        )
        raise ValueError(
            f"mesh is {checks.repr_short(mesh) if file else f'a {type(mesh).__name__}'}; "
            f"it must be a PyVista surface or (points, triangles){file}"
        )
    points = checks.array("the mesh's points", given[0])
    if points.ndim != 2 or points.shape[1] != 3:
        raise ValueError(f"the mesh's points have shape {points.shape}; they must be (any, 3)")
    checks.within("the mesh's points", points, checks.FINITE)
    triangles = checks.indices("the mesh's triangles", given[1], 3, len(points))
    if not len(triangles):
        raise ValueError("mesh has no triangles; it must have a closed surface of them")
    if uv is not None:
        uv = checks.broadcast("the mesh's texture coordinates", uv, (len(points), 2))
    return _used(points, uv, triangles)


def _used(points: NDArray[np.float64], uv: NDArray[np.float64] | None, triangles: NDArray[np.integer]) -> Mesh:
    """Return a mesh without unused points."""
    used, numbers = np.unique(triangles, return_inverse=True)
    return points[used], None if uv is None else uv[used], numbers.reshape(-1, 3)


def merged(
    points: NDArray[np.float64], uv: NDArray[np.float64] | None, triangles: NDArray[np.intp]
) -> tuple[NDArray[np.float64], NDArray[np.float64] | None, NDArray[np.intp], NDArray[np.intp]]:
    """Return a mesh whose nearly coincident points are at the same place, and the number of each point's place.

    Triangles that then have only two distinct corners, and points without triangles, are dropped.
    """
    one = _coincident(points, SAME * float(np.ptp(points, axis=0).max()))
    corners = one[triangles]
    triangles = triangles[(corners != np.roll(corners, 1, axis=1)).all(axis=1)]
    if not len(triangles):
        raise ValueError("mesh is but a point or a line; it must be a surface")
    place = np.unique(one[np.unique(triangles)], return_inverse=True)[1]
    return *_used(points[one], uv, triangles), place


def _facing_out(
    points: NDArray[np.float64], triangles: NDArray[np.intp], place: NDArray[np.intp]
) -> NDArray[np.intp]:
    """Return a closed mesh's triangles, facing outwards; raise ValueError if it is not closed."""
    edges, edge, forwards = sides_of(place[triangles])
    times = np.bincount(edge.ravel(), minlength=len(edges))
    wrong = times != 2
    if wrong.any():
        first = np.argmax(wrong)
        a, b = (np.array2string(points[np.argmax(place == i)], precision=4) for i in edges[first])
        raise ValueError(
            f"mesh is not closed: of its {len(edges)} edges {wrong.sum()} have not two triangles, such as that "
            f"from {a} to {b} [m from its middle] with {times[first]}"
        )
    # Neighbours with the same orientation traverse their common edge in opposite directions.
    disagree = np.bincount(edge.ravel(), weights=forwards.ravel()) != 1
    if disagree.any():
        raise ValueError(
            f"mesh has triangles that disagree about which side is outside, at {disagree.sum()} edges; all must "
            "be counter-clockwise seen from outside (in PyVista: mesh.compute_normals(consistent_normals=True))"
        )
    volume = np.linalg.det(points[triangles]).sum() / 6
    if abs(volume) <= SAME**2 * np.ptp(points, axis=0).max() ** 3:
        raise ValueError(f"mesh encloses a volume of {volume:g} m³; it must enclose some")
    return triangles if volume > 0 else triangles[:, ::-1]


def _coincident(points: NDArray[np.float64], tolerance: float) -> NDArray[np.intp]:
    """Return the index of the first point that coincides with each point, shape [any].

    Points in one cell of a grid coincide. Two near points may be in different cells, but are then in one cell of
    a grid that is shifted by half a cell along some axes.
    """
    if tolerance == 0:
        tolerance = 1.0
    grids = []
    for shift in itertools.product((0.0, 0.5), repeat=points.shape[1]):
        cell = np.floor(points / (2 * tolerance) + shift).astype(np.int64)
        grids.append(np.unique(cell, axis=0, return_inverse=True)[1].ravel())
    first = np.arange(len(points))
    while True:
        before = first
        for cell in grids:
            least = np.full(cell.max() + 1, len(points))
            np.minimum.at(least, cell, first)
            first = least[cell]
        if np.array_equal(first, before):
            return first


def _filled(points: NDArray[np.float64], triangles: NDArray[np.intp], shape: Sequence[int]) -> NDArray[np.bool_]:
    """Return the mask of unit cells around the origin whose centres are inside a closed mesh.

    A centre is inside if more of the triangles above it face up than down (its winding number is above 0). Seen
    from above, a row of centres enters a triangle where it crosses one edge and leaves it at another. Triangles
    with a common edge find the same crossing, to the last bit: no centre falls between them or counts twice.
    """
    place = points + (np.array(shape) - 1) / 2  # cell centres are whole numbers
    corner = place[triangles]
    edge = np.stack([corner, np.roll(corner, -1, axis=1)], axis=2)  # [triangle, edge, end, axis]
    rises = edge[:, :, 0, 1] < edge[:, :, 1, 1]
    ends = np.where(rises[..., None, None], edge, edge[:, :, ::-1])  # upwards along y
    of, row = _between(ends[:, :, 0, 1].ravel(), ends[:, :, 1, 1].ravel(), shape[1])
    (xa, ya, _), (xb, yb, _) = ends.reshape(-1, 2, 3)[of].transpose(1, 2, 0)
    x, rises = xa + (row - ya) / (yb - ya) * (xb - xa), rises.ravel()[of]
    order = np.lexsort((row, of // 3, rises))  # each row crosses a triangle's edges once upwards, once downwards
    down, up = order.reshape(2, -1)
    pair, column = _between(np.minimum(x[down], x[up]), np.maximum(x[down], x[up]), shape[0])
    row, triangle, facing = row[up][pair], of[up][pair] // 3, np.sign(x[up] - x[down])[pair]
    a, b, c = corner.transpose(1, 0, 2)
    nx, ny, nz = np.cross(b - a, c - a).T
    (xa, ya, za), steep = a[triangle].T, np.where(nz == 0, 1.0, nz)
    z = za - ((nx / steep)[triangle] * (column - xa) + (ny / steep)[triangle] * (row - ya))
    z = np.clip(z, corner[..., 2].min(axis=1)[triangle], corner[..., 2].max(axis=1)[triangle])  # steep ones round
    crossings = np.zeros((shape[0], shape[1], shape[2] + 1), dtype=np.int16)
    below = np.clip(np.ceil(z), 0, shape[2]).astype(np.intp)  # number of centres below
    np.add.at(crossings, (column, row, below), facing.astype(np.int16))
    above = crossings[:, :, ::-1]
    return np.cumsum(above, axis=2, dtype=np.int16, out=above)[:, :, -2::-1] > 0


def _between(low: NDArray, high: NDArray, count: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return whole numbers n with low ≤ n < high, from 0 to count − 1, and before them whose bounds these are."""
    low, high = (np.clip(np.ceil(one), 0, count).astype(np.intp) for one in (low, high))
    many = np.maximum(high - low, 0)
    of = np.repeat(np.arange(len(many)), many)
    return of, np.arange(len(of)) - np.repeat(np.cumsum(many) - many - low, many)


def _subdivided(
    points: NDArray[np.float64], uv: NDArray[np.float64] | None, triangles: NDArray[np.intp], longest: float
) -> Mesh:
    """Return a mesh with edges halved until none is longer than `longest` [m]."""
    count = 0
    while len(triangles) > count:
        count = len(triangles)
        points, uv, triangles = halved(points, uv, triangles, longest)
    return points, uv, triangles


def halved(
    points: NDArray[np.float64], uv: NDArray[np.float64] | None, triangles: NDArray[np.intp], longest: float
) -> Mesh:
    """Return a mesh after halving once each edge longer than `longest` [m]."""
    edges, edge, _ = sides_of(triangles)
    long = np.linalg.norm(points[edges[:, 0]] - points[edges[:, 1]], axis=1) > longest
    middle = np.where(long, len(points) + np.cumsum(long) - 1, -1)[edge]
    points = np.concatenate([points, points[edges[long]].mean(axis=1)])
    if uv is not None:
        uv = np.concatenate([uv, uv[edges[long]].mean(axis=1)])
    # Rotate each triangle a, b, c so that existing midpoints come first among those of ab, bc, ca.
    count = np.count_nonzero(middle >= 0, axis=1)
    lone = np.where(count == 2, np.argmin(middle >= 0, axis=1) + 1, np.argmax(middle >= 0, axis=1))
    turn = (np.arange(3) + lone[:, None]) % 3
    corner, middle = np.take_along_axis(triangles, turn, 1).T, np.take_along_axis(middle, turn, 1).T
    (a, b, c), (ab, bc, ca) = corner, middle
    parts = [triangles[count == 0]]
    for n, split in (
        (1, ((a, ab, c), (ab, b, c))),
        (2, ((ab, b, bc), (a, ab, bc), (a, bc, c))),
        (3, ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))),
    ):
        parts += [np.stack(triangle, axis=1)[count == n] for triangle in split]
    return points, uv, np.concatenate(parts)


def shared_normals(points: NDArray[np.float64], triangles: NDArray[np.intp]) -> NDArray[np.intp]:
    """Return the vertex whose normal each vertex uses: one at the same point, with nearly the same normal."""
    corner = points[triangles]
    area = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    normal = np.zeros_like(points)
    for k in range(3):
        np.add.at(normal, triangles[:, k], area)
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), np.finfo(float).tiny)
    place = np.unique(points, axis=0, return_inverse=True)[1].ravel()
    normal_of = np.arange(len(points))
    left = np.arange(len(points))
    while len(left):
        # The first remaining vertex at each point defines the normal; others that agree with it use it.
        _, first, group = np.unique(place[left], return_index=True, return_inverse=True)
        leader = left[first][group]
        agrees = (np.einsum("vi,vi->v", normal[left], normal[leader]) > _SHARP) | (left == leader)
        normal_of[left[agrees]] = leader[agrees]
        left = left[~agrees]
    return normal_of
