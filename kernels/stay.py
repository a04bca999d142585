"""Many steps in one launch, for bodies so small that launches are most of what they cost."""

import functools
from typing import Any

import warp as wp

from .basis import kernel
from .motion import Motion, world

MOST_THREADS = 512
"""Threads in a block; the compiler leaves registers for so many."""

WAIT = """
#if defined(__CUDA_ARCH__) && __CUDA_ARCH__ >= 900
    asm volatile("barrier.cluster.arrive.release; barrier.cluster.wait.acquire;" ::: "memory");
#elif defined(__CUDA_ARCH__)
    __syncthreads();
#endif
"""


@wp.func_native(WAIT)
def wait():
    """Let no thread of the cluster of blocks go on before all have come here, and see what they have written."""
    ...


@functools.cache
def stay(motion: Motion, method: Any, blocks: int):
    """Compose the kernel that takes many steps in one launch: its threads share the particles, and wait.

    Step k is steps[k mod their number]. A launch is then paid once for all: most of what a small body costs.
    More blocks than one form a cluster, which a GPU has from compute capability 9.0 on.
    """
    World, (Step, advance, _) = world(motion), method(motion)
    evaluate, force_at = motion.route.evaluate, motion.route.force_at

    def take_steps(world: World, steps: wp.array(dtype=Step), count: int, connection_count: int, threads: int):
        thread = wp.tid()
        for k in range(count):
            step = steps[k % steps.shape[0]]
            if wp.static(evaluate is not None):
                c = thread
                while c < connection_count:
                    evaluate(world.forces, step.lost, step.x, step.v, c)
                    c += threads
                wait()
            i = thread
            while i < world.inverse_mass.shape[0]:
                advance(world, step, force_at(world.forces, step.lost, step.x, step.v, i), i)
                i += threads
            wait()

    return kernel(take_steps, launch_bounds=MOST_THREADS, cluster_dim=blocks)
