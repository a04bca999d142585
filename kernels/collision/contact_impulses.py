"""Impulses of contacts on particles, summed over a frame: for sensors, pictures and files."""

import functools

import warp as wp

from ..basis import kernel, vector
from .contact_data import body_contact_term


@functools.cache
def add_impulses(dim: int, scalar: type, compensated: bool):
    """Compose the kernel, over particles, that adds up the impulse of other bodies on each, in float64.

    A force counts for the time that the method gives it in its sum over the substep.
    """
    VertexForces = body_contact_term(dim, scalar, compensated).Data
    Wide = vector(dim, wp.float64)

    @kernel
    def add_impulse(
        body_contact: VertexForces,
        seconds: wp.float64,  # how long the forces count [s]
        # In and out:
        impulse: wp.array(dtype=Wide),  # [N s], shape [particle_count]
    ):
        i = wp.tid()
        total = Wide()
        for s in range(body_contact.first[i], body_contact.first[i + 1]):
            vertex = body_contact.vertex[s]
            for k in range(wp.static(dim)):
                f = wp.float64(body_contact.force[vertex, k]) * body_contact.unit
                total[k] = total[k] + wp.float64(body_contact.weight[s]) * f
        impulse[i] = impulse[i] + seconds * total

    return add_impulse
