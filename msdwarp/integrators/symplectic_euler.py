"""Semi-implicit (symplectic) Euler."""

from dataclasses import dataclass
from typing import ClassVar

import warp as wp

from ..engine import Dynamics, Rates, State
from ..kernels.integrators import kick, symplectic_euler
from .base import Integrator, kick_drift_limit


@dataclass(frozen=True)
class SymplecticEuler(Integrator):
    """v += h a(x, v), then x += h v: the "Euler" method of the 2014 report (equation 10).

    Order 1. Symplectic without damping: the energy error stays bounded. Stable if h²λ(M⁻¹K) + 2hλ(M⁻¹B) < 4 for
    every mode; this is exact if K and B share modes. Reference: Hairer, Lubich & Wanner, Geometric Numerical
    Integration, 2nd ed. (2006), I.1.2.
    """

    order: ClassVar[int] = 1
    lag: ClassVar[float] = 0.5

    @property
    def lagging(self) -> bool:
        """Whether forces use velocities half a substep before the positions."""
        return True

    def step(self, dynamics: Dynamics, state: State, work: None, h: float) -> None:
        """Advance the state by one substep of h seconds."""
        now, then = state.state_in, state.state_out
        dynamics.launch(
            symplectic_euler, h=h, compensation=now.compensation, x=now.x, v=now.v, x_out=then.x, v_out=then.v
        )
        state.flip()

    def hand_over(self, dynamics: Dynamics, state: State, work: None, h: float, h_next: float) -> wp.array:
        """Return the velocities half a substep of the next length before the positions.

        The method is leapfrog with velocities half a substep old. Without this correction each change of the step
        would change the energy: (h/2) Σ v·f is up to 0.8 of the energy of the fastest mode.
        """
        now, (v,) = state.state_in, state.empty_vectors(1)
        fields = {"compensation": now.compensation, "x": now.x, "v": now.v, "v_half": now.v, "v_out": v}
        dynamics.launch(kick, h=0.5 * (h - h_next), **fields)
        return v

    def stable_step(self, rates: Rates) -> float:
        """Return the largest stable substep [s]; see `Integrator.stable_step`."""
        return kick_drift_limit(rates.stiffness, rates.damping)
