"""Renderers on Warp, with OpenGL's camera and look: a rasteriser on the CPU, and a ray caster on any device."""

from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from .. import checks
from ..kernels.pictures import raster, raycast, shading
from ..runtime import ReleasedInTurn, cores, in_turn
from ..world import FINISHES, Reflectance
from .arrows import Arrows
from .drawing import Drawing
from .light import CONTACT, CORNERS, SHADED, SHADOW, SOFTNESS, TONE, across, shininess, spread
from .shadow_map import ShadowMap
from .stage import UNSEEN, Camera, Stage

BAND, MOST_THREADS = 32, 8
"""Rows of the picture that a thread shades at a time; maximal number of threads."""
AROUND = 8
"""Corners of a polygon around the shadow on the ground, which bounds the part of the picture that changes."""
POINTS = {"cpu": 4, "cuda": 16}
"""Points of the light that each of a pixel's four rays samples in penumbras, on a CPU and on a GPU."""
THREADS = 1 << 17
"""Threads on a GPU that refine pixels: enough to fill it; each handles several pixels if necessary."""
LANES = 16
"""Threads that share a pixel: one alone would cast 68 rays in sequence."""
REFITS = 32
"""Number of refits of a search tree before it is rebuilt: its boxes overlap more as bodies move."""
ALL = slice(None)
FARTHEST = 1e10
"""Depth where nothing is [m], as in Blender."""
_BLANK = np.full((1, 1, 3), 255, dtype=np.uint8)


