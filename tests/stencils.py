"""What a stencil reads of a system, one neighbour after the other."""

import numpy as np
from tangles import CONSTANTS

from msdwarp import System
from msdwarp.engine.model.lattice import Lattice, find_lattice
from msdwarp.kernels.springs.stencil import stencil_rows


def reads(lattice: Lattice, count: int):
    """Yield, for every neighbour that a stencil reads, (direction, bit, where each particle finds it)."""
    rows, neighbours = stencil_rows(lattice.steps)
    assert len(lattice.shift) == len(rows)
    for row, shift in zip(neighbours, lattice.shift, strict=True):
        for one in row:
            yield one.direction, one.bit, np.arange(count) + shift + one.along


def joined(lattice: Lattice, count: int) -> list[tuple]:
    """Return (particle, neighbour, rest length, stiffness, damping) of all that a stencil does not mask."""
    found = []
    for direction, bit, there in reads(lattice, count):
        column = direction if lattice.uniform else bit.bit_length() - 1
        for i in np.flatnonzero(lattice.mask & np.uint32(bit)):
            own = (lattice.constants[name][lattice.kind[i], column] for name in CONSTANTS)
            found.append((int(i), int(there[i]), *map(float, own)))
    return sorted(found)


def both_ways(system: System) -> list[tuple]:
    """Return the same of the connections, each seen from both its ends."""
    constants = [getattr(system, name) for name in CONSTANTS]
    listed = zip(*system.connections.T, *constants, strict=True)
    ahead = [(int(i), int(j), *map(float, own)) for i, j, *own in listed]
    return sorted([*ahead, *((j, i, *own) for i, j, *own in ahead)])


def of_connections(system: System, kept) -> System:
    """Return the particles with some of their connections."""
    fields = {name: getattr(system, name)[kept] for name in ("connections", *CONSTANTS)}
    return System(position=system.position, **fields)


def lattice_of(system: System) -> Lattice:
    """Return a system's lattice, which must hold all connections but its ties, and read where memory is."""
    lattice, n = find_lattice(system), system.particle_count
    assert lattice.mask.dtype == np.uint32
    assert lattice.mask.shape == lattice.kind.shape == (n,)
    tied = np.isin(np.arange(system.connection_count), lattice.ties)
    assert joined(lattice, n) == both_ways(of_connections(system, ~tied))
    beyond = n  # columns of two: the second of the last may be as far beyond the end
    if lattice.stride > 0:
        beyond = -(-n // (2 * lattice.stride)) * 2 * lattice.stride
    for *_, there in reads(lattice, n):
        assert -lattice.margin <= there.min()
        assert there.max() + beyond - n < n + lattice.margin
    return lattice
