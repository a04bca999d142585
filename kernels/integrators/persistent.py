"""Many stages in one launch: by blocks of a GPU, one or a cluster or one for each world, or by CPU threads."""

import functools
from typing import Any, NamedTuple

import warp as wp

from ..places import arrays_of, on_device
from ..springs.fracture import NO_SUBSTEP
from ..threads import Part, barrier, wait, wait_in_block
from .composition import Composition, before_forces, beginning, tools
from .enter_world import enter_world, to_world
from .stages import stage_of

MOST_THREADS = 512
"""Maximal number of threads per block; launch bounds limit registers accordingly."""


@wp.struct
class Nothing:
    """The struct of what precedes forces, if nothing does."""


class Before(NamedTuple):
    """What a launch of many stages does before the forces of each."""

    Data: Any = Nothing
    """Type of its struct, the kernel's last argument."""
    run: Any = None
    """wp.func (data, scene, step, part) that ends with a barrier."""


NOTHING_BEFORE = Before()


@functools.cache
def persistent(
    composition: Composition,
    method: Any,
    blocks: int = 1,
    block: int = 0,
    together: int = 0,
    in_parts: bool = False,
    before: Before = NOTHING_BEFORE,
):
    """Compose the kernel that takes many stages in one launch; its threads divide the particles and use barriers.

    `steps`, shape [2, stages], has the stages of two substeps, which alternate. For small bodies, launching single
    stages would take most of the time. From compute capability 9.0 on, several blocks form a cluster: `blocks` is
    their number.

    In an ensemble one block of `block` threads, or on the CPU one thread, advances each world; a multiprocessor
    runs `together` threads at once, which limits registers. Frozen worlds are skipped; worlds do not wait for each
    other.

    If `in_parts`, a kernel with one thread is launched for each `Part` of the particles, all at the same time. A
    particle's forces are summed in the same order as by a single thread. For scattered forces each thread has its
    own array, for the connections of its particles. Connections between two parts are evaluated in both.

    Warp would compile a kernel with a one-dimensional array among its arguments twice for the CPU.
    """
    V, SceneData, _, _, store, _ = tools(composition)
    begin, take_stage, Step = beginning(composition), stage_of(composition, method), method(composition).Step
    algorithm, moving, timed = composition.force_algorithm, composition.collider_term.moving, composition.timed
    evaluate, lanes, tears = algorithm.evaluate, algorithm.lanes, algorithm.tears
    element_count, evaluate_element = (None, None) if in_parts else before_forces(composition)
    Data, run_before = before
    say_where = on_device(Step, arrays_of(Step, composition.compensated))
    in_worlds = composition.differs is not None
    if in_worlds:
        enter, shift = enter_world(composition), to_world(Step, composition.compensated)

    @wp.func
    def pause(part: Part):
        if wp.static(in_parts):
            barrier(part.meeting, part.threads, part.yield_cpu)
        elif wp.static(in_worlds):
            wait_in_block()
        else:
            wait()

    def take_stages(scene: SceneData, steps: wp.array2d(dtype=Step), count: int, part: Part, data: Data):
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
        if wp.static(in_parts):
            pause(part)  # earlier launches have ended
        for k in range(count):
            substep = k / steps.shape[1]
            begins = k % steps.shape[1] == 0
            step = steps[substep % 2, k % steps.shape[1]]
            if wp.static(in_worlds):
                shift(step, wp.int64(w) * scene.worlds.stride)
            else:
                say_where(step)
            if wp.static(timed):
                scene.stage = first_stage + k
            if wp.static(moving):
                scene.colliders.substep = first + substep
            if wp.static(begin is not None):
                if begins:
                    c = part.first_spring + thread
                    while c < part.last_spring:
                        begin(scene, step.compensation, step.x, c)
                        c += part.stride
                    pause(part)
            if wp.static(tears):
                scene.forces.breaking.substep = wp.where(begins, begun + substep, wp.static(NO_SUBSTEP))
            if wp.static(evaluate is not None):
                if wp.static(in_parts):
                    for n in range(part.runs.shape[0]):
                        for s in range(part.runs[n][0], part.runs[n][1]):
                            evaluate(scene.forces, step.compensation, step.x, step.v, s)
                    for n in range(part.others.shape[0]):
                        store(scene.forces.f, part.others[n], V())
                else:
                    s = part.first_spring + thread
                    while s < part.last_spring:
                        evaluate(scene.forces, step.compensation, step.x, step.v, s)
                        s += part.stride
                    pause(part)
            if wp.static(evaluate_element is not None):
                p = thread
                while p < element_count(scene):
                    evaluate_element(scene, step.compensation, step.x, step.v, p)
                    p += part.stride
                pause(part)
            if wp.static(run_before is not None):
                run_before(data, scene, step, part)
            i = part.first + thread / wp.static(lanes)
            while i < part.last:
                take_stage(scene, step, i)
                i += part.stride / wp.static(lanes)
            pause(part)

    if in_worlds:
        return composition.kernel(take_stages, launch_bounds=(block, max(1, together // block)))
    return composition.kernel(take_stages, launch_bounds=MOST_THREADS, cluster_dim=blocks)
