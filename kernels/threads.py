"""The threads of a launch: their index, and barriers at which they wait for each other."""

import warp as wp

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
