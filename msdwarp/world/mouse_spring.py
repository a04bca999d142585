"""MouseSpring: springs that hold some particles, and may let go and take hold of others between two frames."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import checks
from ..bodies import System
from .loads import Load


@dataclass(frozen=True, eq=False, repr=False)
class MouseSpring(Load):
    """A spring and a damper from each of some particles to a point of the world, F = −k (x − p) − b v.

    It is what a person at the screen pulls with. Unlike an `Attachment` it may hold nobody, and
    `Simulation.change(loads=...)` exchanges it for another `MouseSpring` of the same room in place: nothing is
    compiled or recorded anew.

    Parameters
    ----------
    on
        Numbers of the particles that it holds, each once, shape [held_count]; by default nobody.
    to
        Where to [m], shape [held_count, d].
    stiffness
        Spring constants k [N/m], one for all or shape [held_count].
    damping
        Damper constants b [N s/m], one for all or shape [held_count].
    room
        The most particles that it, and those that it is exchanged for, can hold.

    Raises
    ------
    ValueError
        If a number is out of range or not finite, a particle is named twice, there are not as many points as
        particles, or more particles than room.
    """

    to: Any = ()
    stiffness: Any = 0.0
    damping: Any = 0.0
    room: int = 64

    def __post_init__(self) -> None:
        """Check the arguments, and sort what belongs to each particle by these."""
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

    def __repr__(self) -> str:
        return f"MouseSpring(on {len(self.on)} particles)"

    @property
    def rest_length(self) -> NDArray[np.float64]:
        """As attachments have it: 0, it holds in all directions alike."""
        return np.zeros(len(self.on))

    def stored(self, position: NDArray) -> float:
        """Return the energy of its springs with all particles at `position` [m], shape [particle_count, d] [J]."""
        return (
            0.5 * float(self.stiffness @ ((position[self.on] - self.to) ** 2).sum(axis=1)) if len(self.on) else 0.0
        )

    def particles(self, system: System) -> NDArray[np.bool_]:
        """Return the particles that it holds, which may be none, shape [particle_count]."""
        held = np.zeros(system.particle_count, dtype=bool)
        held[self.on] = True
        return held

    def check(self, system: System) -> None:
        """Raise ValueError if it names particles that this system does not have, or is of another space."""
        count, dim = system.particle_count, system.dim
        checks.every("on", self.on, (self.on >= 0) & (self.on < count), f"from 0 to {count - 1}")
        if len(self.on) and self.to.shape[1] != dim:
            raise ValueError(f"to has {self.to.shape[1]} coordinates; it must have {dim}")
