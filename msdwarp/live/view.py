"""View: a simulation, or a trajectory, that people look at and handle while it runs."""

import queue
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Protocol

from .. import checks
from ..simulation import SimulationDiverged
from .commands import COMMANDS, Commands, said_of
from .keys import KEYS, SCENES, listed
from .picking import Pull
from .shown import Shown
from .sources import Reading, Source

TOLD_FOR = 1.5
"""How long it is shown what was done [s]."""
BUDGET = 1 / 20
"""The longest that frames are simulated before the view looks up [s]."""
READ_EVERY = 0.2
"""Seconds from one reading of energies to the next."""
AVERAGED = 10
"""About how many pictures the speeds that are told are averaged over."""
BEHIND = 0.25
"""How far simulated time may fall behind before it is not caught up with [s]."""
MOST_TRIANGLES = 100_000
"""The most triangles that a page is sent where a GPU draws: a million are 6 MB a frame, an image less than 0.1 MB.
A CPU needs longer to draw them than most links to carry them."""


class Screen(Protocol):
    """A window or a page. All of it is called in the thread of the view's loop."""

    def open(self, view: "View") -> None:
        """Begin."""
        ...

    def stage(self) -> None:
        """Show another scene, or the same drawn in another way: `view.shown` is a new one."""
        ...

    def show(self) -> None:
        """Show the frame that `view.shown` follows now."""
        ...

    def tell(self) -> None:
        """Show what is written: `view.notice`, `view.lines`, `view.readings`, and where sliders stand."""
        ...

    def poll(self) -> bool:
        """See to what has come from the person; return whether this is still open."""
        ...

    @property
    def watched(self) -> bool:
        """Whether anybody looks."""
        ...

    takes_images: bool
    """Whether it can be sent images that are drawn elsewhere."""

    def close(self) -> None:
        """End."""
        ...


