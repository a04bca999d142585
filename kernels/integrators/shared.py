"""Many steps in one launch for each thread of the CPU: they share the particles, and wait for each other."""

import functools
from typing import Any

import warp as wp

from ..basis import kernel
from ..forces import NO_SUBSTEP
from .composition import Composition, beginning, loads, tools

GIVEN_UP = 16
"""Where in `Share.meeting` it is said that a thread is missing: not in the line of the cache that all wait for."""
MEET = f"""
#if !defined(__CUDA_ARCH__)
    int* arrived = meeting.data;
    const int own = __atomic_add_fetch(arrived, 1, __ATOMIC_ACQ_REL);
    const int all = (own + threads - 1) / threads * threads;
    for (int tries = 0; __atomic_load_n(arrived, __ATOMIC_ACQUIRE) < all; ++tries) {{
        if (__atomic_load_n(arrived + {GIVEN_UP}, __ATOMIC_RELAXED))
            return;
        if (tries > 300)  // some 10 µs: the one that is waited for may need this core, or another program
            reinterpret_cast<wp::int32 (*)()>(let_others)();
#if defined(__x86_64__)
        else
            __builtin_ia32_pause();
#endif
    }}
#endif
"""


@wp.func_native(MEET)
def meet(meeting: wp.array(dtype=int), threads: int, let_others: wp.uint64):
    """Let no thread go on before all have come here, and see what they have written.

    The k-th meeting is over when threads have come k times their number, which is counted and never set back.
    """
    ...


@wp.struct
class Share:
    """What one of several threads advances."""

    threads: int  # how many there are
    first: int  # its particles are from this one on
    last: int  # up to this one, which is not one of them
    first_begun: int  # the connections where it does what effects do as a substep begins
    last_begun: int
    # Of a route that scatters, the connections that end in its particles: in runs, from one to before another.
    runs: wp.array(dtype=wp.vec2i)
    others: wp.array(dtype=int)  # particles of other shares that these end in
    meeting: wp.array(dtype=int)  # how often threads have come to meet; at GIVEN_UP whether one never will
    let_others: wp.uint64  # address of the system's function that lets other programs have the core


@kernel
def wait_for_all(share: Share):
    """Let no thread go on before all have come here."""
    meet(share.meeting, share.threads, share.let_others)


@functools.cache
def in_shares(composition: Composition, method: Any):
    """Compose the kernel that takes many steps, as `persistent` does, for the particles of one share.

    It is launched once for each share, all at the same time. A particle's forces are summed in the same order as
    by one thread: where they are scattered, into an array of the thread's own, of all connections that end in its
    particles. Those between two shares are evaluated in both.
    """
    _, World, _, _, store, _ = tools(composition)
    begin, load, marked = beginning(composition), loads(composition), bool(composition.selective)
    evaluate, force_at = composition.route.evaluate, composition.route.force_at
    moving, timed, tears = composition.contact.moving, composition.timed, composition.route.tears
    Step, advance, _ = method(composition)
    V = tools(composition).V

    def take_share(world: World, steps: wp.array(dtype=Step), count: int, share: Share):
        if wp.static(moving):
            first = int(world.colliders.substep)
        if wp.static(timed):
            first_stage = int(world.stage)
        if wp.static(tears):
            begun = int(world.forces.breaking.substep)
        meet(share.meeting, share.threads, share.let_others)  # what was launched before is done
        for k in range(count):
            step = steps[k % steps.shape[0]]
            if wp.static(timed):
                world.stage = first_stage + k
            if wp.static(begin is not None):
                if k % (steps.shape[0] / 2) == 0:  # where a substep begins
                    for c in range(share.first_begun, share.last_begun):
                        begin(world, step.lost, step.x, c)
                    meet(share.meeting, share.threads, share.let_others)
            if wp.static(tears):
                world.forces.breaking.substep = wp.static(NO_SUBSTEP)
                if k % (steps.shape[0] / 2) == 0:
                    world.forces.breaking.substep = begun + k / (steps.shape[0] / 2)
            if wp.static(evaluate is not None):
                for n in range(share.runs.shape[0]):
                    c = int(share.runs[n][0])
                    while c < share.runs[n][1]:
                        evaluate(world.forces, step.lost, step.x, step.v, c)
                        c += 1
                for n in range(share.others.shape[0]):
                    store(world.forces.f, share.others[n], V())
            if wp.static(moving):
                world.colliders.substep = first + k / (steps.shape[0] / 2)
            for i in range(share.first, share.last):
                if wp.static(load is None):
                    advance(world, step, force_at(world.forces, step.lost, step.x, step.v, i), i)
                else:
                    own = force_at(world.forces, step.lost, step.x, step.v, i)
                    mark = wp.uint8(0)
                    if wp.static(marked):
                        mark = world.marks[i]
                    advance(world, step, own + load(world, step.lost, step.x, step.v, i, mark), i)
            meet(share.meeting, share.threads, share.let_others)

    return kernel(take_share)
