"""Semi-implicit (symplectic) Euler."""

from dataclasses import dataclass
from typing import ClassVar

from ..engine import Dynamics, Rates, State
from ..kernels.integrators import symplectic_euler
from .base import Integrator, kick_drift_limit


@dataclass(frozen=True)
class SymplecticEuler(Integrator):
    """v += h a(x, v), then x += h v: the report's "Euler" (eq. 10).

    Order 1. Symplectic without damping: the energy error stays bounded. Stable while
    h²λ(M⁻¹K) + 2hλ(M⁻¹B) < 4 for every mode, exactly so where K and B share modes.
    Reference: Hairer, Lubich & Wanner, Geometric Numerical Integration, 2nd ed. (2006), I.1.2.
    """

    order: ClassVar[int] = 1
    lag: ClassVar[float] = 0.5

    def step(self, dynamics: Dynamics, state: State, work: None, h: float) -> None:
        """Advance the state by one substep of h seconds."""
        now, then = state.here, state.there
        dynamics.launch(symplectic_euler, h=h, lost=now.lost, x=now.x, v=now.v, x_out=then.x, v_out=then.v)
        state.flip()

    def stable_step(self, rates: Rates) -> float:
        """Return the largest stable substep [s]; see `Integrator.stable_step`."""
        return kick_drift_limit(rates.stiffness, rates.damping)
