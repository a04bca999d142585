"""Many steps in one launch per CPU thread; threads divide the particles and synchronize at barriers."""

import functools
from typing import Any

import warp as wp

from ..basis import kernel
from ..springs import NO_SUBSTEP
from .composition import Composition, beginning, loads, tools

ABORT = 16
"""Index in `PartOfParticles.meeting` of the flag that a thread is missing; outside the cache line that all threads
poll."""
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


@wp.func_native(MEET)
def barrier(meeting: wp.array(dtype=int), threads: int, yield_cpu: wp.uint64):
    """Wait until all CPU threads have reached a barrier; afterwards their writes are visible.

    Barrier k opens when the count of arrivals, which is never reset, reaches k times the number of threads.
    """
    ...


@wp.struct
class PartOfParticles:
    """The part of the particles that one of several threads advances."""

    threads: int  # number of threads
    first: int  # first particle
    last: int  # end of the particles, exclusive
    first_begun: int  # connections whose actions at a substep's start this thread runs
    last_begun: int
    # For scatter: ranges of connections with at least one end in this part
    runs: wp.array(dtype=wp.vec2i)
    others: wp.array(dtype=int)  # particles of other parts at the other ends of these connections
    meeting: wp.array(dtype=int)  # number of arrivals at barriers; at ABORT, whether a thread is missing
    yield_cpu: wp.uint64  # address of the system function that yields the core


@kernel
def wait_for_all(share: PartOfParticles):
    """Wait until the threads of all parts have reached the next barrier; see `barrier`."""
    barrier(share.meeting, share.threads, share.yield_cpu)


@kernel
def count_down(left: wp.array(dtype=int)):
    """Subtract 1 from left[0]."""
    left[0] = left[0] - 1


@functools.cache
def in_partition(composition: Composition, method: Any):
    """Compose the kernel that runs many stages, as `persistent` does, for one part of the particles.

    It is launched once per part, all parts at the same time. A particle's forces are summed in the same order as
    by a single thread. For scattered forces each thread has its own array, for the connections of its particles.
    Connections between two parts are evaluated in both.
    """
    _, SceneData, _, _, store, _ = tools(composition)
    begin, load, masked_particles = beginning(composition), loads(composition), bool(composition.selective)
    evaluate, force_at = composition.force_algorithm.evaluate, composition.force_algorithm.force_at
    moving, timed, tears = composition.collider_term.moving, composition.timed, composition.force_algorithm.tears
    Step, advance, _ = method(composition)
    V = tools(composition).V

    def take_share(scene: SceneData, steps: wp.array2d(dtype=Step), count: int, share: PartOfParticles):
        if wp.static(moving):
            first = int(scene.colliders.substep)
        if wp.static(timed):
            first_stage = int(scene.stage)
        if wp.static(tears):
            begun = int(scene.forces.breaking.substep)
        barrier(share.meeting, share.threads, share.yield_cpu)  # earlier launches have ended
        for k in range(count):
            substep = k / steps.shape[1]
            step = steps[substep % 2, k % steps.shape[1]]
            if wp.static(timed):
                scene.stage = first_stage + k
            if wp.static(begin is not None):
                if k % steps.shape[1] == 0:  # at a substep's start
                    for c in range(share.first_begun, share.last_begun):
                        begin(scene, step.compensation, step.x, c)
                    barrier(share.meeting, share.threads, share.yield_cpu)
            if wp.static(tears):
                scene.forces.breaking.substep = wp.static(NO_SUBSTEP)
                if k % steps.shape[1] == 0:
                    scene.forces.breaking.substep = begun + substep
            if wp.static(evaluate is not None):
                for n in range(share.runs.shape[0]):
                    c = int(share.runs[n][0])
                    while c < share.runs[n][1]:
                        evaluate(scene.forces, step.compensation, step.x, step.v, c)
                        c += 1
                for n in range(share.others.shape[0]):
                    store(scene.forces.f, share.others[n], V())
            if wp.static(moving):
                scene.colliders.substep = first + substep
            for i in range(share.first, share.last):
                if wp.static(load is None):
                    advance(scene, step, force_at(scene.forces, step.compensation, step.x, step.v, i), i)
                else:
                    own = force_at(scene.forces, step.compensation, step.x, step.v, i)
                    mask = wp.uint8(0)
                    if wp.static(masked_particles):
                        mask = scene.effect_mask[i]
                    advance(scene, step, own + load(scene, step.compensation, step.x, step.v, i, mask), i)
            barrier(share.meeting, share.threads, share.yield_cpu)

    return kernel(take_share)
