"""Uniform arrays: one number, or one row, stored once and repeated by a view whose first stride is 0.

So a constant that is equal everywhere takes the memory of one number, on the host and on the device. These
functions create, join and read arrays of a system, and keep uniform ones uniform.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray


def uniform(value: ArrayLike, count: int) -> NDArray:
    """Return a number or a row, repeated `count` times: shape [count, ...], read-only."""
    value = np.asarray(value)
    return np.broadcast_to(value, (count, *value.shape))


def is_uniform(values: NDArray) -> bool:
    """Return whether an array of several entries stores only one."""
    return len(values) > 1 and values.strides[0] == 0


def stored(values: NDArray) -> NDArray:
    """Return the entries that are stored in memory: the first of a uniform array, else all."""
    return values[:1] if is_uniform(values) else values


def uniform_like(values: NDArray, like: NDArray) -> NDArray:
    """Return `values`, which were computed entry by entry from `like`, as uniform if `like` is."""
    return uniform(values[0], len(values)) if is_uniform(like) else values


def joined(a: NDArray, b: NDArray) -> NDArray:
    """Return two arrays concatenated: a uniform one if both are, with the same entry."""
    views = a.strides[:1] == b.strides[:1] == (0,)  # also arrays of one entry: two equal ones are uniform
    if views and len(a) and len(b) and np.array_equal(a[0], b[0]):
        return uniform(a[0], len(a) + len(b))
    return np.concatenate([a, b])
