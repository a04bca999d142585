"""Pictures by a ray caster on Warp, on any device: with OpenGL's camera and look, and no need of OpenGL."""

import numpy as np
import warp as wp
from numpy.typing import NDArray

from ..kernels.pictures import raycast
from ..runtime import in_turn
from .arrows import Arrows
from .drawing import Drawing
from .light import CORNERS, spread
from .stage import Camera, Stage
from .surroundings import body_of, look_from, surroundings_of

POINTS = {"cpu": 4, "cuda": 16}
"""Points of the light that each of a pixel's four rays samples where a shadow fades, on a CPU and on a GPU."""
THREADS = 1 << 17
"""Threads on a GPU that refine pixels: enough to fill it; each takes several pixels if need be."""
LANES = 16
"""Of these threads this many share a pixel: one alone would cast 68 rays in sequence."""
REFITS = 32
"""Pictures for which a search tree is refitted before it is rebuilt: its boxes overlap more as bodies move."""


class RayCaster:
    """Draws a drawing by casting rays at it, on the device of the drawing."""

    @in_turn
    def __init__(self, drawing: Drawing, stage: Stage, arrows: Arrows | None = None) -> None:
        self.drawing, device = drawing, drawing.device
        self._searched = _Searched(drawing)
        self._over = None if arrows is None else _Searched(arrows)
        self._on_gpu, self._size = wp.get_device(device).is_cuda, (0, 0)
        self._points = POINTS["cuda" if self._on_gpu else "cpu"]
        self._view = surroundings_of(drawing, stage, np.concatenate([CORNERS, spread(16 * self._points)]))
        self._threads, self._lanes = (THREADS, LANES) if self._on_gpu else (1, 1)
        self.look_from(stage.camera, (stage.width, stage.height))

    @in_turn
    def look_from(self, camera: Camera, size: tuple[int, int]) -> None:
        """Set the camera and the width and height of the next pictures; the lights stay."""
        look_from(self._view, camera, size)
        if size == self._size:
            return
        self._size, device, (width, height) = size, self.drawing.device, size
        self._rays = wp.zeros((height, width), dtype=wp.vec4, device=device)
        self._chosen = wp.zeros((2, height * width), dtype=int, device=device)
        self._count = wp.zeros(2, dtype=int, device=device)
        self._pixels = self._host = wp.zeros((height, width), dtype=wp.vec3ub, device=device)
        if self._on_gpu:  # from there bytes go fastest into memory that is pinned
            self._host = wp.zeros((height, width), dtype=wp.vec3ub, device="cpu", pinned=True)

    @in_turn
    def draw(self, *, shadows: bool = True) -> NDArray[np.uint8]:
        """Return the picture of the drawing as it stands, uint8 of shape [height, width, 3]."""
        self.refit()
        return self.shoot(shadows=shadows)

    @in_turn
    def shoot(self, *, shadows: bool = True) -> NDArray[np.uint8]:
        """Return the picture of the drawing as it was at the last `refit`."""
        self._view.shadows = int(shadows)
        width, height = self._size
        device = self.drawing.device
        inputs = [self._searched.body, self._view]
        tiles = -(-width // raycast.TILE) * -(-height // raycast.TILE)
        every = tiles * raycast.TILE**2
        wp.launch(raycast.cast, every, inputs, [self._rays], device=device)
        self._count.zero_()
        wp.launch(raycast.choose, every, [self._rays], [self._pixels, self._chosen, self._count], device=device)
        chosen = [self._points, self._threads, self._chosen, self._count]
        wp.launch(raycast.refine(self._lanes), self._threads, [*inputs, *chosen], [self._pixels], device=device)
        if self._over is not None:
            self._over.refit()
            inputs = [self._over.body, self._view]
            wp.launch(raycast.lay_over, (height, width), inputs, [self._pixels], device=device)
        if self._on_gpu:
            wp.copy(self._host, self._pixels)
            wp.synchronize_stream(device)
        return self._host.numpy().astype(np.uint8)  # a copy

    @in_turn
    def refit(self) -> None:
        """Update the search tree to the drawing."""
        self._searched.refit()


class _Searched:
    """Triangles with a search tree for rays."""

    def __init__(self, drawn: Drawing | Arrows) -> None:
        self.body, self._points, self._refits = body_of(drawn), drawn.points, REFITS
        self._indices = wp.array(drawn.triangles.ravel(), dtype=int, device=drawn.device)

    def refit(self) -> None:
        """Refit the search tree to the triangles, or rebuild it: first at the first picture, for its points."""
        if self._refits == REFITS:
            self._mesh = wp.Mesh(points=self._points, indices=self._indices)
            self.body.mesh, self._refits = self._mesh.id, 0
        else:
            self._mesh.refit()
            self._refits += 1
