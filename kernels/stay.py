"""Many steps in one launch, for bodies so small that launches are most of what they cost."""

import functools
from typing import Any

import warp as wp

from .basis import kernel
from .motion import Motion, world

WAIT = """
#if defined(__CUDA_ARCH__)
    __syncthreads();
    if (blocks > 1) {
        if (threadIdx.x == 0) {
            __threadfence();
            atomicAdd(arrived.data, 1);
            while (*reinterpret_cast<volatile int*>(arrived.data) < blocks * turn) { }
            __threadfence();
        }
        __syncthreads();
    }
#endif
"""


@wp.func_native(WAIT)
def wait(arrived: wp.array(dtype=int), blocks: int, turn: int):
    """Let no thread go on before all have come here, and see what they have written.

    `arrived` counts blocks, `turn` the waits so far. All blocks must be on the device at once.
    """
    ...


@functools.cache
def stay(motion: Motion, method: Any):
    """Compose the kernel that takes many steps in one launch: its threads share the particles, and wait.

    Step k is steps[k mod their number]. A launch is then paid once for all: most of what a small body costs.
    """
    World, (Step, advance, _) = world(motion), method(motion)
    evaluate, force_at = motion.route.evaluate, motion.route.force_at

    @kernel
    def take_steps(
        world: World,
        steps: wp.array(dtype=Step),
        count: int,
        connection_count: int,
        threads: int,
        blocks: int,
        arrived: wp.array(dtype=int),
    ):
        thread = wp.tid()
        turn = int(0)
        for k in range(count):
            step = steps[k % steps.shape[0]]
            if wp.static(evaluate is not None):
                c = thread
                while c < connection_count:
                    evaluate(world.forces, step.lost, step.x, step.v, c)
                    c += threads
                turn += 1
                wait(arrived, blocks, turn)
            i = thread
            while i < world.inverse_mass.shape[0]:
                advance(world, step, force_at(world.forces, step.lost, step.x, step.v, i), i)
                i += threads
            turn += 1
            wait(arrived, blocks, turn)

    return take_steps
