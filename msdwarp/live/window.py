"""Window: a view in a window, with keys and the mouse."""

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from ..pictures import OnScreen, legends
from . import overlay
from .keys import FLAGS

if TYPE_CHECKING:
    from .sources import Source
    from .view import View

SIZE = (1280, 800)
"""Initial width and height of the window in pixels."""
CLOSES = ("escape", "q")
"""The keys that close the window."""
ZOOM = 1.15
"""Factor by which one notch of the mouse wheel divides the camera's distance."""
MOVES = {"left": "turn", "middle": "shift", "right": "shift"}
"""Camera movement by mouse button; if pressed on the body, the left button pulls it instead."""
PULL, EDGE = (0.95, 0.35, 0.05), (1.0, 1.0, 1.0)
"""Colors of the arrow that shows a pull, and of the arrow's edge."""
MOUSE = """beside  drag: turn the camera
wheel  nearer, farther
right  drag: shift the camera
q  close"""
"""Use of the mouse, in the list of keys."""
GAP = 14
"""Distance of texts from the edges in a window 720 rows high [pixels]."""


class Window:
    """A view in a window: a `Screen`; `size` is the initial size [pixels].

    The left mouse button pulls the body if pressed on it, otherwise it turns the camera. The middle and right
    buttons shift the camera, the wheel zooms. `KEYS` lists the keys; escape and q close the window.
    """

    takes_images = False

    _view: "View"
    _screen: OnScreen

    def __init__(self, size: tuple[int, int] = SIZE) -> None:
        self._size, self._is_open = size, False

    def open(self, view: "View") -> None:
        """Open the window; raise RuntimeError if there is no display (see `no_display`)."""
        self._view, self._source = view, None
        self._source: Source | None
        self._drag_mode, self._pointer, self._is_stale = "", (0, 0), False
        self._painted: dict[str, Any] = {}
        self._screen = OnScreen(f"msdwarp - {view.source.title}", self._size, self._on_event)
        self._size, self._is_open = self._screen.size, True

    @property
    def watched(self) -> bool:
        """Whether the window is open."""
        return self._is_open and self._screen.is_open

    def stage(self) -> None:
        """Show another scene or drawing; the camera stays if the source is the same."""
        view, screen = self._view, self._screen
        same, self._source = self._source is view.source, view.source
        if not same:
            self._stage, self._shift = view.staged(screen.size), view.following.shift
            screen.set_title(f"msdwarp - {view.source.title}")
        screen.stage(view.shown.drawing, self._stage, keep_camera=same)
        self._is_stale = True

    def show(self) -> None:
        """Show the current frame."""
        shift = self._view.following.shift
        self._screen.orbit.target = self._screen.orbit.target + shift - self._shift
        self._shift = shift
        self._draw_pull()
        self._screen.draw()
        self._is_stale = False

    def poll(self) -> bool:
        """Handle keys and mouse; return whether the window is still open."""
        screen, view = self._screen, self._view
        if self._drag_mode == "ask":  # the view has handled the request by now
            self._drag_mode = "pull" if view.hand.grip is not None and view.hand.holder is self else "turn"
        if self._is_stale:  # the view has shown a new frame
            self._draw_pull()
            screen.redraw()
            self._is_stale = False
        if not screen.poll():
            return False
        if screen.size != self._size:
            self._size = screen.size
            self.tell()
            self._is_stale = True
        return True

    def close(self) -> None:
        """Close the window; repeated calls are allowed."""
        if self._is_open:
            self._is_open = False
            self._screen.close()
            del self._screen, self._view, self._source

    def image(self) -> NDArray[np.uint8]:
        """Return the window's content, shape [height, width, 3]."""
        return self._screen.image()

    def _on_event(self, what: str, x: int, y: int, key: str, shift: bool) -> None:
        """Handle a key or the mouse; see `OnScreen`."""
        view, orbit, height = self._view, self._screen.orbit, self._screen.size[1]
        right, up = (x - self._pointer[0]) / height, (y - self._pointer[1]) / height
        self._pointer = (x, y)
        if what == "key" and key.lower() in CLOSES:
            view.post("quit")
        elif what == "key" and key == FLAGS:
            view.post("flags", eye=orbit.camera.eye, target=orbit.target)
        elif what == "key":
            view.press(key.lower(), shift=shift)
        elif what in MOVES and not self._drag_mode:
            self._drag_mode = MOVES[what]
            if what == "left" and view.source.handling is not None:
                origin, direction, _ = self._ray()
                view.post("pick", holder=self, origin=origin, direction=direction)
                self._drag_mode = "ask"
        elif what.endswith(" up"):
            if self._drag_mode in ("ask", "pull"):
                view.post("let_go", holder=self)
            self._drag_mode = ""
        elif what == "move" and self._drag_mode:
            self._is_stale = True
            if self._drag_mode in ("ask", "pull"):
                view.post("drag", holder=self, ray=self._ray())
            else:
                getattr(orbit, self._drag_mode)(right, up)
        elif what.startswith("wheel"):
            orbit.zoom(ZOOM if what == "wheel in" else 1 / ZOOM)
            self._is_stale = True

    def _ray(self) -> tuple[NDArray, NDArray, NDArray]:
        """Return the ray through the mouse pointer: origin [m], ray direction, camera's direction."""
        (width, height), (x, y) = self._screen.size, self._pointer
        return self._screen.orbit.ray((x + 0.5 - width / 2) / height, (y + 0.5 - height / 2) / height)

    # Texts and panels in front of the scene.

    @property
    def _pixel(self) -> float:
        """Scale of texts and arrows: 1 in a window 720 rows high."""
        return min(max(self._size[1] / 720, 0.8), 2.5)

    def tell(self) -> None:
        """Update the view's lines, energies, notice, color scale and keys."""
        view, (width, height), unit = self._view, self._screen.size, self._pixel
        gap, message = GAP * unit, view.notice
        lines = (*view.lines, view.hint)
        columns = max(20, int(0.4 * width / (7.5 * unit)))
        self._paint("lines", (lines, columns), lambda: overlay.text(lines, unit, columns=columns), (gap, -gap))
        last = view.readings[-1] if view.readings else None
        self._paint("energies", last, lambda: overlay.energies(view.readings, unit), (gap, gap))
        scale, stops = view.shown.drawing.scale, view.shown.drawing.stops
        if scale is not None:
            scale = scale._replace(full=float(f"{scale.full:.2g}"))  # ends of adapting scales are rounded
        self._paint("scale", scale, lambda: legends((width // 2, height), scale, stops).right, (-0.0, 0.0))
        row = max(20, int(0.8 * width / (15 * unit)))
        at = (None, gap + 0.16 * height)
        self._paint("notice", message, lambda: overlay.notice(message, unit, columns=row) if message else None, at)
        listed = f"{view.keys()}\n{MOUSE}" if view.helps else ""
        self._paint("keys", listed, lambda: overlay.keys(listed, unit) if listed else None, (-gap, -gap))

    def _paint(
        self, name: str, what: Any, paint: Callable[[], Image.Image | None], at: tuple[float | None, float]
    ) -> None:
        """Show the image that `paint` returns as panel `name`, unless the panel already shows `what`.

        `at` is the distance from the lower left corner, or if negative from the right or upper edge; None centres.
        """
        size = self._screen.size
        if self._painted.get(name) == (what, size):
            return
        self._painted[name] = (what, size)
        image, place = paint(), [0.0, 0.0]
        if image is not None:
            for k, (distance, extent, room) in enumerate(zip(at, image.size, size, strict=True)):
                if distance is None:
                    place[k] = (room - extent) / 2
                else:
                    place[k] = distance + (room - extent if np.signbit(distance) else 0)
        self._screen.panel(name, image, *place)
        self._is_stale = True

    def _draw_pull(self) -> None:
        """Draw an arrow from the picked point to its target."""
        view, screen, frame = self._view, self._screen, self._view.shown.frame
        assert frame is not None
        ends = view.hand.arrow(frame.position)
        if ends is not None:
            ends = screen.orbit.pixels(ends, height=screen.size[1], width=screen.size[0])
        for name, color, grow in (("edge of the pull", EDGE, 2.0), ("pull", PULL, 0.0)):
            drawn = None if ends is None else arrow(ends[0], ends[1], self._pixel, grow * self._pixel)
            screen.shape(name, drawn, color)


def arrow(start: NDArray, end: NDArray, unit: float, grow: float = 0.0) -> NDArray[np.float64]:
    """Return triangles of a dot at `start` and an arrow to `end` [pixels], shape [any, 3, 2].

    `unit` is the scale, 1 in a window 720 rows high; dot and arrow are wider by `grow` pixels on each side.
    """
    turns = np.linspace(0.0, 2.0 * np.pi, 25)
    rim = start + (5.0 * unit + grow) * np.stack([np.cos(turns), np.sin(turns)], axis=-1)
    dot = np.stack([np.broadcast_to(start, (24, 2)), rim[:-1], rim[1:]], axis=1)
    length = float(np.linalg.norm(end - start))
    if length < 8.0 * unit:
        return dot
    along = (end - start) / length
    aside = np.array([-along[1], along[0]])
    head, wide, thin = min(18.0 * unit, 0.6 * length), 0.45, 2.0 * unit + grow
    neck = end - head * along
    tip, base = end + 2.0 * grow * along, neck - grow * along
    half = (wide * head + 1.5 * grow) * aside
    a, b, c, d = start + thin * aside, start - thin * aside, neck - thin * aside, neck + thin * aside
    return np.concatenate([dot, [[a, b, c], [a, c, d], [tip, base + half, base - half]]])
