"""Tape: the substeps of a frame, repeated from a checkpoint, each with its own arrays."""

from collections.abc import Callable, Sequence

import warp as wp

from ..device.vector_arrays import rows_like
from ..model.state import State, copy_vectors
from ..stepping.dynamics import Dynamics
from ..stepping.stages import Solve, Stage
from ..stepping.substep import take_substep


class Tape:
    """Takes the substeps of a frame with a launch per stage, and stores the state before each and at the end.

    Parameters
    ----------
    dynamics
        The equation of motion, prepared for frames of `substeps` substeps.
    substeps
        Number of substeps in a frame.
    stages
        Function (state) -> the stages of a substep from `state.state_in` to `state.state_out`.
    """

    def __init__(
        self, dynamics: Dynamics, substeps: int, stages: Callable[[State], Sequence[Stage | Solve]]
    ) -> None:
        self._dynamics = dynamics
        self.state = State(dynamics.model)
        """The state that stages read and write: successive entries of `states`."""
        instant = self.state.state_in
        self.storage, self.states = rows_like((instant.x, instant.v), substeps + 1)
        """Positions [m] and the method's velocities [m/s] before each substep and at the end; and their memory."""
        self._instants = [instant._replace(x=x, v=v) for x, v in self.states]
        self._stages = []
        for k in range(substeps):
            self.go_to(k)
            self._stages.append(stages(self.state))

    def go_to(self, substep: int) -> None:
        """Make the start of a substep the current state."""
        self.state.state_in, self.state.state_out = self._instants[substep : substep + 2]

    def launch(self, substeps: range | None = None) -> None:
        """Launch substeps of a frame, by default all, from the state before the first on the tape."""
        for k in substeps or range(len(self._stages)):
            self.take(k)

    def advance(self, state: State, substeps: int, first: int) -> None:
        """Advance another state by substeps of a frame, from number `first` on; keep all states on the tape."""
        now = state.x, state.v
        copy_vectors(self.states[first], now)
        self.launch(range(first, first + substeps))
        copy_vectors(now, self.states[first + substeps])

    def take(self, substep: int, look: Callable[[int, wp.array, wp.array], None] | None = None) -> None:
        """Launch a substep; before stage n, call `look` with n and with the state at which it evaluates forces."""
        self.go_to(substep)
        take_substep(self._dynamics, self.state, self._stages[substep], substep, look)
        self._dynamics.go_to_frame_end()
