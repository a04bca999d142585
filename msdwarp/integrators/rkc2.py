"""Runge-Kutta-Chebyshev of order 2."""

import functools
import math
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np
import warp as wp
from numpy.polynomial.chebyshev import Chebyshev
from numpy.typing import NDArray

from .. import checks
from ..engine import Rates, Stage, State
from ..kernels.integrators.runge_kutta import chebyshev
from .base import Integrator

MOST_STAGES = 40
MOST_AUTOMATIC_STAGES = 5
"""With more stages a substep is so long that a body that hits a floor leaves the linear regime within it."""


class Coefficients(NamedTuple):
    """Coefficients of stage j of s: Y_j − Y0 = mu D_{j−1} + nu D_{j−2} + h (reach F_{j−1} + reach0 F0)."""

    first: float
    mu: NDArray
    nu: NDArray
    reach: NDArray
    reach0: NDArray
    w0: float
    w1: float
    a: float
    b: float


@functools.cache
def coefficients(stages: int) -> Coefficients:
    """Return the coefficients of Sommeijer, Shampine & Verwer (1997), damped by ε = 2/13."""
    s, w0 = stages, 1 + (2 / 13) / stages**2
    T = [Chebyshev.basis(j) for j in range(s + 1)]
    value, slope, bend = (np.array([t.deriv(n)(w0) if n else t(w0) for t in T]) for n in range(3))
    w1 = slope[s] / bend[s]
    b = np.empty(s + 1)
    b[2:] = bend[2:] / slope[2:] ** 2
    b[:2] = b[2]
    a = 1 - b * value
    j = np.arange(2, s + 1)
    mu, reach = 2 * b[j] * w0 / b[j - 1], 2 * b[j] * w1 / b[j - 1]
    return Coefficients(b[1] * w1, mu, -b[j] / b[j - 2], reach, -a[j - 1] * reach, w0, w1, a[s], b[s])


@functools.cache
def tableau(stages: int) -> NDArray:
    """Return Butcher's coefficients, equivalent to the recurrence by which the stages are computed."""
    c, rows = coefficients(stages), np.zeros((stages + 1, stages))
    rows[1, 0] = c.first
    for j, (mu, nu, reach, reach0) in enumerate(zip(c.mu, c.nu, c.reach, c.reach0, strict=True), 2):
        rows[j] = mu * rows[j - 1] + nu * rows[j - 2]
        rows[j, [j - 1, 0]] += reach, reach0
    return rows[1:]


@functools.cache
def real_reach(stages: int) -> float:
    """Return the stability limit along the negative real axis: about 0.653 (s² − 1)."""
    s, c = stages, coefficients(stages)
    T = Chebyshev.basis(s)
    return float((c.w0 + 1) * T.deriv(2)(c.w0) / T.deriv(1)(c.w0))


@functools.cache
def disc_reach(stages: int) -> float:
    """Return the radius of the largest stable disc that touches the imaginary axis at 0.

    Modes with proportional damping b = r k have eigenvalues on the circle |μ + 1/r| = 1/r while they oscillate,
    so springs with damping / stiffness of at least r require h/r to be at most this radius.
    """
    s, c = stages, coefficients(stages)
    angle = np.linspace(0, np.pi, 721)
    T = Chebyshev.basis(s)

    def stable(radius: float) -> bool:
        discs = radius * np.linspace(0.02, 1, 50)[:, None]
        z = discs * (np.exp(1j * angle) - 1)
        return bool(np.all(np.abs(c.a + c.b * T(c.w0 + c.w1 * z)) <= 1 + 1e-12))

    low, high = 0.0, real_reach(s)
    while high - low > 1e-4 * high:
        middle = (low + high) / 2
        low, high = (middle, high) if stable(middle) else (low, middle)
    return low


class StageArrays(NamedTuple):
    """A stage: changes since the start of the substep, positions, velocities."""

    dx: wp.array
    dv: wp.array
    x: wp.array
    v: wp.array


class Work(NamedTuple):
    """Workspace: the initial acceleration, and two stages."""

    a0: wp.array
    """Accelerations at the start of the substep [m/s²]."""
    previous: StageArrays
    current: StageArrays


@dataclass(frozen=True)
class RKC2(Integrator):
    """Runge-Kutta-Chebyshev of order 2, for overdamped systems.

    With s stages the method is stable along the negative real axis up to 0.653 (s² − 1), so the work per simulated
    time falls as 1/s. Every spring needs a damper: undamped oscillations are never stable. Reference: Sommeijer,
    Shampine & Verwer, J. Comput. Appl. Math. 88 (1997) 315-326.

    Parameters
    ----------
    stages
        Force evaluations per substep, from 2 to 40; by default the smallest stable number, from 2 to 5.

    Raises
    ------
    ValueError
        If `stages` is out of range.
    """

    stages: int | None = None

    order: ClassVar[int] = 2
    long_steps: ClassVar[bool] = True
    supports_contact: ClassVar[bool] = False  # collisions in such long steps would gain or lose energy

    def __post_init__(self) -> None:
        """Check the argument."""
        if self.stages is not None and checks.count("stages", self.stages, 2) > MOST_STAGES:
            raise ValueError(f"stages is {self.stages}; it must be at most {MOST_STAGES}")

    @property
    def tableau(self) -> NDArray:
        """Butcher's coefficients; see `Integrator.tableau`."""
        return tableau(self.stages or 2)

    def workspace(self, state: State) -> Work:
        """Return arrays for the acceleration of the first stage, and for two stages."""
        a0, *stages = state.model.vectors_together(9)
        return Work(a0, StageArrays(*stages[:4]), StageArrays(*stages[4:]))

    def substep(self, state: State, work: Work, h: float) -> list[Stage]:
        """Return the s stages of a substep of h seconds."""
        c, start, end = coefficients(self.evaluations), state.state_in, state.state_out
        a0, previous, current = work
        common = {"compensation": start.compensation, "x0": start.x, "v0": start.v, "a0": a0}
        rows = [(0.0, 0.0, c.first, 0.0), *zip(c.mu, c.nu, c.reach, c.reach0, strict=True)]
        x, v, stages = start.x, start.v, list[Stage]()
        for k, (mu, nu, reach, reach0) in enumerate(rows):
            nu = nu if k > 1 else 0.0  # D_0 = 0
            first, last = k == 0, k == len(rows) - 1
            x_out, v_out = (end.x, end.v) if last else (current.x, current.v)
            motion = {"x": x, "v": v, "x_out": x_out, "v_out": v_out}
            numbers = {"mu": mu, "nu": nu, "reach": h * reach, "reach0": h * reach0}
            changes = {"dx": previous.dx, "dv": previous.dv, "dx_out": current.dx, "dv_out": current.dv}
            flags = {"first": int(first), "last": int(last)}
            stages.append(Stage(chebyshev, {**motion, **numbers, **changes, **flags, **common}))
            x, v, previous, current = x_out, v_out, current, previous
        return stages

    def stable_step(self, rates: Rates) -> float:
        """Return a stable substep [s] for the given number of stages, or for the largest automatic number."""
        stages = self.stages or MOST_AUTOMATIC_STAGES
        creeping = real_reach(stages) / rates.damping if rates.damping else math.inf
        return min(creeping, disc_reach(stages) * rates.least_ratio)

    def fitted(self, rates: Rates, h: float) -> "RKC2":
        """Return the method with the smallest stable number of stages, unless a number is given."""
        if self.stages is not None:
            return self
        options = [RKC2(s) for s in range(2, MOST_AUTOMATIC_STAGES + 1)]
        return next((method for method in options if method.stable_step(rates) >= h), options[-1])
