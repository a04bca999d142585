"""Picking: where the mouse takes hold of a body, and how firmly."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import checks
from ..bodies import AXES, System, in_space, pieces

FREQUENCY = 25.0
"""√(k / m) of the springs of a hand [rad/s], m the mass of all that hangs on them: it follows within 0.1 s."""
MOST_OF_SPRINGS = 0.5
"""Largest spring constant of a hand on a particle, over the sum of those of its connections."""
MOST_WEIGHTS = 50.0
"""Largest pull, over the weight of all that hangs on it."""
SPREAD, MOST_HELD = 2.0, 32
"""How far around the point a hand holds, in mean lengths of connections; and the most particles that it does."""


class Picking(NamedTuple):
    """What a hand holds of a body."""

    particles: NDArray[np.int64]
    """Shape [held_count], the nearest to the point first."""
    offset: NDArray[np.float64]
    """From the point that was taken to each [m], shape [held_count, d]."""
    stiffness: NDArray[np.float64]
    """Spring constants [N/m], shape [held_count]."""
    damping: NDArray[np.float64]
    """Damper constants [N s/m]: critical for the piece as a whole, shape [held_count]."""
    reach: float
    """The furthest that the point may be pulled from where it is [m]."""

    @classmethod
    def of(cls, system: System, position: NDArray, point: NDArray, gravity: float = 9.82) -> "Picking | None":
        """Return the grip at a point, or None where nothing free is near.

        Parameters
        ----------
        system
            The body.
        position
            Where its particles are now [m], shape [particle_count, d].
        point
            Where it is taken [m], shape [3].
        gravity
            Acceleration that weights are told by [m/s²].
        """
        away = np.linalg.norm(in_space(position, np.float64) - point, axis=1)
        free = np.isfinite(system.mass)
        away[~free] = np.inf
        nearest = int(np.argmin(away))
        if not np.isfinite(away[nearest]):
            return None
        piece_of = pieces(system.particle_count, system.connections)
        mine = (piece_of == piece_of[nearest]) & free
        mass = float(system.mass[mine].sum())
        near = np.flatnonzero(mine & (away <= max(SPREAD * _spacing(system, position), 1.01 * away[nearest])))
        near = near[np.argsort(away[near], kind="stable")][:MOST_HELD]
        shares = np.exp(-2.0 * (away[near] / max(away[near].max(), 1e-30)) ** 2)
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
        """Return where to each particle is pulled [m], shape [held_count, d].

        Parameters
        ----------
        position
            Where all particles are [m], shape [particle_count, d].
        target
            Where the point that was taken should be [m], shape [3].
        """
        here = self._here(position)
        way = _in_plane(target, position.shape[1]) - here
        far = float(np.linalg.norm(way))
        return here + way * min(1.0, self.reach / max(far, 1e-30)) + self.offset

    def _here(self, position: NDArray) -> NDArray[np.float64]:
        return (position[self.particles].astype(np.float64) - self.offset).mean(axis=0)

    def here(self, position: NDArray) -> NDArray[np.float64]:
        """Return where the point that was taken is now [m], shape [3], with all particles at `position`."""
        return in_space(self._here(position), np.float64)


class Pull(NamedTuple):
    """A hand, and where it pulls what it holds."""

    grip: Picking | None = None
    """What it holds; None for nothing."""
    holder: Any = None
    """Whose it is: an end of a drag counts only if it is theirs."""
    target: NDArray[np.float64] = np.zeros(3)
    """Where to [m], shape [3]."""
    last: Sequence[int] = ()
    """The particles that it held last."""


def place(name: str, value: ArrayLike) -> NDArray[np.float64]:
    """Return a point or a direction in space as an array; raise ValueError if it is none."""
    given = checks.array(name, value)
    if given.shape != (3,) or not np.isfinite(given).all():
        raise ValueError(f"{name} is {checks.repr_short(value)}; it must be three finite numbers")
    return given


def _spacing(system: System, position: NDArray) -> float:
    """Return the mean length of the connections [m]; of none the body's size."""
    if not system.connection_count:
        return float(np.ptp(position, axis=0).max())
    return float(np.mean(system.rest_length))


def _in_plane(point: NDArray, dim: int) -> NDArray[np.float64]:
    """Return those coordinates of a point in space that a body of fewer dimensions has."""
    return np.asarray(point, dtype=np.float64)[list(AXES[dim])]


def hit(origin: NDArray, direction: NDArray, points: NDArray, triangles: NDArray) -> NDArray[np.float64] | None:
    """Return where a ray first meets triangles (Möller and Trumbore 1997), shape [3]; None where it meets none.

    Parameters
    ----------
    origin, direction
        The ray, shape [3] each.
    points
        Vertices [m], shape [any, 3].
    triangles
        Their three vertices, shape [any, 3].
    """
    a, b, c = (points[triangles[:, k]].astype(np.float64) for k in range(3))
    edge1, edge2 = b - a, c - a
    p = np.cross(direction, edge2)
    volume = (edge1 * p).sum(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        inverse = 1.0 / volume
        from_a = origin - a
        u = (from_a * p).sum(axis=1) * inverse
        q = np.cross(from_a, edge1)
        v = (q @ direction) * inverse
        far = (edge2 * q).sum(axis=1) * inverse
        meets = (volume != 0) & (u >= 0) & (v >= 0) & (u + v <= 1) & (far > 0)
    if not meets.any():
        return None
    return origin + far[meets].min() * direction
