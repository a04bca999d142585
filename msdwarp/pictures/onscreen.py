"""A drawing in a window, through PyVista; keys and the mouse are only reported."""

import math
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from .. import checks
from .actors import Actors, add_lights, ground_actor
from .drawing import Drawing
from .opengl_window import import_pyvista, no_display
from .stage import Camera, Stage, view_axes

GROUND, SHADOWS, SCENE, PANELS = 0, 1, 2, 3
"""Layers, each drawn over the previous ones; PyVista's own layers at 1 and 2 are empty."""
X11 = "vtkXOpenGLRenderWindow"
"""VTK's window on a display of Linux."""
BY_PROCESSOR = ("llvmpipe", "softpipe", "swrast", "GDI Generic")
"""Names of OpenGL drivers without a graphics card."""
SAMPLES = 4
"""Samples per pixel with a graphics card."""
EVENTS = {
    "KeyPressEvent": "key",
    "LeftButtonPressEvent": "left",
    "LeftButtonReleaseEvent": "left up",
    "MiddleButtonPressEvent": "middle",
    "MiddleButtonReleaseEvent": "middle up",
    "RightButtonPressEvent": "right",
    "RightButtonReleaseEvent": "right up",
    "MouseMoveEvent": "move",
    "MouseWheelForwardEvent": "wheel in",
    "MouseWheelBackwardEvent": "wheel out",
}
"""VTK's names of events, and the names used here."""
STEEPEST = math.radians(89.0)
"""Largest elevation of the camera [rad], short of where up is undefined."""


