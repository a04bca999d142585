"""Pictures without OpenGL: a ray caster on Warp, with the same camera, look and shadow."""

import math
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from .. import checks
from ..kernels.pictures import raycast
from .arrows import COLOUR, Arrows
from .drawing import Drawing
from .light import HEAD, KEY, SHADOW
from .stage import VIEW_ANGLE, Stage


def _image(pixels: NDArray[np.uint8], device: str) -> wp.array:
    """Upload an image with components in 0 … 1."""
    return wp.array(pixels.astype(np.float32) / 255, dtype=wp.vec3, device=device)


class RayCaster:
    """Draws a drawing by casting rays at it, on the device of the drawing."""

    def __init__(self, drawing: Drawing, stage: Stage, arrows: Arrows | None = None) -> None:
        self.drawing, device = drawing, drawing.device
        self._arrows, self._over = arrows, raycast.Body()
        self._over_mesh: wp.Mesh | None = None
        camera, ground = stage.camera, stage.ground
        self._size = width, height = stage.width, stage.height
        self._mesh: wp.Mesh | None = None
        self._body = raycast.Body()
        self._body.normals, self._body.colours = drawing.normals, drawing.colours
        self._body.uv = wp.array(drawing.uv, dtype=wp.vec2, device=device)
        blank = np.full((1, 1, 3), 255, dtype=np.uint8)
        self._body.texture = _image(blank if drawing.texture is None else drawing.texture, device)
        self._body.textured = int(drawing.texture is not None)
        self._body.gloss = wp.array(drawing.gloss, dtype=float, device=device)

        view = self._view = raycast.Surroundings()
        view.eye = wp.vec3(*camera.eye)
        pixel = 2 * math.tan(math.radians(VIEW_ANGLE) / 2) / height
        view.across, view.down = wp.vec3(*(pixel * camera.right)), wp.vec3(*(-pixel * camera.up))
        view.corner = wp.vec3(*(camera.forward + pixel * (height * camera.up - width * camera.right) / 2))
        view.far = 100 * float(np.linalg.norm(camera.eye - camera.target))
        view.light, view.towards_viewer = wp.vec3(*camera.light), wp.vec3(*-camera.forward)
        view.background = wp.vec3(*checks.colour("background", stage.look.background))
        view.ambient, view.key, view.head = drawing.ambient, drawing.diffuse * KEY, drawing.diffuse * HEAD
        view.has_ground, view.below = int(ground is not None), drawing.below
        view.ground = _image(blank, device)
        if ground is not None:
            view.ground = _image(ground.texture[::-1], device)
            view.ground_centre, view.ground_normal = wp.vec3(*ground.centre), wp.vec3(*ground.normal)
            span = 2 * ground.half
            view.ground_u, view.ground_v = wp.vec3(*(ground.u / span)), wp.vec3(*(ground.v / span))
        self._rays = wp.zeros((height, width), dtype=wp.vec3, device=device)
        self._pixels = wp.zeros((height, width), dtype=wp.vec3ub, device=device)

    def draw(self, *, shadows: bool = True) -> NDArray[np.uint8]:
        """Return the picture of the drawing as it stands, uint8 of shape [height, width, 3]."""
        self._view.shadow = SHADOW if shadows else 1.0
        width, height = self._size
        drawing, device = self.drawing, self.drawing.device
        if self._mesh is None:  # made here, since its search tree is as good as the points it is built for
            triangles = wp.array(drawing.triangles.ravel(), dtype=int, device=device)
            self._mesh = wp.Mesh(points=drawing.points, indices=triangles)
            self._body.mesh = self._mesh.id
        self._mesh.refit()
        inputs = [self._body, self._view]
        wp.launch(raycast.cast, (height, width), inputs, [self._rays], device=device)
        wp.launch(raycast.refine, (height, width), [*inputs, self._rays], [self._pixels], device=device)
        if self._arrows is not None:
            over = self._body_of(self._arrows)
            wp.launch(raycast.lay_over, (height, width), [over, self._view], [self._pixels], device=device)
        return self._pixels.numpy().astype(np.uint8)  # a copy

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
