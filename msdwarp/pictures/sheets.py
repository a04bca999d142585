"""Sheets on obstacles: a cloth is drawn around an edge or a ball that its flat triangles would cut."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from ..bodies import System, facets_of
from ..kernels.colliders.signed_distance import KINDS
from ..kernels.pictures import sheets
from ..world import Collider, Scene
from .collider_meshes import pose_in_space
from .parts import Part, SurfacePart

MOST_PIECES = 8
"""Maximal number of pieces of the side of a triangle."""
MOST_TRIANGLES = 20_000
"""Triangles of all pieces of a sheet; a finer sheet is divided less."""
GAP = 0.6
"""Distance of a drawn sheet from an obstacle that it touches, over the mean side of its pieces: so far that
they do not cut edges that they bend around."""


class Sheet(Part):
    """A surface without inside, divided into pieces that bend around obstacles.

    Particles rest on an obstacle, and triangles between them cut its edges and curves, so the obstacle would show
    through. `flat` is the surface without bending; `places` are its triangles' corners at the start [m], shape
    [triangle_count, 3, 3], whose mean side sets the distance from obstacles. At particles that are `pinned`, shape
    [particle_count], the surface is not moved, since they may be inside an obstacle.
    """

    def __init__(
        self,
        flat: SurfacePart,
        places: NDArray,
        pinned: NDArray[np.bool_],
        obstacles: Sequence[Collider],
        device: str,
    ) -> None:
        self._flat, self._obstacles, self._device = flat, obstacles, device
        self.times = flat.times  # the pieces of a triangle are visible with it
        pieces = int(np.clip(np.sqrt(MOST_TRIANGLES / len(flat.triangles)), 1, MOST_PIECES))
        corners, weights, self.triangles = divided(flat.triangles, pieces)
        particle, of_vertex = np.asarray(flat.mixture[0].numpy(), int), flat.mixture[1].numpy()
        # In the order of particles, so that rounding leaves no crack between triangles with vertices of their own.
        order = np.argsort(particle[corners, 0], axis=1)
        corners, weights = np.take_along_axis(corners, order, axis=1), np.take_along_axis(weights, order, axis=1)
        self.uv, self.finish, self.closed = np.einsum("vk,vkd->vd", weights, flat.uv[corners]), flat.finish, False
        mixed, carriers = weights[:, :, None] * of_vertex[corners], particle[corners]
        self._follow_particles(carriers.reshape(len(corners), -1), mixed.reshape(len(corners), -1), device)
        self._free = wp.array((mixed * ~pinned[carriers]).sum(axis=(1, 2)), dtype=float, device=device)
        own = [wp.zeros(len(flat.uv), dtype=wp.vec3, device=device) for _ in range(3)]
        flat.join(slice(0, len(flat.uv)), *own)
        self._corners = wp.array(corners, dtype=wp.vec3i, device=device)
        self._weights = wp.array(weights, dtype=wp.vec3, device=device)
        side = float(np.linalg.norm(places - np.roll(places, 1, axis=1), axis=2).mean())
        self._solids, self._gap = _solids(obstacles, device), GAP * side / pieces
        self._poses: list[Any] = [wp.zeros(len(obstacles), dtype=t, device=device) for t in (wp.mat33, wp.vec3)]

    def follow(self, x: wp.array, time: float) -> None:
        """Move the pieces with their particles, and out of obstacles."""
        self._flat.follow(x, time)
        poses = [pose_in_space(one, time, 3) for one in self._obstacles]
        for array, values in zip(self._poses, zip(*poses, strict=True), strict=True):
            array.assign(np.array(values, dtype=np.float32))
        flat = [self._flat.points, self._flat.normals, self._corners, self._weights]
        inputs = [*flat, self._free, self._solids, *self._poses, self._gap]
        wp.launch(sheets.bend, len(self.points), inputs, [self.points, self.normals], device=self._device)


def kept_off(scene: Scene) -> list[Collider]:
    """Return the obstacles that sheets bend around: all but soft ones and the ground, which is drawn first."""
    rigid = [one for one in scene.colliders if one.stiffness is None and one is not scene.ground]
    return rigid if scene.system.dim == 3 else []


def triangles_of_sheets(system: System) -> NDArray[np.bool_]:
    """Return which triangles of a system's surface have no inside behind them, shape [triangle_count]."""
    facets, on_sheet = facets_of(system), np.zeros(system.particle_count, dtype=bool)
    vertices = np.unique(facets.corner[~facets.closed])
    on_sheet[facets.particle[vertices][facets.weight[vertices] != 0]] = True
    assert system.surface is not None
    return system.surface.triangles_in(on_sheet)


def divided_triangle(pieces: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Divide a triangle into small ones, with `pieces` along each side.

    Return the barycentric coordinates of the vertices, times `pieces`, and the vertices of the small triangles.
    """
    steps = [(i, j, pieces - i - j) for i in range(pieces + 1) for j in range(pieces + 1 - i)]
    at = {(i, j): k for k, (i, j, _) in enumerate(steps)}
    up = [(at[i, j], at[i + 1, j], at[i, j + 1]) for i, j, rest in steps if rest > 0]
    down = [(at[i + 1, j], at[i + 1, j + 1], at[i, j + 1]) for i, j, rest in steps if rest > 1]
    return np.array(steps), np.array(up + down)


def divided(triangles: NDArray, pieces: int) -> tuple[NDArray[np.int32], NDArray[np.float64], NDArray[np.int32]]:
    """Divide triangles into small ones, with `pieces` along each side; adjacent ones have vertices in common.

    Return for each new vertex the corners of a triangle in which it lies and its barycentric coordinates there,
    both of shape [fine_count, 3], and the vertices of the small triangles.
    """
    steps, small = divided_triangle(pieces)
    vertices, steps = np.repeat(triangles, len(steps), axis=0), np.tile(steps, (len(triangles), 1))
    # A vertex on a side is the same in the triangle beyond.
    ends = np.where(steps > 0, vertices, -1)
    order = np.argsort(ends, axis=1)
    key = np.concatenate([np.take_along_axis(each, order, axis=1) for each in (ends, steps)], axis=1)
    _, first, number = np.unique(key, axis=0, return_index=True, return_inverse=True)
    mine = number.reshape(len(triangles), -1)[:, small].reshape(-1, 3)
    return vertices[first], steps[first] / pieces, mine.astype(np.int32)


def _solids(obstacles: Sequence[Collider], device: str) -> Any:
    """Return the struct of solids that `msdwarp.kernels.colliders.signed_distance` reads."""
    solids: Any = sheets.Solids()
    shapes = [
        {"a": np.zeros(3), "b": np.zeros(3), "radius": 0.0, "axes": np.eye(3)} | one.geometry(3)
        for one in obstacles
    ]
    for name, dtype in (("a", wp.vec3), ("b", wp.vec3), ("radius", float), ("axes", wp.mat33)):
        setattr(solids, name, wp.array(np.array([one[name] for one in shapes]), dtype=dtype, device=device))
    solids.kind = wp.array([KINDS.index(type(one).__name__) for one in obstacles], dtype=int, device=device)
    return solids
