"""Moments of a run: what its pictures show at frames, and between them."""

import math
from collections.abc import Callable, Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from ... import checks
from ...files import FrameArray, Trajectory

Moment = tuple[NDArray, float, NDArray | None, NDArray | None]
"""Positions [m], the time [s], the particles' values and the forces on them, as `Renderer.image` takes them."""


MOST_FPS = 60.0
"""Most pictures per second of a film; faster films skip frames."""


class Moments:
    """What a run shows at frame k, also for fractions.

    Between frames positions follow the cubic with their positions and velocities (Hermite's), which is exact under
    constant acceleration; values and forces change evenly.
    """

    def __init__(
        self, trajectory: Trajectory, values: Callable[[int], NDArray] | None, forces: FrameArray | None
    ) -> None:
        self._last, self._times = len(trajectory) - 1, trajectory.times
        self._frame = lru_cache(maxsize=2)(trajectory.frame)
        self._values = None if values is None else lru_cache(maxsize=2)(values)
        self._forces = None if forces is None else lru_cache(maxsize=2)(lambda k: forces[k])

    def at(self, moment: float) -> Moment:
        """Return what is shown at a number of a frame, or a fraction between two."""
        k = min(int(moment + 1e-9), self._last)
        fraction, one = moment - k, self._frame(k)
        if fraction < 1e-9 or k == self._last:
            return one.position, float(one.time), _at(self._values, k), _at(self._forces, k)
        other, step = self._frame(k + 1), float(self._times[k + 1] - self._times[k])
        x, y, v, w = (
            each.astype(np.float64) for each in (one.position, other.position, one.velocity, other.velocity)
        )
        ends = (1 + 2 * fraction) * (1 - fraction) ** 2 * x + fraction**2 * (3 - 2 * fraction) * y
        slopes = fraction * (1 - fraction) ** 2 * v - fraction**2 * (1 - fraction) * w
        position = (ends + step * slopes).astype(one.position.dtype)
        return (
            position,
            float(one.time) + fraction * step,
            _at(self._values, k, fraction),
            _at(self._forces, k, fraction),
        )


def _at(values: Callable[[int], NDArray] | None, k: int, fraction: float = 0.0) -> NDArray | None:
    """Return values in frame k or, if `fraction` is not 0, that much of the way to the next frame."""
    if values is None:
        return None
    return (1 - fraction) * values(k) + fraction * values(k + 1) if fraction else values(k)


def exposed(moment: float, open_for: float, samples: int, span: Sequence[int]) -> NDArray[np.float64]:
    """Return moments spread evenly over an exposure around a moment, within a span of frames (first ... last)."""
    around = moment + open_for * ((np.arange(samples) + 0.5) / samples - 0.5)
    return np.clip(around, span[0], span[-1])


def frames_shown(
    trajectory: Trajectory, first: int, last: int, every: int, speed: float
) -> tuple[range, Sequence[float], float]:
    """Return (frames to draw, moments of the film as frames and fractions of them, its frames per second)."""
    count = len(trajectory)
    if not count:
        raise ValueError(f"{trajectory.path} has no frames to draw")
    for name, k in (("first", first), ("last", last)):
        if not -count <= k < count:
            raise ValueError(
                f"{name} is {k}; the run has {count} frames, and it must be from {-count} to {count - 1}"
            )
    shown = range(first % count, last % count + 1, checks.count("every", every, 1))
    if not shown:
        raise ValueError(f"last is {last}; it must not be before first, which is {first}")
    usual = trajectory.fps / every
    fps = usual * checks.between("speed", speed, 0.01, 100)
    step = math.ceil(fps / max(usual, MOST_FPS) - 1e-9)
    if step > 1 or fps >= (rate := min(usual, MOST_FPS)) - 1e-9:
        return shown[::step], shown[::step], fps / step
    steps = math.floor((shown[-1] - shown[0]) / (every * fps / rate) + 1e-9)
    return shown, [shown[0] + k * every * fps / rate for k in range(steps + 1)], rate
