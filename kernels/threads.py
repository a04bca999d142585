"""The threads of a launch: their index, their part of the work, and barriers at which they wait for each other."""

import warp as wp

from .basis import kernel

ABORT = 16
"""Index in `Part.meeting` of the flag that a thread is missing; outside the cache line that all threads poll."""
GRID_THREAD = """
#if defined(__CUDA_ARCH__)
    return static_cast<wp::int32>(blockIdx.x * blockDim.x + threadIdx.x);
#else
    return 0;
#endif
"""
WAIT = """
#if defined(__CUDA_ARCH__) && __CUDA_ARCH__ >= 900
    asm volatile("barrier.cluster.arrive.release; barrier.cluster.wait.acquire;" ::: "memory");
#elif defined(__CUDA_ARCH__)
    __syncthreads();
#endif
"""
WAIT_IN_BLOCK = """
#if defined(__CUDA_ARCH__)
    __syncthreads();
#endif
"""
MEET = f"""
#if !defined(__CUDA_ARCH__)
    int* arrived = meeting.data;
    const int own = __atomic_add_fetch(arrived, 1, __ATOMIC_ACQ_REL);
    const int all = (own + threads - 1) / threads * threads;
    for (int tries = 0; __atomic_load_n(arrived, __ATOMIC_ACQUIRE) < all; ++tries) {{
        if (__atomic_load_n(arrived + {ABORT}, __ATOMIC_RELAXED))
            return;
        if (tries > 300)  // some 10 µs: the one that is waited for may need this core, or another program
            reinterpret_cast<wp::int32 (*)()>(yield_cpu)();
#if defined(__x86_64__)
        else
            __builtin_ia32_pause();
#endif
    }}
#endif
"""


@wp.func_native(GRID_THREAD)
def grid_thread() -> int:
    """Return the index of this thread in its launch; 0 on the CPU, where such a launch has a single thread.

    Unlike `wp.tid` it may be called in functions, so that the same source can be a kernel or part of one.
    """
    ...


@wp.func_native(WAIT)
def wait():
    """Wait until all threads of the cluster of blocks have reached this call; their writes are then visible."""
    ...


@wp.func_native(WAIT_IN_BLOCK)
def wait_in_block():
    """Wait until all threads of the block have reached this call; their writes are then visible."""
    ...


@wp.struct
class Part:
    """The part of a body that one launch advances: all of it on a GPU, one of several parts for a CPU thread."""

    first: int  # first particle
    last: int  # end of the particles, exclusive
    first_spring: int  # connections whose actions at a substep's start it runs
    last_spring: int
    stride: int  # threads of the launch that divide the particles of a body, or of each world
    # For parts on CPU threads:
    threads: int  # number of parts
    meeting: wp.array(dtype=int)  # number of arrivals at barriers; at ABORT, whether a thread is missing
    yield_cpu: wp.uint64  # address of the system function that yields the core
    # For scatter: ranges of connections with at least one end in this part
    runs: wp.array(dtype=wp.vec2i)
    others: wp.array(dtype=int)  # particles of other parts at the other ends of these connections


@wp.func_native(MEET)
def barrier(meeting: wp.array(dtype=int), threads: int, yield_cpu: wp.uint64):
    """Wait until all CPU threads have reached a barrier; afterwards their writes are visible.

    Barrier k opens when the count of arrivals, which is never reset, reaches k times the number of threads.
    """
    ...


@kernel
def wait_for_all(part: Part):
    """Wait until the threads of all parts have reached the next barrier; see `barrier`."""
    barrier(part.meeting, part.threads, part.yield_cpu)


@kernel
def count_down(left: wp.array(dtype=int)):
    """Subtract 1 from left[0]."""
    left[0] = left[0] - 1
