"""Undoing what a failed call has changed in a simulation."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any


@contextmanager
def undoing(simulation: Any) -> Iterator[None]:
    """Restore the attributes of a simulation, and of its controller of substeps, if a block fails.

    That is enough where the block makes new arrays instead of writing to those that are there.
    """
    parts = [one for one in (simulation, vars(simulation).get("_step_controller")) if one is not None]
    before = [vars(one).copy() for one in parts]
    try:
        yield
    except BaseException:  # of a function of time, or of a signal's handler
        for one, kept in zip(parts, before, strict=True):
            vars(one).update(kept)
            for name in vars(one).keys() - kept.keys():
                del vars(one)[name]
        raise


@contextmanager
def undoing_in_place(stepping: Any) -> Iterator[None]:
    """Go back to the present state and baseline of a `Stepping` if a block that writes to its arrays fails."""
    baseline = stepping.watch.baseline
    stepping.keep()
    try:
        yield
    except BaseException:  # of a function of time, or of a signal's handler
        stepping.watch.compare_with(baseline)
        stepping.go_back()
        raise
