"""The kernels that run a stage of a method in all worlds, and the one that runs all stages of a frame."""

import functools
from typing import Any

import warp as wp

from ..basis import kernel
from ..integrators import Composition, loads, tools
from .by_world import Differences, by_world, to_world

WAIT = """
#if defined(__CUDA_ARCH__)
    __syncthreads();
#endif
"""


@wp.func_native(WAIT)
def wait():
    """Let no thread of the block go on before all have come here, and see what they have written."""
    ...


@functools.cache
def each_particle_of_worlds(composition: Composition, differs: Differences, method: Any):
    """Compose the kernel, over worlds and particles, of one stage of a method."""
    V, SceneData, *_ = tools(composition)
    (Step, advance, forced), force_algorithm = method(composition), composition.force_algorithm
    (ByWorld, take), shift = by_world(composition, differs), to_world(Step, composition.compensated)
    force_at, load, masked_particles = force_algorithm.force_at, loads(composition), bool(composition.selective)

    def advance_particles(scene: SceneData, by: ByWorld, step: Step):
        w, i = wp.tid()
        own = take(scene, by, w)
        shift(step, wp.int64(w) * by.stride)
        force = V()
        if wp.static(forced):
            force = force_at(own.forces, step.compensation, step.x, step.v, i)
        if wp.static(forced and load is not None):
            mask = wp.uint8(0)
            if wp.static(masked_particles):
                mask = own.effect_mask[i]
            force += load(own, step.compensation, step.x, step.v, i, mask)
        advance(own, step, force, i)

    return kernel(advance_particles, launch_bounds=force_algorithm.bounds, grid_stride=force_algorithm.grid_stride)


@functools.cache
def each_connection_of_worlds(composition: Composition, differs: Differences, method: Any):
    """Compose the kernel, over worlds and connections, that evaluates the scattered forces of a stage."""
    _, SceneData, *_ = tools(composition)
    Step, evaluate = method(composition).Step, composition.force_algorithm.evaluate
    (ByWorld, take), shift = by_world(composition, differs), to_world(Step, composition.compensated)

    def evaluate_forces(scene: SceneData, by: ByWorld, step: Step):
        w, c = wp.tid()
        own = take(scene, by, w)
        shift(step, wp.int64(w) * by.stride)
        evaluate(own.forces, step.compensation, step.x, step.v, c)

    return kernel(evaluate_forces, grid_stride=False)


@functools.cache
def persistent_worlds(composition: Composition, differs: Differences, method: Any, threads: int, together: int):
    """Compose the kernel that takes many steps of all worlds in one launch: a block of threads for each world.

    Step k is steps[k mod their number], which are those of two substeps. On the CPU a world is one thread's. No
    world waits for another, so one that is frozen is left alone.

    Parameters
    ----------
    composition, differs, method
        What the kernel is composed from.
    threads
        Threads of a block.
    together
        Threads that a multiprocessor shall hold at a time: it limits registers.
    """
    _, SceneData, *_ = tools(composition)
    Step, advance, _ = method(composition)
    (ByWorld, take), shift = by_world(composition, differs), to_world(Step, composition.compensated)
    evaluate, force_at = composition.force_algorithm.evaluate, composition.force_algorithm.force_at
    load, masked_particles = loads(composition), bool(composition.selective)

    def take_steps(
        scene: SceneData,
        by: ByWorld,
        steps: wp.array(dtype=Step),
        count: int,
        connection_count: int,
    ):
        tid = wp.tid()
        w = tid / wp.static(threads)
        thread = tid % wp.static(threads)
        if by.frozen[w] != 0:
            return
        own = take(scene, by, w)
        for k in range(count):
            step = steps[k % steps.shape[0]]
            shift(step, wp.int64(w) * by.stride)
            if wp.static(evaluate is not None):
                c = thread
                while c < connection_count:
                    evaluate(own.forces, step.compensation, step.x, step.v, c)
                    c += wp.static(threads)
                wait()
            i = thread
            while i < own.inverse_mass.shape[0]:
                if wp.static(load is None):
                    advance(own, step, force_at(own.forces, step.compensation, step.x, step.v, i), i)
                else:
                    force = force_at(own.forces, step.compensation, step.x, step.v, i)
                    mask = wp.uint8(0)
                    if wp.static(masked_particles):
                        mask = own.effect_mask[i]
                    advance(own, step, force + load(own, step.compensation, step.x, step.v, i, mask), i)
                i += wp.static(threads)
            wait()

    return kernel(take_steps, launch_bounds=(threads, max(1, together // threads)))
