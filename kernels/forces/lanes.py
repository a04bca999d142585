"""The route to the forces for small lattices on a GPU: several threads share a particle.

A thread for each particle waits for one neighbour after the other, and the GPU is idle meanwhile.
So a particle has several threads, its lanes. Of n lanes each takes every n-th neighbour, and all learn the sum.
"""

import functools

import warp as wp

from ..basis import vector
from ..compensation import compensation
from ..records import records
from .dampers import Law
from .law import spring_damper
from .route import Route, difference
from .stencil import stencil_layout, stencil_rows

MOST_NEIGHBOURS = 32
"""Neighbours that the bits of a mask tell apart."""
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
"""Lanes are neighbours in a warp. Each adds the same numbers in the same pairs, so all get the same sum."""


@functools.cache
def lane_of(lanes: int):
    """Compose the number of this thread among the lanes of its particle."""

    @wp.func_native(LANE.format(lanes=lanes))
    def lane() -> int: ...

    return lane


@functools.cache
def stencil_of_lanes(
    dim: int, scalar: type, damper: Law | None, compensated: bool, steps: tuple, lanes: int
) -> Route:
    """Compose the stencil's route for a uniform lattice, `lanes` threads to a particle.

    Lane l takes the neighbours l, l + lanes, ... in the order of rows, which here is that of the mask's bits. On
    the CPU there may be one lane only.
    """
    V, Three = vector(dim, scalar), vector(3, scalar)
    Lost, _ = compensation(dim, scalar, compensated)
    load, constants_of, lane_here = records(dim, scalar).load, records(3, scalar).load, lane_of(lanes)
    apart, force_density = difference(dim, scalar, compensated), spring_damper(dim, scalar, damper)
    rows, neighbours = stencil_rows(steps)
    each = [(r, one.along) for r, row in enumerate(neighbours) for one in row]
    damped, rounds, layout = damper is not None, -(-len(each) // lanes), stencil_layout(lanes, rows, neighbours)
    Shifts = wp.types.vector(len(rows), int)

    def there(k: int) -> bool:
        return k < len(each)

    def row_of(k: int) -> int:
        return each[k][0] if there(k) else 0

    def along(k: int) -> int:
        return each[k][1] if there(k) else 0

    @wp.struct
    class SharedLattice:
        mask: wp.array(dtype=wp.uint32)  # bits of the neighbours that there are, shape [particle_count]
        shift: Shifts  # how far off each row of neighbours lies, in particles
        constants: wp.array(dtype=Three)  # of each neighbour, in the order of CONSTANTS, shape [MOST_NEIGHBOURS]

    @wp.func_native(SUM.format(sharing=hex((1 << lanes) - 1), first=32 - lanes, half=lanes // 2, dim=dim))
    def sum_of_lanes(value: V) -> V: ...

    @wp.func
    def force_at(forces: SharedLattice, lost: Lost, x: wp.array(dtype=V), v: wp.array(dtype=V), i: int) -> V:
        lane = lane_here()
        if wp.static(layout) < 0:  # never: see stencil_layout
            return V()
        mask = forces.mask[i]
        x_i = load(x, i)
        v_i = V()
        dv = V()
        if wp.static(damped):
            v_i = load(v, i)
        force = V()
        for n in range(wp.static(rounds)):
            # Chosen from what the kernel is launched with: read from a table, positions would be asked for later.
            offset = int(0)
            for m in range(wp.static(lanes)):
                if wp.static(there(n * lanes + m)):
                    shift = forces.shift[wp.static(row_of(n * lanes + m))] + wp.static(along(n * lanes + m))
                    offset = wp.where(lane == m, shift, offset)
            k = n * wp.static(lanes) + lane
            own = constants_of(forces.constants, k)
            dx = apart(lost, x, x_i, i, i + offset)
            if wp.static(damped):
                dv = v_i - load(v, i + offset)
            q = force_density(dx, dv, own[0], own[1], own[2])
            # What is read of a missing neighbour may be any other particle's: it does not count.
            if ((mask >> wp.uint32(k)) & wp.uint32(1)) == wp.uint32(0):
                q = scalar(0.0)
            force -= q * dx
        return sum_of_lanes(force)

    return Route(SharedLattice, force_at, block=128, grid_stride=False, lanes=lanes)
