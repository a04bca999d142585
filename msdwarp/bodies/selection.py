"""Selection: which particles are meant by indices, a slice or a mask."""

from typing import Any

import numpy as np
from numpy.typing import NDArray


def selected(name: str, selection: Any, count: int) -> NDArray[np.bool_]:
    """Return which of `count` particles are meant, shape [count].

    Parameters
    ----------
    name
        What the argument is called.
    selection
        Indices, a slice, or a mask of shape [count].
    count
        Number of particles.

    Raises
    ------
    ValueError
        If it is none of these, an index is out of range, or whole numbers look like a mask.
    """
    chosen = np.zeros(count, dtype=bool)
    # None, True and False would index all: a new axis is put before the particles.
    if selection is None or isinstance(selection, bool | np.bool_ | str):
        raise ValueError(_does_not(name, count, f"it is {selection!r}"))
    try:
        where = selection if isinstance(selection, slice) else np.asarray(selection)
        if isinstance(where, slice) or where.size:  # nobody is a list of no type
            chosen[where] = True
    except (IndexError, TypeError, ValueError) as error:
        raise ValueError(_does_not(name, count, str(error))) from error
    if isinstance(where, np.ndarray):
        check_no_mask(name, where, count)
    return chosen


def check_no_mask(name: str, where: NDArray, count: int) -> None:
    """Raise ValueError for a mask of whole numbers, which as indices would be of the first two particles.

    Such has an entry for each particle, nothing but 0 and 1, and one of them twice at least.
    """
    zeros_and_ones = where.dtype.kind in "iu" and where.shape == (count,) and np.isin(where, (0, 1)).all()
    if zeros_and_ones and len(np.unique(where)) < count:
        raise ValueError(
            f"{name} holds 0 and 1 for each of {count} particles, which as indices are the first two: "
            "a mask must be of booleans, such as mask == 1"
        )


def _does_not(name: str, count: int, why: str) -> str:
    return f"{name} does not index {count} particles: {why}; it must be indices, a slice or a mask of booleans"
