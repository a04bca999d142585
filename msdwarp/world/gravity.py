"""Gravity: a number, a vector, or a function of time, which is treated as a load."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import checks
from .loads import Force, named, values_at

Gravity = Any
"""Acceleration of free fall [m/s²]: a number, downwards along the last coordinate; a vector of shape [d]; or a
function of time [s] that returns one of these."""


@dataclass(frozen=True, eq=False, repr=False)
class Falling(Force):
    """The weight m g(t) of particles under time-dependent gravity; `force` is g [m/s²].

    This gravity has no potential energy, but does external work on a system.
    """

    def at(self, times: NDArray[np.float64], dim: int, name: str = "gravity") -> NDArray[np.float64]:
        """Return g at these times [m/s²], shape [time_count, d]."""
        return gravity_at(self.force, times, dim, name)


def gravity_at(
    gravity: Gravity, times: NDArray[np.float64], dim: int, name: str = "gravity"
) -> NDArray[np.float64]:
    """Return gravity at these times [m/s²], shape [time_count, d]; raise ValueError if gravity is invalid."""
    if not callable(gravity):
        return np.broadcast_to(checks.gravity(name, gravity, dim), (len(times), dim))
    try:
        first: Any = gravity(float(times[0]))
        size = np.ndim(first) == 0
    except Exception as error:
        raise ValueError(f"{name} has no value at {times[0]:g} s: {checks.message(error)}") from error
    values = values_at(name, gravity, times, 1 if size else dim)
    if not size:
        return values
    downwards = np.zeros((len(times), dim))
    downwards[:, -1] = -values[:, 0]
    return downwards


def with_potential(gravity: Gravity) -> Any:
    """Return the part of gravity that has a potential: all if it is constant, 0 if a function of time."""
    return 0.0 if callable(gravity) else gravity


def gravity_in_words(gravity: Gravity) -> str:
    """Return gravity as text with its unit; for a function its name."""
    if callable(gravity):
        return f"{named(gravity)} of time"
    values = np.asarray(gravity, dtype=float)
    along = f"{values:.4g}" if values.ndim == 0 else f"({', '.join(f'{one:.4g}' for one in values)})"
    return f"{along} m/s²"
