"""Threads that share a point: each looks at some of the facets near it, and all of them learn the result."""

import functools

import warp as wp

from ..basis import kernel
from .contact_data import BodyContactData, Substep
from .cpu_partition import first_of_part, next_of_part

ON_GPU = 4
"""Threads to a point on a GPU where there are triangles: most points have some six near them."""
FEW_ON_GPU = 2
"""The same where there are grains and ropes only, on which less has to be computed."""
BLOCK = 64
"""Threads in a block on a GPU: in larger ones many wait for those whose rows are long."""
BLOCKS = 10
"""Blocks of a multiprocessor at a time: more of them hide the latency of memory better."""
FAST = {"fast_math": True}
"""Options of kernels in which divisions and roots on a GPU may be wrong by two units in the last place."""
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
"""They are neighbours in a warp. Values that one of them has read, the others may overwrite afterwards."""
CHOSEN = """
#if defined(__CUDA_ARCH__)
    const unsigned sharing = {sharing}u << (threadIdx.x & {first});
    const unsigned those = __ballot_sync(sharing, chosen);
    return those ? __shfl_sync(sharing, value, __ffs(those) - 1) : value;
#else
    return value;
#endif
"""


def bounds_of_blocks(scalar: type) -> tuple[int, int]:
    """Return for how many threads in a block, and blocks at a time, the compiler is to leave registers."""
    return BLOCK, BLOCKS if scalar is wp.float32 else BLOCKS // 2  # float64 takes two


def each_active_point(evaluate_point, scalar: type, lanes: int, worlds: bool):
    """Compose the kernel that evaluates points that are near anything; `lanes` of its threads share a point."""
    Data, Step = BodyContactData(scalar, worlds), Substep(scalar)

    def evaluate_points(
        data: Data,
        h: scalar,
        behind: scalar,
        per_unit: wp.float64,
        buffer: wp.array(dtype=scalar),
        threads: int,  # in each part
        part: int,
        parts: int,
        flags: wp.array(dtype=float),
        stored: wp.array(dtype=wp.float64),  # [J], shape [point_count], where measured
        heated: wp.array(dtype=wp.float64),  # [W]
    ):
        step = Step(h, behind, per_unit, buffer[0], parts)
        k = first_of_part(wp.tid(), part) / wp.static(lanes)
        lane = wp.tid() % wp.static(lanes)
        while k < data.neighbors.active_count[0]:
            evaluate_point(data, data.neighbors.active_points[k], lane, step, flags, stored, heated)
            k = next_of_part(k, threads / wp.static(lanes), parts)

    return kernel(evaluate_points, launch_bounds=bounds_of_blocks(scalar), module_options=FAST)


@functools.cache
def least_of_lanes(kind: type, lanes: int):
    """Compose the least of the values that the threads of a point have, of a type; all of them must call it."""
    if lanes == 1:

        @wp.func
        def least(value: kind) -> kind:
            return value

    else:

        @wp.func_native(LEAST.format(sharing=hex((1 << lanes) - 1), first=32 - lanes, half=lanes // 2))
        def least(value: kind) -> kind: ...

    return least


@functools.cache
def chosen_of_lanes(kind: type, lanes: int):
    """Compose (chosen, value) -> the value of the first thread of a point for which `chosen` is true.

    All of them must call it. Where it is true for none each keeps its own.
    """
    if lanes == 1:

        @wp.func
        def pick(chosen: bool, value: kind) -> kind:
            return value

    else:

        @wp.func_native(CHOSEN.format(sharing=hex((1 << lanes) - 1), first=32 - lanes))
        def pick(chosen: bool, value: kind) -> kind: ...

    return pick
