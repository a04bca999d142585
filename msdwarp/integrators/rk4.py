"""The classical Runge-Kutta method."""

import math
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np
import warp as wp
from numpy.typing import NDArray

from ..engine import Rates, Stage, State
from ..kernels.integrators.runge_kutta import rk4
from .base import Integrator

TABLEAU = np.array([[1 / 2, 0, 0, 0], [0, 1 / 2, 0, 0], [0, 0, 1, 0], [1 / 6, 1 / 3, 1 / 3, 1 / 6]])


class Work(NamedTuple):
    """Workspace: stages a and c. Stage b uses the arrays of `state_out`."""

    x_a: wp.array
    v_a: wp.array
    x_c: wp.array
    v_c: wp.array
    v_sum: wp.array
    """Weighted sum of the accelerations of stages, times h [m/s]."""


@dataclass(frozen=True)
class RK4(Integrator):
    """The classical Runge-Kutta method of order 4 (equation 6 of the 2014 report).

    Contact is applied after each substep, so across a contact the order is 1, as in every method. The stability
    region reaches 2.785 along the negative real axis, 2.828 along the imaginary axis, and at least 2.615 in any
    direction in between. Reference: Hairer, Nørsett & Wanner, Solving Ordinary Differential Equations I, 2nd ed.
    (1993), II.1.
    """

    order: ClassVar[int] = 4

    @property
    def tableau(self) -> NDArray:
        """Butcher's coefficients; see `Integrator.tableau`."""
        return TABLEAU

    def workspace(self, state: State) -> Work:
        """Return arrays for the positions and velocities of two stages, and for the sum of accelerations."""
        return Work(*state.model.vectors_together(5))

    def substep(self, state: State, work: Work, h: float) -> list[Stage]:
        """Return the four stages of a substep of h seconds."""
        state_in, state_out = state.state_in, state.state_out
        x_a, v_a, x_c, v_c, v_sum = work
        start, a, b, c = (state_in.x, state_in.v), (x_a, v_a), (state_out.x, state_out.v), (x_c, v_c)
        steps = (
            (start, a, h / 2, h / 6),
            (a, b, h / 2, h / 3),
            (b, c, h, h / 3),
            (c, b, 0.0, h / 6),  # b is not read later
        )
        common = {"compensation": state_in.compensation, "x0": state_in.x, "v0": state_in.v}
        common |= {"v_sum": v_sum, "v_a": v_a, "v_b": state_out.v}
        stages = []
        for k, ((x, v), (x_out, v_out), reach, weight) in enumerate(steps):
            fields = {"reach": reach, "weight": weight, "first": int(k == 0), "last": int(k == 3)}
            stages.append(Stage(rk4, {"x": x, "v": v, "x_out": x_out, "v_out": v_out, **fields, **common}))
        return stages

    def stable_step(self, rates: Rates) -> float:
        """Return a stable substep [s]; see `Integrator.stable_step`.

        The step is stable for every system with these two rates, and within 8 % of the largest such step. A given
        system may allow more, up to twice as much if its fastest modes are critically damped. Eigenvalues h·μ of
        a mode have modulus h √λ_k if it oscillates, and otherwise lie in −h λ_b … 0.
        """
        oscillating = 2.615 / math.sqrt(rates.stiffness) if rates.stiffness else math.inf
        creeping = 2.785 / rates.damping if rates.damping else math.inf
        return min(oscillating, creeping)
