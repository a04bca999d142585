"""The classical Runge-Kutta method."""

import math
from dataclasses import dataclass
from typing import ClassVar

import warp as wp

from ..dynamics import Dynamics
from ..kernels.integrate import rk4_finish, rk4_stage
from ..model import State
from .base import Integrator, Rates


@dataclass(frozen=True)
class RK4(Integrator):
    """The classical Runge-Kutta method of order 4 (report eq. 6), its stages seeing position and velocity.

    Contact is applied after each substep, which makes it first order across a contact, as every method.
    Its region of stability reaches 2.785 along the negative real axis, 2.828 along the imaginary one, and
    in no direction between them less than 2.615.
    Reference: Hairer, Nørsett & Wanner, Solving Ordinary Differential Equations I, 2nd ed. (1993), II.1.
    """

    order: ClassVar[int] = 4
    evaluations: ClassVar[int] = 4

    def workspace(self, state: State) -> tuple[wp.array, ...]:
        """Return two stages and the sum of slopes, each of positions and velocities."""
        return state.empty_vectors(6)

    def step(self, dynamics: Dynamics, state: State, work: tuple[wp.array, ...], h: float) -> None:
        """Advance the state by one substep of h seconds."""
        x_a, v_a, x_b, v_b, x_sum, v_sum = work
        start, total = (state.x, state.v), (x_sum, v_sum)
        stages = (
            ((state.x, state.v), (x_a, v_a), h / 2, h / 6),
            ((x_a, v_a), (x_b, v_b), h / 2, h / 3),
            ((x_b, v_b), (x_a, v_a), h, h / 3),
        )
        for here, there, reach, weight in stages:
            dynamics.evaluate(*here)
            dynamics.launch(rk4_stage, reach, weight, *start, *here, *there, *total)
        dynamics.evaluate(x_a, v_a)
        dynamics.launch(rk4_finish, h / 6, x_a, v_a, *start, *total)

    def stable_step(self, rates: Rates) -> float:
        """Return a stable substep [s]; see `Integrator.stable_step`.

        It holds for any system with these two rates, and is the largest that does to within 8 %; a given
        system may bear more, up to twice where its fastest modes are critically damped. A mode's eigenvalues
        h·μ have modulus h √λ_k where they oscillate and lie in −h λ_b … 0 where not.
        """
        oscillating = 2.615 / math.sqrt(rates.stiffness) if rates.stiffness else math.inf
        creeping = 2.785 / rates.damping if rates.damping else math.inf
        return min(oscillating, creeping)
