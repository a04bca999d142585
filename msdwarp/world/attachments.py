"""Attachments: springs from particles to points that are fixed, move with a collider, or follow the mouse."""

from dataclasses import dataclass, field, replace
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from .. import checks
from ..bodies import System, mask_of
from .colliders import Collider
from .loads import Load

NOW = "now"
"""Value of `rest_length` that means the initial distance."""


@dataclass(frozen=True, eq=False, repr=False)
class Attachment(Load):
    """Springs and dampers from particles to fixed or moving points.

    With a rest length of 0, F = −k (x − p) − b (v − u) for the point p with velocity u, equal in all directions.
    With another rest length the force acts only along the axis, as in a connection.

    Parameters
    ----------
    on
        The attached particles; see `Load`.
    to
        Points [m] at time 0, shape [any, d] in the order of the particles' indices, or [d] for all; or a collider,
        which carries the particles' initial positions. By default the initial positions.
    carried_by
        A collider with whose motion the points move, if any. If it is not among the scene's `colliders`, it is not
        an obstacle.
    stiffness
        Spring constant k of each spring [N/m].
    damping
        Damper constant b of each damper [N s/m].
    rest_length
        Length at which a spring exerts no force [m], one for all or shape [any]; "now" is the initial
        distance.
    """

    of_start = True
    on: Any = None
    to: Any = None
    carried_by: Collider | None = field(default=None, kw_only=True)
    stiffness: float = field(kw_only=True)
    damping: float = field(default=0.0, kw_only=True)
    rest_length: Any = field(default=0.0, kw_only=True)

    def __post_init__(self) -> None:
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

    def check(self, system: System) -> None:
        """Raise ValueError if the attachment cannot hold particles of this system."""
        self.bound(system)

    def bound(self, system: System) -> Self:
        """Return this attachment with points and rest lengths as numbers, computed from the initial state."""
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


@dataclass(frozen=True, eq=False, repr=False)
class MouseSpring(Load):
    """Springs and dampers from particles to points, F = −k (x − p) − b v: the pull of the mouse.

    Unlike an `Attachment` it may hold no particle. `Simulation.change(loads=...)` can replace it by another
    `MouseSpring` with the same `room` without compiling kernels.

    Parameters
    ----------
    on
        Indices of the held particles, each once, shape [held_count]; by default none.
    to
        Points to which the particles are pulled [m], shape [held_count, d].
    stiffness, damping
        Spring constants k [N/m] and damper constants b [N s/m], one for all or shape [held_count].
    room
        Maximal number of held particles, for this load and loads that replace it.
    """

    constant = ("room",)
    to: Any = ()
    stiffness: Any = 0.0
    damping: Any = 0.0
    room: int = 64

    def __post_init__(self) -> None:
        """Check the arguments; sort particles, points and constants by the particles' indices."""
        checks.count("room", self.room, 1)
        held = checks.array("on", () if self.on is None else self.on).astype(np.int64).reshape(-1)
        if len(held) > self.room:
            raise ValueError(f"on names {len(held)} particles; it must be at most room = {self.room}")
        if len(np.unique(held)) < len(held):
            raise ValueError("on has a particle twice; each must occur once")
        to = checks.finite("to", self.to).reshape(len(held), -1) if len(held) else np.zeros((0, 0))
        order = np.argsort(held)
        object.__setattr__(self, "on", held[order])
        object.__setattr__(self, "to", to[order])
        for name in ("stiffness", "damping"):
            values = checks.finite(name, getattr(self, name))
            checks.every(name, values, values >= 0, "at least 0")
            object.__setattr__(self, name, checks.broadcast(name, values, held.shape)[order])

    @property
    def rest_length(self) -> NDArray[np.float64]:
        """Rest lengths [m]: 0, so that forces are equal in all directions."""
        return np.zeros(len(self.on))

    def particles(self, system: System) -> NDArray[np.bool_]:
        """Return the mask of the held particles, which may be none, shape [particle_count]."""
        return mask_of(self.on, system.particle_count)

    def check(self, system: System) -> None:
        """Raise ValueError if a held particle is not in this system, or coordinates differ in number."""
        checks.within("on", self.on, checks.index_below(system.particle_count))
        if len(self.on) and self.to.shape[1] != system.dim:
            raise ValueError(f"to has {self.to.shape[1]} coordinates; it must have {system.dim}")
