"""Leapfrog."""

from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import warp as wp

from .. import checks
from ..engine import Dynamics, Rates, State
from ..kernels.integrators import extrapolated_leapfrog, kick, symplectic_euler
from .base import Integrator, kick_drift_limit


class Work(NamedTuple):
    """What leapfrog needs beside the state."""

    v: wp.array
    """Velocities at the instant of the positions [m/s]."""


@dataclass(frozen=True)
class Leapfrog(Integrator):
    """Symplectic Euler with velocities stored half a substep before the positions.

    It makes a half kick back at the start, a half kick forward when a velocity is read, and the same substeps in
    between. Order 2 without damping (then it is velocity Verlet). The dampers use the velocity (1 + θ) v(n − ½) −
    θ v(n − 3/2). With θ = 0 it is half a substep old, which makes the order 1; with θ = ½ it is extrapolated to
    the time of the positions, which keeps order 2. Stable if h²λ(M⁻¹K) + 2(1 + 2θ) hλ(M⁻¹B) < 4. The half kick
    ignores contact: for a particle at rest on a floor it reports the velocity −g h/2. Reference: Hairer, Lubich &
    Wanner, Acta Numerica 12 (2003) 399-450.

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
    lag: ClassVar[float] = 0.5

    def __post_init__(self) -> None:
        """Check the argument."""
        checks.one_of("damper_extrapolation", self.damper_extrapolation, (0.0, 0.5))

    @property
    def lagging(self) -> bool:
        """Whether forces use velocities half a substep before the positions."""
        return not self.damper_extrapolation

    @property
    def method_state(self) -> int:
        """Arrays passed on: the velocities that dampers use, if they differ from those that it steps with."""
        return 1 if self.damper_extrapolation else 0

    def workspace(self, state: State) -> Work:
        """Return an array for the velocities at the time of the positions."""
        return Work(*state.empty_vectors(1))

    def start(self, dynamics: Dynamics, state: State, work: Work, h: float) -> None:
        """Take the velocities back by half a substep."""
        now = state.state_in
        for v_seen in now.method_state:
            wp.copy(v_seen, now.v)
        wp.copy(now.v, self._kicked(dynamics, state, work, -0.5 * h))

    def step(self, dynamics: Dynamics, state: State, work: Work, h: float) -> None:
        """Advance the state by one substep of h seconds."""
        now, then = state.state_in, state.state_out
        arrays = {"compensation": now.compensation, "x": now.x, "v": now.v, "x_out": then.x, "v_out": then.v}
        if self.damper_extrapolation:
            arrays |= {
                "v": now.method_state[0],
                "v_out": then.method_state[0],
                "v_half": now.v,
                "v_half_out": then.v,
            }
            dynamics.launch(extrapolated_leapfrog, h=h, theta=self.damper_extrapolation, **arrays)
        else:
            dynamics.launch(symplectic_euler, h=h, **arrays)
        state.flip()

    def velocity(self, dynamics: Dynamics, state: State, work: Work, h: float) -> wp.array:
        """Return the velocities at the instant of the positions [m/s]."""
        return self._kicked(dynamics, state, work, 0.5 * h)

    def _kicked(self, dynamics: Dynamics, state: State, work: Work, h: float) -> wp.array:
        """Return the velocities after a kick of h seconds."""
        now = state.state_in
        v = now.method_state[0] if self.damper_extrapolation else now.v
        dynamics.launch(kick, h=h, compensation=now.compensation, x=now.x, v=v, v_half=now.v, v_out=work.v)
        return work.v

    def stable_step(self, rates: Rates) -> float:
        """Return the largest stable substep [s]; see `Integrator.stable_step`."""
        return kick_drift_limit(rates.stiffness, (1 + 2 * self.damper_extrapolation) * rates.damping)
