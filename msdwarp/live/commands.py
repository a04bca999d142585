"""Commands of a view: what keys, buttons and clients can request."""

import inspect
import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import checks
from ..world import Look
from .picking import Picking, Pull, hit
from .recording import Filming, Recording, save_picture
from .shown import COLORS
from .sources import Running
from .state import ViewState

SLOWEST, FASTEST = 1 / 64, 64.0
"""Bounds of the playback speed, relative to real time."""
SENDS = ("auto", "triangles", "images")
"""What pages can receive: triangles, images, or the faster of both."""


def _numbers(values: Sequence[float]) -> str:
    return ", ".join(f"{one:g}" for one in values)


def camera_flags(eye: NDArray, target: NDArray, field_of_view: float) -> str:
    """Return the flags that set a camera at `eye` looking at `target` [m], for `run`, `render` and `view`.

    A field of view [degrees] that is the default is left out. Raises ValueError if `eye` is the target.
    """
    away, distance = eye - target, float(np.linalg.norm(eye - target))
    if distance == 0:
        raise ValueError("the camera is at its target; it must be away from it")
    azimuth, elevation = math.degrees(math.atan2(away[1], away[0])), math.degrees(math.asin(away[2] / distance))
    digits = 3 - math.floor(math.log10(distance))  # a thousandth of the distance or finer
    at = ",".join(f"{round(one, digits) + 0.0:.12g}" for one in target.tolist())
    where = f"--target {at} --distance {round(distance, digits):.12g}"
    lens = "" if field_of_view == Look().field_of_view else f" --field-of-view {field_of_view:.5g}"
    return f"--azimuth {azimuth:.5g} --elevation {elevation:.5g} {where}{lens}"


