"""Tables of the springs of each particle, for the worlds of an ensemble."""

import functools

import warp as wp

from ..basis import vector
from ..springs.gather import SLICE
from .springs import Neighbours


@functools.cache
def in_worlds(scalar: type, damped: bool) -> Neighbours:
    """Return the neighbours in many worlds of one system; their particles are `stride` apart.

    The derivatives by constants have an entry for each spring of each world: w · connection_count + c.
    """
    Three = vector(3, scalar)

    @wp.struct
    class Table:
        # The particles and springs of one world, as in `in_table`:
        first: wp.array(dtype=int)
        other: wp.array(dtype=int)
        connection: wp.array(dtype=int)
        connections: wp.array(dtype=wp.vec2i)
        column: wp.array(dtype=int)
        strain: wp.array2d(dtype=scalar)
        particle_count: int
        stride: int
        # Shared by all worlds, or concatenated by world:
        rest_length: wp.array(dtype=scalar)
        stiffness: wp.array(dtype=scalar)
        damping: wp.array(dtype=scalar)
        differs: wp.vec3i  # 0 for each of these three that is shared, else 1

    @wp.func
    def range_of(table: Table, i: int):
        own = i % table.stride
        part = own / wp.static(SLICE)
        first = int(0)
        last = int(0)
        if own < table.particle_count:
            first = table.first[part] + own % wp.static(SLICE)
            last = table.first[part + 1]
        return first, wp.static(SLICE), last

    @wp.func
    def look(table: Table, i: int, slot: int):
        c = table.connection[slot]
        w = i / table.stride
        return c >= 0, w * table.stride + table.other[slot], w * table.connections.shape[0] + c

    @wp.func
    def spring_of(table: Table, slot: int, c: int) -> Three:
        own = table.connection[slot]
        at = wp.vec3i(own, own, own) + (c - own) * table.differs
        b = scalar(0.0)
        if wp.static(damped):
            b = table.damping[at[2]]
        return Three(table.rest_length[at[0]], table.stiffness[at[1]], b)

    @wp.func
    def owns(table: Table, i: int, slot: int, c: int) -> bool:
        return table.connections[table.connection[slot]][0] == i % table.stride

    @wp.func
    def strain_of(table: Table, stage: int, c: int) -> scalar:
        s = scalar(0.0)
        column = table.column[c % table.connections.shape[0]]
        if column >= 0:
            s = table.strain[stage, column]
        return s

    return Neighbours(Table, range_of, look, spring_of, owns, strain_of)
