"""The error of a run that cannot continue: it says where, when and why.

`engine/diagnostics/divergence_monitor.py` detects divergence; in ensembles `kernels/reductions/frozen_worlds.py`.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..engine import rate_bounds
from ..integrators import choose_forced
from .pinned_staging import to_host
from .stepping import Stepping

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


def locate_divergence(stepping: Stepping) -> Divergence:
    """Simulate the last frame again, and check each substep; return where it diverged, and go back."""
    stepping.go_back()
    stepping.dynamics.begin_frame(stepping.frame_start)
    good, substep = to_host(stepping.state.x), 0
    for substep in range(stepping.choice.substeps):
        good = to_host(stepping.state.x)
        stepping.stepper.take(1, substep)
        stepping.watch.look(stepping.found)
        stepping.found.mark()
        if stepping.watch.finds_trouble(stepping.found):
            break
    divergence = Divergence(good, substep + 1, stepping.watch.worst_particle())
    stepping.go_back()
    return divergence


def divergence_of(run: Any, failure: Any = None) -> SimulationDiverged:
    """Return the error for the last frame of a `Run`, after going back to its start.

    `failure` is that of the controller of substeps, whose last attempt is described: its `gained` is the rise of
    energy without a cause, as a fraction of its scale, if this ended the run.
    """
    stepping, gained = (run.stepping, None) if failure is None else (failure.stepping, failure.gained)
    choice, time, inside, too_far = stepping.choice, run.time, run.inside, stepping.too_far
    try:
        position, substep, particle = locate_divergence(stepping)
        rates = rate_bounds(run.problem.system, stepping.assembly, stepping.state)
        needed = max(choice.least, choose_forced(rates, run.chooser.method, choice.fps, 1).least)
        system = run.problem.system.replace(**stepping.assembly.changed_fields())
    finally:
        if failure is not None:  # with the substeps of the last good frame
            run.stepping.go_back()
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
    if 0 < needed <= choice.substeps:
        advice += (
            ", so a force or a law is not finite there, or stretching or contact came on within the frame: then "
            f"try {2 * choice.substeps}"
        )
    if too_far:
        advice = f"a particle moves by {too_far:.3g} m in a substep, and contact would miss bodies on its way"
        advice += ": take more substeps, or raise fps"
    elif inside and time < INSIDE_MATTERS:
        advice = inside
    when = time + substep * choice.step
    event = "diverged"
    if gained is not None:
        event = f"energy has grown by {gained:.0%} without a cause, and shorter steps did not prevent it: ended"
    return SimulationDiverged(
        f"{event} at {when:.4g} s, in substep {substep} of {choice.substeps}, first at particle {particle}"
        f"{stretched}; {advice}. The last good frame, at {time:.4g} s, is kept",
        time=when,
        substep=substep,
        particle=particle,
        connection=connection,
        strain=strain,
        substeps_needed=needed,
    )
