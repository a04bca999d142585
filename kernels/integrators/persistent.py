"""Many steps in one launch, for bodies so small that launches are most of what they cost."""

import functools
from typing import Any

import warp as wp

from ..basis import kernel
from ..forces import NO_SUBSTEP
from ..places import arrays_of, on_device
from .composition import Composition, beginning, by_first_lane, tools

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
def persistent(composition: Composition, method: Any, blocks: int):
    """Compose the kernel that takes many steps in one launch: its threads share the particles, and wait.

    Step k is steps[k mod their number], which are those of two substeps. A launch is then paid once for all: most
    of what a small body costs. Several blocks form a cluster, which GPUs have from compute capability 9.0 on.
    """
    _, World, *_ = tools(composition)
    begin, marked = beginning(composition), bool(composition.selective)
    evaluate, force_at, lanes = composition.route.evaluate, composition.route.force_at, composition.route.lanes
    moving, timed, tears = composition.contact.moving, composition.timed, composition.route.tears
    Step = method(composition).Step
    advance, load = by_first_lane(composition, method)
    say_where = on_device(Step, arrays_of(Step, composition.compensated))

    def take_steps(world: World, steps: wp.array(dtype=Step), count: int, connection_count: int, threads: int):
        thread = wp.tid()
        if wp.static(moving):
            first = int(world.colliders.substep)
        if wp.static(timed):
            first_stage = int(world.stage)
        if wp.static(tears):
            begun = int(world.forces.breaking.substep)
        for k in range(count):
            step = steps[k % steps.shape[0]]
            say_where(step)
            if wp.static(timed):
                world.stage = first_stage + k
            if wp.static(begin is not None):
                if k % (steps.shape[0] / 2) == 0:  # where a substep begins
                    c = thread
                    while c < connection_count:
                        begin(world, step.lost, step.x, c)
                        c += threads
                    wait()
            if wp.static(tears):
                world.forces.breaking.substep = wp.static(NO_SUBSTEP)
                if k % (steps.shape[0] / 2) == 0:
                    world.forces.breaking.substep = begun + k / (steps.shape[0] / 2)
            if wp.static(evaluate is not None):
                c = thread
                while c < connection_count:
                    evaluate(world.forces, step.lost, step.x, step.v, c)
                    c += threads
                wait()
            if wp.static(moving):
                world.colliders.substep = first + k / (steps.shape[0] / 2)
            i = thread
            if wp.static(lanes > 1):
                i = thread / wp.static(lanes)
            while i < world.inverse_mass.shape[0]:
                if wp.static(load is None):
                    advance(world, step, force_at(world.forces, step.lost, step.x, step.v, i), i)
                else:
                    own = force_at(world.forces, step.lost, step.x, step.v, i)
                    mark = wp.uint8(0)
                    if wp.static(marked):
                        mark = world.marks[i]
                    advance(world, step, own + load(world, step.lost, step.x, step.v, i, mark), i)
                if wp.static(lanes > 1):
                    i += threads / wp.static(lanes)
                else:
                    i += threads
            wait()

    return kernel(take_steps, launch_bounds=MOST_THREADS, cluster_dim=blocks)
