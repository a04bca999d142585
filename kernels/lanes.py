"""Communication between adjacent GPU threads of a warp that work on the same item, such as a contact point.

After all of them have called one of these functions, each may overwrite values that the others have read.
"""

import functools

import warp as wp

WARP = 32
"""Threads of a warp."""
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
RESERVE = """
#if defined(__CUDA_ARCH__)
    const int lane = threadIdx.x & 31;
    int until = count;  // of this thread and those before it
    for (int far = 1; far < 32; far *= 2) {
        const int before = __shfl_up_sync(~0u, until, far);
        if (lane >= far)
            until += before;
    }
    int first = 0;
    if (lane == 31 && until > 0)
        first = wp::atomic_add(numbers, at, until);
    return __shfl_sync(~0u, first, 31) + until - count;
#else
    return __atomic_fetch_add(&wp::index(numbers, at), count, __ATOMIC_RELAXED);
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


@functools.cache
def least_of_lanes(kind: type, lanes: int):
    """Compose the minimum over the threads of a point, for values of type `kind`; all threads must call it."""

    @wp.func_native(LEAST.format(sharing=hex((1 << lanes) - 1), first=32 - lanes, half=lanes // 2))
    def least(value: kind) -> kind: ...

    return least


@functools.cache
def lowest_of_lanes(lanes: int):
    """Compose the minimum of each coordinate of a vector over the threads of a point; all threads must call it."""
    least = least_of_lanes(wp.float32, lanes)

    @wp.func
    def lowest(x: wp.vec3) -> wp.vec3:
        return wp.vec3(least(x[0]), least(x[1]), least(x[2]))

    return lowest


@functools.cache
def wait_for_lanes(lanes: int):
    """Compose () -> None, which returns when all threads of a point have called it.

    Afterwards each of them may overwrite what the others have read.
    """

    @wp.func_native(WAIT.format(sharing=hex((1 << lanes) - 1), first=32 - lanes))
    def wait(): ...

    return wait


@functools.cache
def chosen_of_lanes(kind: type, lanes: int):
    """Compose (chosen, value) -> the `value` of the first of a point's threads whose `chosen` is true.

    All threads of the point must call it. If `chosen` is true for none, each gets back its own `value`.
    """

    @wp.func_native(CHOSEN.format(sharing=hex((1 << lanes) - 1), first=32 - lanes))
    def pick(chosen: bool, value: kind) -> kind: ...

    return pick


@functools.cache
def ballot_of_lanes(lanes: int):
    """Compose (chosen) -> a bit for each thread of a point, 1 where `chosen` is true; all threads must call it."""

    @wp.func_native(BALLOT.format(sharing=hex((1 << lanes) - 1), first=32 - lanes))
    def ballot(chosen: bool) -> wp.uint32: ...

    return ballot


@wp.func_native(RESERVE)
def reserve(numbers: wp.array(dtype=int), at: int, count: int) -> int:
    """Add `count` to numbers[at] and return its previous value; all threads of a warp must call it together."""
    ...


@wp.func_native(LOWEST)
def lowest_bit(bits: wp.uint32) -> int:
    """Return the index of the lowest bit that is 1, counted from 0; at least one bit must be 1."""
    ...


@wp.func_native(COUNT)
def count_bits(bits: wp.uint32) -> int:
    """Count the bits that are 1."""
    ...


@wp.func
def count_before(bits: wp.uint32, lane: int) -> int:
    """Count the bits that are 1 below bit `lane`."""
    return count_bits(bits & ((wp.uint32(1) << wp.uint32(lane)) - wp.uint32(1)))
