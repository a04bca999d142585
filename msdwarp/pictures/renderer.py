"""Pictures of a scene, by OpenGL (PyVista) or by Warp alone: a ray caster on a GPU, a rasteriser on the CPU."""

from __future__ import annotations

import importlib.util
import os
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import ArrayLike, NDArray

from .. import checks
from ..runtime import find_device, in_turn, start_warp
from ..world import Scene
from .arrows import Arrows
from .drawing import ColorScale, Drawing
from .legend import MOST_ROOM, legends, with_legends
from .opengl import OpenGL
from .opengl_window import ADVICE, has_card, opengl_window
from .stage import Camera, Stage
from .warp_renderers import Rasteriser, RayCaster

BACKENDS = ("auto", "raster", "raycast", "opengl")
"""The renderers; "auto" chooses one of the others.

The class of each takes (drawing, stage, arrows); its `draw(..., shadows)` returns the image.
"""
BACKGROUNDS = ("#000000", "#ffffff")
"""Backgrounds of the two pictures of which a transparent one is made."""


class Renderer:
    """Draws the frames of a scene, with one camera, which stands still unless the look lets it move.

    Parameters
    ----------
    scene
        The scene to draw. Connections are drawn until the times `broken_at` of its system: for a body that has
        torn, give `scene.replace(system=simulation.snapshot())`.
    positions
        Points that the camera keeps in view [m], shape [..., d]: the particles' positions in one or many frames,
        or any others. Solid colliders are also kept in view, for the whole duration of the scene.
    resolution
        Width and height in pixels.
    coloring
        "texture" for the surface with its texture; "strain" for springs from blue (shorter than at rest) to
        red (longer); or a `ColorScale`, which colors the surface (or springs, if there is none) by values
        given with each frame. Default: set by the scene's look.
    backend
        "raster" (Warp, on the CPU), "raycast" (Warp, on any device), "opengl" (PyVista), or "auto": the ray caster
        if `device` is a GPU, else PyVista if a graphics card draws its OpenGL, else the rasteriser.
    device
        Where the ray caster draws: cpu, cuda:0 ... By default the first GPU, or the CPU if there is none.
    zoom
        Zoom factor, above 0; 1 fits everything.
    arrows
        Draw forces on particles, given with each frame, as arrows in front of everything else. The number is the
        force of the longest arrow [N]; larger forces get arrows of the same length. None: no arrows.
    bodies
        Names of the groups that are drawn, such as `["ball"]`; "obstacles" stands for all obstacles. Empty: all.
    transparent
        Whether pictures have no background, and a fourth channel, the opacity: 0 … 255. They take twice the time.
        With `Look(floor="shadows")` shadows are all that is left of the ground.

    Raises
    ------
    ValueError
        If an argument is out of range, or there is nothing to draw.
    RuntimeError
        If OpenGL is requested but not available.
    """

    @in_turn
    def __init__(
        self,
        scene: Scene,
        positions: NDArray,
        *,
        resolution: tuple[int, int] = (1280, 720),
        coloring: str | ColorScale | None = None,
        backend: str = "auto",
        device: str | None = None,
        zoom: float = 1.0,
        arrows: float | None = None,
        bodies: Sequence[str] = (),
        transparent: bool = False,
    ) -> None:
        checks.one_of("backend", backend, BACKENDS)
        checks.one_of("transparent", transparent, (False, True))
        bodies = checks.sequence("bodies", bodies, str, "'ball'")
        checks.instance("scene", scene, Scene, "Scene(system=chain(5))")
        width, height = picture_size(resolution)
        checks.positive("zoom", zoom)
        if coloring is None:
            coloring = "strain" if scene.look.strain else "texture"
        start_warp()
        self.transparent = transparent
        """Whether pictures have a fourth channel, the opacity."""
        self.backend = _chosen(backend, device)
        """The renderer in use: "raster", "raycast" or "opengl"."""
        on = find_device(device).alias if self.backend == "raycast" else "cpu"
        self.drawing = Drawing(scene, coloring, on, bodies)
        positions, self._shape = _numbers("positions", positions), scene.system.position.shape
        if positions.ndim < 2 or positions.shape[-1] != scene.system.dim or positions.size == 0:
            allowed = f"(..., {scene.system.dim}), with at least one point"
            raise ValueError(f"positions has shape {positions.shape}; it must be {allowed}")
        checks.every("positions", positions, np.isfinite(positions), "finite")
        full = None if arrows is None else checks.positive("arrows", arrows)
        self._legends = legends((width, height), self.drawing.scale, self.drawing.stops, full)
        room = min(self._legends.height / height, MOST_ROOM)
        how = positions, (width, height), zoom, room, self.drawing.radius
        self.stage = Stage(scene, *how)
        count = scene.system.particle_count
        self.arrows = None if arrows is None else Arrows(arrows, count, self.stage, self.drawing.device)
        if self.backend == "opengl" and (window := opengl_window()):
            os.environ["VTK_DEFAULT_OPENGL_WINDOW"] = window
        kind = {"opengl": OpenGL, "raycast": RayCaster, "raster": Rasteriser}[self.backend]
        if transparent:
            before = [replace(scene, look=replace(scene.look, background=color)) for color in BACKGROUNDS]
            draws = partial(kind, self.drawing, arrows=self.arrows)
            self._backend: Any = _Matte(draws, (Stage(one, *how) for one in before))
        else:
            self._backend = kind(self.drawing, self.stage, self.arrows)

    def image(
        self,
        position: NDArray | wp.array,
        time: float = 0.0,
        values: ArrayLike | None = None,
        forces: ArrayLike | None = None,
    ) -> NDArray[np.uint8]:
        """Return the picture of a frame, uint8 of shape [height, width, 3], or [height, width, 4] if transparent.

        Parameters
        ----------
        position
            Particle positions [m], shape [particle_count, d]; or a Warp array of vectors, such as
            `Simulation.positions`, which the ray caster reads on the device, unchecked.
        time
            Time of the frame [s], for moving colliders.
        values
            A number per particle, in the unit of the `ColorScale`, shape [particle_count]; None if the coloring
            is not a `ColorScale`.
        forces
            A force on each particle [N], shape [particle_count, d], if there are `arrows`; else None.

        Raises
        ------
        ValueError
            If `position`, `values` or `forces` is not finite or not of the system's shape, or values are missing,
            or values or forces are given without a `ColorScale` or arrows.
        """
        if self.stage.moves and position.shape[:1] == self._shape[:1]:
            self.aim(_on_host(position), time)
        return self.with_legend(self.bare(position, time, values=values, forces=forces))

    @in_turn
    def aim(self, position: NDArray | None, time: float = 0.0) -> None:
        """Move the camera along its path to a time [s], or with the body that it follows.

        `position` are all particles' positions [m], shape [particle_count, d]; None: those at the start.
        """
        if self.stage.moves:
            self.look_from(self.stage.camera_at(time, position))

    @in_turn
    def look_from(self, camera: Camera) -> None:
        """Set the camera of the next pictures; the lights stay."""
        self._backend.look_from(camera, (self.stage.width, self.stage.height))

    @in_turn
    def bare(
        self,
        position: NDArray | wp.array | None,
        time: float = 0.0,
        *,
        shadows: bool = True,
        values: ArrayLike | None = None,
        forces: ArrayLike | None = None,
    ) -> NDArray[np.uint8]:
        """Return the picture of a frame without a legend, and without the body if `position` is None."""
        if forces is not None and self.arrows is None:
            raise ValueError("forces is given; it must be None unless the renderer was made with arrows")
        if position is None:
            if self.arrows is not None:
                self.arrows.follow(np.zeros(self._shape), None)
            camera = self.stage.camera
            self.drawing.follow_without_body(camera.eye - camera.forward, time)
            return self._backend.draw(shadows=shadows)
        checks.non_negative("time", time)
        shape, by_value = self._shape, self.drawing.by_value
        if not self._is_here(position):
            position = finite_array("position", _on_host(position), shape)
        if self.arrows is not None:
            self.arrows.follow(
                _on_host(position), None if forces is None else finite_array("forces", forces, shape)
            )
        if values is None and by_value:
            raise ValueError(
                f"values is None; it must have the shape {shape[:1]} where the coloring is a ColorScale"
            )
        if values is not None and not by_value:
            raise ValueError("values is given; it must be None unless the coloring is a ColorScale")
        if values is not None:
            values = finite_array("values", values, shape[:1]).astype(np.float64)
        self.drawing.follow(position, time, values)
        return self._backend.draw(shadows=shadows)

    def _is_here(self, position: NDArray | wp.array) -> bool:
        """Return whether positions are on the drawing's device, so that they need not be copied to the host."""
        return (
            isinstance(position, wp.array)
            and position.device == wp.get_device(self.drawing.device)
            and position.shape == self._shape[:1]
            and wp.types.type_size(position.dtype) == self._shape[1]
        )

    def with_legend(self, image: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Return a picture with its legend: the color bar and the longest arrow, if it has them."""
        return with_legends(image, self._legends)


def no_opengl() -> str | None:
    """Return why OpenGL cannot draw pictures here, or None if it can."""
    if importlib.util.find_spec("pyvista") is None:
        return "PyVista is not installed"
    return f"no OpenGL library was found; {ADVICE}" if opengl_window() is None else None


def _chosen(backend: str, device: str | None) -> str:
    """Return the name of the renderer; raise RuntimeError if OpenGL is requested but not available."""
    if backend == "auto":
        if device is not None and device != "cpu":
            return "raycast"
        return "opengl" if no_opengl() is None and has_card() else "raster"
    if backend == "opengl" and (why := no_opengl()) is not None:
        raise RuntimeError(f"backend is 'opengl', which cannot draw here; it must be 'raster' or 'raycast': {why}")
    return backend


def _on_host(value: NDArray | wp.array) -> NDArray:
    return value.numpy() if isinstance(value, wp.array) else value


def _numbers(name: str, value: ArrayLike) -> NDArray:
    """Return an array without copying it, since it may hold a whole run; raise ValueError if it has no numbers."""
    try:
        given = np.asarray(value)
    except ValueError:  # rows of different lengths
        return checks.array(name, value)
    return given if given.dtype.kind in "iuf" else checks.array(name, value)


def finite_array(name: str, value: ArrayLike, shape: tuple[int, ...]) -> NDArray:
    """Return an array; raise ValueError unless it has this shape and is finite."""
    given = _numbers(name, value)
    if given.shape != shape:
        raise ValueError(f"{name} has shape {given.shape}; it must be {shape}")
    checks.every(name, given, np.isfinite(given), "finite")
    return given


def picture_size(resolution: object) -> tuple[int, int]:
    """Return the width and height of pictures; raise ValueError if they are invalid."""
    if not isinstance(resolution, Sequence | np.ndarray) or isinstance(resolution, str) or len(resolution) != 2:
        given = checks.repr_short(resolution)
        raise ValueError(f"resolution is {given}; it must be two whole numbers, width and height")
    width, height = (checks.count("resolution", n, 16) for n in resolution)
    return width, height


class _Matte:
    """A renderer, made of two that see the same before black and before white.

    The share of the background in a pixel is what the two differ by (A. R. Smith and J. F. Blinn, "Blue screen
    matting", SIGGRAPH 1996). Shadows on a ground in the background's color become black and translucent.
    """

    def __init__(self, kind: Callable[[Stage], Any], stages: Iterable[Stage]) -> None:
        self._renderers = [kind(stage) for stage in stages]

    def look_from(self, camera: Camera, size: tuple[int, int]) -> None:
        """Set the camera of the next pictures; the lights stay."""
        for one in self._renderers:
            one.look_from(camera, size)

    def draw(self, *, shadows: bool = True) -> NDArray[np.uint8]:
        """Return the picture of the drawing's current state, uint8 of shape [height, width, 4]."""
        black, white = (one.draw(shadows=shadows).astype(np.float32) for one in self._renderers)
        share = 255 - np.clip((white - black).mean(axis=2, keepdims=True), 0, 255)
        return from_premultiplied(np.concatenate([black, share], axis=2))


def premultiplied(image: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Return a picture with colors multiplied by opacity, in 0 … 255, as which pictures can be added."""
    values = image.astype(np.float32)
    if image.shape[2] == 4:
        values[..., :3] *= values[..., 3:] / 255
    return values


def from_premultiplied(values: NDArray) -> NDArray[np.uint8]:
    """Return a picture, given colors in 0 … 255 multiplied by opacity, and opacity if there are four channels."""
    if values.shape[2] == 4:
        color = values[..., :3] * (255 / np.maximum(values[..., 3:], 0.5))
        values = np.concatenate([np.minimum(color, 255), values[..., 3:]], axis=2)
    return (values + 0.5).astype(np.uint8)
