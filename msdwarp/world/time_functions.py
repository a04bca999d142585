"""Functions of time, evaluated at all times of a frame in one call if possible."""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import checks

_LEAST = 8
"""Minimal number of times in a call: more than the number of coordinates that a function may return."""
_SAME = 1e-9
"""Allowed relative difference between values for an array of times and for single times."""


def flat(value: Any) -> NDArray[np.float64]:
    """Return all numbers that a function of time has returned, such as (displacement, turn), as one row."""
    try:
        array = np.asarray(value)
    except ValueError:  # parts of different lengths
        if not isinstance(value, tuple):
            raise ValueError(f"it returned {checks.repr_short(value)}, whose rows differ in length") from None
        return np.concatenate([flat(one) for one in value])
    if array.dtype.kind not in "biuf":
        raise ValueError(f"it returned {checks.repr_short(value)}; it must return numbers")
    if np.ma.is_masked(value):
        raise ValueError(f"it returned {checks.repr_short(value)}, which has masked entries")
    return array.astype(np.float64).ravel()


def sampled(function: Callable[[Any], Any], times: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the values of a function of time at each time, as rows of numbers, shape [time_count, width].

    The function returns a number, several, or a tuple of these. It is called once with all times, which takes
    about as long as one time. If it cannot take an array (with `if t < 1` in it), or values for an array differ
    from values for three single times, it is called for each time.

    Raises the function's own exceptions, and ValueError if values are not numbers, or their number varies.
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
    """Return values from one call with all times; None if the function does not support arrays."""
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
    except Exception:  # a function not written for arrays may raise any error
        return None


def _same(found: NDArray, known: NDArray) -> bool:
    """Return whether numbers are equal except for rounding."""
    if len(found) != len(known):
        return False
    pairs = zip(found.tolist(), known.tolist(), strict=True)  # faster than NumPy for few numbers
    return all(abs(one - other) <= _SAME * (1.0 + abs(other)) for one, other in pairs)


def _leaves(value: Any, count: int) -> Any:
    """Yield each number in a function's result, as a scalar or an array over time."""
    if isinstance(value, tuple | list):
        for one in value:
            yield from _leaves(one, count)
        return
    array = np.asarray(value, dtype=np.float64)
    if array.ndim == 0 or array.shape == (count,):
        yield array
    elif array.ndim == 1:  # constant in time
        yield from array
    elif array.shape[-1] == count:
        yield from array.reshape(-1, count)
    else:
        raise ValueError("no array over time")
