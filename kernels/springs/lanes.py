"""Gather algorithms for small bodies on a GPU: several threads per particle.

With one thread per particle most of the GPU would be idle while threads wait for their neighbours' data. So each
particle has several threads, its lanes. Each of n lanes takes every n-th neighbour, and all receive the sum.
"""

import functools

import warp as wp

from ..basis import fully_hashed, vector
from ..compensation import state_types
from ..records import records
from .dampers import law_numbers
from .force_algorithm import ForceAlgorithm, difference, velocity_of
from .law import spring_damper
from .spring_laws import Laws
from .stencil import stencil_rows

MOST_NEIGHBOURS = 32
"""Maximal number of neighbours, so that a mask has a bit for each."""
LANE = """
#if defined(__CUDA_ARCH__)
    return threadIdx.x % {lanes};
#else
    return 0;
#endif
"""
SUM = """
#if defined(__CUDA_ARCH__)
    const unsigned sharing = {sharing}u << (threadIdx.x & {first});
    for (int far = {half}; far > 0; far /= 2)
        for (int c = 0; c < {dim}; ++c)
            value[c] += __shfl_xor_sync(sharing, value[c], far);
#endif
    return value;
"""
"""A particle's lanes are adjacent in a warp. All lanes add the same pairs of numbers, so their sums are equal."""


@functools.cache
def lane_of(lanes: int):
    """Compose the index of this thread among the lanes of its particle."""

    @wp.func_native(LANE.format(lanes=lanes))
    def lane() -> int: ...

    return lane


@functools.cache
def sum_over_lanes(dim: int, scalar: type, lanes: int):
    """Compose the sum over the lanes of a particle."""
    V = vector(dim, scalar)

    @wp.func_native(SUM.format(sharing=hex((1 << lanes) - 1), first=32 - lanes, half=lanes // 2, dim=dim))
    def sum_of_lanes(value: V) -> V: ...

    return sum_of_lanes


@functools.cache
def stencil_of_lanes(
    dim: int, scalar: type, laws: Laws, compensated: bool, steps: tuple, lanes: int, by_kind: bool = False
) -> ForceAlgorithm:
    """Compose the stencil algorithm for a uniform lattice, with `lanes` threads per particle.

    In a lattice `by_kind` constants depend on the particle's kind as well. Lane l takes neighbours l, l + lanes,
    ... in the order of rows, here also the order of mask bits. On the CPU there may be only one lane.
    """
    V, Vectors, Compensation = state_types(dim, scalar, compensated)
    Three = vector(3, scalar)
    load, constants_of = records(dim, scalar).load, records(3, scalar).load
    lane_here, sum_of_lanes = lane_of(lanes), sum_over_lanes(dim, scalar, lanes)
    separation, density = difference(dim, scalar, compensated), spring_damper(dim, scalar, laws)
    rows, neighbours = stencil_rows(steps)
    each = [(r, one.along) for r, row in enumerate(neighbours) for one in row]
    velocity = velocity_of(dim, scalar, laws.damper is not None)
    rounds = -(-len(each) // lanes)
    Shifts, count = wp.types.vector(len(rows), int), len(each)
    each += [(0, 0)] * (rounds * lanes - count)  # padding, for neighbours that are never read

    @wp.struct
    class SharedLattice:
        mask: wp.array(dtype=wp.uint32)  # bits of existing neighbours, shape [particle_count]
        shift: Shifts  # index offset of each row of neighbours
        constants: wp.array(dtype=Three)  # of each neighbour, in the order of CONSTANTS, shape [MOST_NEIGHBOURS]
        if by_kind:  # `constants` of one kind after the other
            kind: wp.array(dtype=int)  # kind of each particle, shape [particle_count]
        if not laws.linear:
            law: law_numbers(scalar)

    @fully_hashed
    def force_at(forces: SharedLattice, compensation: Compensation, x: Vectors, v: Vectors, i: int) -> V:
        lane = lane_here()
        mask = forces.mask[i]
        x_i = load(x, i)
        v_i = velocity(v, i)
        force = V()
        for n in range(wp.static(rounds)):
            # Offsets are kernel arguments, since reading a table first would delay the loads of positions.
            offset = int(0)
            for m in range(wp.static(lanes)):
                if wp.static(n * lanes + m < count):
                    shift = forces.shift[wp.static(each[n * lanes + m][0])] + wp.static(each[n * lanes + m][1])
                    offset = wp.where(lane == m, shift, offset)
            k = n * wp.static(lanes) + lane
            if wp.static(by_kind):
                own = constants_of(forces.constants, forces.kind[i] * wp.static(MOST_NEIGHBOURS) + k)
            else:
                own = constants_of(forces.constants, k)
            dx = separation(compensation, x, x_i, i, i + offset)
            dv = v_i - velocity(v, i + offset)
            q = density(dx, dv, *own) if wp.static(laws.linear) else density(dx, dv, *own, forces.law)
            # Data read for a missing neighbour are discarded.
            if ((mask >> wp.uint32(k)) & wp.uint32(1)) == wp.uint32(0):
                q = scalar(0.0)
            force -= q * dx
        return sum_of_lanes(force)

    return ForceAlgorithm(SharedLattice, force_at, block=128, grid_stride=False, lanes=lanes)
