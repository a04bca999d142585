"""What the kernels of pictures read: triangles, and camera, lights and ground."""

import math
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from .. import checks
from ..kernels.pictures import shading
from .arrows import Arrows
from .drawing import Drawing
from .light import FILL, HEAD, KEY, SHADED, SHADOW, SHININESS, SOFTNESS, across
from .stage import UNSEEN, VIEW_ANGLE, Camera, Stage

_NO_SPOTS = np.zeros((0, 2))
_BLANK = np.full((1, 1, 3), 255, dtype=np.uint8)


def body_of(drawn: Drawing | Arrows) -> Any:
    """Return a drawing or arrows as kernels read them, in the same memory, without a search tree."""
    body, device = shading.Body(), drawn.device
    body.points, body.normals, body.colours = drawn.points, drawn.normals, drawn.colours
    body.uv = wp.array(drawn.uv, dtype=wp.vec2, device=device)
    body.triangles = wp.array(drawn.triangles, dtype=wp.vec3i, device=device)
    body.closed = wp.array(drawn.closed, dtype=wp.bool, device=device)
    body.gloss = wp.array(drawn.gloss, dtype=float, device=device)
    body.texture = _image(_BLANK if drawn.texture is None else drawn.texture, device)
    body.textured = int(drawn.texture is not None)
    # A lattice of tubes casts fine shadows all over itself, which would hide its colours.
    if isinstance(drawn, Drawing) and drawn.shows_strain:
        body.first_shaded = sum(len(one.triangles) for one in drawn.body)
    return body


def surroundings_of(drawing: Drawing, stage: Stage, spots: NDArray = _NO_SPOTS) -> Any:
    """Return the camera, the lights and the ground; `spots` are the light's points for rays, shape [any, 2]."""
    view, device, ground, light = shading.Surroundings(), drawing.device, stage.ground, stage.camera.light
    view.background = wp.vec3(*checks.colour("background", stage.look.background))
    view.ambient, view.bounce = drawing.ambient, drawing.bounce
    view.key, view.head, view.fill = (drawing.diffuse * strength for strength in (KEY, HEAD, FILL))
    view.fill_from = wp.vec3(*stage.camera.fill)
    view.light = wp.vec3(*light)
    view.light_u, view.light_v = (wp.vec3(*(SOFTNESS * axis)) for axis in across(light))
    view.shininess, view.shaded, view.shadow = SHININESS, SHADED, SHADOW
    view.gleam = 1e-4 ** (1 / SHININESS)
    view.spots = wp.array(spots, dtype=wp.vec2, device=device)
    view.has_ground = int(ground is not None)
    view.ground = _image(_BLANK, device)
    if ground is not None:
        view.below = drawing.below + UNSEEN * ground.reach
        view.ground = _image(ground.texture[::-1], device)
        view.ground_centre, view.ground_normal = wp.vec3(*ground.centre), wp.vec3(*ground.normal)
        span = 2 * ground.half
        view.ground_u, view.ground_v = wp.vec3(*(ground.u / span)), wp.vec3(*(ground.v / span))
    look_from(view, stage.camera, (stage.width, stage.height))
    return view


def look_from(view: Any, camera: Camera, size: tuple[int, int]) -> None:
    """Set the camera and the width and height of pictures; the lights stay."""
    width, height = size
    view.eye = wp.vec3(*camera.eye)
    pixel = 2 * math.tan(math.radians(VIEW_ANGLE) / 2) / height
    view.across, view.down = wp.vec3(*(pixel * camera.right)), wp.vec3(*(-pixel * camera.up))
    view.corner = wp.vec3(*(camera.forward + pixel * (height * camera.up - width * camera.right) / 2))
    view.far = 100 * float(np.linalg.norm(camera.eye - camera.target))
    view.towards_viewer = wp.vec3(*-camera.forward)


def _image(pixels: NDArray[np.uint8], device: str) -> wp.array:
    return wp.array(np.ascontiguousarray(pixels), dtype=wp.vec3ub, device=device)
