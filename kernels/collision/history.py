"""What points remember of the bodies that they touch: the displacement along them, and on which side they are.

As long as a point touches a sheet, it is known which facet it touches (`contact_side`), and whether it came from
the side of its normal or from behind. Where it slides on, the facet has a corner in common with the one before:
farther facets are another layer of the sheet. A point that is suddenly on the other side has come through. The
sign of its distance then stays, so that the law pushes it back, until it is deeper than half of the sheet's
spacing. It is forgotten where the point lets go of the sheet, and where it may go around its border: there the
sheet is seen from its edge.
Reference: Baraff, Witkin, Kass, Untangling cloth, SIGGRAPH 2003: what such a memory can do, and its limits.
"""

import functools

import warp as wp

from ..basis import vector
from .contact_data import HISTORY, BodyContactData
from .pairs import NONE


@functools.cache
def memories(scalar: type, sided: bool, worlds: bool):
    """Compose (Memory, no_memory, remember, keep, shrink_overlap).

    A point remembers two bodies, NONE where there are fewer; of more those whose numbers are least. `keep` writes
    them, and `shrink_overlap` lessens the overlap that is left of the start.
    """
    V, Data = vector(3, scalar), BodyContactData(scalar, worlds)

    @wp.struct
    class Memory:
        body_0: int
        body_1: int
        moved_0: V  # along the first [m]
        moved_1: V
        side_0: int  # of the first, as in `contact_side`
        side_1: int

    @wp.func
    def no_memory() -> Memory:
        memory = Memory()
        memory.body_0 = wp.static(NONE)
        memory.body_1 = wp.static(NONE)
        return memory

    @wp.func
    def remember(known: Memory, body: int, moved: V, side: int) -> Memory:
        memory = known
        if body < known.body_0:
            memory.body_1 = known.body_0
            memory.moved_1 = known.moved_0
            memory.side_1 = known.side_0
            memory.body_0 = body
            memory.moved_0 = moved
            memory.side_0 = side
        elif body < known.body_1:
            memory.body_1 = body
            memory.moved_1 = moved
            memory.side_1 = side
        return memory

    @wp.func
    def keep(data: Data, p: int, memory: Memory):
        data.history.contact_body[0, p] = wp.where(memory.body_0 < wp.static(NONE), memory.body_0, -1)
        data.history.contact_body[1, p] = wp.where(memory.body_1 < wp.static(NONE), memory.body_1, -1)
        data.history.tangential_displacement[0, p] = memory.moved_0
        data.history.tangential_displacement[1, p] = memory.moved_1
        if wp.static(sided):
            data.history.contact_side[0, p] = memory.side_0
            data.history.contact_side[1, p] = memory.side_1

    @wp.func
    def shrink_overlap(data: Data, p: int, h: scalar):
        left = data.history.initial_overlap[p] - h * data.history.overlap_release_speed
        data.history.initial_overlap[p] = wp.max(scalar(0.0), left)

    return Memory, no_memory, remember, keep, shrink_overlap


@functools.cache
def displacements(scalar: type):
    """Compose (moved_along, moved_on_side): how far a point was moved along a body before [m]; 0 if not in touch.

    Along a sheet that counts by the side that the point is held on (`contact_side`).
    """
    V = vector(3, scalar)

    @wp.func
    def moved_along(bodies: wp.array2d(dtype=int), displacement: wp.array2d(dtype=V), p: int, other: int) -> V:
        found = V()
        if bodies[0, p] == other:
            found = displacement[0, p]
        elif bodies[1, p] == other:
            found = displacement[1, p]
        return found

    @wp.func
    def moved_on_side(
        bodies: wp.array2d(dtype=int),
        sides: wp.array2d(dtype=int),
        displacement: wp.array2d(dtype=V),
        p: int,
        other: int,
        held: int,
    ) -> V:
        found = V()
        for k in range(wp.static(HISTORY)):
            if bodies[k, p] == other and sides[k, p] == held:
                found = displacement[k, p]
        return found

    return moved_along, moved_on_side
