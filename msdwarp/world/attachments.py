"""Attachments: particles held by springs to points of the world, or of what moves in it."""

from dataclasses import dataclass, field, replace
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from .. import checks
from ..bodies import System
from .colliders import Collider
from .loads import Load

NOW = "now"
"""The rest length that is the distance at the start."""


@dataclass(frozen=True, eq=False, repr=False)
class Attachment(Load):
    """Springs and dampers from particles to fixed or moving points.

    With a rest length of 0, F = −k (x − p) − b (v − u) for the point p with velocity u: it holds equally in all
    directions. With another rest length it acts only along its axis, like a connection.

    Parameters
    ----------
    on
        The attached particles; see `Load`.
    to
        Points [m] at time 0, shape [any, d] in the order of the particles' numbers, or [d] for all; or a collider
        that carries the starting positions of the particles; by default these positions.
    carried_by
        A collider whose motion the points follow, if any. If it is not among the scene's `colliders`, it is no
        obstacle.
    stiffness
        Spring constant k of each [N/m].
    damping
        Damper constant b of each [N s/m].
    rest_length
        Length at which a spring exerts no force [m], one for all or shape [any]; "now" is the distance at the
        start.

    Raises
    ------
    ValueError
        If a number is out of range or not finite, or two colliders are given.
    """

    on: Any = None
    to: Any = None
    carried_by: Collider | None = field(default=None, kw_only=True)
    stiffness: float = field(kw_only=True)
    damping: float = field(default=0.0, kw_only=True)
    rest_length: Any = field(default=0.0, kw_only=True)

    def __post_init__(self) -> None:
        """Check the arguments."""
        for name in ("stiffness", "damping"):
            object.__setattr__(self, name, checks.non_negative(name, getattr(self, name)))
        if isinstance(self.to, Collider):
            if self.carried_by is not None:
                raise ValueError(f"to is {self.to!r}; beside carried_by it must be points")
            object.__setattr__(self, "carried_by", self.to)
            object.__setattr__(self, "to", None)
        if self.carried_by is not None:
            checks.instance("carried_by", self.carried_by, Collider, "Sphere()")
        points: Any = self.to
        if points is not None:
            object.__setattr__(self, "to", checks.finite("to", points))
        if isinstance(self.rest_length, str):
            checks.one_of("rest_length", self.rest_length, [NOW, "a number of at least 0"])
        else:
            lengths = checks.finite("rest_length", self.rest_length)
            checks.every("rest_length", lengths, lengths >= 0, "at least 0")
            object.__setattr__(self, "rest_length", lengths)

    def __repr__(self) -> str:
        # Never an array: points and lengths by their number.
        said = [] if self.on is None else [self.on if isinstance(self.on, str) else _counted(self.on, "particle")]
        said += [] if self.to is None else [f"to {_counted(self.to, 'point')}"]
        said += [] if self.carried_by is None else [f"carried_by={self.carried_by!r}"]
        said += [f"stiffness={self.stiffness:g}"] + ([f"damping={self.damping:g}"] if self.damping else [])
        if isinstance(self.rest_length, str) or self.rest_length.any():
            text = self.rest_length if isinstance(self.rest_length, str) else _one_or_many(self.rest_length)
            said.append(f"rest_length={text}")
        return f"Attachment({', '.join(said)})"

    def check(self, system: System) -> None:
        """Raise ValueError if it cannot hold particles of this system."""
        self.bound(system)

    def bound(self, system: System) -> Self:
        """Return this attachment with its points and rest lengths as numbers, from the starting state.

        Raises
        ------
        ValueError
            If the number of points or lengths differs from that of particles, the collider has another number of
            coordinates, or a particle with a nonzero rest length lies in its point, so that there is no direction.
        """
        if self.carried_by is not None and (wrong := self.carried_by.fits(system.dim)):
            raise ValueError(f"carried_by.{wrong}")
        particles = np.flatnonzero(self.particles(system))
        here = system.position[particles]
        to = here if self.to is None else checks.broadcast("to", self.to, here.shape)
        away = np.linalg.norm(here - to, axis=1)
        if isinstance(self.rest_length, str):
            lengths = away
        else:
            lengths = checks.broadcast("rest_length", self.rest_length, away.shape)
            kept_off = (away == 0) & (lengths > 0)
            if kept_off.any():
                k = int(np.argmax(kept_off))
                raise ValueError(
                    f"rest_length is {lengths[k]:g}, but particle {particles[k]} starts at the point that it is "
                    "attached to: there is no direction in which to keep it off. It must be 0, or 'now'"
                )
        return replace(self, to=np.array(to), rest_length=np.array(lengths))


def _counted(value: Any, thing: str) -> str:
    """Return how many things an array of indices or points names."""
    given = np.asarray(value)
    count = int(given.sum()) if given.dtype == bool else 1 if given.ndim < 2 and thing == "point" else len(given)
    return f"{count} {thing}{'' if count == 1 else 's'}"


def _one_or_many(values: NDArray) -> str:
    return f"{values.flat[0]:g}" if (values == values.flat[0]).all() else f"{values.min():g} to {values.max():g}"
