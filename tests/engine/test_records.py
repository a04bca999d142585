"""Arrays of vectors in records: what lies before the first and behind the last may be read."""

import numpy as np
import pytest
import warp as wp

from msdwarp.kernels.basis import kernel, vector
from msdwarp.kernels.records import record_length, records


@pytest.mark.parametrize("dim", [1, 2, 3])
def test_what_lies_around_an_array_is_read_where_it_lies(plain_device, dim):
    # A lattice's neighbours are found by counting. Those that are missing lie in the margin, or in another world.
    V, length = vector(dim, wp.float32), record_length(dim)
    load, store, _ = records(dim, wp.float32)
    storage = wp.array(np.arange(9 * length, dtype=np.float32), device=plain_device)
    inner = wp.array(
        ptr=storage.ptr + 3 * length * 4, dtype=V, shape=3, strides=(length * 4,), device=plain_device
    )

    @kernel
    def copy(x: wp.array(dtype=V), found: wp.array(dtype=V)):
        k = wp.tid()
        store(found, k, load(x, k - 2))

    found = wp.zeros(7 * length, dtype=wp.float32, device=plain_device)
    out = wp.array(ptr=found.ptr, dtype=V, shape=7, strides=(length * 4,), device=plain_device)
    wp.launch(copy, 7, [inner], [out], device=plain_device)
    expected = storage.numpy().reshape(9, length)[1:8, :dim]
    assert np.array_equal(found.numpy().reshape(7, length)[:, :dim], expected)
