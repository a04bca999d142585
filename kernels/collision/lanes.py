"""GPU threads that share a point: each tests some of the facets near it, and all receive the result."""

import functools

import warp as wp

from ..basis import kernel
from ..partition import first_of_part, next_of_part, raise_to
from ..threads import grid_thread
from .contact_data import ACTIVE, BodyContactData, Substep

ON_GPU, MANY_ON_GPU = 8, 4
"""Threads per point on a GPU in scenes with triangles: few points take less time by more threads, which also share
the facets around a point; many points fill a GPU anyway."""
MOST_BY_MORE = 2**14
"""Points of a world up to which it is the larger number."""
FEW_ON_GPU = 2
"""The same for grains and ropes only, which need less computation."""
BLOCK = 64
"""Threads per block on a GPU: in larger blocks many threads wait for those with long rows."""
BLOCKS = 10
"""Concurrent blocks per multiprocessor: more of them hide memory latency better."""
LEAST = """
#if defined(__CUDA_ARCH__)
    const unsigned sharing = {sharing}u << (threadIdx.x & {first});
    for (int far = {half}; far > 0; far /= 2) {{
        const auto other = __shfl_xor_sync(sharing, value, far);
        value = other < value ? other : value;
    }}
#endif
    return value;
"""
"""A point's threads are adjacent in a warp. After the call, one may overwrite values that others have read."""
CHOSEN = """
#if defined(__CUDA_ARCH__)
    const unsigned sharing = {sharing}u << (threadIdx.x & {first});
    const unsigned those = __ballot_sync(sharing, chosen);
    return those ? __shfl_sync(sharing, value, __ffs(those) - 1) : value;
#else
    return value;
#endif
"""


WAIT = """
#if defined(__CUDA_ARCH__)
    __syncwarp({sharing}u << (threadIdx.x & {first}));
#endif
"""
BALLOT = """
#if defined(__CUDA_ARCH__)
    const unsigned at = threadIdx.x & {first};
    return (__ballot_sync({sharing}u << at, chosen) >> at) & {sharing}u;
#else
    return chosen;
#endif
"""
LOWEST = """
#if defined(__CUDA_ARCH__)
    return __ffs(bits) - 1;
#else
    return __builtin_ctz(bits);
#endif
"""
COUNT = """
#if defined(__CUDA_ARCH__)
    return __popc(bits);
#else
    return __builtin_popcount(bits);
#endif
"""


def bounds_of_blocks(scalar: type) -> tuple[int, int]:
    """Return the launch bounds: threads per block, and concurrent blocks, for the compiler's use of registers."""
    return BLOCK, BLOCKS if scalar is wp.float32 else BLOCKS // 2  # float64 takes two


def each_active_point(evaluate_point, scalar: type, lanes: int, worlds: bool, counts_time: bool = False):
    """Compose the kernel that evaluates all active points; `lanes` of its threads share a point.

    One such kernel of each substep also counts the time since the last search (`counts_time`).
    """
    Data, Step = BodyContactData(scalar, worlds), Substep(scalar)

    def evaluate_points(
        data: Data,
        h: scalar,
        behind: scalar,
        per_unit: wp.float64,
        buffer: wp.array(dtype=scalar),
        threads: int,  # per part
        part: int,
        parts: int,
        flags: wp.array(dtype=float),
        stored: wp.array(dtype=wp.float64),  # [J], shape [point_count], if measuring
        heated: wp.array(dtype=wp.float64),  # [W]
    ):
        step = Step(h, behind, per_unit, buffer[0], parts)
        if wp.static(counts_time):
            if grid_thread() == 0 and part == 0:
                data.neighbors.since[0] += float(h)
                raise_to(flags, wp.static(ACTIVE), float(data.neighbors.active_count[0]))
        k = first_of_part(grid_thread(), part) / wp.static(lanes)
        lane = grid_thread() % wp.static(lanes)
        while k < data.neighbors.active_count[0]:
            evaluate_point(data, data.neighbors.active_points[k], lane, step, flags, stored, heated)
            k = next_of_part(k, threads / wp.static(lanes), parts)

    return kernel(evaluate_points, launch_bounds=bounds_of_blocks(scalar))


@functools.cache
def least_of_lanes(kind: type, lanes: int):
    """Compose the minimum over the threads of a point, for values of type `kind`; all of them must call it."""
    if lanes == 1:

        @wp.func
        def least(value: kind) -> kind:
            return value

    else:

        @wp.func_native(LEAST.format(sharing=hex((1 << lanes) - 1), first=32 - lanes, half=lanes // 2))
        def least(value: kind) -> kind: ...

    return least


@functools.cache
def wait_for_lanes(lanes: int):
    """Compose () -> None, which returns when all threads of a point have called it.

    Afterwards one of them may write what others have read.
    """
    if lanes == 1:

        @wp.func
        def wait():
            return

    else:

        @wp.func_native(WAIT.format(sharing=hex((1 << lanes) - 1), first=32 - lanes))
        def wait(): ...

    return wait


@functools.cache
def chosen_of_lanes(kind: type, lanes: int):
    """Compose (chosen, value) -> the `value` of the first of a point's threads whose `chosen` is true.

    All threads of the point must call it. If `chosen` is true for none, each gets back its own `value`.
    """
    if lanes == 1:

        @wp.func
        def pick(chosen: bool, value: kind) -> kind:
            return value

    else:

        @wp.func_native(CHOSEN.format(sharing=hex((1 << lanes) - 1), first=32 - lanes))
        def pick(chosen: bool, value: kind) -> kind: ...

    return pick


@functools.cache
def ballot_of_lanes(lanes: int):
    """Compose (chosen) -> a bit for each thread of a point, 1 where `chosen` is true; all of them must call it."""

    @wp.func_native(BALLOT.format(sharing=hex((1 << lanes) - 1), first=32 - lanes))
    def ballot(chosen: bool) -> wp.uint32: ...

    return ballot


@wp.func_native(LOWEST)
def lowest_bit(bits: wp.uint32) -> int:
    """Return the index of the lowest bit that is 1, from 0; one must be 1."""
    ...


@wp.func_native(COUNT)
def count_bits(bits: wp.uint32) -> int:
    """Count the bits that are 1."""
    ...


@wp.func
def count_before(bits: wp.uint32, lane: int) -> int:
    """Count the bits that are 1 among those of the threads before this one."""
    return count_bits(bits & ((wp.uint32(1) << wp.uint32(lane)) - wp.uint32(1)))
