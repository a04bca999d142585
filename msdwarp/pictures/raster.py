"""Pictures by a rasteriser on Warp, on the CPU, where it is the cheapest, with no need of OpenGL."""

from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from ..kernels.pictures import raster, raster_shading
from .arrows import Arrows
from .drawing import Drawing
from .film import processors
from .light import SOFTNESS, spread
from .shadow_map import ShadowMap
from .stage import Stage
from .surroundings import body_of, body_of_arrows, surroundings_of

LOOKS = 16
"""Texels of the shadow map that are looked at where a shadow fades."""
BAND, MOST_THREADS = 32, 8
"""Rows of the picture that a thread shades at a time, and how many threads there are at most."""
AROUND = 8
"""Corners around the shadow on the ground, by which it is found what of the picture changes."""


class Rasteriser:
    """Draws a drawing that is on the CPU, triangle by triangle, with shadows from a map of what the light sees.

    The camera stands still, so the ground is drawn once, and what moves and its shadow are laid over that.
    """

    def __init__(self, drawing: Drawing, stage: Stage, arrows: Arrows | None = None) -> None:
        self._drawing, self._stage, self._arrows = drawing, stage, arrows
        shape = (stage.height, stage.width)
        self._map, spots = ShadowMap(drawing, stage.camera.light), spread(LOOKS)
        self._seen = self._map.seen(SOFTNESS, spots)
        self._view = surroundings_of(drawing, stage, spots)
        self._pool = ThreadPoolExecutor(min(MOST_THREADS, processors()))
        self._mesh = _Mesh(body_of(drawing), drawing.points, drawing.triangles, drawing.closed)
        if arrows is not None:
            open_ended = np.zeros(len(arrows.triangles), dtype=bool)
            self._over = _Mesh(body_of_arrows(arrows, "cpu"), arrows.points, arrows.triangles, open_ended)
        self._nearest = wp.zeros((4 * shape[0], shape[1]), dtype=wp.uint64, device="cpu")
        self._backdrop = wp.zeros(shape, dtype=wp.vec3ub, device="cpu")
        self._pixels = wp.zeros(shape, dtype=wp.vec3ub, device="cpu")
        wp.launch(raster.draw_backdrop, shape, [self._view], [self._backdrop], device="cpu")
        self._shade(self._mesh, (0, 0, 1, 0))  # nothing, but it compiles what threads launch at once

    def draw(self, *, shadows: bool = True) -> NDArray[np.uint8]:
        """Return the picture of the drawing as it stands, uint8 of shape [height, width, 3]."""
        points = self._drawing.points.numpy()[self._drawing.in_sight]
        wp.copy(self._pixels, self._backdrop)
        if len(points):  # a stage may be bare
            if shadows:
                self._map.follow(points)
                self._seen.lamp = self._map.lamp
            self._lay_over(self._mesh, self._part(points, shadows=shadows), shadows=shadows)
        if self._arrows is not None:
            self._lay_over(self._over, self._around(self._arrows.points.numpy()), shadows=False)
        return self._pixels.numpy().astype(np.uint8)  # a copy

    def _part(self, points: NDArray, *, shadows: bool) -> tuple[int, int, int, int]:
        """Return what of the picture holds the points and their shadow on the ground."""
        ground = self._stage.ground
        if ground is None or not shadows:
            return self._around(points)
        light = self._stage.camera.light
        corners = self._map.outline(points, AROUND)
        height = (corners - ground.centre) @ ground.normal
        return self._around(np.concatenate([points, corners - height[:, None] * light / (light @ ground.normal)]))

    def _around(self, points: NDArray) -> tuple[int, int, int, int]:
        """Return (first row, first column, rows, columns) of what of the picture holds the points."""
        return self._stage.camera.frame(points, *self._pixels.shape)

    def _lay_over(self, mesh: "_Mesh", part: tuple[int, int, int, int], *, shadows: bool) -> None:
        """Draw a mesh over what is there, in a part of the picture that holds it."""
        self._view.shadows = int(shadows)
        inputs = [mesh.points, mesh.triangles, mesh.closed, self._view]
        wp.launch(raster.draw_triangles, len(mesh.triangles), inputs, [self._nearest], device="cpu")
        row, column, rows, columns = part
        # Squares of 2 x 2 pixels are the same in all pictures, whatever part of them changes.
        rows, columns = rows + row % 2, columns + column % 2
        row, column = row - row % 2, column - column % 2
        bands = [(row + k, column, min(BAND, rows - k), columns) for k in range(0, rows, BAND)]
        # Python's lock is free while Warp's native code is at work.
        for _ in self._pool.map(lambda band: self._shade(mesh, band), bands):
            pass

    def _shade(self, mesh: "_Mesh", part: tuple[int, int, int, int]) -> None:
        """Shade a part of the picture."""
        row, column, rows, columns = part
        inputs = [mesh.body, self._view, self._seen, mesh.points, mesh.triangles, row, column, columns]
        wp.launch(raster_shading.shade, (rows + 1) // 2, inputs, [self._nearest, self._pixels], device="cpu")


class _Mesh:
    """Triangles as the kernels read them: they follow the points."""

    def __init__(self, body: Any, points: wp.array, triangles: NDArray, closed: NDArray) -> None:
        self.body, self.points = body, points
        self.triangles = wp.array(triangles, dtype=wp.vec3i, device="cpu")
        self.closed = wp.array(closed, dtype=wp.bool, device="cpu")
