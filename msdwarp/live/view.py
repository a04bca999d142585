"""View: an interactive view of a running simulation or a trajectory."""

import threading
import time
from collections.abc import Callable
from contextlib import suppress
from typing import Any

from .. import checks
from ..simulation import SimulationDiverged
from .commands import COMMANDS, Commands
from .keys import KEYS, SCENES
from .state import Screen

BUDGET = 1 / 20
"""Longest time for simulating frames between commands [s]."""
READ_EVERY = 0.2
"""Time between readings of energies [s]."""
AVERAGED = 10
"""Number of pictures over which speeds are averaged."""
BEHIND = 0.25
"""If simulated time is behind by more than this [s], the view does not catch up."""


class View(Commands):
    """An interactive view of a simulation or a trajectory.

    A loop executes commands, simulates the frames that are due, and shows the last one. It starts when a screen is
    watched, or after the command "pause". Other threads may call only `post`, `press` and `close`.

    Parameters
    ----------
    source
        The first source to show.
    screens
        Windows and pages that show the view.
    scenes
        Scenes for the keys 1 to 9, by name: functions that return a source.
    rebuild
        A function that builds the first scene with other parameters and returns a source.
    paused
        Whether the view starts paused.
    renderer
        Renderer of snapshots and films: "auto", "raster", "raycast" or "opengl".
    zoom
        Zoom factor of the first camera.

    Attributes
    ----------
    source, shown
        The current source and the source's drawing.
    paused, speed
        Whether the view is paused; the playback speed (1 is real time).
    sends
        What pages receive: "auto", "triangles" or "images".
    images
        Whether pages receive images instead of triangles.
    notice
        The message about the last command, while it is displayed; else empty.
    readings
        Energies of the last few seconds.
    """

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
                open_yet = [screen.poll() for screen in opened]  # polls every screen
                if not all(open_yet):
                    break
                began = time.perf_counter()
                self._execute_commands()
                moved = not self._waits and self._advance()
                watched = any(screen.watched for screen in opened)
                if watched and self._waits:
                    self._begin_to_run()
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
        """End the loop, and wait for its thread, if any; any thread may call this, repeatedly."""
        self._ends.set()
        if self._thread is not None and self._thread is not threading.current_thread():
            self._thread.join()

    def post(self, command: str, **values: Any) -> None:
        """Request a command (see `msdwarp.live.commands.COMMANDS`) with its values; any thread may call this."""
        self._requests.put((command, values))

    @property
    def waiting(self) -> int:
        """Number of requested commands that are not executed yet."""
        return self._requests.qsize()

    def press(self, key: str, *, shift: bool = False) -> bool:
        """Request the action of a key, from any thread; return whether the key has an action."""
        if key in SCENES and not shift:
            self.post("scene", number=int(key))
            return True
        pressed = [one for one in KEYS if (one.name, one.shift) == (key, shift)]
        for one in pressed:
            self.post(one.command, **one.values)
        return bool(pressed)

    def _execute_commands(self) -> None:
        """Execute the commands requested so far; later ones wait until frames have been simulated."""
        for _ in range(self.waiting):
            command, values = self._requests.get_nowait()
            try:
                checks.one_of("command", command, COMMANDS)
                COMMANDS[command](self, **values)
            except SimulationDiverged as error:
                self._failed(error)
            except _errors() as error:  # also a script's: no request may end the view
                self._notify(checks.message(error, SimulationDiverged))

    def _advance(self) -> bool:
        """Simulate the frames that are due; return whether there were any."""
        if self.paused:
            return False
        now = time.perf_counter()
        due, taken = self._frames_due(now), 0
        try:
            while taken < due and (not taken or time.perf_counter() - now < BUDGET):
                self._move_hand()
                if not self.source.advance():
                    self._pause(True)
                    break
                taken += 1
        except _errors() as error:  # such as a full disk, or of a function of time
            self._failed(error)
        self._frames_taken += taken
        if self._frames_due(time.perf_counter()) > BEHIND * self.source.fps * self.speed + 1:
            self._start_clock()
        return taken > 0

    def _failed(self, error: BaseException) -> None:
        """Pause because a frame could not be simulated."""
        if not isinstance(error, SimulationDiverged):
            with suppress(Exception):  # the recording itself may have failed
                self._end_recording()
        self._pause(True)
        self._notify(f"{checks.message(error, SimulationDiverged)} — press r to restart")

    def _frames_due(self, now: float) -> int:
        return int((now - self._clock) * self.source.fps * self.speed) - self._frames_taken

    def _show(self) -> None:
        frame, now = self.source.frame(), time.perf_counter()
        broken_at, before = self.source.broken_at(), self.shown
        if broken_at is not None and (torn := before.torn(broken_at, frame.time)) is not before:
            self.shown = torn
            self._stage()
        self.shown.follow(frame)
        self.following.follow(frame, held=self.hand.grip is not None)
        for screen in self.screens:
            screen.show()
        if self._is_shown and now > self._last_shown:
            self._averaged = min(self._averaged + 1, AVERAGED)
            self._fps += (1 / (now - self._last_shown) - self._fps) / self._averaged
            self._ratio += (
                (frame.time - self._last_time) / (now - self._last_shown) - self._ratio
            ) / self._averaged
        self._last_shown, self._last_time, self._is_shown = now, frame.time, True

    def _tell(self, watched: bool) -> None:
        """Read energies and update texts on screens a few times per second."""
        now = time.perf_counter()
        if not watched or now - self._last_reading < READ_EVERY:
            return
        self._last_reading = now
        if self._filming is not None and (message := self._filming.ended()) is not None:
            self._filming = None
            self._notify(message)
        if not self.paused and (reading := self.source.reading()) is not None:
            self.readings.append(reading)
        for screen in self.screens:
            screen.tell()


def _errors() -> tuple[type[BaseException], ...]:
    """Return what a user's function may raise without ending a view; only the main thread gets a real Ctrl-C."""
    in_main = threading.current_thread() is threading.main_thread()
    return (Exception, SystemExit) if in_main else (BaseException,)
