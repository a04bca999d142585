"""Explicit Euler, for comparison: unstable without damping."""

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from ..engine import Rates, Stage, State
from ..kernels.integrators.euler import explicit_euler
from .base import Integrator


@dataclass(frozen=True)
class ExplicitEuler(Integrator):
    """x += h v and v += h a(x, v), both from the old state. For comparison only, in Python.

    Order 1. Without damping every oscillation grows by √(1 + h²ω²) per substep, at any step. With damping it is
    stable if and only if h ≤ b/k and 2hλ(M⁻¹B) ≤ 4 + h²λ(M⁻¹K).
    Reference: Hairer & Wanner, Solving Ordinary Differential Equations II, 2nd ed. (1996), IV.2.
    """

    order: ClassVar[int] = 1

    @property
    def tableau(self) -> NDArray:
        """Butcher's coefficients; see `Integrator.tableau`."""
        return np.ones((1, 1))

    def substep(self, state: State, work: None, h: float) -> list[Stage]:
        """Return the only stage of a substep of h seconds."""
        return [Stage(explicit_euler, {"h": h, **state.motion()})]

    def stable_step(self, rates: Rates) -> float:
        """Return a stable substep [s], 0 if a spring has no damper."""
        return min(rates.least_ratio, 2 / rates.damping if rates.damping else math.inf)
