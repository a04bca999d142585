"""Tunnelling: points that come so fast, or are pressed so hard, that they may come out on the other side."""

import functools

import warp as wp

from ..basis import vector
from .cpu_partition import claim

COUNT, POINT, FACET, GAP, SPEED, PLACE = range(6)
"""The record of the first one in a frame: how many there are, the point, the facet, the distance where the substep
ends [m], the speed of approach [m/s], and from PLACE on the place [m]."""
NOTED = 8


@functools.cache
def note_tunnelling(scalar: type):
    """Compose (noted, p, facet, x, onward, least, speed): note a contact unless it stays above the least gap.

    `onward` is the gap with which the substep will end [m]. Of sheets, ropes and particles the least gap is 0:
    past it a point has changed sides. Of closed bodies it is the depth from which a point is still pushed out.
    """
    V = vector(3, scalar)

    @wp.func
    def note(
        noted: wp.array(dtype=wp.float64), p: int, facet: int, x: V, onward: scalar, least: scalar, speed: scalar
    ):
        if onward <= least:
            if claim(noted, wp.static(COUNT)):
                noted[wp.static(POINT)] = wp.float64(p)
                noted[wp.static(FACET)] = wp.float64(facet)
                noted[wp.static(GAP)] = wp.float64(onward)
                noted[wp.static(SPEED)] = wp.float64(speed)
                for k in range(3):
                    noted[wp.static(PLACE) + k] = wp.float64(x[k])

    return note
