"""Shown: the drawing of a view, the values of its colors, and how its cameras follow the body."""

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from .. import checks
from ..bodies import Frame, broken_before, in_space, lengths
from ..pictures import ColorScale, Drawing
from ..world import Scene
from .sources import Source

COLORS = ("look", "speed", "strain")
ENERGIES = {"kinetic": "#e4633f", "elastic": "#2f6f9f", "potential": "#5a9e6f", "sum": "#333a40"}
"""Colors of energy curves, as in `studies.plots`."""
LEAST_FULL = 0.05
"""Least end of a color scale, as a fraction of the largest value so far."""
LABELS = {"speed": "speed [m/s]", "strain": "mean strain of a particle's connections"}

EASE, SAMPLE = 0.4, 1000
"""Time constant with which cameras follow the body, in simulated time [s]; number of particles that locate it."""


class Shown:
    """The `drawing` of a scene in one of COLORS; with `wires` the springs by strain instead of the surface."""

    def __init__(self, scene: Scene, color: str = COLORS[0], *, wires: bool = False, device: str = "cpu") -> None:
        checks.one_of("color", color, COLORS)
        self.scene, self.color, self.wires = scene, color, wires
        labelled = color in LABELS and not wires
        coloring = "strain" if wires else ColorScale(LABELS[color], 1.0) if labelled else "texture"
        self.drawing = Drawing(scene, coloring, device)
        self.frame: Frame | None = None
        self._broken = 0
        self._largest = 0.0

    def torn(self, broken_at: NDArray, time: float) -> "Shown":
        """Return a `Shown` with the times at which springs break [s], after which the drawing omits them.

        Return `self` if no further springs have broken before `time` [s] since the last call.
        """
        count = int((broken_at <= time).sum())
        if count == self._broken:
            return self
        scene = replace(self.scene, system=self.scene.system.replace(broken_at=broken_at))
        other = Shown(scene, self.color, wires=self.wires, device=self.drawing.device)
        other._broken = count
        return other

    def follow(self, frame: Frame) -> None:
        """Show a frame."""
        self.frame = frame
        if not self.drawing.by_value:
            self.drawing.follow(frame.position, frame.time)
            return
        values, scale = self._values(frame), self.drawing.scale
        assert scale is not None
        largest = float(np.quantile(values, 0.99))
        self._largest = max(self._largest, largest)
        if largest > scale.full or largest < 0.2 * scale.full:
            # A scale relative to the largest value so far does not show noise of a body at rest.
            full = max(1.25 * largest, LEAST_FULL * self._largest)
            self.drawing.scale = scale._replace(full=full or 1.0)
        self.drawing.follow(frame.position, frame.time, values)

    def _values(self, frame: Frame) -> NDArray[np.float64]:
        """Return the value of each particle, shape [particle_count]."""
        if self.color == "speed":
            return np.linalg.norm(frame.velocity.astype(np.float64), axis=1)
        system = self.scene.system
        whole, count = ~broken_before(system.broken_at, frame.time), system.particle_count
        pairs = system.connections[whole]
        ends, strain = pairs.reshape(-1), lengths(frame.position, pairs) / system.rest_length[whole] - 1.0
        total = np.bincount(ends, np.repeat(np.abs(strain), 2), count)
        return total / np.maximum(np.bincount(ends, minlength=count), 1)


class Following:
    """How far a view's cameras have followed the body: `shift` [m], shape [3].

    Cameras follow the group `Look.follow`. Without group and target, they follow a body of unknown path when it
    leaves their initial view.
    """

    def __init__(self, source: Source) -> None:
        look, system, frame = source.scene.look, source.scene.system, source.frame()
        group = slice(None) if look.follow is None else system.groups[look.follow]
        members = np.arange(system.particle_count)[group]
        self._moves = look.follow is not None or (source.handling is not None and look.target is None)
        self._members = members[:: max(1, len(members) // SAMPLE)]
        self._time, self.shift = frame.time, np.zeros(3)
        self._low = self._high = middle = self._middle(frame)
        if self._moves and look.follow is None:
            seen, body = (in_space(one, np.float64) for one in (source.seen(), frame.position))
            slack = np.ptp(body, axis=0) / 4  # less than half a body, so that a squashed body moves no camera
            self._low = np.minimum(seen.min(axis=0) + slack, middle)
            self._high = np.maximum(seen.max(axis=0) - slack, middle)

    def follow(self, frame: Frame, *, held: bool) -> None:
        """Follow the body: smoothly to a later frame, at once to an earlier one, not while the mouse holds it."""
        passed, self._time = frame.time - self._time, frame.time
        before = np.zeros(3) if passed < 0 else self.shift
        middle = self._middle(frame) - before
        way = middle - np.clip(middle, self._low, self._high)
        if self._moves and not held and np.isfinite(way).all():
            self.shift = before + way * (1.0 if passed < 0 else 1.0 - math.exp(-passed / EASE))

    def _middle(self, frame: Frame) -> NDArray[np.float64]:
        """Return the body's position [m], shape [3]: a median, which stray pieces hardly change."""
        return np.median(in_space(frame.position[self._members], np.float64), axis=0)
