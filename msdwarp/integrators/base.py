"""Integrator: a time-stepping method as data; `symplectic_euler.py` is the shortest example."""

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any, ClassVar, Self

from numpy.typing import NDArray

from ..engine import Rates, Solve, Stage, State


class Integrator(ABC):
    """A time-stepping method: the stages of a substep as data, which `msdwarp.engine` runs.

    All launches of a stage must be capturable in a CUDA graph, since a frame is recorded once and replayed.

    Attributes
    ----------
    order
        Order of convergence; damping and contact may lower it (see each method).
    solves
        Whether a substep has solves between stages; then each stage is a separate launch.
    lag
        Lag of velocities behind positions, in substeps, for the energy (see
        `msdwarp.engine.diagnostics.energy_balance`).
    staggered
        Whether given velocities are shifted back by `lag` substeps at the start, and forward again when read. A
        method that lags without being staggered uses and reports velocities without shifts.
    supports_contact
        Whether the method supports contact between bodies.
    long_steps
        Whether stable steps may be too long to resolve the motion; then every frame's energy is checked.
    """

    order: ClassVar[int]
    solves: ClassVar[bool] = False
    lag: ClassVar[float] = 0.0
    staggered: ClassVar[bool] = False
    supports_contact: ClassVar[bool] = True
    long_steps: ClassVar[bool] = False

    @property
    def tableau(self) -> NDArray | None:
        """Butcher's coefficients of an explicit method, shape [stages, stages]; None if it has none.

        Stage j evaluates forces at Y_j = Y_0 + h Σ_m tableau[j − 1, m] (v_m, a_m), summed over the stages m < j.
        The last row gives the end of the substep. Gradients are computed from these coefficients.
        """
        return None

    @property
    def evaluations(self) -> int:
        """Force evaluations per substep."""
        return 1 if self.tableau is None else len(self.tableau)

    @property
    def stage_times(self) -> tuple[float, ...]:
        """Times within a substep at which each stage evaluates forces, as fractions of the substep."""
        return (0.0,) if self.tableau is None else (0.0, *self.tableau[:-1].sum(axis=1).tolist())

    @property
    def weights(self) -> tuple[float, ...]:
        """Weight of each stage's force, evaluated at `stage_times`, in an integral over the substep."""
        if self.tableau is not None:
            return tuple(self.tableau[-1].tolist())
        return (1.0,) + (0.0,) * (len(self.stage_times) - 1)

    @property
    def lagging(self) -> bool:
        """Whether forces use velocities of half a substep before the positions."""
        return False

    @property
    def method_state(self) -> int:
        """Number of vector arrays passed from substep to substep, besides positions and velocities."""
        return 0

    def workspace(self, state: State) -> Any:
        """Return the arrays that the method needs besides the state; None if there are none."""
        return None

    @abstractmethod
    def substep(self, state: State, work: Any, h: float) -> Sequence[Stage | Solve]:
        """Return the stages of one substep of h seconds, from `state.state_in` to `state.state_out`.

        `work` is from `workspace`; its contents are not kept between substeps.
        """

    @abstractmethod
    def stable_step(self, rates: Rates) -> float:
        """Return the largest stable substep [s] for a linear system with these rates."""

    def fitted(self, rates: Rates, h: float) -> Self:
        """Return the method with options chosen for substeps of h seconds."""
        return self


def kick_drift_limit(stiffness_rate: float, damping_rate: float) -> float:
    """Return the h at which h²λ_k + 2hλ_b is 4, the stability limit of kick-drift with an explicit damper.

    At the limit the fastest mode changes sign in every substep. With x_n − x_{n−1} = h v_n, x and v alternating,
    x = h v / 2, and v_{n+1} − v_n = −h (λ_k x + λ_b v) becomes 2 = h (λ_k h / 2 + λ_b).
    """
    if stiffness_rate == 0.0:
        return 2.0 / damping_rate if damping_rate else math.inf
    # The root of λ_k h² + 2λ_b h − 4, in a form without cancellation.
    return 4.0 / (damping_rate + math.sqrt(damping_rate**2 + 4.0 * stiffness_rate))