class View(Commands):
    """An interactive view of a simulation or a trajectory.

    Its loop executes commands, simulates the frames that are due, and shows the last one. From other threads call
    only `post`, `press` and `close`.

    Parameters
    ----------
    source
        The first source to show.
    screens
        The windows and pages.
    scenes
        The scenes of the keys 1 to 9, by name: functions that return a `Source`.
    rebuild
        A function that builds the current scene with other parameters and returns a `Source`.
    paused
        Whether it starts paused.
    renderer
        Renderer of snapshots and films: "auto", "raster", "raycast" or "opengl".

    Attributes
    ----------
    source, shown
        The current source, and its drawing.
    paused, speed
        Whether it is paused; the playback speed (1 is real time).
    sends
        Data that is sent to pages: "auto", "triangles" or "images".
    notice
        A message about the last command, while it is shown; else empty.
    readings
        Energies of the last seconds.
    """

    def __init__(
        self,
        source: Source,
        screens: Sequence[Screen],
        *,
        scenes: Mapping[str, Callable[[], Source]] | None = None,
        rebuild: Callable[..., Source] | None = None,
        paused: bool = False,
        renderer: str = "auto",
    ) -> None:
        self.source, self.screens, self.scenes, self._rebuild = source, list(screens), dict(scenes or {}), rebuild
        self.paused, self.speed, self.helps = paused, 1.0, False
        self.recording = None
        self.renderer, self._kept, self._filming = renderer, None, None
        self.sends, self._is_slow, self._images = "auto", False, False
        self._wanted: queue.SimpleQueue[tuple[str, dict[str, Any]]] = queue.SimpleQueue()
        self._thread: threading.Thread | None = None
        self._ends = threading.Event()
        self._notice, self._told = "", -TOLD_FOR
        self._begin(source)

    def _begin(self, source: Source) -> None:
        """Show another source from its start."""
        before = getattr(self, "shown", None)
        self.source = source
        self.readings: deque[Reading] = deque(maxlen=300)
        self.hand = Pull()
        self._read = self._looked = 0.0
        self._fps, self._ratio, self._averaged = 0.0, 0.0, 0
        self._is_shown = False
        self._start_clock()
        self._draw("look" if before is None else before.colour, wires=before is not None and before.wires)

    # The loop.

    def run(self, until: Callable[[], bool] = lambda: False) -> None:
        """Run until a screen is closed, `close` is called, or `until` returns true."""
        opened: list[Screen] = []
        try:
            for screen in self.screens:
                screen.open(self)
                opened.append(screen)
            self._stage()
            self._start_clock()
            while not self._ends.is_set() and not until():
                open_yet = [screen.poll() for screen in opened]  # each is asked
                if not all(open_yet):
                    break
                began = time.perf_counter()
                self._obey()
                moved = self._advance()
                watched = any(screen.watched for screen in opened)
                if watched and (moved or not self._is_shown):
                    self._show()
                self._tell(watched)
                spare = (1 / 240 if moved else 1 / 60) - (time.perf_counter() - began)
                if spare > 0:
                    time.sleep(spare)
        finally:
            if self.recording is not None:
                self.recording.close()
            for screen in opened:
                screen.close()

    def start(self) -> None:
        """Run in a separate thread."""
        self._thread = threading.Thread(target=self.run, name="msdwarp view", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """End the loop, and wait for its thread if there is one. It may be called repeatedly, from any thread."""
        self._ends.set()
        if self._thread is not None and self._thread is not threading.current_thread():
            self._thread.join()

    def post(self, command: str, **values: Any) -> None:
        """Request a command, one of `COMMANDS`, with its values. It may be called from any thread."""
        self._wanted.put((command, values))

    @property
    def waiting(self) -> int:
        """The number of commands that were requested, and are not done yet."""
        return self._wanted.qsize()

    def press(self, key: str, *, shift: bool = False) -> bool:
        """Request the action of a key, from any thread; return whether the key has one."""
        if key in SCENES and not shift:
            self.post("scene", number=int(key))
            return True
        several = [one for one in KEYS.get(key, ()) if one.shift == shift]
        for one in several:
            self.post(one.command, **one.values)
        return bool(several)

    def _obey(self) -> None:
        """Do what was asked for until now: frames have their turn before what comes meanwhile."""
        for _ in range(self.waiting):
            command, values = self._wanted.get_nowait()
            try:
                checks.one_of("command", command, COMMANDS)
                COMMANDS[command](self, **values)
            except SimulationDiverged as error:
                self._failed(error)
            except (Exception, SystemExit) as error:  # of a scene's script too: what a page asks for ends nothing
                self._say(said_of(error))

    def _advance(self) -> bool:
        """Simulate the frames that are due; return whether there were any."""
        if self.paused:
            return False
        now = time.perf_counter()
        due = self._frames_due(now)
        taken = 0
        try:
            while taken < due and (not taken or time.perf_counter() - now < BUDGET):
                self._lead_hand()
                if not self.source.advance():
                    self._pause(True)
                    break
                taken += 1
        except Exception as error:  # such as of a disk that is full
            self._failed(error)
        self._taken += taken
        if self._frames_due(time.perf_counter()) > BEHIND * self.source.fps * self.speed + 1:
            self._start_clock()
        return taken > 0

    def _frames_due(self, now: float) -> int:
        return int((now - self._clock) * self.source.fps * self.speed) - self._taken

    def _start_clock(self) -> None:
        self._clock, self._taken = time.perf_counter(), 0

    def _show(self) -> None:
        """Have every screen show the present frame."""
        frame, now = self.source.frame(), time.perf_counter()
        broken = self.source.broken_at()
        if broken is not None and self.shown.tears(broken, frame.time):
            self.shown = self.shown.torn(broken, frame.time)
            self._stage()
        self.shown.follow(frame)
        for screen in self.screens:
            screen.show()
        if self._is_shown and now > self._looked:
            self._averaged = min(self._averaged + 1, AVERAGED)
            self._fps += (1 / (now - self._looked) - self._fps) / self._averaged
            self._ratio += ((frame.time - self._at) / (now - self._looked) - self._ratio) / self._averaged
        self._looked, self._at, self._is_shown = now, frame.time, True

    def _tell(self, watched: bool) -> None:
        """Read energies and have screens write, a few times a second."""
        now = time.perf_counter()
        if not watched or now - self._read < READ_EVERY:
            return
        self._read = now
        if self._filming is not None and (said := self._filming.ended()) is not None:
            self._filming = None
            self._say(said)
        if not self.paused and (reading := self.source.reading()) is not None:
            self.readings.append(reading)
        for screen in self.screens:
            screen.tell()

    def _draw(self, colour: str, *, wires: bool) -> None:
        """Draw what is shown in other colours, or as connections."""
        scene, device = self.source.scene, self.source.device
        self.shown = Shown(scene, colour, wires=wires)
        large = device != "cpu" and len(self.shown.drawing.triangles) > MOST_TRIANGLES
        wanted = self.sends == "images" or (self.sends == "auto" and (large or self._is_slow))
        self._images = wanted and any(screen.takes_images for screen in self.screens)
        if self._images and device != "cpu":
            self.shown = Shown(scene, colour, wires=wires, device=device)
        self.shown.follow(self.source.frame())

    @property
    def images(self) -> bool:
        """Whether pages receive images instead of triangles."""
        return self._images

    def _stage(self) -> None:
        self._is_shown = False
        for screen in self.screens:
            screen.stage()

    @property
    def can_rebuild(self) -> bool:
        """Whether the scene can be built with other parameters."""
        return self._rebuild is not None

    # What is written.

    @property
    def notice(self) -> str:
        """A message about the last command, while it is shown."""
        return self._notice if time.perf_counter() - self._told < TOLD_FOR * (1 + len(self._notice) / 40) else ""

    def _say(self, text: str) -> None:
        self._notice, self._told, self._read = text, time.perf_counter(), 0.0

    @property
    def lines(self) -> list[str]:
        """Time, speed, simulation settings and energies, as text."""
        source = self.source
        pictures = "1 picture" if round(self._fps) == 1 else f"{self._fps:.0f} pictures"
        state = "paused" if self.paused else f"{self._ratio:.2g} of real time, {pictures} a second"
        lines = [f"{source.time:.2f} s, {state}", source.says()]
        if self.readings:
            last = self.readings[-1]
            total = last.kinetic + last.elastic + last.potential
            lines.append(f"energy {total:.3g} J: kinetic {last.kinetic:.3g}, elastic {last.elastic:.3g}")
            lines.append(f"largest strain {last.strain:.2g}")
        return lines

    def keys(self) -> str:
        """Return the list of keys as text."""
        return listed(list(self.scenes))
