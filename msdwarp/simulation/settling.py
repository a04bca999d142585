"""Settling: moves a system to static equilibrium by FIRE, much faster than damping stops its motion."""

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .. import checks
from ..bodies import LINEAR, System, scaled_parts
from ..engine import Assembly, Dynamics, rate_bounds, starting_state, weight
from ..integrators import SymplecticEuler, choose_stable
from ..runtime import in_turn
from ..world import Attachment, Collider, Load, Problem
from .divergence_error import SimulationDiverged, locate_divergence
from .stepping import Stepping

SUBSTEPS = 64
"""Substeps of a frame at first; the residual force is read between frames."""
FRACTION_OF_WEIGHT = 1e-3
"""Default tolerance as a fraction of the mean weight of a particle."""
FRACTION_OF_START = 1e-4
"""Default tolerance without gravity, as a fraction of the largest force in the first frame."""
SAFETY, LEAST_SAFETY = 0.6, 0.03
"""Fraction of the longest stable substep: h² λ = 1.44, see `msdwarp.kernels.integrators.fire`. If springs stiffen
so fast that settling diverges, it begins again with shorter substeps, down to the least fraction."""
MOST_SUBSTEPS = 200_000
"""Default number of substeps after which settling ends, converged or not."""
REFRESH = 8
"""Frames after which the stable substep is computed again."""
FRAMES_TO_SEPARATE = 40
"""Frames within which what overlaps at the start is moved apart; nothing is settled before."""
FAR = 1000.0
"""A particle that has moved by more than this many sizes of the system falls freely."""
NEAR = 0.9
"""If the needed substeps exceed this fraction of the current number, the number is kept."""


class Settled(NamedTuple):
    """Result of settling a system.

    Attributes
    ----------
    residual
        Largest remaining force on a free particle [N].
    tolerance
        Largest allowed residual force [N].
    substeps
        Number of substeps of FIRE.
    """

    residual: float
    tolerance: float
    substeps: int

    @property
    def converged(self) -> bool:
        """Whether the residual force is within the tolerance."""
        return self.residual <= self.tolerance

    def __str__(self) -> str:
        """Describe the result in a line."""
        told, within = ("settled", "within") if self.converged else ("not settled", "above")
        return (
            f"{told} in {self.substeps} substeps: the largest force left is {self.residual:.3g} N, {within} the "
            f"tolerance of {self.tolerance:.3g} N"
        )


@in_turn
def settled(
    problem: Problem,
    assemble: Callable[..., Assembly],
    *,
    tolerance: float | None = None,
    most: int = MOST_SUBSTEPS,
    threads: int | str = "auto",
    time: float = 0.0,
    safety: float = SAFETY,
) -> tuple[Problem, Settled, dict[str, NDArray]]:
    """Return (the problem at rest in equilibrium, result, its contacts), under the loads at a `time` [s].

    `assemble` uploads a problem, with the options of the simulation. FIRE runs for at most `most` substeps, in
    float64 and without dampers, since these do not change equilibria. See `Simulation.settle`.
    """
    tolerance = None if tolerance is None else checks.positive("tolerance", tolerance)
    most = checks.count("substeps", most, 1)
    system = problem.system
    parts = scaled_parts(vars(system), 1.0, 0.0)
    still = np.zeros_like(system.velocity)
    undamped = system.replace(velocity=still, damping=0.0, damper=LINEAR, **parts)
    at_rest = problem.replace(
        system=undamped,
        colliders=[held_at(f"colliders[{k}]", one, time) for k, one in enumerate(problem.colliders)],
        loads=[held_at(f"loads[{k}]", one, time) for k, one in enumerate(problem.loads)],
        contact=[replace(one, restitution=1.0) for one in problem.contact_rules],  # dampers would stop FIRE
        probes={},
    )
    assembly = assemble(at_rest, precision="float64", settles=True)
    fire = assembly.fire
    assert fire is not None
    method = SymplecticEuler()
    state = starting_state(undamped, assembly, method.method_state, time, 1.0)
    rates = rate_bounds(undamped, assembly, state)
    limit = method.stable_step(rates)
    if not math.isfinite(limit):
        raise ValueError("the system has no springs that hold a free particle; it must have some to settle")
    fps = 1.0 / (SUBSTEPS * safety * limit)
    first = FRAMES_TO_SEPARATE if assembly.release_overlaps_within(FRAMES_TO_SEPARATE / fps) else 0
    stepping = Stepping(
        Dynamics(assembly, threads),
        state,
        method,
        [choose_stable(rates, method, fps, safety=safety)],
        energy_limit=math.inf,
        blocks=None,
        still=True,
        time=time,
    )
    taken = frame = 0
    residual = math.inf
    while frame <= first or (taken < most and (tolerance is None or residual > tolerance)):
        if not stepping.advance(time):
            if safety > LEAST_SAFETY:
                how: dict[str, Any] = {"tolerance": tolerance, "most": most, "threads": threads, "time": time}
                return settled(problem, assemble, **how, safety=0.25 * safety)
            found = locate_divergence(stepping)
            raise SimulationDiverged(
                f"settling diverged in substep {taken + found.substep}, at particle {found.particle}: a number is "
                "no longer finite",
                time=time,
                substep=found.substep,
                particle=found.particle,
            )
        taken, frame, residual = taken + stepping.choice.substeps, frame + 1, fire.largest_force
        if tolerance is None and frame > first:
            free = int(np.isfinite(assembly.model.mass).sum())
            fall = FRACTION_OF_WEIGHT * weight(assembly.model) / max(free, 1)
            tolerance = fall if fall > 0.0 else FRACTION_OF_START * fire.strongest_force
        if frame % REFRESH == 0:
            check_near(system, stepping.frame(time).position)
            choice = choose_stable(rate_bounds(undamped, assembly, stepping.state), method, fps, safety=safety)
            if not NEAR * stepping.choice.substeps <= choice.substeps <= stepping.choice.substeps:
                stepping = stepping.with_choice(choice)
    assert tolerance is not None
    changed = stepping.assembly.changed_fields()
    result = system.replace(position=stepping.frame(time).position, velocity=still, **changed)
    return problem.replace(system=result), Settled(residual, tolerance, taken), assembly.contacts()


def check_near(system: System, position: NDArray) -> None:
    """Raise ValueError if a particle is so far from where it was that nothing can hold it."""
    way = np.linalg.norm(position - system.position, axis=1)
    far = int(way.argmax())
    size = max(np.ptp(system.position, axis=0).max(), np.max(system.rest_length, initial=0.0))
    if way[far] > FAR * size:
        named = "".join(f" of {name!r}" for name, of in system.groups.items() if far in of)
        raise ValueError(
            f"particle {far}{named} has moved by {way[far]:.3g} m while settling, over {FAR:g} times the size of "
            "the system: nothing holds it; it must be pinned, rest on something, or be left out"
        )


def held_at(name: str, one: Collider | Load, time: float) -> Any:
    """Return an obstacle or a load that stays where its motion has it at `time` [s]; `name` is for messages."""
    if isinstance(one, Attachment):
        by = one.carried_by
        return one if by is None else replace(one, carried_by=held_at(f"{name}.carried_by", by, time))
    motion = getattr(one, "motion", None)
    if motion is None:
        return one
    try:
        place = motion(time)
    except Exception as error:
        raise ValueError(f"{name}.motion has no place at {time:g} s: {checks.message(error)}") from error
    return replace(one, motion=lambda _: place)
