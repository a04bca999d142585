"""What an integrator is."""

from abc import ABC, abstractmethod
from typing import ClassVar

import warp as wp

from ..dynamics import Dynamics
from ..model import State


class Integrator(ABC):
    """A time-stepping method. It asks for forces and launches kernels; how forces come about it never knows.

    Every launch must be one that a graph can hold: the substeps of a frame are recorded once and replayed.
    """

    order: ClassVar[int]
    """Order of convergence, without damping and contact where they lower it (see the method)."""
    evaluations: ClassVar[int]
    """Force evaluations per substep."""

    def workspace(self, state: State) -> tuple[wp.array, ...]:
        """Return the arrays that the method needs beside the state."""
        return ()

    def start(  # noqa: B027 (most methods keep the state at one instant and need nothing here)
        self, dynamics: Dynamics, state: State, work: tuple[wp.array, ...], h: float
    ) -> None:
        """Bring a state given at one instant to the instants at which the method keeps it."""

    @abstractmethod
    def step(self, dynamics: Dynamics, state: State, work: tuple[wp.array, ...], h: float) -> None:
        """Advance the state by one substep of h seconds."""

    def velocity(self, dynamics: Dynamics, state: State, work: tuple[wp.array, ...], h: float) -> wp.array:
        """Return the velocities at the instant of the positions [m/s]."""
        return state.v

    @abstractmethod
    def stable_step(self, stiffness_rate: float, damping_rate: float) -> float:
        """Return the largest stable substep [s] for a linear system.

        Parameters
        ----------
        stiffness_rate
            Largest eigenvalue of M⁻¹K [1/s²], a squared angular frequency.
        damping_rate
            Largest eigenvalue of M⁻¹B [1/s].
        """
