"""Tunnelling: points so fast, or pressed so hard, that they may come out on the wrong side of a facet."""

import functools

import warp as wp

from ..basis import vector
from .cpu_partition import claim

COUNT, POINT, FACET, GAP, SPEED, PLACE = range(6)
"""Indices in the record of a frame: number of events, and of the first one the point, the facet, the distance at
the substep's end [m], the speed of approach [m/s], and from PLACE on the position [m]."""
NOTED = 8


@functools.cache
def note_tunnelling(scalar: type):
    """Compose (noted, p, facet, x, onward, least, speed): record a contact unless its gap stays above `least`.

    `onward` is the gap expected at the substep's end [m]. For sheets, ropes and particles `least` is 0: below it a
    point has changed sides. For closed bodies it is the depth up to which a point is pushed out, negated.
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
