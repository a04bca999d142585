"""Two trajectories compared."""

from typing import NamedTuple

import numpy as np

from ..files import Trajectory


class Comparison(NamedTuple):
    """How far two trajectories differ."""

    frame_count: int
    """Frames compared."""
    first: int | None
    """The first frame that differs in any bit of a position or velocity; None if none does."""
    largest: float
    """The largest distance between where a particle is in one and in the other [m]."""
    frame: int
    """The frame in which that is."""


def compare(one: Trajectory, other: Trajectory) -> Comparison:
    """Compare as many frames as both have, of the same particles."""
    first, largest, at = None, 0.0, 0
    count = min(len(one), len(other))
    for k in range(count):
        a, b = one.frame(k), other.frame(k)
        same = np.array_equal(a.position, b.position) and np.array_equal(a.velocity, b.velocity)
        if not same:
            first = k if first is None else first
            apart = float(np.linalg.norm(a.position.astype(float) - b.position, axis=1).max())
            largest, at = max((largest, at), (apart, k))
    return Comparison(count, first, largest, at)
