"""State: positions, velocities and the integrator's own arrays, on a device."""

from collections.abc import Iterable
from typing import Any, NamedTuple, Self

import numpy as np
import warp as wp
from numpy.typing import NDArray

from ...bodies import System
from ...kernels.compensation import compensated_sum
from ...runtime import in_turn
from .model import Model


class Instant(NamedTuple):
    """The state at one instant, in arrays made by `Model.vectors`."""

    x: wp.array
    """Positions [m]."""
    v: wp.array
    """Velocities [m/s]; between the substeps of a frame at the integrator's own times, which may lag."""
    method_state: tuple[wp.array, ...]
    """The integrator's own arrays, kept from one substep to the next."""
    compensation: Any
    """Struct of rounding errors of sums: `x`, `v`, and `x_out` for the next instant."""


class State:
    """Positions, velocities and the integrator's own arrays, for now (`state_in`) and the next step (`state_out`).

    `method_state` is the number of further arrays that the integrator keeps from one substep to the next.
    """

    def __init__(self, model: Model, method_state: int = 0) -> None:
        self.model, self._at_home = model, True
        Compensation, _ = compensated_sum(model.dim, model.scalar, model.compensated)
        compensation = [
            model.vectors() if model.compensated else wp.zeros(0, model.vector, device=model.device) for _ in "xxv"
        ]
        instants = []
        for x, x_out in ((compensation[0], compensation[1]), (compensation[1], compensation[0])):
            struct = Compensation()
            struct.x, struct.x_out, struct.v = x, x_out, compensation[2]
            arrays = model.vectors_together(2 + method_state)
            instants.append(Instant(arrays[0], arrays[1], arrays[2:], struct))
        self.state_in, self.state_out = instants

    @classmethod
    @in_turn
    def from_system(cls, system: System, model: Model, method_state: int = 0) -> Self:
        """Upload positions and velocities: the model's rows, by world, if there are any; else the system's."""
        state = cls(model, method_state)
        for name, field in (("x", "position"), ("v", "velocity")):
            exact = model.rows[field] if field in model.rows else getattr(system, field)[None]
            model.check_range(exact, field)
            state.write(name, exact)
        return state

    def write(self, name: str, exact: NDArray[np.float64], chosen: NDArray[np.bool_] | None = None) -> None:
        """Write positions "x" [m] or velocities "v" [m/s] of all or of chosen particles.

        `exact` has shape [rows, particle_count, d]: world w gets row w mod rows. `chosen`: shape [particle_count].
        """
        model = self.model
        rounded = exact.astype(model.dtype)
        changes = [(getattr(self.state_in, name), rounded)]
        if model.compensated:
            lost = (rounded - exact).astype(model.dtype)
            both = (self.state_in.compensation, self.state_out.compensation)
            changes += [(array, lost) for array in {getattr(one, name) for one in both}]
        for array, values in changes:
            values = model.spread(values)
            if chosen is not None:
                mask = model.spread(np.broadcast_to(chosen[:, None], exact.shape))
                values = np.where(mask, values, array.numpy())
            array.assign(values)

    def throw(self, exact: NDArray[np.float64], chosen: NDArray[np.bool_]) -> None:
        """Set the velocities of chosen particles [m/s]; `exact` has shape [particle_count, d]."""
        self.write("v", exact[None], chosen)

    @property
    def x(self) -> wp.array:
        """Positions [m]."""
        return self.state_in.x

    @property
    def v(self) -> wp.array:
        """Velocities [m/s]."""
        return self.state_in.v

    @property
    def compensation(self) -> Any:
        """Rounding errors of positions and velocities, to be subtracted (see `kernels.compensation`)."""
        return self.state_in.compensation

    def motion(self) -> dict[str, Any]:
        """Return the arrays of a stage that advances a whole substep, by their names in the method's `Step`."""
        now, then = self.state_in, self.state_out
        return {"compensation": now.compensation, "x": now.x, "v": now.v, "x_out": then.x, "v_out": then.v}

    def flip(self) -> None:
        """Make `state_out` the current instant."""
        self.state_in, self.state_out, self._at_home = self.state_out, self.state_in, not self._at_home

    def settle(self) -> None:
        """Copy the current state into the arrays that held it at first, since recorded graphs read them."""
        if not self._at_home:
            self.flip()
            copy_vectors(moving(self.state_in), moving(self.state_out))


def moving(instant: Instant) -> list[wp.array]:
    """Return the arrays of an instant that are not shared with the next instant."""
    return [array for array in (instant.x, instant.v, *instant.method_state, instant.compensation.x) if array.size]


def copy_vectors(to: Iterable[Any], source: Iterable[Any]) -> None:
    """Copy arrays made by `Model.vectors_together`, with one copy per allocation."""
    pieces = {id(one._ref): (other._ref, one._ref) for other, one in zip(to, source, strict=True)}
    for there, here in pieces.values():
        wp.copy(there, here)
