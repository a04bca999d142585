"""Moments of a run: what its pictures show at frames, and between them."""

from collections.abc import Callable, Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from ...files import FrameArray, Trajectory

Moment = tuple[NDArray, float, NDArray | None, NDArray | None]
"""Positions [m], the time [s], the particles' values and the forces on them, as `Renderer.image` takes them."""


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
        share, one = moment - k, self._frame(k)
        several = self._values, self._forces
        if share < 1e-9 or k == self._last:
            return one.position, float(one.time), *(None if each is None else each(k) for each in several)
        other, step = self._frame(k + 1), float(self._times[k + 1] - self._times[k])
        x, y, v, w = (
            each.astype(np.float64) for each in (one.position, other.position, one.velocity, other.velocity)
        )
        ends = (1 + 2 * share) * (1 - share) ** 2 * x + share**2 * (3 - 2 * share) * y
        slopes = share * (1 - share) ** 2 * v - share**2 * (1 - share) * w
        between = (None if each is None else (1 - share) * each(k) + share * each(k + 1) for each in several)
        return (ends + step * slopes).astype(one.position.dtype), float(one.time) + share * step, *between


def exposed(moment: float, open_for: float, samples: int, span: Sequence[int]) -> NDArray[np.float64]:
    """Return moments spread evenly over an exposure around a moment, within a span of frames (first ... last)."""
    around = moment + open_for * ((np.arange(samples) + 0.5) / samples - 0.5)
    return np.clip(around, span[0], span[-1])
