"""Velocities at the time of the positions, and at the time to which the method's velocities belong."""

from typing import Any

import warp as wp

from ...kernels.integrators.euler import kick
from ..model.state import State
from .dynamics import Dynamics
from .stages import Stage
from .substep import take_stage


class Velocities:
    """Shifts velocities between the time of the positions and the method's own time.

    The method's velocities lag behind positions by `lag` [s], which is negative if time runs backwards. Velocities
    are shifted only if they are `staggered`; else users give and read them at the method's time.

    Dampers act on the velocities before a shift, so a shift forward does not undo one back. While `given`, until
    the state moves or is replaced, the velocities that are read are therefore those at `start`.
    """

    def __init__(self, dynamics: Dynamics, state: State, lag: float, staggered: bool) -> None:
        self._dynamics, self._state, self._lag, self._staggered = dynamics, state, lag, staggered
        self._v, self.given = (state.model.vectors() if staggered else state.v), False
        if lag:
            dynamics.note(kick, in_frames=False)

    def kept(self) -> wp.array | None:
        """Return a copy of the given velocities, if any, for `give`."""
        return wp.clone(self._v) if self.given else None

    def give(self, v: Any) -> None:
        """Have velocities v [m/s] read until the state moves; None: those of the state."""
        self.given = v is not None
        if v is not None:
            self._v.assign(v)

    def start(self) -> None:
        """Shift velocities from the time of the positions to the method's own time."""
        state = self._state.state_in
        if self._staggered:
            for v in (*state.method_state, self._v):
                wp.copy(v, state.v)
            kicked(self._dynamics, self._state, -self._lag, state.v, self._v)
            self.given = True

    def read(self) -> wp.array:
        """Return velocities at the time of the positions [m/s]."""
        if self._staggered and not self.given:
            kicked(self._dynamics, self._state, self._lag, self._v)
        return self._v if self._staggered else self._state.v

    def change_lag(self, lag: float, most: float) -> None:
        """Shift the state's velocities for substeps with another lag [s].

        A present lag above `most` [s] is taken to be `most`: a load that has just set in can make the present step
        far too long, and then a shift by its lag would be arbitrarily large.

        Without it each change of the step would change the energy by (h/2) Σ v·f, up to 0.8 of the energy of the
        fastest mode.
        """
        now = min(self._lag, most)
        if self._staggered:
            wp.copy(self._state.v, self._v if self.given else kicked(self._dynamics, self._state, now, self._v))
        elif self._lag:
            v = self._state.model.vectors()
            wp.copy(self._state.v, kicked(self._dynamics, self._state, now - lag, v))


def kicked(dynamics: Dynamics, state: State, seconds: float, v_out: wp.array, v: Any = None) -> wp.array:
    """Write to `v_out`, and return, velocities, by default those of the state, shifted by `seconds` [m/s].

    The forces are those at the state's positions, without contact.
    """
    start = state.state_in
    v = start.v if v is None else v
    dampers_v = start.method_state[0] if start.method_state else v
    fields = {"compensation": start.compensation, "x": start.x, "v": dampers_v, "v_half": v, "v_out": v_out}
    take_stage(dynamics, Stage(kick, {"h": seconds, **fields}))
    return v_out
