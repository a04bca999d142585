"""State: what moves, as arrays on a device."""

from collections.abc import Iterable
from typing import Any, NamedTuple, Self

import numpy as np
import warp as wp
from numpy.typing import NDArray

from ..bodies import System
from ..kernels.compensation import compensation
from ..quiet import in_turn
from .model import Model


class Instant(NamedTuple):
    """What moves, at one instant: arrays as `Model.vectors` makes them."""

    x: wp.array
    """Positions [m]."""
    v: wp.array
    """Velocities [m/s]; between a frame's substeps at the integrator's own instants."""
    carried: tuple[wp.array, ...]
    """What else the integrator hands from one substep to the next."""
    lost: Any
    """Struct of what sums have lost by rounding: `x`, `v`, and `x_out` for the next instant."""


class State:
    """What moves, on a device, twice: at the present instant (`here`), and where the next is written (`there`).

    Parameters
    ----------
    model
        The system it is the state of.
    carried
        Number of arrays that the integrator carries along (see `Integrator.carried`).
    """

    def __init__(self, model: Model, carried: int = 0) -> None:
        self.model, self._at_home = model, True
        Lost, _ = compensation(model.dim, model.scalar, model.compensated)
        lost = [
            model.vectors() if model.compensated else wp.zeros(0, model.vector, device=model.device) for _ in "xxv"
        ]
        instants = []
        for x, x_out in ((lost[0], lost[1]), (lost[1], lost[0])):
            struct = Lost()
            struct.x, struct.x_out, struct.v = x, x_out, lost[2]
            arrays = self.empty_vectors(2 + carried)
            instants.append(Instant(arrays[0], arrays[1], arrays[2:], struct))
        self.here, self.there = instants

    @classmethod
    @in_turn
    def of(cls, system: System, model: Model, carried: int = 0) -> Self:
        """Upload the positions and velocities of a system."""
        model.check_range(system.position, "position")
        model.check_range(system.velocity, "velocity")
        state = cls(model, carried)
        for name, exact in (("x", system.position), ("v", system.velocity)):
            rounded = exact.astype(model.dtype)
            getattr(state.here, name).assign(rounded)
            if model.compensated:  # what rounding takes from the start is not lost either
                for lost in {getattr(instant.lost, name) for instant in (state.here, state.there)}:
                    lost.assign((rounded - exact).astype(model.dtype))
        return state

    def throw(self, exact: NDArray[np.float64], chosen: NDArray[np.bool_]) -> None:
        """Give chosen particles other velocities [m/s]; `exact` has shape [particle_count, d]."""
        rounded = exact.astype(self.model.dtype)
        changes = [(self.here.v, rounded)]
        if self.model.compensated:
            changes.append((self.here.lost.v, (rounded - exact).astype(self.model.dtype)))
        for array, values in changes:
            array.assign(np.where(chosen[:, None], values, array.numpy()))

    @property
    def x(self) -> wp.array:
        """Positions [m]."""
        return self.here.x

    @property
    def v(self) -> wp.array:
        """Velocities [m/s]."""
        return self.here.v

    @property
    def lost(self) -> Any:
        """What sums have lost by rounding."""
        return self.here.lost

    def empty_vectors(self, count: int) -> tuple[wp.array, ...]:
        """Return `count` arrays of zeros, one vector a particle: an integrator's working memory."""
        return self.model.vectors_together(count)

    def flip(self) -> None:
        """Make what has been written `there` the present."""
        self.here, self.there, self._at_home = self.there, self.here, not self._at_home

    def settle(self) -> None:
        """Bring the present back to the arrays that held it at first, which is where a graph expects it."""
        if not self._at_home:
            self.flip()
            copy_vectors(moving(self.here), moving(self.there))


def moving(instant: Instant) -> list[wp.array]:
    """Return the arrays of an instant that are not shared with the next one."""
    return [array for array in (instant.x, instant.v, *instant.carried, instant.lost.x) if array.size]


def copy_vectors(to: Iterable[Any], source: Iterable[Any]) -> None:
    """Copy arrays that `Model.vectors_together` made, piece of memory by piece: all arrays of each are named."""
    pieces = {id(one._ref): (other._ref, one._ref) for other, one in zip(to, source, strict=True)}
    for there, here in pieces.values():
        wp.copy(there, here)
