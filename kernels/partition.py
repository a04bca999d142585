"""Partition of points or vertices among CPU threads, and atomic operations on numbers that several threads change.

On a GPU, or with a single CPU thread, there is one part. Warp's own atomic functions are not atomic on the CPU,
where Warp runs a kernel in one thread.
"""

import warp as wp

CHUNK = 32
"""Consecutive items of one thread: enough that two threads seldom write to the same cache line."""
COUNT_UP = """
#if defined(__CUDA_ARCH__)
    return wp::atomic_add(numbers, at, 1);
#else
    return __atomic_fetch_add(&wp::index(numbers, at), 1, __ATOMIC_RELAXED);
#endif
"""
RAISE = """
#if defined(__CUDA_ARCH__)
    // The bits of numbers from 0 on have the order of integers, those below 0 the opposite one; NaN is largest.
    // So no thread waits for another, as threads do in Warp's own loop over compare-and-swap.
    int* place = reinterpret_cast<int*>(&wp::index(numbers, at));
    if (value < 0.0f)
        atomicMin(reinterpret_cast<unsigned*>(place), __float_as_uint(value));
    else
        atomicMax(place, __float_as_int(value) & 0x7fffffff);
#else
    wp::float32* place = &wp::index(numbers, at);
    wp::float32 before;
    __atomic_load(place, &before, __ATOMIC_RELAXED);
    while (!(value <= before) && before == before)  // NaN stays
        if (__atomic_compare_exchange(place, &before, &value, false, __ATOMIC_RELAXED, __ATOMIC_RELAXED))
            break;
#endif
"""
EXTEND = """
#if defined(__CUDA_ARCH__)
    for (int k = 0; k < 3; ++k) {
        int* low = reinterpret_cast<int*>(&wp::index(lower, at)) + k;
        if (least[k] < 0.0f)
            atomicMax(reinterpret_cast<unsigned*>(low), __float_as_uint(least[k]));
        else
            atomicMin(low, __float_as_int(least[k]) & 0x7fffffff);
        int* high = reinterpret_cast<int*>(&wp::index(upper, at)) + k;
        if (most[k] < 0.0f)
            atomicMin(reinterpret_cast<unsigned*>(high), __float_as_uint(most[k]));
        else
            atomicMax(high, __float_as_int(most[k]) & 0x7fffffff);
    }
#else
    wp::atomic_min(lower, at, least);
    wp::atomic_max(upper, at, most);
#endif
"""
ADD_WHOLE = """
#if defined(__CUDA_ARCH__)
    wp::atomic_add(numbers, i, k, value);
#else
    if (parts > 1)
        __atomic_fetch_add(&wp::index(numbers, i, k), value, __ATOMIC_RELAXED);
    else
        wp::index(numbers, i, k) += value;
#endif
"""


@wp.func
def first_of_part(thread: int, part: int) -> int:
    """Return the index of the first item of a thread in this part; `next_of_part` returns the next ones."""
    return part * wp.static(CHUNK) + thread


@wp.func
def next_of_part(e: int, threads: int, parts: int) -> int:
    """Return the next item of a thread after item e; the threads of a part take its items in turn."""
    following = e + threads
    if parts > 1 and following % wp.static(CHUNK) == 0:
        following += (parts - 1) * wp.static(CHUNK)
    return following


@wp.func_native(COUNT_UP)
def count_up(numbers: wp.array(dtype=int), at: int) -> int:
    """Add 1 to numbers[at] and return its previous value."""
    ...


@wp.func_native(RAISE)
def raise_to(numbers: wp.array(dtype=float), at: int, value: float):
    """Replace numbers[at] by `value` if `value` is greater; NaN stays."""
    ...


@wp.func_native(EXTEND)
def extend_to(
    lower: wp.array(dtype=wp.vec3), upper: wp.array(dtype=wp.vec3), at: int, least: wp.vec3, most: wp.vec3
):
    """Extend the box between lower[at] and upper[at] to hold that from `least` to `most`; see `raise_to`."""
    ...


@wp.func_native(ADD_WHOLE)
def add_whole(numbers: wp.array2d(dtype=wp.int64), i: int, k: int, value: wp.int64, parts: int):
    """Add `value` to numbers[i, k]; not atomically for a single CPU thread, where that would cost too much."""
    ...
