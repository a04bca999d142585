"""Build the table of neighbours for the gather algorithm (see `springs.gather`).

A spring has two ends, one at each of its particles. The ends, sorted by particle, fill the table's slots.
"""

import functools

import warp as wp

from ..basis import kernel
from .constants import KIND_SHIFT
from .gather import SLICE


@kernel
def list_ends(
    connections: wp.array(dtype=wp.vec2i),  # two particles each, shape [connection_count]
    # Out:
    particle: wp.array(dtype=int),  # shape [end_count], twice as many as springs
    end: wp.array(dtype=int),  # shape [end_count]
):
    """List both ends of each spring c: particles, and end indices 2c and 2c + 1."""
    c = wp.tid()
    for side in range(2):
        particle[2 * c + side] = connections[c][side]
        end[2 * c + side] = 2 * c + side


@kernel
def name_itself(
    first: wp.array(dtype=int),  # starts of slices, and the end, shape [slice_count + 1]
    particle_count: int,
    # Out:
    other: wp.array(dtype=int),  # shape [slot_count]
):
    """Fill every slot of particle i with i; such slots are padding, since a particle exerts no force on itself."""
    part = wp.tid()
    for slot in range(first[part], first[part + 1]):
        other[slot] = wp.min(part * SLICE + (slot - first[part]) % SLICE, particle_count - 1)


@kernel
def fill_slots(
    # The ends, sorted by particle:
    particle: wp.array(dtype=int),  # shape [end_count]
    end: wp.array(dtype=int),  # indices of ends, shape [end_count]
    start: wp.array(dtype=int),  # first end of each particle, shape [particle_count]
    # Layout of the table:
    first: wp.array(dtype=int),  # starts of slices, and the end, shape [slice_count + 1]
    # Model:
    connections: wp.array(dtype=wp.vec2i),  # two particles each, shape [connection_count]
    # Out:
    other: wp.array(dtype=int),  # neighbour in each slot, shape [slot_count]
    connection: wp.array(dtype=int),  # spring of each slot, shape [slot_count]
):
    """Enter each end, in the order of particles, into the next slot of its particle."""
    e = wp.tid()
    i = particle[e]
    slot = first[i / SLICE] + (e - start[i]) * SLICE + i % SLICE
    c = end[e] / 2
    other[slot] = connections[c][1 - end[e] % 2]
    connection[slot] = c


@kernel
def pack_kinds(
    connection: wp.array(dtype=int),  # of each slot, −1 for padding, shape [slot_count]
    kind: wp.array(dtype=wp.uint8),  # of each spring, shape [connection_count]
    # In and out:
    other: wp.array(dtype=int),  # neighbour in each slot, shape [slot_count]
):
    """Write each spring's kind into the bits above a neighbour's index."""
    slot = wp.tid()
    if connection[slot] >= 0:
        other[slot] = other[slot] | (int(kind[connection[slot]]) << KIND_SHIFT)


@kernel
def name_itself_where_broken(
    first: wp.array(dtype=int),  # starts of slices, and the end, shape [slice_count + 1]
    connection: wp.array(dtype=int),  # of each slot, −1 for padding, shape [slot_count]
    broken_at: wp.array(dtype=wp.float32),  # of each spring [s], inf if unbroken, shape [connection_count]
    # Out:
    other: wp.array(dtype=int),  # shape [slot_count]
):
    """Write i into slots of particle i whose springs are broken, so that they exert no force."""
    i = wp.tid()
    slot = first[i / SLICE] + i % SLICE
    while slot < first[i / SLICE + 1]:
        if connection[slot] >= 0:
            if wp.isfinite(broken_at[connection[slot]]):
                other[slot] = i
        slot += SLICE


@functools.cache
def take(dtype: type):
    """Compose the kernel, over slots, that copies the value of each slot's spring into the slot."""

    @kernel
    def take_values(
        connection: wp.array(dtype=int),  # of each slot, −1 for padding, shape [slot_count]
        values: wp.array(dtype=dtype),  # shape [connection_count]
        # Out:
        slots: wp.array(dtype=dtype),  # shape [slot_count]
    ):
        slot = wp.tid()
        if connection[slot] >= 0:
            slots[slot] = values[connection[slot]]

    return take_values
