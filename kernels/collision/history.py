"""Contact history: the tangential displacement of each point along the bodies that it touches."""

import functools

import warp as wp

from ..basis import vector
from .contact_data import BodyContactData
from .pairs import NONE


@functools.cache
def memories(scalar: type):
    """Compose (Memory, no_memory, remember, keep, shrink_overlap).

    `Memory` has two bodies that a point touches: those of lowest index if there are more, NONE for a missing one.
    `keep` stores it; `shrink_overlap` reduces the initial overlap that is still allowed.
    """
    V, Data = vector(3, scalar), BodyContactData(scalar)

    @wp.struct
    class Memory:
        body_0: int
        body_1: int
        moved_0: V  # tangential displacement along body_0 [m]
        moved_1: V
        fastest_0: scalar  # fastest approach to body_0 in this contact [m/s]
        fastest_1: scalar

    @wp.func
    def no_memory() -> Memory:
        memory = Memory()
        memory.body_0 = wp.static(NONE)
        memory.body_1 = wp.static(NONE)
        return memory

    @wp.func
    def remember(known: Memory, body: int, moved: V, fastest: scalar) -> Memory:
        memory = known
        if body < known.body_0:
            memory.body_1 = known.body_0
            memory.moved_1 = known.moved_0
            memory.fastest_1 = known.fastest_0
            memory.body_0 = body
            memory.moved_0 = moved
            memory.fastest_0 = fastest
        elif body < known.body_1:
            memory.body_1 = body
            memory.moved_1 = moved
            memory.fastest_1 = fastest
        return memory

    @wp.func
    def keep(data: Data, p: int, memory: Memory):
        data.history.contact_body[0, p] = wp.where(memory.body_0 < wp.static(NONE), memory.body_0, -1)
        data.history.contact_body[1, p] = wp.where(memory.body_1 < wp.static(NONE), memory.body_1, -1)
        data.history.tangential_displacement[0, p] = memory.moved_0
        data.history.tangential_displacement[1, p] = memory.moved_1
        data.history.fastest[0, p] = memory.fastest_0
        data.history.fastest[1, p] = memory.fastest_1

    @wp.func
    def shrink_overlap(data: Data, p: int, h: scalar):
        left = data.history.initial_overlap[p] - h * data.history.overlap_release_speed
        data.history.initial_overlap[p] = wp.max(scalar(0.0), left)

    return Memory, no_memory, remember, keep, shrink_overlap


@functools.cache
def recall(scalar: type):
    """Compose (held, moved_along), which read the history of a point.

    `held` returns its stored `Memory`. `moved_along` returns from a `Memory` the tangential displacement along a
    body [m], and the fastest approach to it [m/s]; both are 0 without contact.
    """
    V, Data, Memory = vector(3, scalar), BodyContactData(scalar), memories(scalar)[0]

    @wp.func
    def held(data: Data, p: int) -> Memory:
        memory = Memory()
        memory.body_0 = data.history.contact_body[0, p]
        memory.body_1 = data.history.contact_body[1, p]
        memory.moved_0 = data.history.tangential_displacement[0, p]
        memory.moved_1 = data.history.tangential_displacement[1, p]
        memory.fastest_0 = data.history.fastest[0, p]
        memory.fastest_1 = data.history.fastest[1, p]
        return memory

    @wp.func
    def moved_along(memory: Memory, other: int):
        found = V()
        fastest = scalar(0.0)
        if memory.body_0 == other:
            found = memory.moved_0
            fastest = memory.fastest_0
        elif memory.body_1 == other:
            found = memory.moved_1
            fastest = memory.fastest_1
        return found, fastest

    return held, moved_along
