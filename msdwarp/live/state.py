"""State: the source, the texts and the screens of a view."""

import queue
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol

from .. import checks
from ..pictures import Stage
from .handling import Handling
from .keys import listed
from .picking import Pull
from .recording import Filming, Recording
from .shown import COLORS, Following, Shown
from .sources import Reading, Source

NOTICE_TIME = 1.5
"""Time for which a short notice is shown [s]."""
ROOM = 0.8
"""Zoom of the first camera, which leaves room since bodies move."""
MOST_TRIANGLES = 100_000
"""Largest number of triangles sent to a page if a GPU can draw images: a million triangles take 6 MB per frame, an
image below 0.1 MB. A CPU takes longer to draw an image than most links to transfer triangles."""


class Screen(Protocol):
    """A window or a page. All methods are called in the thread of the view's loop."""

    takes_images: bool  # whether it can show images instead of triangles

    @property
    def watched(self) -> bool:
        """Whether anybody is watching."""
        ...

    def open(self, view: Any) -> None:
        """Start showing a `View`."""

    def stage(self) -> None:
        """Show another scene or drawing, after `view.shown` was replaced."""

    def show(self) -> None:
        """Show the current frame of `view.shown`."""

    def tell(self) -> None:
        """Show `view.notice`, `view.lines` and `view.readings`, and update sliders."""

    def poll(self) -> bool:
        """Handle user input; return whether the screen is still open."""
        ...

    def close(self) -> None:
        """Close the window or stop serving the page."""


class ViewState:
    """The state of a view; parameters as for `View`."""

    def __init__(
        self,
        source: Source,
        screens: Sequence[Screen],
        *,
        scenes: Mapping[str, Callable[[], Source]] | None = None,
        rebuild: Callable[..., Source] | None = None,
        paused: bool = False,
        renderer: str = "auto",
        zoom: float = 1.0,
    ) -> None:
        self.screens, self.scenes = list(screens), dict(scenes or {})
        self.paused, self.speed, self.helps = paused, 1.0, False
        self.renderer, self.sends, self.images = renderer, "auto", False
        self._waits, self._zoom = True, checks.positive("zoom", zoom)
        self.recording: Recording | None = None
        self._last_recording: Path | None = None
        self._filming: Filming | None = None
        self._requests: queue.SimpleQueue[tuple[str, dict[str, Any]]] = queue.SimpleQueue()
        self._thread: threading.Thread | None = None
        self._ends, self._is_slow = threading.Event(), False
        self._notice, self._noticed = "", -NOTICE_TIME
        self._begin(source, rebuild or source.rebuild)

    def _begin(self, source: Source, rebuild: Callable[..., Source] | None) -> None:
        """Show another source from its first frame."""
        before: Shown | None = getattr(self, "shown", None)
        self.source, self.rebuild = source, rebuild
        self.readings: deque[Reading] = deque(maxlen=300)
        self.hand, self.following = Pull(), Following(source)
        self._last_reading = self._last_shown = 0.0
        self._fps, self._ratio, self._averaged = 0.0, 0.0, 0
        self._start_clock()
        self._draw(COLORS[0] if before is None else before.color, wires=before is not None and before.wires)

    def _start_clock(self) -> None:
        """Restart the count of frames that are due in real time."""
        self._clock, self._frames_taken = time.perf_counter(), 0

    def _begin_to_run(self) -> None:
        """Stop waiting for a viewer, and restart the clock."""
        self._waits = False
        self._start_clock()

    def _draw(self, color: str, *, wires: bool) -> None:
        """Create the drawing of the source, colored by COLORS[color], or of its springs if `wires` is true."""
        scene, device = self.source.scene, self.source.device
        self.shown = Shown(scene, color, wires=wires)
        large = device != "cpu" and len(self.shown.drawing.triangles) > MOST_TRIANGLES
        wanted = self.sends == "images" or (self.sends == "auto" and (large or self._is_slow))
        self.images = wanted and any(screen.takes_images for screen in self.screens)
        if self.images and device != "cpu":
            self.shown = Shown(scene, color, wires=wires, device=device)
        self.shown.follow(self.source.frame())

    def _stage(self) -> None:
        self._is_shown = False
        for screen in self.screens:
            screen.stage()

    def _redraw(self, color: str | None = None, *, wires: bool | None = None) -> None:
        """Create the drawing of the source again; settings that are None stay the same."""
        before = self.shown
        self._draw(before.color if color is None else color, wires=before.wires if wires is None else wires)
        self._stage()

    def _change_to(self, other: Source, rebuild: Callable[..., Source] | None) -> str:
        """Show another source, or the previous one if that fails; return the message of an ended recording."""
        before, hand = (self.source, self.rebuild), (self.hand, self.following)
        try:
            self._begin(other, rebuild)
            self._stage()
        except Exception:
            self._begin(*before)
            self.hand, self.following = hand
            self._stage()
            raise
        return self._end_recording()

    def staged(self, size: tuple[int, int]) -> Stage:
        """Return camera, lights and ground for pictures of the source, of this width and height [pixels]."""
        room = 1.0 if self.source.scene.look.distance is not None else ROOM
        radius = self.shown.drawing.radius
        return Stage(self.source.scene, self.source.seen(), size, zoom=room * self._zoom, radius=radius)

    @property
    def _handling(self) -> Handling:
        """The source's `Handling`; raise ValueError if the source is a recording."""
        if self.source.handling is None:
            raise ValueError("this is a recording: it cannot be changed")
        return self.source.handling

    def _end_recording(self) -> str:
        """End the recording, if any; return its message, to be appended to another one."""
        if self.recording is None:
            return ""
        ended, self.recording = self.recording, None
        message, self._last_recording = ended.close(), ended.folder
        return f"; {message}"

    @property
    def notice(self) -> str:
        """The message about the last command, while it is displayed."""
        shown_for = NOTICE_TIME * (1 + len(self._notice) / 40)
        return self._notice if time.perf_counter() - self._noticed < shown_for else ""

    def _notify(self, text: str) -> None:
        self._notice, self._noticed, self._last_reading = text, time.perf_counter(), 0.0

    @property
    def lines(self) -> list[str]:
        """Time, speed, simulation settings and energies as text."""
        pictures = "1 picture" if round(self._fps) == 1 else f"{self._fps:.0f} pictures"
        state = "paused" if self.paused else f"{self._ratio:.2g} of real time, {pictures} a second"
        lines = [f"{self.source.time:.2f} s, {state}", self.source.summary()]
        if self.readings:
            last = self.readings[-1]
            lines.append(f"energy {last.sum:.3g} J: kinetic {last.kinetic:.3g}, elastic {last.elastic:.3g}")
            lines.append(f"largest strain {last.strain:.2g}")
        return lines

    @property
    def hint(self) -> str:
        """A hint for new users."""
        return ("drag the body to pull it; " if self.source.handling is not None else "") + "h lists the keys"

    def keys(self) -> str:
        """Return the list of keys as text."""
        return listed(list(self.scenes))

    def _move_hand(self) -> None:
        """Move the targets of mouse springs before a frame."""
        if (grip := self.hand.grip) is None:
            return
        to = grip.pulled(self.source.frame().position, self.hand.target)
        arrays = {"particles": grip.particles, "to": to, "stiffness": grip.stiffness, "damping": grip.damping}
        self._handling.do("hold", **{name: values.tolist() for name, values in arrays.items()})
