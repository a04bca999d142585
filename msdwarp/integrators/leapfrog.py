"""Leapfrog."""

from dataclasses import dataclass
from typing import ClassVar

import warp as wp

from .. import checks
from ..dynamics import Dynamics
from ..kernels.integrate import extrapolated_leapfrog, kick, symplectic_euler
from ..model import State
from .base import Integrator, Rates, kick_drift_limit


@dataclass(frozen=True)
class Leapfrog(Integrator):
    """Symplectic Euler with velocities kept half a substep behind the positions.

    A half kick back at the start, a half kick forward wherever a velocity is read, and the same substeps
    in between. Order 2 without damping (then it is velocity Verlet). The dampers see the velocity
    (1 + θ) v(n − ½) − θ v(n − 3/2): of half a substep ago with θ = 0, which makes the order 1, extrapolated to
    the instant of the positions with θ = ½, which keeps it at 2. Stable while h²λ(M⁻¹K) + 2(1 + 2θ) hλ(M⁻¹B) < 4.
    The half kick knows nothing of contact: of a particle at rest on a floor it reports the velocity −g h/2
    though it never moves.
    Reference: Hairer, Lubich & Wanner, Acta Numerica 12 (2003) 399-450.

    Parameters
    ----------
    damper_extrapolation
        θ, 0 or 0.5.

    Raises
    ------
    ValueError
        If `damper_extrapolation` is neither.
    """

    damper_extrapolation: float = 0.0

    order: ClassVar[int] = 2
    evaluations: ClassVar[int] = 1

    def __post_init__(self) -> None:
        """Check the argument."""
        checks.one_of("damper_extrapolation", self.damper_extrapolation, (0.0, 0.5))

    def workspace(self, state: State) -> tuple[wp.array, ...]:
        """Return arrays for the velocities at the instant of the positions: as reported, as dampers see them."""
        return state.empty_vectors(2 if self.damper_extrapolation else 1)

    def memory(self, work: tuple[wp.array, ...]) -> tuple[wp.array, ...]:
        """Return the velocities that dampers see."""
        return work[1:]

    def start(self, dynamics: Dynamics, state: State, work: tuple[wp.array, ...], h: float) -> None:
        """Take the velocities back by half a substep."""
        if self.damper_extrapolation:
            wp.copy(work[1], state.v)
        dynamics.evaluate(state.x, state.v)
        dynamics.launch(kick, -0.5 * h, state.x, state.v, state.v, state.v)

    def step(self, dynamics: Dynamics, state: State, work: tuple[wp.array, ...], h: float) -> None:
        """Advance the state by one substep of h seconds."""
        x, v = state.x, state.v
        if not self.damper_extrapolation:
            dynamics.evaluate(x, v)
            dynamics.launch(symplectic_euler, h, x, v, x, v)
            return
        v_seen = work[1]
        dynamics.evaluate(x, v_seen)
        dynamics.launch(extrapolated_leapfrog, h, self.damper_extrapolation, x, v, v_seen, x, v, v_seen)

    def velocity(self, dynamics: Dynamics, state: State, work: tuple[wp.array, ...], h: float) -> wp.array:
        """Return the velocities at the instant of the positions [m/s]."""
        v_now = work[0]
        v_seen = work[1] if self.damper_extrapolation else state.v
        dynamics.evaluate(state.x, v_seen)
        dynamics.launch(kick, 0.5 * h, state.x, state.v, v_seen, v_now)
        return v_now

    def stable_step(self, rates: Rates) -> float:
        """Return the largest stable substep [s]; see `Integrator.stable_step`."""
        return kick_drift_limit(rates.stiffness, (1 + 2 * self.damper_extrapolation) * rates.damping)
