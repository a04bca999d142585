"""Triangle meshes of solid colliders, for drawing, and their poses.

Everything here is in three dimensions. A plane system is drawn upright in the x-z plane: a disc as a ball, a
capsule as a rod, a triangle as a cone, and a rectangle as a block as deep as its shorter side.
"""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..bodies import AXES, in_space
from ..shapes import box
from ..world import Box, Capsule, Collider, Cone, Plane, Scene, Sphere

AROUND = 72
"""Segments of a circle: the error is a quarter of a pixel for an outline of 500 pixels."""
WALL = 0.75
"""Half the edge of the square drawn for a plane, over the diagonal of the scene."""
SAMPLES = 61
"""Times at which the extent of a moving obstacle is sampled."""


class Mesh(NamedTuple):
    """The closed surface of a solid before it moves, with duplicate vertices along edges and seams.

    `points` [m] and unit `normals` are of shape [vertex_count, 3], `uv` of [vertex_count, 2], and `triangles`,
    counter-clockwise seen from outside, of [triangle_count, 3].
    """

    points: NDArray[np.float64]
    normals: NDArray[np.float64]
    uv: NDArray[np.float64]
    triangles: NDArray[np.int32]


def meshes(scene: Scene) -> list[tuple[Collider, Mesh]]:
    """Return the colliders of a scene that are drawn, all except planes, and their meshes."""
    dim = scene.system.dim
    return [(one, mesh_of(one, dim)) for one in scene.colliders if type(one) in _MESHES]


def walls(scene: Scene, towards: Sequence[NDArray]) -> list[tuple[Collider, Mesh]]:
    """Return the planes of a scene, except its ground, that face all given directions, each with a square in it.

    The squares are near the initial solids and bodies, and larger than them. A plane that faces away from the
    camera would hide the scene, and one that faces away from the light would put it in shadow.
    """
    dim = scene.system.dim
    points = np.concatenate([in_space(scene.system.position, np.float64), extent(scene)])
    low, high = points.min(axis=0), points.max(axis=0)
    middle, half = (low + high) / 2, WALL * float(np.linalg.norm(high - low)) or 1.0
    found: list[tuple[Collider, Mesh]] = []
    for one in scene.colliders:
        if not isinstance(one, Plane) or one is scene.ground:
            continue
        normal = in_space(one.unit_normal(dim), np.float64)
        if min(normal @ way for way in towards) < 1e-6:
            continue
        across, along, _ = _frame(normal).T
        centre = middle - (middle @ normal - one.offset) * normal
        corners = centre + half * np.array([-across - along, across - along, across + along, along - across])
        uv = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
        two = np.array([[0, 1, 2], [0, 2, 3]], dtype=np.int32)
        found.append((one, Mesh(corners, np.tile(normal, (4, 1)), uv, two)))
    return found


def mesh_of(collider: Collider, dim: int) -> Mesh:
    """Return the mesh of a sphere, box, capsule or cone in a space of `dim` coordinates.

    Texture coordinates: a box has its six faces in tiles, like `msdwarp.box`. For the others u runs around the
    axis and v along it on the surface: from 0 at the south pole, the round end at `start`, or the rim of the base,
    to 1 at the north pole, the other end, or the apex. The base of a cone shows the middle of the texture, at the
    scale that u has on the rim.
    """
    return _MESHES[type(collider)](collider.geometry(dim))


