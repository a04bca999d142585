"""Functions of time, evaluated at all times of a frame at once where they can be."""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import checks

_LEAST = 8
"""Times that a function gets at once, at least: more than the coordinates that it may return."""
_SAME = 1e-9
"""What a function gives for an array may differ from what it gives for each number by this, relatively."""


def flat(value: Any) -> NDArray[np.float64]:
    """Return the numbers that a function of time gave, such as (displacement, turn), as one row."""
    try:
        array = np.asarray(value)
    except ValueError:  # of unequal lengths
        rows = [flat(one) for one in value]
        return np.concatenate(rows)
    if array.dtype.kind not in "biuf":
        raise ValueError(f"{checks.repr_short(value)} are not numbers")
    return array.astype(np.float64).ravel()


def sampled(function: Callable[[Any], Any], times: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return what a function of time gives at each time, its numbers side by side, shape [time_count, width].

    It is called with all times at once, which costs as much as one call. Where it can't take an array (as one that
    says `if t < 1`), or gives something else for it than for three of its numbers, it is called for each.

    Parameters
    ----------
    function
        Returns a number, several, or a tuple of these; of an array of times the same with an array in place of
        each number that depends on time.
    times
        When [s], shape [time_count].

    Raises
    ------
    Exception
        What the function raises for one of the times; ValueError if what it gives are no numbers, or not always as
        many.
    """
    count = len(times)
    tried = sorted({0, count // 2, count - 1})
    known = [flat(function(float(times[k]))) for k in tried]
    if count > len(tried):
        found = _at_once(function, times, len(known[0]))
        if found is not None and all(_same(found[k], row) for k, row in zip(tried, known, strict=True)):
            return found
        known = [flat(function(float(time))) for time in times]
    if len({len(row) for row in known}) > 1:
        raise ValueError(f"it gives {len(known[0])} numbers, and at another time {len(known[-1])}")
    return np.stack(known)


def _at_once(function: Callable[[Any], Any], times: NDArray, width: int) -> NDArray[np.float64] | None:
    """Return the same of one call with all times; None if the function can't be called so."""
    more = _LEAST - len(times)
    given = np.concatenate([times, np.repeat(times[-1:], more)]) if more > 0 else times.copy()
    try:
        with np.errstate(all="ignore"):
            rows = list(_leaves(function(given), len(given)))
        if len(rows) != width:
            return None
        found = np.empty((len(times), width))
        for k, row in enumerate(rows):
            found[:, k] = row[: len(times)] if row.ndim else row
        return found
    except Exception:  # whatever a function does with what it was not written for
        return None


def _same(found: NDArray, known: NDArray) -> bool:
    """Tell whether these are the same numbers, but for rounding."""
    if len(found) != len(known):
        return False
    pairs = zip(found.tolist(), known.tolist(), strict=True)  # few numbers: Python is quicker than NumPy
    return all(abs(one - other) <= _SAME * (1.0 + abs(other)) for one, other in pairs)


def _leaves(value: Any, count: int) -> Any:
    """Yield the numbers in what a function gave, each as one or as an array over time."""
    if isinstance(value, tuple | list):
        for one in value:
            yield from _leaves(one, count)
        return
    array = np.asarray(value, dtype=np.float64)
    if array.ndim == 0 or array.shape == (count,):
        yield array
    elif array.ndim == 1:  # constant
        yield from array
    elif array.shape[-1] == count:
        yield from array.reshape(-1, count)
    else:
        raise ValueError("no array over time")
