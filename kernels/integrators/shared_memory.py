"""Small worlds whose state stays in the shared memory of a block of threads for many steps."""

import functools
from typing import Any

import warp as wp

from ..basis import kernel
from ..places import Place, arrays_of, shifts
from ..springs.stencil import COLUMN
from ..threads import wait_in_block
from .composition import Composition, loads, tools
from .enter_world import enter_world

MOST_BYTES = 44 * 1024
"""Every GPU gives a block 48 KB of shared memory by default; Warp uses 4 bytes per thread of it."""
FILL = """
#if defined(__CUDA_ARCH__)
    __shared__ __align__(16) int room[{words}];
    for (int k = thread; k < {words}; k += {threads})
        room[k] = 0;
    __syncthreads();
    for (int s = 0; s < home.shape[0]; ++s) {{
        const int* from = reinterpret_cast<const int*>(home.data[s] + bytes);
        for (int k = thread; k < words; k += {threads})
            room[s * each + margin + k] = from[k];
    }}
    __syncthreads();
    return reinterpret_cast<wp::int64>(room);
#else
    return 0;
#endif
"""
EMPTY = """
#if defined(__CUDA_ARCH__)
    const int* room = reinterpret_cast<const int*>(chip);
    for (int s = 0; s < home.shape[0]; ++s) {{
        int* to = reinterpret_cast<int*>(home.data[s] + bytes);
        for (int k = thread; k < words; k += {threads})
            to[k] = room[s * each + margin + k];
    }}
#endif
"""


@functools.cache
def on_chip_worlds(
    composition: Composition, method: Any, threads: int, together: int, room: int, in_columns: bool
):
    """Compose the kernel that takes many steps of small worlds in one launch, with their states in shared memory.

    A block has a thread for each particle of its world, or for each column of particles (see `column_forces`). All
    forces are computed before any thread moves a particle, so a stage may update arrays in place. `steps` has the
    steps of one substep; their arrays are byte offsets in shared memory. An array has `words` words of four bytes,
    with `margin` readable zero words before and after; arrays are `each` words apart. Array s of world 0 is copied
    from `home[s]`, and back.

    The algorithm must not be scatter. A block has `threads` threads and `room` bytes of shared memory, and a
    multiprocessor runs `together` threads, which limits registers. Columns are for lattices with layers.
    """
    _, SceneData, *_ = tools(composition)
    Step, advance, _ = method(composition)
    enter, moving, timed = enter_world(composition), composition.collider_term.moving, composition.timed
    shift = shifts(Step, arrays_of(Step, composition.compensated), Place.CHIP)
    force_algorithm, load = composition.force_algorithm, loads(composition)
    masked_particles, Addresses = bool(composition.selective), wp.array(dtype=wp.int64)
    force_at, forces_at = force_algorithm.force_at, force_algorithm.column_forces
    rows = COLUMN if in_columns else 1
    Forces = wp.types.matrix((rows, composition.dim), composition.scalar)
    sizes = {"words": room // 4, "threads": threads}

    @wp.func_native(FILL.format(**sizes))
    def fill(home: Addresses, bytes: wp.int64, thread: int, words: int, each: int, margin: int) -> wp.int64: ...

    @wp.func_native(EMPTY.format(**sizes))
    def empty(
        chip: wp.int64, home: Addresses, bytes: wp.int64, thread: int, words: int, each: int, margin: int
    ): ...

    def take_steps_on_chip(
        scene: SceneData,
        steps: wp.array(dtype=Step),
        count: int,
        home: Addresses,
        words: int,
        each: int,
        margin: int,
    ):
        tid = wp.tid()
        w = tid / wp.static(threads)
        thread = tid % wp.static(threads)
        if scene.worlds.frozen[w] != 0:
            return
        own = enter(scene, w)
        if wp.static(moving):
            first = int(scene.colliders.substep)
        if wp.static(timed):
            first_stage = int(scene.stage)
        i = thread
        stride = int(0)
        if wp.static(in_columns):
            stride = own.forces.stride
            i = thread / stride * (wp.static(COLUMN) * stride) + thread % stride
        chip = fill(home, wp.int64(w) * own.worlds.stride, thread, words, each, margin)
        for k in range(count):
            step = steps[k % steps.shape[0]]
            shift(step, chip)
            if wp.static(moving):
                own.colliders.substep = first + k / steps.shape[0]
            if wp.static(timed):
                own.stage = first_stage + k
            forces = Forces()
            if i < own.inverse_mass.shape[0]:
                if wp.static(in_columns):
                    forces = forces_at(own.forces, step.compensation, step.x, step.v, i)
                else:
                    forces[0] = force_at(own.forces, step.compensation, step.x, step.v, i)
                if wp.static(load is not None):
                    for d in range(wp.static(rows)):
                        if i + d * stride < own.inverse_mass.shape[0]:
                            mask = wp.uint8(0)
                            if wp.static(masked_particles):
                                mask = own.effect_mask[i + d * stride]
                            forces[d] += load(own, step.compensation, step.x, step.v, i + d * stride, mask)
            wait_in_block()
            for d in range(wp.static(rows)):
                if i + d * stride < own.inverse_mass.shape[0]:
                    advance(own, step, forces[d], i + d * stride)
            wait_in_block()
        empty(chip, home, wp.int64(w) * own.worlds.stride, thread, words, each, margin)

    return kernel(take_steps_on_chip, launch_bounds=(threads, max(1, together // threads)))
