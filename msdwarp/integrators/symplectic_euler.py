"""Semi-implicit (symplectic) Euler."""

from dataclasses import dataclass
from typing import ClassVar

from ..engine import Rates, Stage, State
from ..kernels.integrators.euler import symplectic_euler
from .base import Integrator, kick_drift_limit


@dataclass(frozen=True)
class SymplecticEuler(Integrator):
    """v += h a(x, v), then x += h v: the "Euler" method of the 2014 report (equation 10).

    Order 1. Symplectic without damping: the energy error stays bounded. Stable if h²λ(M⁻¹K) + 2hλ(M⁻¹B) < 4 for
    every mode; exact if K and B have common modes. Reference: Hairer, Lubich & Wanner, Geometric Numerical
    Integration, 2nd ed. (2006), I.1.2.
    """

    order: ClassVar[int] = 1
    lag: ClassVar[float] = 0.5

    @property
    def lagging(self) -> bool:
        """Whether forces use velocities of half a substep before the positions."""
        return True

    def substep(self, state: State, work: None, h: float) -> list[Stage]:
        """Return the only stage of a substep of h seconds."""
        return [Stage(symplectic_euler, {"h": h, **state.motion()})]

    def stable_step(self, rates: Rates) -> float:
        """Return the largest stable substep [s]; see `Integrator.stable_step`."""
        return kick_drift_limit(rates.stiffness, rates.damping)
