"""OnScreen: a drawing in a window, through PyVista, which acts on no key and no mouse by itself."""

import os
import sys
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from .. import checks
from .actors import Actors, ShadedGround, add_lights, ground_square, ground_texture
from .drawing import Drawing
from .opengl_window import no_display
from .orbit import Orbit
from .stage import VIEW_ANGLE, Camera, Stage

GROUND, SHADOWS, SCENE, PANELS = 0, 1, 2, 3
"""Layers, each drawn over those before it; PyVista has two of its own at 1 and 2, which are empty."""
X11 = "vtkXOpenGLRenderWindow"
"""VTK's window on a display of Linux."""
BY_PROCESSOR = ("llvmpipe", "softpipe", "swrast", "GDI Generic")
"""What OpenGL says of itself where there is no graphics card."""
SAMPLES = 4
"""Samples of a pixel where there is one."""
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
"""What VTK says happened, and what it is called here."""


class OnScreen:
    """A window in which a drawing is seen from a camera that can be moved.

    Parameters
    ----------
    title
        What stands over the window.
    size
        Its width and height at first, in pixels.
    happened
        Called as something happens: one of the values of `EVENTS`, with x and y in pixels from the lower left, the
        name of the key as X has it, and whether shift is held.

    Attributes
    ----------
    orbit
        The camera.
    is_open
        Whether nobody has closed the window.

    Raises
    ------
    RuntimeError
        If there is no display to open a window on.
    """

    def __init__(
        self, title: str, size: tuple[int, int], happened: Callable[[str, int, int, str, bool], None]
    ) -> None:
        if (why := no_display()) is not None:
            raise RuntimeError(why)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of VTK's and PyVista's own making, at import
            import pyvista as pv
        self._pv, self._happened = pv, happened
        with _on_a_display():
            self._plotter: Any = pv.Plotter(
                off_screen=False, notebook=False, window_size=list(size), lighting="none", title=title
            )
        if sys.platform.startswith("linux") and not self._plotter.render_window.IsA(X11):
            self._plotter.close()
            raise RuntimeError(f"no window can be opened on the display {os.environ.get('DISPLAY')}")
        self._plotter.disable_anti_aliasing()
        self.orbit = Orbit(Camera(*np.array([[0, -1, 0], [0, 0, 0], [0, 1, 0], [1, 0, 0], [0, 0, 1.0]])))
        self.is_open = True
        self._actors: Actors | None = None
        self._shaded: ShadedGround | None = None
        self._panels: dict[str, Any] = {}
        self._stacked: Any = self._layers()
        self._plotter.show(interactive_update=True, auto_close=False)
        # Smooth edges cost a graphics card little, and a processor in its place much.
        if not any(name in self._plotter.render_window.ReportCapabilities() for name in BY_PROCESSOR):
            self._plotter.render_window.SetMultiSamples(SAMPLES)
        self._listen()

    def _layers(self) -> tuple[Any, Any, Any]:
        """Add the layers for the ground, the shadows on it, and for panels, below and above PyVista's own."""
        window = self._plotter.render_window
        window.SetNumberOfLayers(PANELS + 1)
        self._plotter.renderer.SetLayer(SCENE)
        ground, shadows, panels = (self._pv.Renderer(self._plotter, border=False) for _ in range(3))
        for renderer, layer in ((ground, GROUND), (shadows, SHADOWS), (panels, PANELS)):
            renderer.SetLayer(layer)
            renderer.SetInteractive(False)
            window.AddRenderer(renderer)
        if hasattr(panels, "SetUseOIT"):
            panels.SetUseOIT(False)  # panels lie beside each other: no need to sort them
        panels.camera.parallel_projection = True
        return ground, shadows, panels

    def _listen(self) -> None:
        """Have what happens be told here, and by nothing that VTK or PyVista would do about it."""
        listener: Any = self._plotter.iren
        listener.remove_observers()
        self._interactor = listener.interactor
        self._interactor.SetInteractorStyle(None)
        self._tags = [self._interactor.AddObserver(event, self._heard) for event in EVENTS]
        self._tags.append(self._interactor.AddObserver("ExitEvent", self._exits))

    def _heard(self, interactor: Any, event: str) -> None:
        x, y = interactor.GetEventPosition()
        self._happened(EVENTS[event], x, y, interactor.GetKeySym() or "", bool(interactor.GetShiftKey()))

    def _exits(self, interactor: Any, event: str) -> None:
        self.is_open = False

    @property
    def size(self) -> tuple[int, int]:
        """Width and height in pixels."""
        width, height = self._plotter.render_window.GetSize()
        return max(width, 1), max(height, 1)

    def entitle(self, title: str) -> None:
        """Write another title over the window."""
        self._plotter.render_window.SetWindowName(title)

    def poll(self) -> bool:
        """Have what happened be told; return whether the window is still open."""
        if self.is_open:
            self._interactor.ProcessEvents()
        return self.is_open

    def stage(self, drawing: Drawing, stage: Stage, *, keep_camera: bool = False) -> None:
        """Show another drawing, from the stage's camera or the one that there is."""
        pv, plotter = self._pv, self._plotter
        if not keep_camera:
            self.orbit = Orbit(stage.camera)
        if self._actors is not None:
            self._actors.remove()
        if not keep_camera or self._actors is None:
            plotter.renderer.remove_all_lights()
            add_lights(pv, plotter, stage.camera)
            self._stacked[1].remove_all_lights()
            for light in plotter.renderer.lights:
                self._stacked[1].add_light(light)
            self._stand(stage)
        self._actors = Actors(pv, plotter, drawing, self._stage.ground, self._stage.camera.light)
        shadows = self._stacked[1]
        shadows.RemoveAllViewProps()
        self._shaded = None
        if self._stage.ground is not None:
            self._shaded = ShadedGround(pv, self._stage.ground, self._texture, self._actors)
            shadows.AddActor(self._shaded.actor)

    def _stand(self, stage: Stage) -> None:
        """Have the ground and the background be those of a stage."""
        pv, back = self._pv, self._stacked[0]
        self._stage, self._texture = stage, None
        back.RemoveAllViewProps()
        back.SetBackground(*checks.colour("background", stage.look.background))
        if stage.ground is None:
            return
        self._texture = ground_texture(pv, stage.ground)
        square = pv.Actor(mapper=pv.DataSetMapper(ground_square(pv, stage.ground)))
        square.prop.color, square.prop.lighting = "white", False
        square.prop.culling = "back"  # from below it hides nothing
        square.texture = self._texture
        back.AddActor(square)

    def draw(self) -> None:
        """Draw all as it is now."""
        if self._actors is None or not self.is_open:
            return
        points = self._actors.follow()
        if self._shaded is not None:
            self._shaded.follow(points)
        self.redraw()

    def redraw(self) -> None:
        """Draw all as it was, from where the camera is now."""
        if not self.is_open:
            return
        plotter, (back, shadows, front) = self._plotter, self._stacked
        for renderer in (plotter.renderer, back, shadows):
            camera = renderer.camera
            camera.position, camera.focal_point = self.orbit.eye, self.orbit.target
            camera.up, camera.view_angle = (0.0, 0.0, 1.0), VIEW_ANGLE
            renderer.ResetCameraClippingRange()
        width, height = self.size
        camera = front.camera
        camera.position, camera.focal_point = (width / 2, height / 2, 1.0), (width / 2, height / 2, 0.0)
        camera.up, camera.parallel_scale, camera.clipping_range = (0.0, 1.0, 0.0), height / 2, (0.5, 1.5)
        plotter.render()

    def panel(self, name: str, image: Image.Image | None, x: float = 0.0, y: float = 0.0) -> None:
        """Lay an image over the drawing, in place of the one of the same name; None takes it away.

        Parameters
        ----------
        name
            Which it is.
        image
            Red, green, blue and alpha.
        x, y
            Where its lower left corner is, in pixels from that of the window.
        """
        self._replace(name, None)
        if image is None:
            return
        pv = self._pv
        corners = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], dtype=np.float32)
        points = np.zeros((4, 3), np.float32)
        points[:, :2] = np.round([x, y]) + corners * image.size
        square = pv.PolyData.from_regular_faces(points, [[0, 1, 2, 3]])
        square.active_texture_coordinates = corners
        actor = pv.Actor(mapper=pv.DataSetMapper(square))
        actor.texture, actor.prop.color = pv.Texture(np.asarray(image)), "white"
        self._replace(name, actor)

    def shape(self, name: str, points: NDArray | None, colour: tuple[float, float, float] = (0, 0, 0)) -> None:
        """Lay triangles over the drawing, in place of those of the same name; None takes them away.

        Parameters
        ----------
        name
            Which they are.
        points
            Their corners in pixels from the lower left of the window, shape [any, 3, 2].
        colour
            Red, green and blue in 0 … 1.
        """
        self._replace(name, None)
        if points is None:
            return
        pv = self._pv
        flat = np.zeros((points.size // 2, 3), np.float32)
        flat[:, :2] = points.reshape(-1, 2)
        mesh = pv.PolyData.from_regular_faces(flat, np.arange(len(flat)).reshape(-1, 3))
        actor = pv.Actor(mapper=pv.DataSetMapper(mesh))
        actor.prop.color = colour
        self._replace(name, actor)

    def _replace(self, name: str, actor: Any) -> None:
        """Have an actor stand before the drawing, in place of the one of the same name."""
        front = self._stacked[2]
        if (before := self._panels.pop(name, None)) is not None:
            front.RemoveActor(before)
            before.ReleaseGraphicsResources(self._plotter.render_window)
        if actor is not None:
            actor.prop.lighting = False
            if actor.texture is not None:
                actor.ForceTranslucentOn()
            front.AddActor(actor)
            self._panels[name] = actor

    def image(self) -> NDArray[np.uint8]:
        """Return what the window shows, shape [height, width, 3]."""
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
        for renderer in self._stacked:
            renderer.close()
            window.RemoveRenderer(renderer)
            renderer.deep_clean()
        self._stacked = ()
        self._actors = self._shaded = None
        self._plotter.close()
        self._plotter.deep_clean()


@contextmanager
def _on_a_display() -> Iterator[None]:
    """Have VTK choose a window that is seen, though pictures drawn before may have chosen one that is not."""
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
