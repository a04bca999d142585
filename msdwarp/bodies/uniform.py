"""Uniform arrays: one number, or one row, stored once and repeated by a view whose first stride is 0.

A constant that is equal everywhere takes the memory of one number, on the host and on the device. These functions
create, join and read arrays of a system, keep uniform arrays uniform, and tell them in words.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray


def uniform(value: ArrayLike, count: int) -> NDArray:
    """Return a number or a row, repeated `count` times: shape [count, ...], read-only."""
    value = np.asarray(value)
    return np.broadcast_to(value, (count, *value.shape))


def is_uniform(values: NDArray) -> bool:
    """Return whether an array of several entries stores only one of them."""
    return len(values) > 1 and values.strides[0] == 0


def stored(values: NDArray) -> NDArray:
    """Return the entries stored in memory: the first if the array is uniform, otherwise all."""
    return values[:1] if is_uniform(values) else values


def uniform_like(values: NDArray, like: NDArray) -> NDArray:
    """Return `values`, computed entry by entry from `like`, as a uniform array if `like` is uniform."""
    return uniform(values[0], len(values)) if is_uniform(like) else values


def joined(a: NDArray, b: NDArray) -> NDArray:
    """Return two arrays concatenated: as a uniform array if both are uniform with the same entry."""
    views = a.strides[:1] == b.strides[:1] == (0,)  # also for arrays of one entry: two equal ones are uniform
    if views and len(a) and len(b) and np.array_equal(a[0], b[0]):
        return uniform(a[0], len(a) + len(b))
    return np.concatenate([a, b])


def counted(count: int, what: str) -> str:
    """Return a count with its noun, such as "1 particle"."""
    return f"{count} {what}" if count == 1 else f"{count} {what}s"


def span(values: NDArray[np.float64]) -> str:
    """Return the minimum and maximum of values as text, or one value if all are equal."""
    least, most = (float(of(stored(values))) for of in (np.min, np.max))
    return f"{least:.4g}" if least == most else f"{least:.4g} to {most:.4g}"
