"""Functions of time, evaluated at all times of a frame at once if possible."""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import checks

_LEAST = 8
"""Minimal number of times in a call: more than the coordinates that a function may return."""
_SAME = 1e-9
"""Allowed relative difference between a function's values for an array and for single numbers."""


def flat(value: Any) -> NDArray[np.float64]:
    """Return the numbers that a function of time returned, such as (displacement, turn), as one row."""
    try:
        array = np.asarray(value)
    except ValueError:  # of unequal lengths
        return np.concatenate([flat(one) for one in value])
    if array.dtype.kind not in "biuf":
        raise ValueError(f"{checks.repr_short(value)} are not numbers")
    return array.astype(np.float64).ravel()


def sampled(function: Callable[[Any], Any], times: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the values of a function of time at each time, its numbers side by side, shape [time_count, width].

    The function returns a number, several, or a tuple of these. It is called with all times at once, which takes
    as long as one call. It is called for each time if it cannot take an array (with `if t < 1` in it), or if the
    values for an array differ from those for three single times.

    Raises the function's own exceptions, and ValueError if its values are not numbers, or their number varies.
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
    """Return the values from one call with all times; None if the function does not support this."""
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
    except Exception:  # a function not written for arrays may raise anything
        return None


def _same(found: NDArray, known: NDArray) -> bool:
    """Return whether numbers are equal except for rounding."""
    if len(found) != len(known):
        return False
    pairs = zip(found.tolist(), known.tolist(), strict=True)  # for few numbers faster than NumPy
    return all(abs(one - other) <= _SAME * (1.0 + abs(other)) for one, other in pairs)


def _leaves(value: Any, count: int) -> Any:
    """Yield the numbers that a function returned, each a scalar or an array over time."""
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
