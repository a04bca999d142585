"""Drives: particles with positions prescribed as a function of time."""

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
    """Moves particles along a given path; their connections see the position and velocity.

    A drive without motion is a pin that `at(t, unpin=...)` releases; particles then continue with their velocity.

    Parameters
    ----------
    on
        The particles that it moves; see `Load`. No particle can be in two drives.
    motion
        A function of time that returns a displacement from the start, or a displacement and a rotation, as for a
        collider (see `Motion`). The velocity is computed by differences. None: they stay where they start.
    about
        Centre of the rotation [m], shape [d]; by default the centre of mass of the particles at the start.
    """

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
        self.bound(system).pose(0.0)

    def bound(self, system: System) -> "Driven":
        """Return the drive with its particles, their start and the centre, taken from the starting state."""
        held = np.flatnonzero(self.particles(system))
        start = np.array(system.position[held])
        if self.about is not None:
            centre = checks.vector("about", self.about, system.dim)
        else:
            mass = system.mass[held]
            centre = np.average(start, axis=0, weights=mass if np.isfinite(mass).all() else None)

        def at_rest(time: Any) -> NDArray[np.float64]:
            return np.zeros(system.dim)

        return Driven(self.on, self.motion or at_rest, self.about, held, start, centre)


@dataclass(frozen=True, eq=False, repr=False)
class Driven(PrescribedMotion):
    """A drive bound to a system; see `PrescribedMotion.bound`."""

    held: Any = ()
    """The particles that it moves now, shape [count]."""
    start: Any = ()
    """Their positions at the start [m], shape [count, d]."""
    centre: Any = ()
    """The centre of its rotation [m], shape [d]."""

    def particles(self, system: System) -> NDArray[np.bool_]:
        """Return the mask of the driven particles, shape [particle_count]."""
        return mask_of(self.held, system.particle_count)

    def bound(self, system: System) -> "Driven":
        """Return this drive, which is already bound."""
        return self

    def pose(self, time: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return (R, o): at `time` a particle that started at y is at R y + o; raise ValueError without a pose."""
        assert self.motion is not None
        return pose(self.motion, self.centre, time)

    def keeping(self, kept: NDArray[np.bool_]) -> "Driven":
        """Return a drive that keeps only the particles in a mask of shape [particle_count]."""
        still = kept[self.held]
        return replace(self, held=self.held[still], start=self.start[still])


def bound(loads: Sequence[Load], system: System) -> tuple[Load, ...]:
    """Return loads bound to the start of this system; raise ValueError if two of them drive a particle."""
    result, owner = list(loads), np.full(system.particle_count, -1)
    for k, one in enumerate(loads):
        try:
            drive = result[k] = one.bound(system)
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
