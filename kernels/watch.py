"""Watching a run from the device."""

import functools

import warp as wp

from .basis import kernel, vector


@functools.cache
def first_non_finite(dim: int, scalar: type):
    """Compose the kernel that lowers `first[0]` to the least index of a particle that is not finite."""
    V = vector(dim, scalar)

    @kernel
    def find_non_finite(x: wp.array(dtype=V), v: wp.array(dtype=V), first: wp.array(dtype=int)):
        i = wp.tid()
        if not (wp.isfinite(x[i]) and wp.isfinite(v[i])):
            wp.atomic_min(first, 0, i)

    return find_non_finite