class OnScreen:
    """A window that shows a drawing from a movable camera, `orbit`.

    `size` is the initial width and height in pixels. `on_event` is called with each event: one of the values of
    `EVENTS`, x and y in pixels from the lower left, the key's name in X, and whether shift is held. `is_open` is
    False once the user has closed the window. RuntimeError is raised if there is no display.
    """

    def __init__(
        self, title: str, size: tuple[int, int], on_event: Callable[[str, int, int, str, bool], None]
    ) -> None:
        if (why := no_display()) is not None:
            raise RuntimeError(why)
        self._pv, self._on_event = import_pyvista(), on_event
        with _on_a_display():
            self._plotter = self._pv.Plotter(
                off_screen=False, notebook=False, window_size=list(size), lighting="none", title=title
            )
        if sys.platform.startswith("linux") and not self._plotter.render_window.IsA(X11):
            self._plotter.close()
            raise RuntimeError(f"no window can be opened on the display {os.environ.get('DISPLAY')}")
        self._plotter.disable_anti_aliasing()
        self.orbit = Orbit(Camera(*np.array([[0, -1, 0], [0, 0, 0], [0, 1, 0], [1, 0, 0], [0, 0, 1.0]])))
        self.is_open = True
        self._actors: Actors | None = None
        self._panels: dict[str, Any] = {}
        self._renderers: Any = self._layers()
        self._plotter.show(interactive_update=True, auto_close=False)
        # Smooth edges cost a graphics card little time, but a CPU much.
        if not any(name in self._plotter.render_window.ReportCapabilities() for name in BY_PROCESSOR):
            self._plotter.render_window.SetMultiSamples(SAMPLES)
        self._listen()

    def _layers(self) -> tuple[Any, Any, Any]:
        """Add layers for the ground and the shadows on it, below that of the scene, and for panels above it."""
        window = self._plotter.render_window
        window.SetNumberOfLayers(PANELS + 1)
        self._plotter.renderer.SetLayer(SCENE)
        ground, shadows, panels = (self._pv.Renderer(self._plotter, border=False) for _ in range(3))
        for renderer, layer in ((ground, GROUND), (shadows, SHADOWS), (panels, PANELS)):
            renderer.SetLayer(layer)
            renderer.SetInteractive(False)
            window.AddRenderer(renderer)
        if hasattr(panels, "SetUseOIT"):
            panels.SetUseOIT(False)  # panels do not overlap: no need to sort them
        panels.camera.parallel_projection = True
        return ground, shadows, panels

    def _listen(self) -> None:
        """Report events, and keep VTK and PyVista from acting on them."""
        listener: Any = self._plotter.iren
        listener.remove_observers()
        self._interactor = listener.interactor
        self._interactor.SetInteractorStyle(None)
        self._tags = [self._interactor.AddObserver(event, self._report) for event in (*EVENTS, "ExitEvent")]

    def _report(self, interactor: Any, event: str) -> None:
        if event == "ExitEvent":
            self.is_open = False
            return
        x, y = interactor.GetEventPosition()
        self._on_event(EVENTS[event], x, y, interactor.GetKeySym() or "", bool(interactor.GetShiftKey()))

    @property
    def size(self) -> tuple[int, int]:
        """Width and height in pixels."""
        width, height = self._plotter.render_window.GetSize()
        return max(width, 1), max(height, 1)

    def set_title(self, title: str) -> None:
        """Set the window's title."""
        self._plotter.render_window.SetWindowName(title)

    def poll(self) -> bool:
        """Process events; return whether the window is still open."""
        if self.is_open:
            self._interactor.ProcessEvents()
        return self.is_open

    def stage(self, drawing: Drawing, stage: Stage, *, keep_camera: bool = False) -> None:
        """Show another drawing, from the stage's camera or the current one."""
        pv, plotter = self._pv, self._plotter
        if not keep_camera:
            self.orbit = Orbit(stage.camera)
        if self._actors is not None:
            self._actors.remove()
        if not keep_camera or self._actors is None:
            self._stage, self._ground, back = stage, None, self._renderers[0]
            back.RemoveAllViewProps()
            back.SetBackground(*checks.color("background", stage.look.background))
            if stage.ground is not None:
                self._ground = ground_actor(pv, stage.ground)
                self._ground.prop.culling = "back"  # invisible from below
                back.AddActor(self._ground)
        now, shadows = self._stage, self._renderers[1]
        plotter.renderer.remove_all_lights()
        add_lights(pv, plotter, now.camera, now.camera.lights(even=drawing.by_value))
        self._actors = Actors(pv, plotter, drawing, now.ground, self._ground, now.camera)
        shadows.RemoveAllViewProps()
        if now.ground is not None:
            shadows.AddActor(self._actors.on_ground)

    def draw(self) -> None:
        """Update from the drawing, and render."""
        if self._actors is not None and self.is_open:
            self._actors.follow()
            self.redraw()

    def redraw(self) -> None:
        """Render from the current camera."""
        if not self.is_open:
            return
        plotter, (back, shadows, front) = self._plotter, self._renderers
        for renderer in (plotter.renderer, back, shadows):
            camera = renderer.camera
            camera.position, camera.focal_point = self.orbit.camera.eye, self.orbit.target
            camera.up, camera.view_angle = (0.0, 0.0, 1.0), self.orbit.field_of_view
            renderer.ResetCameraClippingRange()
        width, height = self.size
        camera = front.camera
        camera.position, camera.focal_point = (width / 2, height / 2, 1.0), (width / 2, height / 2, 0.0)
        camera.up, camera.parallel_scale, camera.clipping_range = (0.0, 1.0, 0.0), height / 2, (0.5, 1.5)
        plotter.render()

    def panel(self, name: str, image: Image.Image | None, x: float = 0.0, y: float = 0.0) -> None:
        """Replace the RGBA image of this name over the drawing; None removes it.

        Its lower left corner is at (x, y), in pixels from the window's lower left corner.
        """
        self._remove(name)
        if image is not None:
            corners = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], dtype=np.float32)
            square, actor = self._add_overlay(name, np.round([x, y]) + corners * image.size, 4)
            square.active_texture_coordinates = corners
            actor.texture, actor.prop.color = self._pv.Texture(np.asarray(image)), "white"
            actor.ForceTranslucentOn()

    def shape(self, name: str, points: NDArray | None, color: tuple[float, float, float] = (0, 0, 0)) -> None:
        """Replace the triangles of this name over the drawing; None removes them.

        Their corners are in pixels from the lower left of the window, shape [any, 3, 2].
        """
        self._remove(name)
        if points is not None:
            _, actor = self._add_overlay(name, points.reshape(-1, 2), 3)
            actor.prop.color = color

    def _add_overlay(self, name: str, points: NDArray, corners: int) -> tuple[Any, Any]:
        """Add polygons of this many corners over the drawing, points of shape [any, 2]; return mesh and actor."""
        flat = np.zeros((len(points), 3), np.float32)
        flat[:, :2] = points
        mesh = self._pv.PolyData.from_regular_faces(flat, np.arange(len(flat)).reshape(-1, corners))
        actor = self._panels[name] = self._pv.Actor(mapper=self._pv.DataSetMapper(mesh))
        actor.prop.lighting = False
        self._renderers[2].AddActor(actor)
        return mesh, actor

    def _remove(self, name: str) -> None:
        """Remove the image or triangles of this name, if there are any."""
        if (before := self._panels.pop(name, None)) is not None:
            self._renderers[2].RemoveActor(before)
            before.ReleaseGraphicsResources(self._plotter.render_window)

    def image(self) -> NDArray[np.uint8]:
        """Return the window's content, shape [height, width, 3]."""
        return np.array(self._plotter.screenshot(return_img=True)[..., :3])

    def close(self) -> None:
        """Close the window."""
        self.is_open = False
        for tag in self._tags:
            self._interactor.RemoveObserver(tag)
        self._tags.clear()
        del self._interactor
        self._panels.clear()
        window = self._plotter.render_window
        for renderer in self._renderers:
            renderer.close()
            window.RemoveRenderer(renderer)
            renderer.deep_clean()
        self._renderers = ()
        self._actors = self._ground = None
        self._plotter.close()
        self._plotter.deep_clean()


