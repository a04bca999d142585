"""The work of loads: f·v summed over substeps and particles, as the forces are evaluated."""

import functools
from typing import Any

import warp as wp

from ..basis import kernel, vector
from ..effect import Piece
from ..records import records


@functools.cache
def work(dim: int, scalar: type) -> Piece:
    """Return what sums of work add to kernels: the place where they are kept.

    Over a substep the work of a force is Σ weight f·v over its stages. Where velocities lag half a substep behind,
    it is h f_n·(v_(n−½) + v_(n+½))/2, which is what f_n adds to the kinetic energy: half of it is summed in its
    own substep, and half in the next, where v_(n+½) is known.
    """

    @wp.struct
    class Worked:
        done: wp.array(dtype=wp.float64)  # on each particle [J], shape [particle_count]
        last: wp.array(dtype=vector(dim, scalar))  # the force on each in the last substep [N]
        # By stage of a frame [s]; at its end, which belongs to no substep, 0:
        weight: wp.array(dtype=wp.float64)  # what the stage counts
        weight_of_last: wp.array(dtype=wp.float64)  # what the last substep's force counts with its velocity

    return Piece("worked", Worked, timed=True)


@functools.cache
def measured(dim: int, scalar: type, World: Any, force: Any, Lost: Any):
    """Compose a force (world, lost, x, v, i) that does the same as `force`, and adds up its work."""
    V = vector(dim, scalar)
    load = records(dim, scalar).load

    @wp.func
    def measured_force(world: World, lost: Lost, x: wp.array(dtype=V), v: wp.array(dtype=V), i: int) -> V:
        f = force(world, lost, x, v, i)
        v_i = load(v, i)
        done = world.worked.weight[world.stage] * wp.float64(wp.dot(f, v_i))
        if world.worked.weight_of_last[world.stage] > wp.float64(0.0):
            done += world.worked.weight_of_last[world.stage] * wp.float64(wp.dot(world.worked.last[i], v_i))
            world.worked.last[i] = f
        world.worked.done[i] = world.worked.done[i] + done
        return f

    return measured_force


@functools.cache
def sum_work(dim: int, scalar: type):
    """Compose the kernel that sums the work on all particles, by each thread a share."""
    V = vector(dim, scalar)

    @kernel
    def sum_work_done(
        done: wp.array(dtype=wp.float64),  # so far [J], shape [particle_count]
        last: wp.array(dtype=V),  # force in the last substep [N], shape [particle_count]
        v: wp.array(dtype=V),  # velocities [m/s], shape [particle_count]
        remaining: wp.float64,  # what that force still counts [s]
        # Out:
        shares: wp.array(dtype=wp.float64),  # [J], shape [thread_count]
    ):
        share = wp.tid()
        i = share
        total = wp.float64(0.0)
        while i < done.shape[0]:
            total += done[i] + remaining * wp.float64(wp.dot(last[i], v[i]))
            i += shares.shape[0]
        shares[share] = total

    return sum_work_done