class Commands(ViewState):
    """The commands of a view: each method is a command, named without the underscore."""

    def _pause(self, value: bool | None = None) -> None:
        self.paused = not self.paused if value is None else value
        self._begin_to_run()
        self._notify("paused" if self.paused else "running")

    def _step(self) -> None:
        if not self.paused:
            self._pause(True)
        self._move_hand()
        self.source.advance()
        self._is_shown = False
        self._notify("one frame")

    def _pace(self, by: float = 1.0, value: float | None = None) -> None:
        speed = self.speed * by if value is None else checks.positive("speed", value)
        self.speed = min(max(speed, SLOWEST), FASTEST)
        self._start_clock()
        self._notify(f"{self.speed:g} times real time")

    def _reset(self) -> None:
        ended = self._end_recording()
        self.source.reset()
        self.readings.clear()
        self.hand = Pull()
        self._start_clock()
        self._redraw()
        self._notify(f"restarted{ended}")

    def _scene(self, number: int) -> None:
        names = list(self.scenes)
        if not 1 <= number <= len(names):
            raise ValueError(f"there is no scene {number}; there are {len(names)} scenes")
        other = self.scenes[names[number - 1]]()
        self._notify(names[number - 1] + self._change_to(other, other.rebuild))

    def _parameters(self, **parameters: Any) -> None:
        if self.rebuild is None:
            raise ValueError("this scene was not built by a function: it has no parameters")
        ended = self._change_to(self.rebuild(**parameters), self.rebuild)
        self._notify(", ".join(f"{name} = {value}" for name, value in parameters.items()) + ended)

    def _scale(self, name: str, by: float | None = None, factor: float | None = None) -> None:
        handling = self._handling
        if factor is None:
            factor = handling.factors[name] * (by or 1.0)
        handling.do("scale", name=name, factor=factor)
        self._notify(f"{name.replace('_', ' ')} {factor:.3g} times; {self.source.summary()}")

    def _freeze(self) -> None:
        self._handling.do("freeze")
        self._notify("rest lengths set to the current lengths")

    def _gravity(self, value: Sequence[float]) -> None:
        self._handling.do("gravity", value=list(value))
        self._notify(f"gravity {_numbers(value)} m/s²")

    def _wind(self, velocity: Sequence[float]) -> None:
        self._handling.do("wind", velocity=list(velocity))
        self._notify(f"wind {_numbers(velocity)} m/s")

    def _contact(self, side: str, name: str, value: float) -> None:
        self._handling.do("contact", side=side, name=name, value=value)
        self._notify(f"{name} of {side} {value:g}; {self.source.summary()}")

    def _wires(self, value: bool | None = None) -> None:
        self._redraw(wires=not self.shown.wires if value is None else bool(value))
        self._notify("connections" if self.shown.wires else "surface")

    def _color(self, value: str | None = None) -> None:
        after = COLORS[(COLORS.index(self.shown.color) + 1) % len(COLORS)] if value is None else value
        self._redraw(after, wires=False)
        self._notify(f"colors: {after}")

    def _send(self, value: str) -> None:
        """Set what pages receive: triangles, images, or the faster of both."""
        checks.one_of("value", value, SENDS)
        self.sends = value
        self._redraw()
        self._notify("sending " + ("images" if self.images else "triangles") + " to pages")

    def _slow(self) -> None:
        """Switch to images, because a link is too slow for triangles."""
        if self.sends == "auto" and not self.images:
            self._is_slow = True
            self._redraw()
            self._notify("the link is slow: sending images instead of triangles")

    def _help(self) -> None:
        self.helps = not self.helps
        self._last_reading = 0.0

    def _flags(self, eye: ArrayLike, target: ArrayLike) -> None:
        """Print the flags of a camera at `eye` that looks at `target` [m]."""
        lens = self.source.scene.look.field_of_view
        text = camera_flags(np.asarray(eye, dtype=np.float64), np.asarray(target, dtype=np.float64), lens)
        print(text, flush=True)
        self._notify(text)

    def _seek(self, k: int) -> None:
        self.source.seek(k)
        self._start_clock()
        self._is_shown = False

    def _quit(self) -> None:
        self._ends.set()

    # Pulling with the mouse.

    def _grab(self, holder: Any, point: ArrayLike) -> None:
        """Let `holder`, a window or client, hold the body at a surface point [m], instead of any other holder."""
        simulation, at = self._handling.simulation, checks.vector("point", point, 3)
        gravity = float(np.linalg.norm(simulation.model.gravity))
        grip = Picking.of(simulation.system, self.source.frame().position, at, gravity)
        if grip is None:
            raise ValueError("nothing can be pulled here: it is pinned")
        self.hand = Pull(grip, holder, at)

    def _pick(self, holder: Any, origin: Sequence[float], direction: Sequence[float]) -> None:
        """Let `holder` hold the body at the first point where a ray meets the drawing."""
        drawing = self.shown.drawing
        triangles = np.concatenate([one.triangles for one in drawing.body])
        if (point := hit(origin, direction, drawing.points.numpy(), triangles)) is not None:
            self._grab(holder, point)

    def _drag(self, holder: Any, point: ArrayLike = (), ray: Any = None) -> None:
        """Pull the point held by `holder` to a point [m], or to a ray: (origin, direction, screen's normal)."""
        if self.hand.grip is None or self.hand.holder != holder:
            return
        if ray is not None:  # to the ray's point in the plane through the current target, parallel to the screen
            origin, direction, normal = (checks.vector("ray", one, 3) for one in ray)
            way = float(direction @ normal)
            if way <= 0:
                return
            point = origin + direction * float((self.hand.target - origin) @ normal) / way
        self.hand = self.hand._replace(target=checks.vector("point", point, 3))

    def _let_go(self, holder: Any = None) -> None:
        if self.hand.grip is not None and (holder is None or holder == self.hand.holder):
            self.hand = Pull(last=self.hand.grip.particles.tolist())
            self._handling.do("hold", particles=[], to=[], stiffness=[], damping=[])

    def _pin(self) -> None:
        self._let_go()
        if not self.hand.last:
            raise ValueError("nothing was pulled yet: drag the body, then press p to pin it")
        self._handling.do("pin", particles=sorted(self.hand.last))
        self._notify(f"pinned {len(self.hand.last)} particles")

    # Recordings and pictures.

    def _record(self, folder: Any = None) -> None:
        if self.recording is not None:
            self._notify(self._end_recording().removeprefix("; "))
            return
        if not isinstance(self.source, Running):
            raise ValueError("this is already a recording")
        self.recording = Recording(self.source, folder)
        self._notify(f"recording to {self.recording.path}")

    def _film(self) -> None:
        """Draw a film of the last recording in a separate process."""
        if self.recording is not None:
            self._record()
        if self._last_recording is None:
            raise ValueError("no frames were kept yet")
        if self._filming is not None:
            raise ValueError(f"a film is already being drawn: {self._filming.folder}")
        self._filming = Filming(self._last_recording, self.renderer)
        self._notify(f"drawing a film in {self._last_recording}")

    def _screenshot(self, path: Any = None) -> None:
        """Draw the current frame to a PNG file with the renderer of pictures."""
        self._notify(f"wrote {save_picture(self.source, self.shown.scene, path, self.renderer)}")


COMMANDS: dict[str, Callable[..., None]] = {
    name[1:]: method for name, method in vars(Commands).items() if inspect.isfunction(method)
}
"""Functions of the commands that keys, buttons and a page's clients can give, by name."""
