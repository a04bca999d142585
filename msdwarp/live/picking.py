"""Picking: the particles that the mouse holds, and the springs that hold them."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import checks
from ..bodies import AXES, System, in_space, pieces

FREQUENCY = 25.0
"""√(k / m) of the mouse's springs [rad/s], with the mass m of the whole piece: it follows within 0.1 s."""
MOST_OF_SPRINGS = 0.5
"""Largest stiffness of a mouse spring on a particle, divided by the sum of stiffnesses at the particle."""
MOST_WEIGHTS = 50.0
"""Largest pull, divided by the weight of the piece."""
SPREAD, MOST_HELD = 2.0, 32
"""Radius of the held particles around the held point, in mean spring lengths; maximal number of particles."""


class Picking(NamedTuple):
    """The particles held by a drag of the mouse, nearest to the picked point first, and the springs on them."""

    particles: NDArray[np.int64]
    offset: NDArray[np.float64]  # from the picked point to each particle [m], shape [held_count, d]
    stiffness: NDArray[np.float64]  # [N/m]
    damping: NDArray[np.float64]  # together critical for the piece as a whole [N s/m]
    reach: float  # largest allowed pull of the point from its position [m]

    @classmethod
    def of(cls, system: System, position: NDArray, point: NDArray, gravity: float = 9.82) -> "Picking | None":
        """Return the grip at a point [m], shape [3], on particles near it; None if all particles are pinned.

        `position` has all particles [m], shape [particle_count, d]; `gravity` is an acceleration [m/s²].
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
        weights = np.exp(-2.0 * (distance[near] / max(distance[near].max(), 1e-30)) ** 2)
        weights /= weights.sum()
        stiffness = mass * FREQUENCY**2 * weights
        springs = np.bincount(system.connections.reshape(-1), np.repeat(system.stiffness, 2), len(position))
        stiffness = np.minimum(
            stiffness, np.maximum(MOST_OF_SPRINGS * springs[near], system.mass[near] * FREQUENCY**2)
        )
        damping = 2.0 * np.sqrt(mass * stiffness.sum()) * weights
        most = 2.0 * stiffness / FREQUENCY  # damping of springs at FREQUENCY, so that the step stays the same
        offset = position[near].astype(np.float64) - _in_plane(point, system.dim)
        reach = MOST_WEIGHTS * mass * max(gravity, 1.0) / float(stiffness.sum())
        return cls(near, offset, stiffness, np.minimum(damping, most), reach)

    def pulled(self, position: NDArray, target: NDArray) -> NDArray[np.float64]:
        """Return particles' targets [m], shape [held_count, d], for a target of the picked point, shape [3]."""
        here = self.point(position)
        way = _in_plane(target, position.shape[1]) - here
        length = float(np.linalg.norm(way))
        return here + way * min(1.0, self.reach / max(length, 1e-30)) + self.offset

    def point(self, position: NDArray) -> NDArray[np.float64]:
        """Return the picked point's current position [m], shape [d]."""
        return (position[self.particles].astype(np.float64) - self.offset).mean(axis=0)


class Pull(NamedTuple):
    """A drag of the mouse: its `Picking`, owner (the only one who can end it), target [m], particles last held."""

    grip: Picking | None = None
    holder: Any = None
    target: NDArray[np.float64] = np.zeros(3)
    last: Sequence[int] = ()

    def arrow(self, position: NDArray) -> NDArray[np.float64] | None:
        """Return the held point and its target [m], shape [2, 3]; None if nothing is held."""
        if self.grip is None:
            return None
        ends = np.array([self.target, self.target])
        ends[0, list(AXES[position.shape[1]])] = self.grip.point(position)
        return ends


def _in_plane(point: NDArray, dim: int) -> NDArray[np.float64]:
    """Return the coordinates of a point in space that a body in `dim` dimensions has."""
    return np.asarray(point, dtype=np.float64)[list(AXES[dim])]


def hit(
    origin: ArrayLike, direction: ArrayLike, points: NDArray, triangles: NDArray
) -> NDArray[np.float64] | None:
    """Return the first point where a ray meets triangles, shape [any, 3] like `points`; None if it misses all."""
    origin, direction = checks.vector("origin", origin, 3), checks.vector("direction", direction, 3)
    a, b, c = (points[triangles[:, k]].astype(np.float64) for k in range(3))
    # The point is origin + distance direction = a + u (b - a) + v (c - a).
    sides = np.stack([np.broadcast_to(-direction, a.shape), b - a, c - a], axis=2)
    crossed = np.linalg.det(sides) != 0  # triangles seen edge-on are skipped
    distance, u, v = np.linalg.solve(sides[crossed], (origin - a[crossed])[..., None])[..., 0].T
    distances = distance[(u >= 0) & (v >= 0) & (u + v <= 1) & (distance > 0)]
    return origin + distances.min() * direction if len(distances) else None