class Orbit:
    """A camera that the mouse moves around its target; z stays up. Movements are in window heights."""

    def __init__(self, camera: Camera) -> None:
        away = camera.eye - camera.target
        self.target, self.distance = np.array(camera.target), float(np.linalg.norm(away))
        self.azimuth = math.atan2(away[1], away[0]) if away[:2].any() else math.atan2(camera.up[1], camera.up[0])
        self.elevation = math.asin(away[2] / self.distance)
        self.field_of_view = camera.field_of_view
        self._start = self.distance
        self.turn(0.0, 0.0)

    @property
    def camera(self) -> Camera:
        """The current camera."""
        right, up, back = view_axes(self.azimuth, self.elevation)
        eye = self.target + self.distance * back
        return Camera(eye, self.target, -back, right, up, self.field_of_view)

    def turn(self, right: float, up: float) -> None:
        """Turn around the target: a movement by the window's height is half a turn."""
        self.azimuth -= math.pi * right
        self.elevation = min(max(self.elevation - math.pi * up, -STEEPEST), STEEPEST)

    def shift(self, right: float, up: float) -> None:
        """Shift the target so that the scene follows the mouse."""
        camera = self.camera
        unit = 2.0 * self.distance * camera.tangent
        self.target = self.target - unit * (right * camera.right + up * camera.up)

    def zoom(self, by: float) -> None:
        """Divide the distance to the target by a factor."""
        self.distance = min(max(self.distance / by, 1e-3 * self._start), 20.0 * self._start)

    def ray(self, right: float, up: float) -> tuple[NDArray, NDArray, NDArray]:
        """Return the ray through a point relative to the centre: origin [m], direction, direction of view."""
        camera = self.camera
        unit = 2.0 * camera.tangent
        way = camera.forward + unit * (right * camera.right + up * camera.up)
        return camera.eye, way / np.linalg.norm(way), camera.forward

    def pixels(self, points: NDArray, height: int, width: int) -> NDArray[np.float64] | None:
        """Return points [m], shape [any, 3], in pixels from the lower left; None if one is behind the camera."""
        camera = self.camera
        if ((points - camera.eye) @ camera.forward).min() <= 0:
            return None
        row, column = camera.pixels(points, height, width)
        return np.stack([column, height - row], axis=-1)


@contextmanager
def _on_a_display() -> Iterator[None]:
    """Let VTK choose a visible window, although earlier pictures may have chosen an invisible one."""
    name = "VTK_DEFAULT_OPENGL_WINDOW"
    before = os.environ.get(name)
    if sys.platform.startswith("linux"):
        os.environ[name] = X11
    try:
        yield
    finally:
        os.environ.pop(name, None)
        if before is not None:
            os.environ[name] = before
