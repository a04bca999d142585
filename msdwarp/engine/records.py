"""Arrays of vectors in records, as `msdwarp.kernels.records` reads and writes them."""

from typing import Any

import warp as wp

from ..kernels.basis import vector
from ..kernels.records import record_length


def in_records(count: int, dim: int, scalar: Any, device: Any, margin: int = 0) -> wp.array:
    """Return zeros, so many vectors; `margin` more may be read before the first and after the last."""
    length, size = record_length(dim), wp.types.type_size_in_bytes(scalar)
    storage = wp.zeros((count + 2 * margin) * length, dtype=scalar, device=device)
    view = wp.array(
        ptr=int(storage.ptr or 0) + margin * length * size,
        dtype=vector(dim, scalar),
        shape=count,
        strides=(length * size,),
        device=device,
        capacity=storage.capacity,
    )
    view._ref = storage
    return view
