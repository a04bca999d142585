"""The work of loads: f·v summed over substeps and particles, while forces are evaluated."""

import functools

import warp as wp

from ..basis import kernel, vector
from ..effect import ForceTerm
from ..records import records


@wp.struct
class Nothing:
    """The empty struct of an effect that has no data in kernels."""


NOTHING = ForceTerm("nothing", Nothing)
"""The force term of an effect without data in kernels."""


@functools.cache
def work(dim: int, scalar: type) -> ForceTerm:
    """Return the term of external work, with the arrays of sums.

    The work of a force over a substep is Σ weight f·v over its stages. For a method with one force per substep it
    is h f_n·(v_n + v_(n+1))/2 with the velocities before and after: the kinetic energy that f_n adds. Half of it
    is summed in its own substep, and half in the next one, when v_(n+1) is known.
    """

    @wp.struct
    class Worked:
        done: wp.array(dtype=wp.float64)  # on each particle [J], shape [particle_count]
        last: wp.array(dtype=vector(dim, scalar))  # force on each particle in the last substep [N]
        # By stage of a frame [s]; 0 at the frame's end, and in stages without weight:
        weight: wp.array(dtype=wp.float64)  # weight of the stage's force
        weight_of_last: wp.array(dtype=wp.float64)  # weight of the last substep's force with this stage's velocity

    return ForceTerm("worked", Worked, timed=True)


@functools.cache
def sum_work(dim: int, scalar: type):
    """Compose the kernel that sums the work on all particles; each thread sums some particles of a world.

    The sum includes f·x of steady forces; the host subtracts its initial value.
    """
    V = vector(dim, scalar)
    load = records(dim, scalar).load

    @kernel
    def sum_work_done(
        count: int,  # particles of a world
        stride: int,  # particles from one world to the next
        worlds: int,
        done: wp.array(dtype=wp.float64),  # work so far [J], shape [worlds * count], or [0]
        last: wp.array(dtype=V),  # force in the last substep [N], of the same shape
        v: wp.array(dtype=V),  # velocities [m/s], of all worlds
        remaining: wp.float64,  # weight with which the work of `last` is still to be added [s]
        combination: wp.array(dtype=int),  # index in `steady` by particle, 0 for none; or shape [0]
        steady: wp.array(dtype=V),  # steady forces [N], shape [any]
        x: wp.array(dtype=V),  # positions [m], of all worlds
        # Out:
        partial: wp.array(dtype=wp.float64),  # [J], shape [thread_count]
    ):
        thread = wp.tid()
        threads = partial.shape[0] / worlds
        w = thread / threads
        i = thread % threads
        total = wp.float64(0.0)
        while i < count:
            here = w * stride + i
            if done.shape[0] > 0:
                own = w * count + i
                total += done[own] + remaining * wp.float64(wp.dot(last[own], v[here]))
            if i < combination.shape[0]:
                f = steady[combination[i]]
                x_i = load(x, here)
                for k in range(wp.static(dim)):
                    total += wp.float64(f[k]) * wp.float64(x_i[k])
            i += threads
        partial[thread] = total

    return sum_work_done


@kernel
def add_work(
    done: wp.array(dtype=wp.float64),  # work of effects [J], concatenated by world
    worlds: int,
    # Out:
    partial: wp.array(dtype=wp.float64),  # [J], shape [thread_count]
):
    """Add to the threads' partial sums in each world the work `done`, which effects have summed themselves."""
    thread = wp.tid()
    threads = partial.shape[0] / worlds
    count = done.shape[0] / worlds
    first = thread / threads * count
    i = thread % threads
    total = partial[thread]
    while i < count:
        total += done[first + i]
        i += threads
    partial[thread] = total
