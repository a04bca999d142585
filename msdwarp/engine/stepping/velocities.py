"""Velocities at the instant of the positions, and at that at which a method keeps them."""

import warp as wp

from ...kernels.integrators import kick
from ..model.state import State
from .dynamics import Dynamics
from .stages import Stage


class Velocities:
    """Shifts velocities between the instant of the positions and that at which a method keeps them.

    Parameters
    ----------
    dynamics, state
        What runs stages, and what moves.
    lag
        By how much the method's velocities lag behind positions [s]; may be negative where time runs back.
    staggered
        Whether velocities are given, and read, at the instant of the positions; else they are taken as they are.
    """

    def __init__(self, dynamics: Dynamics, state: State, lag: float, staggered: bool) -> None:
        self._dynamics, self._state, self._lag, self._staggered = dynamics, state, lag, staggered
        (self._v,) = state.empty_vectors(1) if staggered else (state.v,)

    def start(self) -> None:
        """Shift velocities given at the instant of the positions to that at which the method keeps them."""
        now = self._state.state_in
        if self._staggered:
            for seen in now.method_state:
                wp.copy(seen, now.v)
            wp.copy(now.v, kicked(self._dynamics, self._state, -self._lag, self._v))

    def read(self) -> wp.array:
        """Return velocities at the instant of the positions [m/s]."""
        return kicked(self._dynamics, self._state, self._lag, self._v) if self._staggered else self._state.v

    def hand_over(self, lag: float) -> None:
        """Have the state hold velocities from which substeps with another lag [s] start.

        Velocities that are taken as they are stay as far behind as the next ones will be. Else each change of the
        step would change the energy: (h/2) Σ v·f is up to 0.8 of the energy of the fastest mode.
        """
        if self._staggered:
            wp.copy(self._state.v, self.read())
        elif self._lag:
            (v,) = self._state.empty_vectors(1)
            wp.copy(self._state.v, kicked(self._dynamics, self._state, self._lag - lag, v))


def kicked(dynamics: Dynamics, state: State, seconds: float, v_out: wp.array) -> wp.array:
    """Run the stage that writes velocities `seconds` later than those of the state to `v_out` [m/s]; return that.

    Forces are those at the state's positions. Contact is left out.
    """
    now = state.state_in
    v = now.method_state[0] if now.method_state else now.v  # those that dampers use
    fields = {"compensation": now.compensation, "x": now.x, "v": v, "v_half": now.v, "v_out": v_out}
    dynamics.run(Stage(kick, {"h": seconds, **fields}))
    return v_out
