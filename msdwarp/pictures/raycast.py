"""Pictures by a ray caster on Warp, on any device: with OpenGL's camera and look, and no need of OpenGL."""

from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from ..kernels.pictures import raycast
from ..quiet import in_turn
from .arrows import Arrows
from .drawing import Drawing
from .light import CORNERS, spread
from .stage import Camera, Stage
from .surroundings import body_of, body_of_arrows, look_from, surroundings_of

POINTS = {"cpu": 4, "cuda": 16}
"""Points of the light that each of four rays a pixel looks at where a shadow fades, on a CPU and on a GPU."""
THREADS = 1 << 17
"""Threads on a GPU that draw what needs a closer look: enough to fill it; each takes several pixels if need be."""
LANES = 16
"""Of these threads so many share a pixel: what one does alone takes as long as 68 rays after each other."""
REFITS = 32
"""So many pictures after each other are drawn with one search tree, whose boxes follow what they hold: longer, and
they would overlap where bodies have moved past each other."""


class RayCaster:
    """Draws a drawing by casting rays at it, on the device of the drawing."""

    @in_turn
    def __init__(self, drawing: Drawing, stage: Stage, arrows: Arrows | None = None) -> None:
        self.drawing, device = drawing, drawing.device
        self._arrows = arrows
        self._over: Any = None if arrows is None else body_of_arrows(arrows, device)
        self._mesh: wp.Mesh | None = None
        self._over_mesh: wp.Mesh | None = None
        self._refits = 0
        self._triangles = wp.array(drawing.triangles.ravel(), dtype=int, device=device)
        on_gpu = wp.get_device(device).is_cuda
        self._points = POINTS["cuda" if on_gpu else "cpu"]
        spots = np.concatenate([CORNERS, spread(16 * self._points)])
        self._body, self._view = body_of(drawing), surroundings_of(drawing, stage, spots)
        self._threads, self._lanes = (THREADS, LANES) if on_gpu else (1, 1)
        self._on_gpu, self._size = on_gpu, (0, 0)
        self.look_from(stage.camera, (stage.width, stage.height))

    @in_turn
    def look_from(self, camera: Camera, size: tuple[int, int]) -> None:
        """Have the next pictures taken from another place, with another width and height; the lights stay."""
        look_from(self._view, camera, size)
        if size == self._size:
            return
        self._size, device, (width, height) = size, self.drawing.device, size
        self._rays = wp.zeros((height, width), dtype=wp.vec4, device=device)
        self._chosen = wp.zeros((2, height * width), dtype=int, device=device)
        self._count = wp.zeros(2, dtype=int, device=device)
        self._pixels = wp.zeros((height, width), dtype=wp.vec3ub, device=device)
        # From a GPU bytes go fastest into memory that is pinned.
        self._host = self._pixels
        if self._on_gpu:
            self._host = wp.zeros((height, width), dtype=wp.vec3ub, device="cpu", pinned=True)

    @in_turn
    def draw(self, *, shadows: bool = True) -> NDArray[np.uint8]:
        """Return the picture of the drawing as it stands, uint8 of shape [height, width, 3]."""
        self.refit()
        return self.shoot(shadows=shadows)

    @in_turn
    def shoot(self, *, shadows: bool = True) -> NDArray[np.uint8]:
        """Return the picture of the drawing as it stood when `refit` was called last."""
        self._view.shadows = int(shadows)
        width, height = self._size
        device = self.drawing.device
        inputs = [self._body, self._view]
        tiles = -(-width // raycast.TILE) * -(-height // raycast.TILE)
        every = tiles * raycast.TILE**2
        wp.launch(raycast.cast, every, inputs, [self._rays], device=device)
        self._count.zero_()
        wp.launch(raycast.choose, every, [self._rays], [self._pixels, self._chosen, self._count], device=device)
        chosen = [self._points, self._threads, self._chosen, self._count]
        wp.launch(raycast.refine(self._lanes), self._threads, [*inputs, *chosen], [self._pixels], device=device)
        if self._arrows is not None:
            over = self._body_of(self._arrows)
            wp.launch(raycast.lay_over, (height, width), [over, self._view], [self._pixels], device=device)
        if self._host is not self._pixels:
            wp.copy(self._host, self._pixels)
            wp.synchronize_stream(device)
        return self._host.numpy().astype(np.uint8)  # a copy

    @in_turn
    def refit(self) -> None:
        """Have what is searched by rays be where the drawing is; every so often make its search tree anew.

        The first one is made with the first picture, since it is as good as the points that it is made for.
        """
        if self._mesh is None or self._refits == REFITS:
            self._mesh = wp.Mesh(points=self.drawing.points, indices=self._triangles)
            self._body.mesh, self._refits = self._mesh.id, 0
        else:
            self._mesh.refit()
            self._refits += 1

    def _body_of(self, arrows: Arrows) -> Any:
        """Return the arrows as they are now, as what rays can meet."""
        over = self._over
        if self._over_mesh is None:
            triangles = wp.array(arrows.triangles.ravel(), dtype=int, device=self.drawing.device)
            self._over_mesh = wp.Mesh(points=arrows.points, indices=triangles)
            over.mesh = self._over_mesh.id
        self._over_mesh.refit()
        return over
