"""Arrays of vectors in records, as `msdwarp.kernels.records` reads and writes them."""

from typing import Any

import warp as wp

from ..kernels.basis import vector
from ..kernels.records import record_length


def in_records(count: int, dim: int, scalar: Any, device: Any) -> wp.array:
    """Return zeros, so many vectors."""
    length, size = record_length(dim), wp.types.type_size_in_bytes(scalar)
    storage = wp.zeros(count * length, dtype=scalar, device=device)
    view = wp.array(
        ptr=storage.ptr,
        dtype=vector(dim, scalar),
        shape=count,
        strides=(length * size,),
        device=device,
        capacity=storage.capacity,
    )
    view._ref = storage  # a view does not own its memory
    return view
