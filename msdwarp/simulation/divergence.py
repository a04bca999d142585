"""What is said when a run cannot go on: where, when and why."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..bodies import System

INSIDE_MATTERS = 1.0
"""How long what started inside an obstacle or a body explains why a run has diverged [s]."""


class Divergence(NamedTuple):
    """What was found out about a frame that went wrong."""

    position: NDArray
    """Positions after the last substep that went well [m], shape [particle_count, d]."""
    substep: int
    """The substep that went wrong, from 1."""
    particle: int
    """The first particle concerned."""


class SimulationDiverged(RuntimeError):
    """The run cannot continue: a number is no longer finite, or the energy has grown without a cause."""

    def __init__(
        self,
        message: str,
        *,
        time: float,
        substep: int,
        particle: int,
        connection: int | None,
        strain: float,
        substeps_needed: int,
    ) -> None:
        super().__init__(message)
        self.time = time
        """When it happened [s]."""
        self.substep = substep
        """The substep of its frame, from 1."""
        self.particle = particle
        """The first particle concerned."""
        self.connection = connection
        """Its most strained connection just before, if it has any."""
        self.strain = strain
        """The strain of that connection."""
        self.substeps_needed = substeps_needed
        """Substeps per frame that are stable for the last good frame; 0 where none are."""


def describe(
    system: System,
    trouble: Divergence,
    time: float,
    dt: float,
    substeps: int,
    needed: int,
    inside: str | None = None,
    gained: float | None = None,
) -> SimulationDiverged:
    """Return the exception for a frame of substeps of `dt` [s], in which trouble was found.

    Parameters
    ----------
    system, time
        The system as it was when the frame began, and when that was [s].
    needed
        How many substeps would have been stable when the frame began; 0 where none are.
    inside
        Words about what started inside an obstacle or a body: that is then the cause.
    gained
        The share of its scale by which energy has grown from nothing though substeps were refined, if that is why.
    """
    position, substep, particle = trouble
    connection, strain, stretched = None, float("nan"), ""
    mine = np.flatnonzero((system.connections == particle).any(axis=1))
    if len(mine):
        i, j = system.connections[mine].T
        with np.errstate(over="ignore", invalid="ignore"):  # what diverges may be large beyond all numbers
            length = np.linalg.norm(position[i].astype(np.float64) - position[j], axis=1)
            strains = length / system.rest_length[mine] - 1
        worst = int(np.argmax(np.abs(strains)))
        connection, strain = int(mine[worst]), float(strains[worst])
        stretched = f", whose connection {connection} was at strain {strain:.3g} before"
    advice = f"at least {needed} substeps a frame are stable there" if needed else "no step is stable here"
    if 0 < needed <= substeps:
        advice += f", so strong stretching must have come on within the frame: try {2 * substeps}"
    if inside and time < INSIDE_MATTERS:
        advice = inside
    when = time + substep * dt
    what = "diverged"
    if gained is not None:
        what = f"energy has grown by {gained:.0%} from nothing, and shorter steps did not prevent it: ended"
    return SimulationDiverged(
        f"{what} at {when:.4g} s, in substep {substep} of {substeps}, first at particle {particle}{stretched}; "
        f"{advice}. The last good frame, at {time:.4g} s, is kept",
        time=when,
        substep=substep,
        particle=particle,
        connection=connection,
        strain=strain,
        substeps_needed=needed,
    )
