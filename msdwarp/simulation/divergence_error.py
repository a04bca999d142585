"""The error of a run that cannot continue: it says where, when and why.

`engine/diagnostics/divergence_monitor.py` detects divergence; in ensembles `kernels/reductions/frozen_worlds.py`.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..bodies import System
from ..engine import rate_bounds
from ..integrators import Integrator, choose_forced

INSIDE_MATTERS = 1.0
"""Until this time [s] an initial overlap with an obstacle or body is assumed to cause a divergence."""


class Divergence(NamedTuple):
    """Where in a frame a run has diverged."""

    position: NDArray
    """Positions before the first bad substep [m], shape [particle_count, d]."""
    substep: int
    """The first bad substep, counted from 1."""
    particle: int
    """The first particle concerned."""


class SimulationDiverged(RuntimeError):
    """The run cannot continue: a number is no longer finite, or the energy has grown without a cause.

    Attributes
    ----------
    time
        Time of the divergence [s].
    substep
        Number of the substep in its frame, counted from 1.
    particle
        The first particle concerned.
    connection
        The particle's most strained connection just before; None if it has none.
    strain
        The strain of this connection.
    substeps_needed
        Substeps per frame that are stable for the last good frame; 0 if no number of substeps is.
    """

    time: float
    substep: int
    particle: int
    connection: int | None
    strain: float
    substeps_needed: int

    def __init__(self, message: str, **details: float | None) -> None:
        super().__init__(message)
        vars(self).update(details)


def divergence_of(
    simulation: Any, method: Integrator, inside: str | None, failure: Any = None
) -> SimulationDiverged:
    """Return the error for a simulation's last frame, after going back to its start; see `describe`.

    `failure` is that of the controller of substeps, whose last attempt is described.
    """
    now, first, gained = simulation, simulation.stepping, None
    try:
        if failure is not None:
            now.stepping, gained = failure.stepping, failure.gained
        too_far, divergence = now.stepping.too_far, now.stepping.locate_divergence()
        rates = rate_bounds(now.system, now.assembly, now.state)
        needed = max(now.choice.least, choose_forced(rates, method, now.fps, 1).least)
        system = now.system.replace(**now.assembly.changed_fields())
        return describe(system, divergence, now.time, now.dt, now.substeps, needed, inside, gained, too_far)
    finally:
        if failure is not None:  # with the substeps of the last good frame
            now.stepping = first
            first.go_back()


def describe(
    system: System,
    divergence: Divergence,
    time: float,
    dt: float,
    substeps: int,
    needed: int,
    inside: str | None = None,
    gained: float | None = None,
    too_far: float = 0.0,
) -> SimulationDiverged:
    """Return the exception for a frame of `substeps` substeps of `dt` [s] that diverged.

    `system` and `time` [s] are from the frame's start, and `needed` is the least number of substeps that is stable
    there, or 0. `inside` is a message about an initial overlap, which is then the cause. `gained` is the
    unexplained rise of energy as a fraction of its scale, if this rise ended the run. `too_far` is the path of a
    particle in a substep [m], if contact would miss bodies on it.
    """
    position, substep, particle = divergence
    connection, strain, stretched = None, float("nan"), ""
    mine = np.flatnonzero((system.connections == particle).any(axis=1))
    if len(mine):
        i, j = system.connections[mine].T
        with np.errstate(over="ignore", invalid="ignore"):  # positions may have overflowed
            length = np.linalg.norm(position[i].astype(np.float64) - position[j], axis=1)
            strains = length / system.rest_length[mine] - 1
        worst = int(np.argmax(np.abs(strains)))
        connection, strain = int(mine[worst]), float(strains[worst])
        stretched = f", whose connection {connection} was at strain {strain:.3g} before"
    advice = f"at least {needed} substeps a frame are stable there" if needed else "no step is stable here"
    if 0 < needed <= substeps:
        advice += (
            ", so a force or a law is not finite there, or stretching or contact came on within the frame: then "
            f"try {2 * substeps}"
        )
    if too_far:
        advice = f"a particle moves by {too_far:.3g} m in a substep, and contact would miss bodies on its way"
        advice += ": take more substeps, or raise fps"
    elif inside and time < INSIDE_MATTERS:
        advice = inside
    when = time + substep * dt
    event = "diverged"
    if gained is not None:
        event = f"energy has grown by {gained:.0%} without a cause, and shorter steps did not prevent it: ended"
    return SimulationDiverged(
        f"{event} at {when:.4g} s, in substep {substep} of {substeps}, first at particle {particle}{stretched}; "
        f"{advice}. The last good frame, at {time:.4g} s, is kept",
        time=when,
        substep=substep,
        particle=particle,
        connection=connection,
        strain=strain,
        substeps_needed=needed,
    )
