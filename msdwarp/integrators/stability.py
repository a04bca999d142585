"""Stability: bounds of a system's rates of oscillation and relaxation, and the stable substeps.

For a linear system M x'' = −K x − B x' an explicit method is stable if the step is below a limit that depends on
the largest eigenvalues of M⁻¹K and M⁻¹B; each integrator computes this limit (`stable_step`). Both eigenvalues
are bounded from above in one pass over the connections. With the axis d of a connection, xᵀKx =
Σ k (d·(x_i − x_j))² ≤ 2 Σ k ((d·x_i)² + (d·x_j)²) = 2 Σ_i x_iᵀ A_i x_i, where A_i = Σ k d dᵀ over the connections
of particle i, and so

    max_i |A_i| / m_i  ≤  λ_max(M⁻¹K)  ≤  2 max_i |A_i| / m_i

A stretched spring also has the transverse stiffness k (1 − l0/l); a damper has none.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

from .. import checks
from ..bodies import System, scaled_parts
from ..engine import Rates, rate_bounds
from .base import Integrator

SAFETY = 0.8
"""Fraction of the limit at rest that was stable in every measured scene, even in strongly stretched bodies."""
MOST_SUBSTEPS = 100_000
"""Maximal number of automatic substeps per frame: recording more would take too long."""


class UnstableStep(ValueError):
    """The requested substeps are longer than the stability limit."""


@dataclass(frozen=True)
class StepChoice:
    """The number of substeps per frame, and the reason.

    Attributes
    ----------
    rates
        Bounds of the system's rates.
    limit
        Largest stable substep [s].
    least
        Smallest stable number of substeps per frame.
    substeps
        The chosen or requested number of substeps per frame.
    fps
        Frames per second.
    refinement
        Factor on the number that stability requires, increased because energy grew or a frame diverged.
    asked
        Function that returns, as text, how many substeps each part of the scene asks for in its present state.
    """

    rates: Rates
    limit: float
    least: int
    substeps: int
    fps: float
    refinement: float = 1.0
    asked: Callable[[], str] = field(default=str, compare=False, repr=False)

    def refined(self, refinement: float) -> "StepChoice":
        """Return the choice of `refinement` times the number of substeps that stability requires."""
        return replace(self, substeps=math.ceil(self.substeps * refinement - 1e-9), refinement=refinement)

    @property
    def step(self) -> float:
        """Length of a substep [s]."""
        return 1.0 / (self.fps * self.substeps)

    @property
    def energy_swing(self) -> float:
        """Ratio of largest to smallest energy of the fastest mode under kick-drift: (1 + r)/(1 − r), r as below.

        Kick-drift methods conserve C = v² + ω²x² − h ω² x v. So the physical energy v² + ω²x² varies between
        C/(1 + r) and C/(1 − r), with the ratio r = hω/2 of step to limit. For r ≥ 1 nothing is conserved: 1.
        """
        ratio = self.step / self.limit if self.limit > 0 else 1.0
        return (1 + ratio) / (1 - ratio) if ratio < 1 else 1.0

    def __str__(self) -> str:
        """Describe the choice in a line."""
        frequency = math.sqrt(self.rates.stiffness) / (2 * math.pi)
        zeta = f"{self.rates.damping_ratio:.2g}"
        finer = f"; {self.refinement:.3g} times as many as for small motions" if self.refinement > 1 else ""
        return (
            f"{self.substeps} substeps a frame (stability needs at least {self.least}: fastest oscillation at "
            f"most {frequency:.3g} Hz, damping ratio {zeta}{finer}{self.asked()})"
        )


def stability_limit(system: System, integrator: Integrator) -> float:
    """Return the largest stable substep [s] of a system in its current state, computed from bounds of its rates.

    Raises
    ------
    ValueError
        If an argument has the wrong type.
    """
    checks.instance("system", system, System, "chain(5)")
    checks.instance("integrator", integrator, Integrator, "RK4()")
    return integrator.stable_step(rate_bounds(system))


def asked_by(parts: Mapping[str, Rates], integrator: Integrator, fps: float) -> str:
    """Return as text how many substeps a frame parts ask for: the three with the largest numbers."""
    limits = {name: (integrator.stable_step(rates), rates.own) for name, rates in parts.items()}
    wanted = {name: max(1.0 / limit, own) for name, (limit, own) in limits.items() if limit > 0.0}
    asked = {name: max(1, math.ceil(each / fps)) for name, each in wanted.items()}
    most = sorted(asked, key=asked.__getitem__, reverse=True)[:3]
    return f"; by part: {', '.join(f'{name} {asked[name]}' for name in most)}" if most else ""


def choose_forced(rates: Rates, integrator: Integrator, fps: float, substeps: int) -> StepChoice:
    """Return a choice of `substeps`, stable or not; limit and `least` are 0 if no step is stable."""
    limit = integrator.stable_step(rates)
    least = max(1, math.ceil(1.0 / (fps * limit))) if limit > 0.0 else 0
    return StepChoice(rates, limit, least, substeps, fps)


def choose_stable(
    rates: Rates, integrator: Integrator, fps: float, substeps: int | None = None, safety: float = SAFETY
) -> StepChoice:
    """Return a choice of the given substeps per frame, or of the smallest number with the margin `safety`.

    Raises
    ------
    UnstableStep
        If the given substeps are too few, no step is stable, or more than MOST_SUBSTEPS would be needed.
    """
    choice = choose_forced(rates, integrator, fps, substeps or 1)
    if choice.limit <= 0.0:
        raise UnstableStep(f"{integrator} is stable at no step here: a spring has no linear damper beside it")
    if substeps is not None:
        if substeps < choice.least:
            raise UnstableStep(
                f"substeps is {substeps}; at least {choice.least} a frame are stable here, "
                f"{math.ceil(choice.least / safety)} with a margin"
            )
        return choice
    wanted = max(1.0 / (safety * integrator.stable_step(rates)), rates.own) / fps
    if wanted > MOST_SUBSTEPS:
        raise UnstableStep(
            f"{wanted:.2g} substeps a frame would be needed, more than {MOST_SUBSTEPS}: raise fps, "
            "or soften what is stiffest for its mass"
        )
    return replace(choice, substeps=max(1, math.ceil(wanted)))


def match_stiffness(system: System, other: System) -> System:
    """Return a body made as stiff, and as damped, as another body's stable step allows.

    The body with the shortest stable step sets a scene's step. A heavier body can be stiffer at no extra cost:
    for equal bounds of the rates, λ(M⁻¹K) and λ(M⁻¹B), stiffness is proportional to mass. So a heavy ball on light
    foam is almost rigid, but has momentum and energy like any other body.

    Parameters
    ----------
    system
        The body to stiffen; ratios among its springs stay the same, and among its dampers.
    other
        The body whose stable step must not be reduced.

    Raises
    ------
    ValueError
        If an argument is not a System, or has no springs.
    """
    checks.instance("system", system, System, "ball(0.2, 0.04)")
    checks.instance("other", other, System, "box((5, 5, 5))")
    own, wanted = rate_bounds(system), rate_bounds(other)
    for name, rates in (("system", own), ("other", wanted)):
        if not rates.stiffness > 0.0:
            raise ValueError(f"{name} has no springs that hold a free particle; it must have some")
    stiffer = wanted.stiffness / own.stiffness
    more_damped = wanted.damping / own.damping if own.damping > 0.0 else 1.0
    parts = scaled_parts(vars(system), stiffer, more_damped)
    return system.replace(stiffness=stiffer * system.stiffness, damping=more_damped * system.damping, **parts)
