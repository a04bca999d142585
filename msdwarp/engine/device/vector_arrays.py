"""Arrays of vectors in the records of `msdwarp.kernels.records`."""

from collections.abc import Sequence
from typing import Any

import warp as wp

from ...kernels.basis import vector
from ...kernels.records import record_length
from .device import view_of

ALIGNED = 64
"""Alignment of arrays in a shared allocation, in numbers: a multiple of a GPU's cache line."""
MOST_NUMBERS = 2**31 - 1
"""Maximal number of elements of a Warp array."""


def in_records(count: int, dim: int, scalar: Any, device: Any) -> wp.array:
    """Return an array of `count` zero vectors."""
    return records_together(1, count, dim, scalar, device)[0]


def records_together(
    arrays: int, count: int, dim: int, scalar: Any, device: Any, margin: int = 0
) -> tuple[wp.array, ...]:
    """Return several arrays of zeros, in one shared allocation (`_ref`) if Warp allows an array of that size.

    Up to `margin` vectors may be read before the start and after the end of each array.
    """
    length, size = record_length(dim), wp.types.type_size_in_bytes(scalar)
    each = -(-(count + 2 * margin) * length // ALIGNED) * ALIGNED
    if arrays > 1 and arrays * each > MOST_NUMBERS:
        return tuple(records_together(1, count, dim, scalar, device, margin)[0] for _ in range(arrays))
    storage = wp.zeros(arrays * each, dtype=scalar, device=device)
    Vector, strides, step = vector(dim, scalar), (length * size,), each * size
    begin = margin * length * size
    return tuple(view_of(storage, count, strides, Vector, begin + k * step) for k in range(arrays))


def numbers_of(vectors: wp.array) -> wp.array:
    """Return the numbers of an array of vectors, with those between them, as a contiguous array."""
    kind: Any = vectors.dtype
    return view_of(vectors, len(vectors) * record_length(kind._length_), dtype=kind._wp_scalar_type_)


def rows_like(together: Sequence[wp.array], rows: int) -> tuple[wp.array, list[tuple[wp.array, ...]]]:
    """Return an array of `rows` rows, and for each row views like arrays in one shared allocation."""
    one: Any = together[0]._ref
    assert all(each._ref is one for each in together), "the arrays are too large for a shared allocation"
    storage = wp.zeros((rows, one.size), dtype=one.dtype, device=one.device)
    return storage, [
        tuple(view_of(row, each.shape, each.strides, each.dtype, each.ptr - one.ptr) for each in together)
        for row in (storage[k] for k in range(rows))
    ]
