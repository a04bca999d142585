"""Picking: where the mouse takes hold of a body, and how firmly."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import checks
from ..bodies import AXES, System, in_space, pieces

FREQUENCY = 25.0
"""√(k / m) of a hand's springs [rad/s], m the mass of the whole piece: the piece follows within 0.1 s."""
MOST_OF_SPRINGS = 0.5
"""Largest spring constant of a hand on a particle, over the sum of those of the particle's springs."""
MOST_WEIGHTS = 50.0
"""Largest pull, over the weight of the piece."""
SPREAD, MOST_HELD = 2.0, 32
"""How far around the point a hand holds, in mean lengths of springs; and the most particles that it holds."""


class Picking(NamedTuple):
    """What a hand holds of a body: arrays over the held particles, the nearest to the point first."""

    particles: NDArray[np.int64]
    offset: NDArray[np.float64]
    """From the point that was taken to each [m], shape [held_count, d]."""
    stiffness: NDArray[np.float64]
    """[N/m]"""
    damping: NDArray[np.float64]
    """[N s/m]: critical for the piece as a whole."""
    reach: float
    """The furthest that the point may be pulled from where it is [m]."""

    @classmethod
    def of(cls, system: System, position: NDArray, point: NDArray, gravity: float = 9.82) -> "Picking | None":
        """Return the grip at a point [m], shape [3], or None if nothing free is near.

        `position` is of all particles [m], shape [particle_count, d]; `gravity` is the acceleration of weights
        [m/s²].
        """
        distance = np.linalg.norm(in_space(position, np.float64) - point, axis=1)
        free = np.isfinite(system.mass)
        distance[~free] = np.inf
        nearest = int(np.argmin(distance))
        if not np.isfinite(distance[nearest]):
            return None
        piece_of = pieces(system.particle_count, system.connections)
        mine = (piece_of == piece_of[nearest]) & free
        mass = float(system.mass[mine].sum())
        if system.connection_count:
            spacing = float(np.mean(system.rest_length))
        else:
            spacing = float(np.ptp(position, axis=0).max())
        near = np.flatnonzero(mine & (distance <= max(SPREAD * spacing, 1.01 * distance[nearest])))
        near = near[np.argsort(distance[near], kind="stable")][:MOST_HELD]
        shares = np.exp(-2.0 * (distance[near] / max(distance[near].max(), 1e-30)) ** 2)
        shares /= shares.sum()
        stiffness = mass * FREQUENCY**2 * shares
        springs = np.bincount(system.connections.reshape(-1), np.repeat(system.stiffness, 2), len(position))
        stiffness = np.minimum(
            stiffness, np.maximum(MOST_OF_SPRINGS * springs[near], system.mass[near] * FREQUENCY**2)
        )
        damping = 2.0 * np.sqrt(mass * stiffness.sum()) * shares
        most = 2.0 * stiffness / FREQUENCY  # no stiffer than springs of this frequency would be at the same step
        offset = position[near].astype(np.float64) - _in_plane(point, system.dim)
        reach = MOST_WEIGHTS * mass * max(gravity, 1.0) / float(stiffness.sum())
        return cls(near, offset, stiffness, np.minimum(damping, most), reach)

    def pulled(self, position: NDArray, target: NDArray) -> NDArray[np.float64]:
        """Return where to each particle is pulled [m], shape [held_count, d], with all particles at `position`.

        The point that was taken is pulled to `target` [m], shape [3].
        """
        here = self.point(position)
        way = _in_plane(target, position.shape[1]) - here
        length = float(np.linalg.norm(way))
        return here + way * min(1.0, self.reach / max(length, 1e-30)) + self.offset

    def point(self, position: NDArray) -> NDArray[np.float64]:
        """Return where the point that was taken is now [m], shape [d]."""
        return (position[self.particles].astype(np.float64) - self.offset).mean(axis=0)


class Pull(NamedTuple):
    """A hand, and where it pulls what it holds."""

    grip: Picking | None = None
    holder: Any = None
    """Whose it is: only they can end the drag."""
    target: NDArray[np.float64] = np.zeros(3)
    """Where to [m]."""
    last: Sequence[int] = ()
    """The particles that it held last."""

    def arrow(self, position: NDArray) -> NDArray[np.float64] | None:
        """Return from where to where it pulls [m], shape [2, 3]; None if it holds nothing."""
        if self.grip is None:
            return None
        ends = np.array([self.target, self.target])
        ends[0, list(AXES[position.shape[1]])] = self.grip.point(position)
        return ends


def _in_plane(point: NDArray, dim: int) -> NDArray[np.float64]:
    """Return the coordinates of a point in space that a body of fewer dimensions has."""
    return np.asarray(point, dtype=np.float64)[list(AXES[dim])]


def hit(
    origin: ArrayLike, direction: ArrayLike, points: NDArray, triangles: NDArray
) -> NDArray[np.float64] | None:
    """Return where a ray first meets triangles; None where it meets none.

    All arrays are of shape [3] or [any, 3].
    """
    origin, direction = checks.vector("origin", origin, 3), checks.vector("direction", direction, 3)
    a, b, c = (points[triangles[:, k]].astype(np.float64) for k in range(3))
    # The point is at origin + distance direction = a + u (b - a) + v (c - a).
    sides = np.stack([np.broadcast_to(-direction, a.shape), b - a, c - a], axis=2)
    crossed = np.linalg.det(sides) != 0  # others are seen edge on
    distance, u, v = np.linalg.solve(sides[crossed], (origin - a[crossed])[..., None])[..., 0].T
    distances = distance[(u >= 0) & (v >= 0) & (u + v <= 1) & (distance > 0)]
    return origin + distances.min() * direction if len(distances) else None
