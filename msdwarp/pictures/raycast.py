"""Pictures by a ray caster on Warp, on any device: with OpenGL's camera and look, and no need of OpenGL."""

import math
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from .. import checks
from ..kernels.pictures import raycast, shading
from .arrows import COLOUR, Arrows
from .drawing import Drawing
from .light import HEAD, KEY, SHADED, SHADOW, SHININESS, SOFTNESS, across, spread
from .stage import UNSEEN, VIEW_ANGLE, Camera, Stage

POINTS = {"cpu": 4, "cuda": 16}
"""Points of the light that each of four rays a pixel looks at where a shadow fades, on a CPU and on a GPU."""
THREADS = 1 << 17
"""Threads on a GPU that draw what needs a closer look: enough to fill it; each takes several pixels if need be."""
REFITS = 32
"""So many pictures after each other are drawn with one search tree, whose boxes follow what they hold: longer, and
they would overlap where bodies have moved past each other."""


def _image(pixels: NDArray[np.uint8], device: str) -> wp.array:
    """Upload an image with components in 0 … 1."""
    return wp.array(pixels.astype(np.float32) / 255, dtype=wp.vec3, device=device)


class RayCaster:
    """Draws a drawing by casting rays at it, on the device of the drawing."""

    def __init__(self, drawing: Drawing, stage: Stage, arrows: Arrows | None = None) -> None:
        self.drawing, device = drawing, drawing.device
        self._arrows, self._over = arrows, shading.Body()
        self._over_mesh: wp.Mesh | None = None
        camera, ground = stage.camera, stage.ground
        self._mesh: wp.Mesh | None = None
        self._refits = 0
        self._triangles = wp.array(drawing.triangles.ravel(), dtype=int, device=device)
        self._body = shading.Body()
        self._body.normals, self._body.colours = drawing.normals, drawing.colours
        self._body.uv = wp.array(drawing.uv, dtype=wp.vec2, device=device)
        blank = np.full((1, 1, 3), 255, dtype=np.uint8)
        self._body.texture = _image(blank if drawing.texture is None else drawing.texture, device)
        self._body.textured = int(drawing.texture is not None)
        self._body.gloss = wp.array(drawing.gloss, dtype=float, device=device)
        # A lattice of tubes would be covered all over by its own fine shadows, which hide what its colours tell.
        if drawing.shows_strain:
            self._body.first_shaded = sum(len(one.part.triangles) for one in drawing.body)

        view = self._view = shading.Surroundings()
        view.background = wp.vec3(*checks.colour("background", stage.look.background))
        view.ambient, view.bounce = drawing.ambient, drawing.bounce
        view.key, view.head = drawing.diffuse * KEY, drawing.diffuse * HEAD
        view.has_ground = int(ground is not None)
        view.ground = _image(blank, device)
        if ground is not None:
            view.below = drawing.below + UNSEEN * ground.reach
            view.ground = _image(ground.texture[::-1], device)
            view.ground_centre, view.ground_normal = wp.vec3(*ground.centre), wp.vec3(*ground.normal)
            span = 2 * ground.half
            view.ground_u, view.ground_v = wp.vec3(*(ground.u / span)), wp.vec3(*(ground.v / span))
        on_gpu = wp.get_device(device).is_cuda
        self._points = POINTS["cuda" if on_gpu else "cpu"]
        self._lit_by(camera.light)
        self._threads = THREADS if on_gpu else 1
        self._on_gpu, self._size = on_gpu, (0, 0)
        self.look_from(camera, (stage.width, stage.height))

    def look_from(self, camera: Camera, size: tuple[int, int]) -> None:
        """Have the next pictures taken from another place, with another width and height; the lights stay."""
        view, (width, height) = self._view, size
        view.eye = wp.vec3(*camera.eye)
        pixel = 2 * math.tan(math.radians(VIEW_ANGLE) / 2) / height
        view.across, view.down = wp.vec3(*(pixel * camera.right)), wp.vec3(*(-pixel * camera.up))
        view.corner = wp.vec3(*(camera.forward + pixel * (height * camera.up - width * camera.right) / 2))
        view.far = 100 * float(np.linalg.norm(camera.eye - camera.target))
        view.towards_viewer = wp.vec3(*-camera.forward)
        if size == self._size:
            return
        self._size, device = size, self.drawing.device
        self._rays = wp.zeros((height, width), dtype=wp.vec4, device=device)
        self._chosen = wp.zeros((2, height * width), dtype=int, device=device)
        self._count = wp.zeros(2, dtype=int, device=device)
        self._pixels = wp.zeros((height, width), dtype=wp.vec3ub, device=device)
        # From a GPU bytes go fastest into memory that is pinned.
        self._host = self._pixels
        if self._on_gpu:
            self._host = wp.zeros((height, width), dtype=wp.vec3ub, device="cpu", pinned=True)

    def _lit_by(self, light: NDArray) -> None:
        """Set where the key light is, and how large."""
        view = self._view
        view.light = wp.vec3(*light)
        view.light_u, view.light_v = (wp.vec3(*(SOFTNESS * axis)) for axis in across(light))
        view.shininess, view.shaded, view.shadow = SHININESS, SHADED, SHADOW
        # Neighbouring pixels look at the corners of a square around it: behind a straight edge that hides none of
        # them, or all, it hides none of the light, or all.
        corners = np.array([[-1, -1], [1, -1], [-1, 1], [1, 1]])
        spots = np.concatenate([corners, spread(16 * self._points)])
        view.spots = wp.array(spots, dtype=wp.vec2, device=self.drawing.device)

    def draw(self, *, shadows: bool = True) -> NDArray[np.uint8]:
        """Return the picture of the drawing as it stands, uint8 of shape [height, width, 3]."""
        self.refit()
        return self.shoot(shadows=shadows)

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
        wp.launch(raycast.refine, self._threads, [*inputs, *chosen], [self._pixels], device=device)
        if self._arrows is not None:
            over = self._body_of(self._arrows)
            wp.launch(raycast.lay_over, (height, width), [over, self._view], [self._pixels], device=device)
        if self._host is not self._pixels:
            wp.copy(self._host, self._pixels)
            wp.synchronize_stream(device)
        return self._host.numpy().astype(np.uint8)  # a copy

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
        over, device = self._over, self.drawing.device
        if self._over_mesh is None:
            count = len(arrows.points)
            triangles = wp.array(arrows.triangles.ravel(), dtype=int, device=device)
            self._over_mesh = wp.Mesh(points=arrows.points, indices=triangles)
            over.mesh, over.normals, over.textured = self._over_mesh.id, arrows.normals, 0
            over.colours = wp.full(count, wp.vec3(*COLOUR), dtype=wp.vec3, device=device)
            over.uv, over.texture = wp.zeros(count, dtype=wp.vec2, device=device), self._body.texture
            over.gloss = wp.zeros(len(arrows.triangles), dtype=float, device=device)
        self._over_mesh.refit()
        return over
