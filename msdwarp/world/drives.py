"""Drives: particles whose positions are prescribed functions of time."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import checks
from ..bodies import System, mask_of
from .loads import Load
from .motion import Motion, pose


@dataclass(frozen=True, eq=False, repr=False)
class PrescribedMotion(Load):
    """Moves particles along a given path; forces in their connections follow from their position and velocity.

    A drive without motion is a pin that `at(t, unpin=...)` releases; the particles then keep their velocity.

    Parameters
    ----------
    on
        The driven particles; see `Load`. No particle may be in two drives.
    motion
        A function of time that returns a displacement from the start, or a displacement and a rotation, as for a
        collider (see `Collider`). Velocities are differences of positions. None: the particles stay at the start.
    about
        Centre of the rotation [m], shape [d]; by default the centre of mass of the particles at the start.
    """

    of_start = True
    on: Any = None
    motion: Motion | None = None
    about: Any = None

    def __post_init__(self) -> None:
        if self.motion is not None and not callable(self.motion):
            raise ValueError(f"motion is {checks.repr_short(self.motion)}; it must be a function of time, or None")
        if self.about is not None:
            object.__setattr__(self, "about", checks.point("about", self.about))

    def __repr__(self) -> str:
        return super().__repr__() + (" at rest" if self.motion is None else "")

    def check(self, system: System) -> None:
        """Raise ValueError if the load cannot act on this system."""
        bound = self.bound(system)
        try:
            bound.pose(0.0)
        except Exception as error:
            raise ValueError(f"motion has no place at 0 s: {checks.message(error)}") from error

    def bound(self, system: System) -> "Driven":
        """Return the drive with particles, their initial positions and the centre taken from the initial state."""
        held = np.flatnonzero(self.particles(system))
        start = np.array(system.position[held])
        if self.about is not None:
            centre = checks.vector("about", self.about, system.dim)
        else:
            mass = system.mass[held]
            centre = np.average(start, axis=0, weights=mass if np.isfinite(mass).all() else None)

        def at_rest(time: Any) -> NDArray[np.float64]:
            return np.zeros(system.dim)

        return Driven(self.on, at_rest if self.motion is None else self.motion, self.about, held, start, centre)


@dataclass(frozen=True, eq=False, repr=False)
class Driven(PrescribedMotion):
    """A drive whose particles, initial positions and centre are known; see `PrescribedMotion.bound`."""

    held: Any = ()
    """The currently driven particles, shape [count]."""
    start: Any = ()
    """Initial positions of these particles [m], shape [count, d]."""
    centre: Any = ()
    """Centre of the rotation [m], shape [d]."""

    def particles(self, system: System) -> NDArray[np.bool_]:
        """Return the mask of the driven particles, shape [particle_count]."""
        return mask_of(self.held, system.particle_count)

    def bound(self, system: System) -> "Driven":
        """Return this drive itself, since it is already bound."""
        return self

    def pose(self, time: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return (R, o): a particle that started at y is at R y + o at `time`; raise ValueError if undefined."""
        assert self.motion is not None
        return pose(self.motion, self.centre, time)

    def keeping(self, kept: NDArray[np.bool_]) -> "Driven":
        """Return this drive without particles outside a mask of shape [particle_count]."""
        still = kept[self.held]
        return binding(self.given or self, replace(self, held=self.held[still], start=self.start[still]))


def binding(given: Load, bound: Load) -> Any:
    """Return a bound load that knows the one that was given."""
    if bound is not given:
        object.__setattr__(bound, "given", given)
    return bound


def bound(loads: Sequence[Load], system: System) -> tuple[Load, ...]:
    """Return loads bound to a system's initial state, as those stay that are bound already.

    Raises ValueError if two drives hold the same particle.
    """
    result, owner = list(loads), np.full(system.particle_count, -1)
    for k, one in enumerate(loads):
        try:
            drive = result[k] = one if one.given is not None else binding(one, one.bound(system))
        except ValueError as error:
            raise ValueError(f"loads[{k}].{error}") from error
        if not isinstance(drive, Driven):
            continue
        others = owner[drive.held]
        if (others >= 0).any():
            i = int(np.argmax(others >= 0))
            raise ValueError(
                f"loads[{k}] drives particle {drive.held[i]}, as loads[{others[i]}] does; a particle can "
                "have only one drive"
            )
        owner[drive.held] = k
    return tuple(result)


def driven_particles(loads: Sequence[Load], system: System) -> NDArray[np.bool_]:
    """Return the mask of driven particles, shape [particle_count]."""
    driven = np.zeros(system.particle_count, dtype=bool)
    for one in loads:
        if isinstance(one, PrescribedMotion):
            driven |= one.particles(system)
    return driven
