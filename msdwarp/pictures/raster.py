"""Pictures by a rasteriser on Warp, on the CPU, where it is the cheapest, with no need of OpenGL."""

from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from ..kernels.pictures import raster
from .arrows import Arrows
from .drawing import Drawing
from .film import processors
from .shadow_map import ShadowMap
from .stage import Stage
from .surroundings import body_of, surroundings_of

BAND, MOST_THREADS = 32, 8
"""Rows of the picture that a thread shades at a time, and the most threads."""
AROUND = 8
"""Corners around the shadow on the ground, which bound the part of the picture that changes."""


class Rasteriser:
    """Draws a drawing that is on the CPU, triangle by triangle, with shadows from a shadow map.

    The camera stands still, so the ground is drawn once, and bodies and their shadows are laid over it.
    """

    def __init__(self, drawing: Drawing, stage: Stage, arrows: Arrows | None = None) -> None:
        self._drawing, self._stage, self._arrows = drawing, stage, arrows
        shape = (stage.height, stage.width)
        self._map, self._view = ShadowMap(drawing, stage.camera.light), surroundings_of(drawing, stage)
        self._pool = ThreadPoolExecutor(min(MOST_THREADS, processors()))
        self._body = body_of(drawing)
        self._over = None if arrows is None else body_of(arrows)
        self._nearest = wp.zeros((4 * shape[0], shape[1]), dtype=wp.uint64, device="cpu")
        self._backdrop = wp.zeros(shape, dtype=wp.vec3ub, device="cpu")
        self._pixels = wp.zeros(shape, dtype=wp.vec3ub, device="cpu")
        wp.launch(raster.draw_backdrop, shape, [self._view], [self._backdrop], device="cpu")
        self._shade(self._body, (0, 0, 1, 0))  # nothing, but it compiles the kernel before threads launch it

    def draw(self, *, shadows: bool = True) -> NDArray[np.uint8]:
        """Return the picture of the drawing as it stands, uint8 of shape [height, width, 3]."""
        points = self._drawing.points.numpy()[self._drawing.visible]
        wp.copy(self._pixels, self._backdrop)
        if len(points):  # a stage may be bare
            changed = points
            if shadows:
                self._map.follow(points)
                if self._stage.ground is not None:
                    changed = np.concatenate([points, self._map.on_ground(points, self._stage.ground, AROUND)])
            self._lay_over(self._body, changed, shadows=shadows)
        if self._arrows is not None:
            self._lay_over(self._over, self._arrows.points.numpy(), shadows=False)
        return self._pixels.numpy().astype(np.uint8)  # a copy

    def _lay_over(self, body: Any, points: NDArray, *, shadows: bool) -> None:
        """Draw triangles over the picture, in the part that holds some points."""
        self._view.shadows = int(shadows)
        inputs = [body, self._view]
        wp.launch(raster.draw_triangles, len(body.triangles), inputs, [self._nearest], device="cpu")
        row, column, rows, columns = self._stage.camera.frame(points, *self._pixels.shape)
        # Squares of 2 x 2 pixels are the same in all pictures, whatever part of them changes.
        rows, columns = rows + row % 2, columns + column % 2
        row, column = row - row % 2, column - column % 2
        bands = [(row + k, column, min(BAND, rows - k), columns) for k in range(0, rows, BAND)]
        # Python's lock is free while Warp's native code is at work.
        for _ in self._pool.map(lambda band: self._shade(body, band), bands):
            pass

    def _shade(self, body: Any, part: tuple[int, int, int, int]) -> None:
        """Shade a part of the picture: first row, first column, rows, columns."""
        row, column, rows, columns = part
        inputs = [body, self._view, self._map.data, row, column, columns]
        wp.launch(raster.shade, (rows + 1) // 2, inputs, [self._nearest, self._pixels], device="cpu")
