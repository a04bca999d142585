"""Leapfrog."""

from dataclasses import dataclass
from typing import ClassVar

from .. import checks
from ..engine import Rates, Stage, State
from ..kernels.integrators.euler import extrapolated_leapfrog, symplectic_euler
from .base import Integrator, kick_drift_limit


@dataclass(frozen=True)
class Leapfrog(Integrator):
    """Symplectic Euler with velocities stored half a substep before the positions.

    The method makes a half kick back at the start, a half kick forward when a velocity is read, and equal substeps
    in between. Order 2 without damping (then it is velocity Verlet). Dampers use the velocity (1 + θ) v(n − ½) −
    θ v(n − 3/2). With θ = 0 this is half a substep old, which lowers the order to 1; θ = ½ extrapolates it to
    the time of the positions, which keeps order 2. Stable if h²λ(M⁻¹K) + 2(1 + 2θ) hλ(M⁻¹B) < 4. The half kick
    ignores contact: for a particle at rest on a floor it gives the velocity −g h/2. Reference: Hairer, Lubich &
    Wanner, Acta Numerica 12 (2003) 399-450.

    Parameters
    ----------
    damper_extrapolation
        θ, 0 or 0.5.

    Raises
    ------
    ValueError
        If `damper_extrapolation` is neither 0 nor 0.5.
    """

    damper_extrapolation: float = 0.0

    order: ClassVar[int] = 2
    lag: ClassVar[float] = 0.5
    staggered: ClassVar[bool] = True

    def __post_init__(self) -> None:
        """Check the argument."""
        checks.one_of("damper_extrapolation", self.damper_extrapolation, (0.0, 0.5))

    @property
    def lagging(self) -> bool:
        """Whether forces use velocities of half a substep before the positions."""
        return not self.damper_extrapolation

    @property
    def method_state(self) -> int:
        """Number of arrays passed from substep to substep: 1 with θ > 0, for the previous velocities; else 0."""
        return 1 if self.damper_extrapolation else 0

    def substep(self, state: State, work: None, h: float) -> list[Stage]:
        """Return the only stage of a substep of h seconds."""
        motion = state.motion()
        if not self.damper_extrapolation:
            return [Stage(symplectic_euler, {"h": h, **motion})]
        halves = {"v_half": motion["v"], "v_half_out": motion["v_out"]}
        motion |= {"v": state.state_in.method_state[0], "v_out": state.state_out.method_state[0]}
        return [Stage(extrapolated_leapfrog, {"h": h, "theta": self.damper_extrapolation, **motion, **halves})]

    def stable_step(self, rates: Rates) -> float:
        """Return the largest stable substep [s]; see `Integrator.stable_step`."""
        return kick_drift_limit(rates.stiffness, (1 + 2 * self.damper_extrapolation) * rates.damping)
