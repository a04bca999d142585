"""What the kernels that draw pictures read: the triangles, and camera, lights and ground."""

import math
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from .. import checks
from ..kernels.pictures import shading
from .arrows import COLOUR, Arrows
from .drawing import Drawing
from .light import FILL, HEAD, KEY, SHADED, SHADOW, SHININESS, SOFTNESS, across
from .stage import UNSEEN, VIEW_ANGLE, Camera, Stage

_BLANK = np.full((1, 1, 3), 255, dtype=np.uint8)


def body_of(drawing: Drawing) -> Any:
    """Return a drawing as what kernels shade, less its mesh; it follows the drawing."""
    body, device = shading.Body(), drawing.device
    body.normals, body.colours = drawing.normals, drawing.colours
    body.uv = wp.array(drawing.uv, dtype=wp.vec2, device=device)
    body.texture = _image(_BLANK if drawing.texture is None else drawing.texture, device)
    body.textured = int(drawing.texture is not None)
    body.gloss = wp.array(drawing.gloss, dtype=float, device=device)
    # A lattice of tubes would be covered all over by its own fine shadows, which hide what its colours tell.
    if drawing.shows_strain:
        body.first_shaded = sum(len(one.part.triangles) for one in drawing.body)
    return body


def body_of_arrows(arrows: Arrows, device: str) -> Any:
    """Return arrows as what kernels shade, less their mesh; it follows them."""
    body, count = shading.Body(), len(arrows.points)
    body.normals, body.textured = arrows.normals, 0
    body.colours = wp.full(count, wp.vec3(*COLOUR), dtype=wp.vec3, device=device)
    body.uv = wp.zeros(count, dtype=wp.vec2, device=device)
    body.texture = _image(_BLANK, device)
    body.gloss = wp.zeros(len(arrows.triangles), dtype=float, device=device)
    return body


def surroundings_of(drawing: Drawing, stage: Stage, spots: NDArray) -> Any:
    """Return the camera, the lights and the ground; `spots` are the light's points, shape [any, 2]."""
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
    """Have pictures taken from another place, with another width and height; the lights stay."""
    width, height = size
    view.eye = wp.vec3(*camera.eye)
    pixel = 2 * math.tan(math.radians(VIEW_ANGLE) / 2) / height
    view.across, view.down = wp.vec3(*(pixel * camera.right)), wp.vec3(*(-pixel * camera.up))
    view.corner = wp.vec3(*(camera.forward + pixel * (height * camera.up - width * camera.right) / 2))
    view.far = 100 * float(np.linalg.norm(camera.eye - camera.target))
    view.towards_viewer = wp.vec3(*-camera.forward)


def _image(pixels: NDArray[np.uint8], device: str) -> wp.array:
    """Upload an image."""
    return wp.array(np.ascontiguousarray(pixels), dtype=wp.vec3ub, device=device)
