"""What contacts push particles with, summed over a frame: for sensors, pictures and files."""

import functools

import warp as wp

from ..basis import kernel, vector
from .surfaces import touching_piece


@functools.cache
def add_impulses(dim: int, scalar: type, compensated: bool):
    """Compose the kernel, over particles, that adds up what other bodies push each with, in float64.

    A force counts for the time that the method gives it in its sum over the substep.
    """
    Touched = touching_piece(dim, scalar, compensated).Data
    Wide = vector(dim, wp.float64)

    @kernel
    def add_impulse(
        touched: Touched,
        seconds: wp.float64,  # how long the forces count [s]
        # In and out:
        impulse: wp.array(dtype=Wide),  # [N s], shape [particle_count]
    ):
        i = wp.tid()
        total = Wide()
        for s in range(touched.first[i], touched.first[i + 1]):
            vertex = touched.vertex[s]
            for k in range(wp.static(dim)):
                f = wp.float64(touched.force[vertex, k]) * touched.unit
                total[k] = total[k] + wp.float64(touched.weight[s]) * f
        impulse[i] = impulse[i] + seconds * total

    return add_impulse
