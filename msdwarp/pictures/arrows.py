"""Arrows in pictures: forces on particles, drawn on top of everything else."""

import numpy as np
import warp as wp
from numpy.typing import NDArray

from .. import checks
from ..bodies import in_space
from ..kernels.pictures import drawing
from .stage import Stage

MOST_ARROWS = 1500
"""Maximal number of arrows in a picture; of more forces only the largest are drawn."""
LONGEST = 0.16
"""Length of the longest arrow over the height of the picture, at the camera's target."""
FAINTEST = 0.02
"""Forces below this fraction of the full force are not drawn."""
COLOR = (0.0, 0.62, 0.66)
"""Color of arrows, which occurs on neither color scale."""


class Arrows:
    """Arrows at particles along the forces on them; their lengths grow with the force up to `full` [N]."""

    def __init__(self, full: float, particle_count: int, stage: Stage, device: str = "cpu") -> None:
        self.full = checks.positive("arrows", full)
        away = float(np.linalg.norm(stage.camera.eye - stage.camera.target))
        self.longest = LONGEST * 2 * away * stage.camera.tangent
        """Length of the longest arrow [m]."""
        self.device, self._nowhere = device, stage.camera.target.astype(np.float32)
        self._count = min(particle_count, MOST_ARROWS)
        self.triangles = _triangles(self._count)
        vertices = drawing.RINGS * drawing.SIDES * self._count
        self.points, self.normals = (wp.zeros(vertices, dtype=wp.vec3, device=device) for _ in "pn")
        self.colors = wp.full(vertices, wp.vec3(*COLOR), dtype=wp.vec3, device=device)
        self.uv, self.texture = np.zeros((vertices, 2)), None
        self.finish = np.zeros(len(self.triangles), dtype=np.int32)
        self.gloss, self.closed = np.zeros(len(self.triangles)), np.zeros(len(self.triangles), dtype=bool)
        self._start, self._way = (wp.zeros(self._count, dtype=wp.vec3, device=device) for _ in "sw")

    def follow(self, position: NDArray, force: NDArray | None) -> None:
        """Place the arrows of forces [N], if given, at particles [m], both of shape [particle_count, d]."""
        start, way = np.tile(self._nowhere, (self._count, 1)), np.zeros((self._count, 3), dtype=np.float32)
        if force is not None:
            size = np.linalg.norm(force.astype(np.float64), axis=1)
            largest = np.argsort(size, kind="stable")[::-1][: self._count]
            drawn = largest[size[largest] > FAINTEST * self.full]
            scale = self.longest / np.maximum(size[drawn], self.full)
            start[: len(drawn)] = in_space(position[drawn])
            way[: len(drawn)] = in_space(force[drawn] * scale[:, None])
        self._start.assign(start)
        self._way.assign(way)
        inputs = [self._start, self._way, self.longest]
        wp.launch(drawing.place_arrows, self._count, inputs, [self.points, self.normals], device=self.device)


def _triangles(count: int) -> NDArray[np.int32]:
    """Return the triangles of `count` arrows, shape [any, 3]: shaft, head and the head's base."""
    n = drawing.SIDES
    k = np.arange(n)
    ahead = (k + 1) % n
    lower, upper = np.stack([k, ahead, k + n], axis=1), np.stack([k + n, ahead, ahead + n], axis=1)
    base = 4 * n + np.stack([np.zeros(n - 2, int), k[2:], k[1:-1]], axis=1)
    one = np.concatenate([lower, upper, lower + 2 * n, base])
    return (one + drawing.RINGS * n * np.arange(count)[:, None, None]).reshape(-1, 3).astype(np.int32)
