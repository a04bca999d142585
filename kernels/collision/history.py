"""Contact history: the tangential displacement of points along the bodies that they touch."""

import functools

import warp as wp

from ..basis import vector
from .contact_data import BodyContactData
from .pairs import NONE


@functools.cache
def memories(scalar: type, worlds: bool):
    """Compose (Memory, no_memory, remember, keep, shrink_overlap).

    A point remembers two bodies, those with the lowest indices if there are more; NONE fills up. `keep` stores
    them; `shrink_overlap` reduces the allowed overlap since the start.
    """
    V, Data = vector(3, scalar), BodyContactData(scalar, worlds)

    @wp.struct
    class Memory:
        body_0: int
        body_1: int
        moved_0: V  # along the first [m]
        moved_1: V

    @wp.func
    def no_memory() -> Memory:
        memory = Memory()
        memory.body_0 = wp.static(NONE)
        memory.body_1 = wp.static(NONE)
        return memory

    @wp.func
    def remember(known: Memory, body: int, moved: V) -> Memory:
        memory = known
        if body < known.body_0:
            memory.body_1 = known.body_0
            memory.moved_1 = known.moved_0
            memory.body_0 = body
            memory.moved_0 = moved
        elif body < known.body_1:
            memory.body_1 = body
            memory.moved_1 = moved
        return memory

    @wp.func
    def keep(data: Data, p: int, memory: Memory):
        data.history.contact_body[0, p] = wp.where(memory.body_0 < wp.static(NONE), memory.body_0, -1)
        data.history.contact_body[1, p] = wp.where(memory.body_1 < wp.static(NONE), memory.body_1, -1)
        data.history.tangential_displacement[0, p] = memory.moved_0
        data.history.tangential_displacement[1, p] = memory.moved_1

    @wp.func
    def shrink_overlap(data: Data, p: int, h: scalar):
        left = data.history.initial_overlap[p] - h * data.history.overlap_release_speed
        data.history.initial_overlap[p] = wp.max(scalar(0.0), left)

    return Memory, no_memory, remember, keep, shrink_overlap


@functools.cache
def displacements(scalar: type):
    """Compose (bodies, displacement, p, other) -> displacement of point p along a body [m]; 0 without contact."""
    V = vector(3, scalar)

    @wp.func
    def moved_along(bodies: wp.array2d(dtype=int), displacement: wp.array2d(dtype=V), p: int, other: int) -> V:
        found = V()
        if bodies[0, p] == other:
            found = displacement[0, p]
        elif bodies[1, p] == other:
            found = displacement[1, p]
        return found

    return moved_along
