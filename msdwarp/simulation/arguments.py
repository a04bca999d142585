"""Checks of the arguments of simulations and runs."""

from collections.abc import Sequence

from .. import checks
from ..bodies import System
from ..integrators import MOST_SUBSTEPS
from ..world import Change, Load

MOST_FRAMES = 10**9
"""Maximal number of frames of a run."""


def frame_count(duration: float, fps: float) -> int:
    """Return the number of frames of 1/fps s in a duration [s], rounded; raise ValueError if it is 0."""
    frames = checks.positive("duration", duration) * checks.positive("fps", fps)
    count = round(min(frames, 2.0 * MOST_FRAMES))
    if count > MOST_FRAMES:
        raise ValueError(
            f"duration is {duration:g}; it must be at most {MOST_FRAMES} frames, {MOST_FRAMES / fps:g} s"
        )
    if count == 0:
        raise ValueError(f"duration is {duration:g}; it must be at least one frame, {1 / fps:g} s")
    return count


def given_substeps(substeps: int | str) -> int | None:
    """Return the requested number of substeps, None for "auto"; raise ValueError for any other value."""
    if isinstance(substeps, str):
        if substeps != "auto":
            raise ValueError(f"substeps is {substeps!r}; it must be a whole number or 'auto'")
        return None
    if checks.count("substeps", substeps, 1) > MOST_SUBSTEPS:
        raise ValueError(f"substeps is {substeps}; it must be at most {MOST_SUBSTEPS}")
    return int(substeps)


def in_order(schedule: Sequence[Change], system: System, loads: Sequence[Load]) -> list[Change]:
    """Return changes sorted by time; raise ValueError if one cannot be applied to this system and these loads."""
    changes = checks.sequence("schedule", schedule, Change, "at(1.0, mass=2.0)")
    for k, change in enumerate(changes):
        try:
            change.foreseen.applied_to(system)  # raise before anything runs
        except ValueError as error:
            raise ValueError(f"schedule[{k}].{error}") from error
    changes = sorted(changes, key=lambda change: change.time)
    for change in changes:
        loads = change.released_from(loads, system)
    return changes