class Rasteriser:
    """Draws a drawing that is on the CPU, triangle by triangle, with shadows from a shadow map.

    The ground is drawn only once for each camera, and bodies and their shadows are drawn over it.
    """

    def __init__(self, drawing: Drawing, stage: Stage, arrows: Arrows | None = None) -> None:
        self._drawing, self._stage, self._arrows = drawing, stage, arrows
        shape = (stage.height, stage.width)
        self._map, self._view = ShadowMap(drawing, stage.camera.light), _surroundings_of(drawing, stage)
        self._pool = ThreadPoolExecutor(min(MOST_THREADS, cores()))
        self._bodies = [_body_of(drawing, ~drawing.glass)]
        if drawing.glass.any():
            self._bodies.append(_body_of(drawing, drawing.glass))
            self._bodies[1].glass = 1
        self._glass = np.unique(drawing.triangles[drawing.glass])
        self._over = None if arrows is None else _body_of(arrows)
        self._nearest = [wp.zeros((4 * shape[0], shape[1]), dtype=wp.uint64, device="cpu") for _ in self._bodies]
        self._backdrop = wp.zeros(shape, dtype=wp.vec3ub, device="cpu")
        self._pixels = wp.zeros(shape, dtype=wp.vec3ub, device="cpu")
        self.look_from(stage.camera, (stage.width, stage.height))
        # Draws nothing, but compiles the kernel before threads launch it.
        self._shade(self._bodies[0], self._nearest[0], (0, 0, 1, 0))

    def look_from(self, camera: Camera, size: tuple[int, int]) -> None:
        """Set the camera of the next pictures, which have the stage's `size`; the lights stay."""
        self._camera = camera
        _look_from(self._view, camera, size)
        self._draw_backdrop(0)  # compiles the kernel before threads launch it
        for _ in self._pool.map(self._draw_backdrop, range(BAND, size[1], BAND)):
            pass

    def _draw_backdrop(self, row: int) -> None:
        """Draw a band of the lit ground, and of the background, from a row on."""
        shape = min(BAND, self._stage.height - row), self._stage.width
        wp.launch(raster.draw_backdrop, shape, [self._view, row], [self._backdrop], device="cpu")

    def draw(self, *, shadows: bool = True) -> NDArray[np.uint8]:
        """Return the picture of the drawing's current state, uint8 of shape [height, width, 3]."""
        points = self._drawing.points.numpy()[self._drawing.visible]
        wp.copy(self._pixels, self._backdrop)
        if len(points):  # a stage may be empty
            changed = points
            if shadows:
                self._map.follow(points, self._stage.ground)
                if self._stage.ground is not None:
                    changed = np.concatenate([points, self._map.on_ground(points, self._stage.ground, AROUND)])
            of_glass = self._drawing.points.numpy()[self._glass]
            self._lay_over(self._bodies, [changed, of_glass], shadows=shadows)
        if self._arrows is not None:
            self._lay_over([self._over], [self._arrows.points.numpy()], shadows=False)
        return self._pixels.numpy().astype(np.uint8)  # a copy

    def _lay_over(self, bodies: list[Any], points: list[NDArray], *, shadows: bool) -> None:
        """Draw triangles over the picture, and glass over these, each within the part that holds its `points`."""
        self._view.shadows = int(shadows)
        layers = list(zip(bodies, self._nearest, points, strict=False))
        before = wp.zeros((0, 0), dtype=wp.uint64, device="cpu")
        for body, nearest, _ in layers:
            inputs = [body, self._view, before]
            wp.launch(raster.draw_triangles, len(body.triangles), inputs, [nearest], device="cpu")
            before = nearest
        for body, nearest, around in layers:
            row, column, rows, columns = self._camera.frame(around, *self._pixels.shape)
            # Align squares of 2 x 2 pixels equally in all pictures, whatever part changes.
            rows, columns = rows + row % 2, columns + column % 2
            row, column = row - row % 2, column - column % 2
            bands = [(row + k, column, min(BAND, rows - k), columns) for k in range(0, rows, BAND)]
            # Warp's native code releases Python's lock.
            for _ in self._pool.map(partial(self._shade, body, nearest), bands):
                pass

    def _shade(self, body: Any, nearest: wp.array, part: tuple[int, int, int, int]) -> None:
        """Shade a part of the picture: first row, first column, rows, columns."""
        row, column, rows, columns = part
        inputs = [body, self._view, self._map.data, row, column, columns]
        wp.launch(raster.shade, (rows + 1) // 2, inputs, [nearest, self._pixels], device="cpu")


class Passes:
    """What a drawing on the CPU shows at each pixel: how far away it is, and which of its triangles it is."""

    def __init__(self, drawing: Drawing, stage: Stage) -> None:
        self._drawing, self._stage = drawing, stage
        self._body, self._view = _body_of(drawing), _surroundings_of(drawing, stage)
        self._nearest = wp.zeros((4 * stage.height, stage.width), dtype=wp.uint64, device="cpu")

    def draw(self, camera: Camera) -> tuple[NDArray[np.float32], NDArray[np.int64]]:
        """Return depths and triangles, each of shape [height, width], of the nearest of four points of a pixel.

        A depth is a distance along the direction of view [m], FARTHEST where there is nothing. Triangles are
        numbers in the drawing, -1 for the ground and the background.
        """
        stage, ground, n = self._stage, self._stage.ground, len(self._body.triangles)
        _look_from(self._view, camera, (stage.width, stage.height))
        self._nearest.zero_()
        none = wp.zeros((0, 0), dtype=wp.uint64, device="cpu")
        wp.launch(raster.draw_triangles, n, [self._body, self._view, none], [self._nearest], device="cpu")
        key = self._nearest.numpy().reshape(stage.height, 4, stage.width).max(axis=1)
        near = (key >> np.uint64(32)).astype(np.uint32).view(np.float32)
        depth = np.where(key > 0, 1 / np.maximum(near, np.float32(1 / FARTHEST)), np.float32(FARTHEST))
        face = (key & np.uint64(0xFFFFFFFF)).astype(np.int64) - 1
        if ground is not None:
            row, column = np.mgrid[: stage.height, : stage.width][..., None] + 0.5
            way = np.array(self._view.corner) + column * self._view.across + row * self._view.down
            with np.errstate(divide="ignore", invalid="ignore"):  # at the horizon
                floor = (ground.centre - camera.eye) @ ground.normal / (way @ ground.normal)
                inside = np.abs(ground.uv(camera.eye + floor[..., None] * way) - 0.5).max(axis=-1) <= 0.5
            # Bodies in contact sink a little into the ground; pictures show them nevertheless.
            hidden = (floor > 0) & inside & (depth > floor + self._view.below)
            depth, face = np.where(hidden, floor, depth).astype(np.float32), np.where(hidden, -1, face)
        return depth, face


class RayCaster(ReleasedInTurn):
    """Draws a drawing by casting rays at it, on the device of the drawing."""

    @in_turn
    def __init__(self, drawing: Drawing, stage: Stage, arrows: Arrows | None = None) -> None:
        self.drawing, device = drawing, drawing.device
        self._searched = [_Searched(drawing, ~drawing.glass)]
        if drawing.glass.any():
            self._searched.append(_Searched(drawing, drawing.glass))
        self._over = None if arrows is None else _Searched(arrows)
        self._on_gpu, self._size = wp.get_device(device).is_cuda, (0, 0)
        self._points = POINTS["cuda" if self._on_gpu else "cpu"]
        self._view = _surroundings_of(drawing, stage)
        spots = np.concatenate([CORNERS, spread(16 * self._points)])
        self._view.spots = wp.array(spots, dtype=wp.vec2, device=device)
        self._threads, self._lanes = (THREADS, LANES) if self._on_gpu else (1, 1)
        self.look_from(stage.camera, (stage.width, stage.height))

    @in_turn
    def look_from(self, camera: Camera, size: tuple[int, int]) -> None:
        """Set the camera and the width and height of the next pictures; the lights stay."""
        _look_from(self._view, camera, size)
        if size == self._size:
            return
        self._size, device, (width, height) = size, self.drawing.device, size
        self._rays = wp.zeros((height, width), dtype=wp.vec4, device=device)
        self._chosen = wp.zeros((2, height * width), dtype=int, device=device)
        self._count = wp.zeros(2, dtype=int, device=device)
        self._pixels = self._host = wp.zeros((height, width), dtype=wp.vec3ub, device=device)
        if self._on_gpu:  # copies from a GPU are fastest into pinned memory
            self._host = wp.zeros((height, width), dtype=wp.vec3ub, device="cpu", pinned=True)

    @in_turn
    def draw(self, *, shadows: bool = True) -> NDArray[np.uint8]:
        """Return the picture of the drawing's current state, uint8 of shape [height, width, 3]."""
        self.refit()
        return self.shoot(shadows=shadows)

    @in_turn
    def shoot(self, *, shadows: bool = True) -> NDArray[np.uint8]:
        """Return the picture of the drawing at the last `refit`."""
        self._view.shadows = int(shadows)
        width, height = self._size
        device = self.drawing.device
        inputs = [self._searched[0].body, self._searched[-1].body, self._view]
        glass = len(self._searched) > 1
        tiles = -(-width // raycast.TILE) * -(-height // raycast.TILE)
        every = tiles * raycast.TILE**2
        wp.launch(raycast.cast(glass), every, inputs, [self._rays], device=device)
        self._count.zero_()
        wp.launch(raycast.choose, every, [self._rays], [self._pixels, self._chosen, self._count], device=device)
        chosen = [self._points, self._threads, self._chosen, self._count]
        refine = raycast.refine(self._lanes, glass)
        wp.launch(refine, self._threads, [*inputs, *chosen], [self._pixels], device=device)
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
        """Update the search tree from the drawing."""
        for one in self._searched:
            one.refit()
        one, other = self._searched[0].body, self._searched[-1].body
        if one is not other:
            one.other_mesh, other.other_mesh = other.mesh, one.mesh


class _Searched:
    """Chosen triangles with a search tree for rays."""

    def __init__(self, drawn: Drawing | Arrows, chosen: NDArray[np.bool_] | slice = ALL) -> None:
        self.body, self._points, self._refits = _body_of(drawn, chosen), drawn.points, REFITS
        # A mesh has a triangle at least: where all is glass, one that no ray meets.
        triangles = drawn.triangles[chosen] if len(self.body.triangles) else np.zeros(3)
        self._indices = wp.array(triangles.ravel(), dtype=int, device=drawn.device)

    def refit(self) -> None:
        """Refit the search tree to the triangles, or rebuild it; it is first built at the first picture."""
        if self._refits == REFITS:
            self._mesh = wp.Mesh(points=self._points, indices=self._indices)
            self.body.mesh, self._refits = self._mesh.id, 0
        else:
            self._mesh.refit()
            self._refits += 1


def _body_of(drawn: Drawing | Arrows, chosen: NDArray[np.bool_] | slice = ALL) -> Any:
    """Return the struct of chosen triangles for kernels, in the same memory, without a search tree."""
    body, device = shading.Body(), drawn.device
    body.points, body.normals, body.colors = drawn.points, drawn.normals, drawn.colors
    body.uv = wp.array(drawn.uv, dtype=wp.vec2, device=device)
    body.triangles = wp.array(drawn.triangles[chosen], dtype=wp.vec3i, device=device)
    body.closed = wp.array(drawn.closed[chosen], dtype=wp.bool, device=device)
    body.gloss = wp.array(drawn.gloss[chosen], dtype=float, device=device)
    body.finish = wp.array(drawn.finish[chosen], dtype=int, device=device)
    body.finishes = wp.array([_finish(one) for one in FINISHES.values()], dtype=shading.Finish, device=device)
    body.texture = _image(_BLANK if drawn.texture is None else drawn.texture, device)
    body.textured = int(drawn.texture is not None)
    # Fine shadows of a lattice of tubes on itself would hide its colors.
    if isinstance(drawn, Drawing) and drawn.shows_strain:
        body.first_shaded = sum(len(one.triangles) for one in drawn.body)
    return body


def _finish(reflectance: Reflectance) -> Any:
    """Return the struct of a reflectance for kernels."""
    finish = shading.Finish()
    finish.shininess = shininess(reflectance.roughness)
    finish.gleam = 1e-4 ** (1 / max(finish.shininess, 1e-3))
    finish.metallic, finish.sheen, finish.opacity = reflectance[1:]
    return finish


def _surroundings_of(drawing: Drawing, stage: Stage) -> Any:
    """Return the camera, the lights and the ground."""
    view, device, ground, light = shading.Surroundings(), drawing.device, stage.ground, stage.camera.light
    view.background = wp.vec3(*checks.color("background", stage.look.background))
    view.sky, view.bounce, view.key, view.head, view.fill = stage.camera.lights(even=drawing.by_value)
    view.fill_from = wp.vec3(*stage.camera.fill)
    view.light = wp.vec3(*light)
    view.light_u, view.light_v = (wp.vec3(*(SOFTNESS * axis)) for axis in across(light))
    view.tone, view.shaded, view.shadow = TONE, SHADED, SHADOW
    view.has_ground = int(ground is not None)
    view.ground = _image(_BLANK, device)
    if ground is not None:
        view.contact = 0.0 if drawing.by_value else CONTACT * ground.reach
        view.below = drawing.radius + UNSEEN * ground.reach
        view.ground = _image(ground.texture[::-1], device)
        view.ground_centre, view.ground_normal = wp.vec3(*ground.centre), wp.vec3(*ground.normal)
        span = 2 * ground.half
        view.ground_u, view.ground_v = wp.vec3(*(ground.u / span)), wp.vec3(*(ground.v / span))
    _look_from(view, stage.camera, (stage.width, stage.height))
    return view


def _look_from(view: Any, camera: Camera, size: tuple[int, int]) -> None:
    """Set the camera and the width and height of pictures; the lights stay."""
    width, height = size
    view.eye = wp.vec3(*camera.eye)
    pixel = 2 * camera.tangent / height
    view.across, view.down = wp.vec3(*(pixel * camera.right)), wp.vec3(*(-pixel * camera.up))
    view.corner = wp.vec3(*(camera.forward + pixel * (height * camera.up - width * camera.right) / 2))
    view.far = 100 * float(np.linalg.norm(camera.eye - camera.target))
    view.towards_viewer = wp.vec3(*-camera.forward)


def _image(pixels: NDArray[np.uint8], device: str) -> wp.array:
    return wp.array(np.ascontiguousarray(pixels), dtype=wp.vec3ub, device=device)
