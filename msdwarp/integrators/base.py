"""What an integrator is."""

import math
from abc import ABC, abstractmethod
from typing import Any, ClassVar, Self

import warp as wp

from ..engine import Dynamics, Rates, State


class Integrator(ABC):
    """A time-stepping method. It asks for forces and launches kernels; how forces come about it never knows.

    Every launch must be one that a graph can hold: the substeps of a frame are recorded once and replayed.
    """

    order: ClassVar[int]
    """Order of convergence, without damping and contact where they lower it (see the method)."""
    one_kernel: ClassVar[bool] = True
    """Whether all that a substep launches is stages of one method (see `msdwarp.engine.Stepper`)."""

    lag: ClassVar[float] = 0.0
    """Substeps by which velocities lag behind positions, as far as energy goes (see `msdwarp.engine.balance`)."""

    bears_touch: ClassVar[bool] = True
    """Whether bodies may touch each other."""
    long_steps: ClassVar[bool] = False
    """Whether a stable step may be longer than the motion that it is to follow: then every frame is looked at."""

    @property
    def evaluations(self) -> int:
        """Force evaluations per substep."""
        return 1

    @property
    def stage_times(self) -> tuple[float, ...]:
        """When within a substep each launch of `step` takes its forces, as shares of the substep."""
        return (0.0,)

    @property
    def weights(self) -> tuple[float, ...]:
        """What each of these launches counts in an integral over the substep."""
        return (1.0,) + (0.0,) * (len(self.stage_times) - 1)

    @property
    def lagging(self) -> bool:
        """Whether the velocities that forces see lag half a substep behind the positions."""
        return False

    @property
    def carried(self) -> int:
        """Arrays of vectors, beside positions and velocities, that one substep leaves to the next."""
        return 0

    def workspace(self, state: State) -> Any:
        """Return the arrays that the method needs beside the state, by their names; None where it needs none."""
        return None

    def start(  # noqa: B027 (most methods keep the state at one instant and need nothing here)
        self, dynamics: Dynamics, state: State, work: Any, h: float
    ) -> None:
        """Bring a state given at one instant to the instants at which the method keeps it."""

    @abstractmethod
    def step(self, dynamics: Dynamics, state: State, work: Any, h: float) -> None:
        """Advance the state by one substep of h seconds: write what comes `there`, and flip it.

        `work` is what `workspace` returned; it keeps nothing from one substep to the next.
        """

    def hand_over(self, dynamics: Dynamics, state: State, work: Any, h: float, h_next: float) -> wp.array:
        """Return the velocities that substeps of another length, h_next [s], are to start from."""
        return self.velocity(dynamics, state, work, h)

    def velocity(self, dynamics: Dynamics, state: State, work: Any, h: float) -> wp.array:
        """Return the velocities at the instant of the positions [m/s]."""
        return state.v

    @abstractmethod
    def stable_step(self, rates: Rates) -> float:
        """Return the largest stable substep [s] for a linear system with these rates."""

    def fitted(self, rates: Rates, h: float) -> Self:
        """Return the method as it is best used with substeps of h seconds."""
        return self


def kick_drift_limit(stiffness_rate: float, damping_rate: float) -> float:
    """Return the h at which h²λ_k + 2hλ_b reaches 4, the limit of kick-drift with an explicit damper.

    At the limit the fastest mode flips sign every substep. With x_n − x_{n−1} = h v_n, x and v alternating,
    x = h v / 2, and v_{n+1} − v_n = −h (λ_k x + λ_b v) becomes 2 = h (λ_k h / 2 + λ_b).
    """
    if stiffness_rate == 0.0:
        return 2.0 / damping_rate if damping_rate else math.inf
    # The root of λ_k h² + 2λ_b h − 4, in the form that does not cancel.
    return 4.0 / (damping_rate + math.sqrt(damping_rate**2 + 4.0 * stiffness_rate))
