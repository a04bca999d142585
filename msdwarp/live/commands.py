"""Commands: what people can ask of a view."""

from abc import abstractmethod
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from .. import checks
from ..simulation import SimulationDiverged
from .handling import Handling
from .picking import Picking, Pull, hit, place
from .recording import Filming, Recording, drawn
from .shown import COLOURS, Shown
from .sources import Reading, Running, Source

SLOWEST, FASTEST = 1 / 64, 64.0
"""Bounds of the speed of playing, over real time."""
SENDS = ("auto", "triangles", "images")
"""What a page can be sent."""


def said_of(error: BaseException) -> str:
    """Return what an error says, with its kind where it does not say what was wrong with what was asked for."""
    explains = isinstance(error, ValueError | OSError | SimulationDiverged)
    return str(error) if explains and str(error) else f"{type(error).__name__}: {error}"


class Commands:
    """What people can ask of a view. Each is a method whose name begins with an underscore; see `COMMANDS`."""

    source: Source
    scenes: dict[str, Callable[[], Source]]
    paused: bool
    speed: float
    helps: bool
    shown: Shown
    hand: Pull
    readings: deque[Reading]
    recording: Recording | None
    renderer: str
    sends: str
    _kept: Path | None
    _filming: Filming | None
    _is_slow: bool
    _rebuild: Callable[..., Source] | None
    _is_shown: bool
    _read: float

    @abstractmethod
    def close(self) -> None:
        """End."""

    @abstractmethod
    def _begin(self, source: Source) -> None:
        """Show another source from its start."""

    @property
    @abstractmethod
    def images(self) -> bool:
        """Whether pages are sent images."""

    @abstractmethod
    def _stage(self) -> None:
        """Have screens show another drawing."""

    @abstractmethod
    def _draw(self, colour: str, *, wires: bool) -> None:
        """Draw what is shown in other colours, or as connections."""

    @abstractmethod
    def _start_clock(self) -> None:
        """Count the frames that are due from now on."""

    @abstractmethod
    def _say(self, text: str) -> None:
        """Show a text for a while."""

    def _failed(self, error: BaseException) -> None:
        """Pause: a frame could not be simulated."""
        if not isinstance(error, SimulationDiverged):
            with suppress(Exception):  # it may be what failed
                self._end_recording()
        self._pause(True)
        self._say(f"{said_of(error)} — press r to restart")

    def _pause(self, value: bool | None = None) -> None:
        self.paused = not self.paused if value is None else value
        self._start_clock()
        self._say("paused" if self.paused else "running")

    def _step(self) -> None:
        if not self.paused:
            self._pause(True)
        self._lead_hand()
        self.source.advance()
        self._is_shown = False
        self._say("one frame")

    def _pace(self, by: float = 1.0, value: float | None = None) -> None:
        speed = self.speed * by if value is None else checks.positive("speed", value)
        self.speed = min(max(speed, SLOWEST), FASTEST)
        self._start_clock()
        self._say(f"{self.speed:g} times real time")

    def _reset(self) -> None:
        ended = self._end_recording()
        self.source.reset()
        self.readings.clear()
        self.hand = Pull()
        self._start_clock()
        self._redraw()
        self._say(f"restarted{ended}")

    def _scene(self, number: int) -> None:
        names = list(self.scenes)
        if not 1 <= number <= len(names):
            raise ValueError(f"there is no scene {number}; there are {len(names)} scenes")
        name = names[number - 1]
        ended = self._change_to(self.scenes[name]())
        self._say(f"{name}{ended}")

    def _parameters(self, **parameters: Any) -> None:
        if self._rebuild is None:
            raise ValueError("this scene was not built by a function: it has no parameters")
        ended = self._change_to(self._rebuild(**parameters))
        self._say(", ".join(f"{name} = {value}" for name, value in parameters.items()) + ended)

    def _change_to(self, other: Source) -> str:
        """Show another source, or if that fails the one before from where it is; return what to say besides."""
        before, hand = self.source, self.hand
        try:
            self._begin(other)
            self._stage()
        except Exception:
            self._begin(before)
            self.hand = hand
            self._stage()
            raise
        return self._end_recording()

    def _done(self, deed: str, **values: Any) -> None:
        """Do something to the simulation by hand."""
        self._handling("changed").do(deed, **values)

    def _handling(self, done: str) -> Handling:
        """Return what can be handled; raise ValueError that says what cannot be done to a recording."""
        if self.source.handling is None:
            raise ValueError(f"this is a recording: it cannot be {done}")
        return self.source.handling

    def _scale(self, name: str, by: float | None = None, factor: float | None = None) -> None:
        handling = self.source.handling
        if handling is not None and factor is None:
            factor = handling.factors[name] * (by or 1.0)
        self._done("scale", name=name, factor=factor)
        said = name.replace("_", " ")
        self._say(f"{said} {factor:.3g} times; {self.source.says()}")

    def _freeze(self) -> None:
        self._done("freeze")
        self._say("rest lengths set to the current lengths")

    def _gravity(self, value: Sequence[float]) -> None:
        self._done("gravity", value=list(value))
        self._say(f"gravity {', '.join(f'{one:g}' for one in value)} m/s²")

    def _wind(self, velocity: Sequence[float]) -> None:
        self._done("wind", velocity=list(velocity))
        self._say(f"wind {', '.join(f'{one:g}' for one in velocity)} m/s")

    def _contact(self, side: str, name: str, value: float) -> None:
        self._done("contact", side=side, name=name, value=value)
        self._say(f"{name} of {side} {value:g}; {self.source.says()}")

    def _wires(self) -> None:
        self._draw(self.shown.colour, wires=not self.shown.wires)
        self._stage()
        self._say("connections" if self.shown.wires else "surface")

    def _colour(self, value: str | None = None) -> None:
        after = COLOURS[(COLOURS.index(self.shown.colour) + 1) % len(COLOURS)] if value is None else value
        self._draw(after, wires=False)
        self._stage()
        self._say(f"colours: {after}")

    def _send(self, value: str) -> None:
        """Have pages be sent triangles, or images that are drawn here, or what is faster."""
        checks.one_of("value", value, SENDS)
        self.sends = value
        self._redraw()
        self._say("sending " + ("images" if self.images else "triangles") + " to pages")

    def _slow(self) -> None:
        """Have pages be sent images where a link does not keep up with triangles."""
        if self.sends == "auto" and not self.images:
            self._is_slow = True
            self._redraw()
            self._say("the link is slow: sending images instead of triangles")

    def _redraw(self) -> None:
        self._draw(self.shown.colour, wires=self.shown.wires)
        self._stage()

    def _help(self) -> None:
        self.helps = not self.helps
        self._read = 0.0

    def _seek(self, k: int) -> None:
        self.source.seek(k)
        self._start_clock()
        self._is_shown = False

    def _quit(self) -> None:
        self.close()

    # The hand.

    def _grab(self, holder: Any, point: ArrayLike) -> None:
        """Take hold of the body at a point of its surface [m]; of several holders the last one holds."""
        handling = self._handling("pulled")
        at = place("point", point)
        gravity = float(np.linalg.norm(handling.simulation.model.gravity))
        grip = Picking.of(handling.simulation.system, self.source.frame().position, at, gravity)
        if grip is None:
            raise ValueError("nothing can be pulled here: it is pinned")
        self.hand = Pull(grip, holder, at)

    def _pick(self, holder: Any, origin: Sequence[float], direction: Sequence[float]) -> None:
        """Take hold of the body where a ray first meets what is drawn of it."""
        drawing = self.shown.drawing
        triangles = np.concatenate([one.triangles for one in drawing.body])
        ray = place("origin", origin), place("direction", direction)
        point = hit(*ray, drawing.points.numpy(), triangles)
        if point is not None:
            self._grab(holder, point)

    def _drag(self, holder: Any, point: ArrayLike | None = None, ray: Any = None) -> None:
        """Pull what is held towards a point [m], or to a ray: (origin, direction, normal of the screen)."""
        if self.hand.grip is None or self.hand.holder != holder:
            return
        if ray is not None:  # in the plane, parallel to the screen, in which it was taken
            origin, direction, normal = (place("ray", one) for one in ray)
            way = float(direction @ normal)
            if way <= 0:
                return
            point = origin + direction * float((self.hand.target - origin) @ normal) / way
        self.hand = self.hand._replace(target=place("point", () if point is None else point))

    def _let_go(self, holder: Any = None) -> None:
        """Let go, if it is this hand that holds."""
        if self.hand.grip is not None and (holder is None or holder == self.hand.holder):
            self.hand = Pull(last=self.hand.grip.particles.tolist())
            self._done("hold", particles=[], to=[], stiffness=[], damping=[])

    def _pin(self) -> None:
        self._let_go()
        if not self.hand.last:
            raise ValueError("nothing was pulled yet: drag the body, then press p to pin it")
        self._done("pin", particles=sorted(self.hand.last))
        self._say(f"pinned {len(self.hand.last)} particles")

    def _lead_hand(self) -> None:
        """Have the hand's springs lead to where the hand is, before a frame."""
        if self.hand.grip is None:
            return
        grip = self.hand.grip
        to = grip.pulled(self.source.frame().position, self.hand.target)
        numbers = {"stiffness": grip.stiffness.tolist(), "damping": grip.damping.tolist()}
        self._done("hold", particles=grip.particles.tolist(), to=to.tolist(), **numbers)

    def _record(self, folder: Any = None) -> None:
        """Begin to keep frames in a file, or end."""
        if self.recording is not None:
            self._say(self._end_recording().removeprefix("; "))
            return
        if not isinstance(self.source, Running):
            raise ValueError("this is already a recording")
        self.recording = Recording(self.source, folder)
        self._say(f"recording to {self.recording.path}")

    def _end_recording(self) -> str:
        """End to keep frames, if any are kept; return what to say, behind something else."""
        if self.recording is None:
            return ""
        ended, self.recording = self.recording, None
        said = ended.close()
        self._kept = ended.folder
        return f"; {said}"

    def _film(self) -> None:
        """Draw a film of the frames that were kept last, in a process of its own."""
        if self.recording is not None:
            self._record()
        if self._kept is None:
            raise ValueError("no frames were kept yet")
        if self._filming is not None:
            raise ValueError(f"a film is already being drawn: {self._filming.folder}")
        self._filming = Filming(self._kept, self.renderer)
        self._say(f"drawing a film in {self._kept}")

    def _screenshot(self, path: Any = None) -> None:
        """Draw the present frame as pictures are drawn, into a PNG file."""
        self._say(f"wrote {drawn(self.source, self.shown.scene, path, self.renderer)}")


COMMANDS: dict[str, Callable[..., None]] = {
    name: getattr(Commands, f"_{name}")
    for name in (
        *("pause", "step", "pace", "reset", "scene", "parameters", "scale", "freeze", "gravity", "wind"),
        *(
            "contact",
            "wires",
            "colour",
            "send",
            "slow",
            "help",
            "seek",
            "quit",
            "grab",
            "pick",
            "drag",
            "let_go",
            "pin",
            "record",
        ),
        *("film", "screenshot"),
    )
}
"""What can be asked of a view, by name."""