def pose_in_space(collider: Collider, time: float, dim: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return (R, o), of shapes [3, 3] and [3]: at `time` a point y of its mesh is at R y + o."""
    turn, shift = collider.pose(time, dim)
    axes = AXES[dim]
    matrix, offset = np.eye(3), np.zeros(3)
    matrix[np.ix_(axes, axes)], offset[axes] = turn, shift
    return matrix, offset


def extent(scene: Scene, *, fixed: bool = True) -> NDArray[np.float64]:
    """Return points that enclose solids at all times of the scene [m], shape [any, 3]: first those that move.

    Without `fixed` it is these alone.
    """
    points, solids = [np.empty((0, 3))], sorted(meshes(scene), key=lambda one: one[0].motion is None)
    for collider, mesh in solids:
        if collider.motion is None and not fixed:
            break
        times = [0.0] if collider.motion is None else np.linspace(0, scene.duration, SAMPLES)
        for time in times:
            turn, shift = pose_in_space(collider, float(time), scene.system.dim)
            points.append(mesh.points @ turn.T + shift)
    return np.concatenate(points)


def _place(point: Sequence[float]) -> NDArray[np.float64]:
    return in_space(np.array(point), np.float64)


def _ball(geometry: dict[str, Any]) -> Mesh:
    centre, radius = _place(geometry["a"]), geometry["radius"]
    angle = np.linspace(-np.pi / 2, np.pi / 2, AROUND // 2 + 1)
    profile = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return _lathe(radius * profile, profile, centre, np.array([0.0, 0.0, 1.0]))


def _rod(geometry: dict[str, Any]) -> Mesh:
    start, end, radius = _place(geometry["a"]), _place(geometry["b"]), geometry["radius"]
    angle = np.linspace(-np.pi / 2, 0, AROUND // 4 + 1)
    lower = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    normals = np.concatenate([lower, lower[::-1] * (1, -1)])
    profile = radius * normals
    profile[len(lower) :, 1] += np.linalg.norm(end - start)
    return _lathe(profile, normals, start, end - start)


def _cone(geometry: dict[str, Any]) -> Mesh:
    apex, base, radius = _place(geometry["a"]), _place(geometry["b"]), geometry["radius"]
    height = float(np.linalg.norm(apex - base))
    rim, tip = np.array([radius, 0.0]), np.array([0.0, height])
    # Rings so close that textures are not distorted where quadrilateral patches are split in two.
    up = np.linspace(0, 1, 25)[:, None]
    outwards = np.array([height, radius]) / np.hypot(height, radius)
    slope = _lathe(rim + up * (tip - rim), np.tile(outwards, (25, 1)), base, apex - base)
    lid = _lathe(np.array([[0.0, 0.0], [radius, 0.0]]), np.tile([0.0, -1.0], (2, 1)), base, apex - base)
    across = (lid.points - base) @ _frame(apex - base)[:, :2]
    uv, triangles = 0.5 + across / (2 * np.pi * radius), lid.triangles + np.int32(len(slope.points))
    flat = lid._replace(uv=uv, triangles=triangles)
    pairs: Any = zip(slope, flat, strict=True)
    return Mesh(*(np.concatenate(pair) for pair in pairs))


def _block(geometry: dict[str, Any]) -> Mesh:
    half = np.asarray(geometry["b"], dtype=float)
    dim = len(half)
    cube = box((2, 2, 2))  # edges of 1 m; its surface has the texture coordinates of a box
    surface = cube.surface
    assert surface is not None
    axes, size = np.eye(3), np.full(3, 2 * half.min())
    place = AXES[dim]
    axes[np.ix_(place, place)], size[place] = geometry["axes"], 2 * half
    points = (surface.points(cube.position) * size) @ axes.T
    a, b, c = (points[surface.triangles[:, k]] for k in range(3))
    normals = np.zeros_like(points)
    normals[surface.triangles] = np.cross(b - a, c - a)[:, None]  # each face has its own vertices, and is flat
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return Mesh(points + _place(geometry["a"]), normals, np.array(surface.uv), surface.triangles)


_MESHES: dict[type, Callable[[dict[str, Any]], Mesh]] = {Sphere: _ball, Box: _block, Capsule: _rod, Cone: _cone}


def _frame(axis: NDArray) -> NDArray[np.float64]:
    """Return a right-handed frame, shape [3, 3], with `axis` as third column; for z the frame is x, y, z."""
    e3 = axis / np.linalg.norm(axis)
    aside = np.array([1.0, 0.0, 0.0]) if abs(e3[0]) < 0.9 else np.array([0.0, 1.0, 0.0])
    e1 = aside - (aside @ e3) * e3
    e1 /= np.linalg.norm(e1)
    return np.stack([e1, np.cross(e3, e1), e3], axis=1)


def _lathe(profile: NDArray, normals: NDArray, origin: NDArray, axis: NDArray) -> Mesh:
    """Return the surface of revolution of a profile about an axis through `origin`.

    `profile` holds (distance from the axis, position along it) [m] of points from bottom to top, shape [any, 2],
    and `normals` its outward unit normals in the same coordinates.
    """
    rows, columns = len(profile), AROUND + 1  # the last column coincides with the first, with u = 1
    radius = np.where(profile[:, 0] < 1e-9 * np.abs(profile).max(), 0.0, profile[:, 0])
    pole = radius == 0
    u = np.tile(np.arange(columns) / AROUND, (rows, 1))
    u[pole] += 0.5 / AROUND  # centre the pole's vertex over the base of each triangle at the pole
    angle = 2 * np.pi * (u % 1.0)
    frame = _frame(axis)
    spoke = np.cos(angle)[..., None] * frame[:, 0] + np.sin(angle)[..., None] * frame[:, 1]
    points = radius[:, None, None] * spoke + profile[:, 1, None, None] * frame[:, 2] + origin
    directions = normals[:, 0, None, None] * spoke + normals[:, 1, None, None] * frame[:, 2]
    way = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(profile, axis=0), axis=1)))
    v = np.repeat((way / way[-1])[:, None], columns, axis=1)
    vertex = np.arange(rows * columns).reshape(rows, columns)
    here, right = vertex[:-1, :-1], vertex[:-1, 1:]
    above, across = vertex[1:, :-1], vertex[1:, 1:]
    # Of the two triangles of a patch at a pole, drop the one with two vertices at the pole.
    lower = np.stack([here, right, np.where(pole[1:, None], above, across)], axis=-1)[~pole[:-1]]
    upper = np.stack([here, across, above], axis=-1)[~pole[1:]]
    return Mesh(
        points.reshape(-1, 3),
        directions.reshape(-1, 3),
        np.stack([u.ravel(), v.ravel()], axis=1),
        np.concatenate([lower.reshape(-1, 3), upper.reshape(-1, 3)]).astype(np.int32),
    )
