"""Angles: triples of particles that resist bending, as in a rod."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import checks
from .uniform import joined

_NUMBERS = ("stiffness", "damping")
"""Parameters of each angle."""


@dataclass(frozen=True, eq=False, init=False)
class Angles:
    """Triples of particles a, b, c along a line that resists bending at b. Immutable.

    An angle at which the line turns by θ stores 2 K tan²(θ/2), which is K θ²/2 if θ is small. A damper dissipates
    the power D θ'². A rod of bending stiffness E I with a distance a between particles has K = E I/a (Bergou,
    Wardetzky, Robinson, Audoly and Grinspun, Discrete elastic rods, ACM Trans. Graph. 27 (2008) 63).

    Parameters
    ----------
    particles
        Particles a, b, c of each angle, shape [angle_count, 3].
    stiffness
        K [N m], shape [angle_count].
    damping
        D [N m s], shape [angle_count].

    Raises
    ------
    ValueError
        If an array has the wrong shape or is not finite, a number is negative, or a particle repeats in an angle.
    """

    particles: NDArray[np.int32]
    stiffness: NDArray[np.float64]
    damping: NDArray[np.float64]

    def __init__(self, *, particles: ArrayLike, stiffness: ArrayLike, damping: ArrayLike = 0.0) -> None:
        own = checks.indices("particles", particles, 3, 2**31 - 1)
        first, middle, last = own.T
        different = (first != middle) & (middle != last) & (first != last)
        checks.every("particles", own, np.broadcast_to(different[:, None], own.shape), "three different particles")
        object.__setattr__(self, "particles", own)
        for name, value in {"stiffness": stiffness, "damping": damping}.items():
            numbers = checks.broadcast(name, value, (len(own),))
            checks.within(name, numbers, checks.FINITE, (lambda values: values >= 0, "at least 0"))
            object.__setattr__(self, name, numbers)

    def __len__(self) -> int:
        return len(self.particles)

    def scaled(self, stiffness: float, damping: float) -> Self:
        """Return these angles with stiffness and damping multiplied by factors."""
        return replace(self, stiffness=stiffness * self.stiffness, damping=damping * self.damping)

    def renumbered(self, number: NDArray[np.integer]) -> Self:
        """Return these angles, sorted by their middle particle, when particle k becomes `number[k]`."""
        particles = number[self.particles]
        order = np.argsort(particles[:, 1], kind="stable")
        values = {name: getattr(self, name)[order] for name in _NUMBERS}
        return replace(self, particles=particles[order], **values)

    def behind(self, first: Angles | None, particles: int) -> Angles:
        """Return the angles of `first`, if any, then these, with particle indices increased by `particles`."""
        own = replace(self, particles=self.particles + np.int32(particles))
        if first is None:
            return own
        values = {name: joined(getattr(first, name), getattr(own, name)) for name in _NUMBERS}
        return Angles(particles=np.concatenate([first.particles, own.particles]), **values)
