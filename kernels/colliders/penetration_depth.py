"""Distances of points from a solid, for checks before a run."""

import functools

import warp as wp

from ..basis import kernel, vector
from .signed_distance import KINDS, signed_distance, solids


@functools.cache
def distances(dim: int):
    """Compose the kernel that writes the signed distances of points from a solid of any kind, in float64."""
    V, Solids, Distance = vector(dim, wp.float64), solids(dim, wp.float64), wp.float64
    distance_from = signed_distance(dim, wp.float64, KINDS)

    @kernel
    def measure_distances(
        s: Solids,
        p: int,
        x: wp.array(dtype=V),  # [m]
        found: wp.array(dtype=Distance),  # [m], below 0 inside
    ):
        i = wp.tid()
        result = distance_from(s, p, x[i])
        found[i] = result[wp.static(dim)]

    return measure_distances
