"""Contacts that are overrun: what comes so fast, or is pressed so hard, that it may come out on the other side."""

import functools

import warp as wp

from ..basis import vector
from .surfaces import Surfaces

COUNT, POINT, FACET, GAP, SPEED, PLACE = range(6)
"""What is noted of the first one in a frame: how many there are, the point, the facet, how far off it they will be
where the substep ends [m], how fast they approach [m/s], and from PLACE on where [m]."""
NOTED = 8


@functools.cache
def note_overrun(scalar: type):
    """Compose (data, p, facet, x, onward, least, speed): note a contact unless it stays above the least gap.

    `onward` is the gap with which the substep will end [m]. Of sheets, ropes and particles the least gap is 0:
    past it a point has changed sides. Of closed bodies it is the depth from which a point is still pushed out.
    """
    V, Data = vector(3, scalar), Surfaces(scalar)

    @wp.func
    def note(data: Data, p: int, facet: int, x: V, onward: scalar, least: scalar, speed: scalar):
        if onward <= least:
            if wp.atomic_add(data.overrun, wp.static(COUNT), wp.float64(1.0)) == wp.float64(0.0):
                data.overrun[wp.static(POINT)] = wp.float64(p)
                data.overrun[wp.static(FACET)] = wp.float64(facet)
                data.overrun[wp.static(GAP)] = wp.float64(onward)
                data.overrun[wp.static(SPEED)] = wp.float64(speed)
                for k in range(3):
                    data.overrun[wp.static(PLACE) + k] = wp.float64(x[k])

    return note
