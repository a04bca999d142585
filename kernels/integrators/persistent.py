"""Many steps in one launch, for bodies so small that separate launches would take most of the time."""

import functools
from typing import Any

import warp as wp

from ..basis import kernel
from ..places import arrays_of, on_device
from ..springs import NO_SUBSTEP
from ..threads import wait, wait_in_block
from .composition import Composition, beginning, by_first_lane, parts, tools
from .enter_world import enter_world, to_world

MOST_THREADS = 512
"""Maximal number of threads per block; launch bounds limit registers accordingly."""


@functools.cache
def persistent(composition: Composition, method: Any, blocks: int, block: int = 0, together: int = 0):
    """Compose the kernel that takes many steps in one launch; its threads divide the particles and use barriers.

    `steps`, shape [2, stages], has the steps of two substeps, which alternate. For small bodies, launching single
    steps would take most of the time. From compute capability 9.0 on, several blocks form a cluster.

    Warp would compile a kernel with a one-dimensional array among its arguments twice for the CPU.

    In an ensemble one block of threads, or on the CPU one thread, advances each world. Frozen worlds are skipped;
    worlds do not wait for each other.

    `blocks` is the number of blocks for a single scene. A world has `block` threads, and a multiprocessor runs
    `together` threads at once, which limits registers.
    """
    _, SceneData, *_ = tools(composition)
    begin, masked_particles = beginning(composition), bool(composition.selective)
    algorithm, moving, timed = composition.force_algorithm, composition.collider_term.moving, composition.timed
    evaluate, force_at, lanes, tears = algorithm.evaluate, algorithm.force_at, algorithm.lanes, algorithm.tears
    Step = method(composition).Step
    advance, load = by_first_lane(composition, method)
    part_count, evaluate_part = parts(composition)
    say_where = on_device(Step, arrays_of(Step, composition.compensated))
    in_worlds, pause = composition.differs is not None, wait if composition.differs is None else wait_in_block
    if in_worlds:
        enter, shift = enter_world(composition), to_world(Step, composition.compensated)

    def take_steps(
        scene: SceneData, steps: wp.array2d(dtype=Step), count: int, connection_count: int, threads: int
    ):
        thread = wp.tid()
        if wp.static(in_worlds):
            w = thread / wp.static(block)
            thread = thread % wp.static(block)
            if scene.worlds.frozen[w] != 0:
                return
            scene = enter(scene, w)
        if wp.static(moving):
            first = int(scene.colliders.substep)
        if wp.static(timed):
            first_stage = int(scene.stage)
        if wp.static(tears):
            begun = int(scene.forces.breaking.substep)
        for k in range(count):
            substep = k / steps.shape[1]
            step = steps[substep % 2, k % steps.shape[1]]
            if wp.static(in_worlds):
                shift(step, wp.int64(w) * scene.worlds.stride)
            else:
                say_where(step)
            if wp.static(timed):
                scene.stage = first_stage + k
            if wp.static(begin is not None):
                if k % steps.shape[1] == 0:  # at a substep's start
                    c = thread
                    while c < connection_count:
                        begin(scene, step.compensation, step.x, c)
                        c += threads
                    pause()
            if wp.static(tears):
                scene.forces.breaking.substep = wp.static(NO_SUBSTEP)
                if k % steps.shape[1] == 0:
                    scene.forces.breaking.substep = begun + substep
            if wp.static(evaluate is not None):
                c = thread
                while c < connection_count:
                    evaluate(scene.forces, step.compensation, step.x, step.v, c)
                    c += threads
                pause()
            if wp.static(evaluate_part is not None):
                c = thread
                while c < part_count(scene):
                    evaluate_part(scene, step.compensation, step.x, step.v, c)
                    c += threads
                pause()
            if wp.static(moving):
                scene.colliders.substep = first + substep
            i = thread
            if wp.static(lanes > 1):
                i = thread / wp.static(lanes)
            while i < scene.inverse_mass.shape[0]:
                if wp.static(load is None):
                    advance(scene, step, force_at(scene.forces, step.compensation, step.x, step.v, i), i)
                else:
                    own = force_at(scene.forces, step.compensation, step.x, step.v, i)
                    mask = wp.uint8(0)
                    if wp.static(masked_particles):
                        mask = scene.effect_mask[i]
                    advance(scene, step, own + load(scene, step.compensation, step.x, step.v, i, mask), i)
                if wp.static(lanes > 1):
                    i += threads / wp.static(lanes)
                else:
                    i += threads
            pause()

    if in_worlds:
        return kernel(take_steps, launch_bounds=(block, max(1, together // block)))
    return kernel(take_steps, launch_bounds=MOST_THREADS, cluster_dim=blocks)
