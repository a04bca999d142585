"""The kernels that run a stage of a method, and what all methods share: accelerations, and contact at the end.

A method is a struct of what a stage reads and writes, and a function that advances particle i; none knows how
forces are computed. What other particles read (positions, velocities, what positions have lost) is never written
where it is read.
"""

import functools
from typing import Any

import warp as wp

from ..basis import kernel, vector
from ..compensation import compensation
from ..forces import COLUMN
from ..records import records
from .composition import Composition, world


@functools.cache
def each_connection(motion: Composition):
    """Compose the kernel, over connections, that evaluates scattered forces."""
    V, Lost = vector(motion.dim, motion.scalar), motion.Lost
    Forces, evaluate = motion.route.Forces, motion.route.evaluate

    def evaluate_forces(forces: Forces, lost: Lost, x: wp.array(dtype=V), v: wp.array(dtype=V)):
        evaluate(forces, lost, x, v, wp.tid())

    return kernel(evaluate_forces, grid_stride=False)


@functools.cache
def each_particle(motion: Composition, method: Any):
    """Compose the kernel, over particles, of one stage of a method."""
    World, (Step, advance, forced), force_at = world(motion), method(motion), motion.route.force_at
    V = vector(motion.dim, motion.scalar)

    def advance_particles(world: World, step: Step):
        i = wp.tid()
        force = V()
        if wp.static(forced):
            force = force_at(world.forces, step.lost, step.x, step.v, i)
        advance(world, step, force, i)

    route = motion.route
    return kernel(advance_particles, launch_bounds=route.bounds, grid_stride=route.grid_stride)


@functools.cache
def each_column(motion: Composition, method: Any):
    """Compose the same for a lattice, over columns of particles that share what they read of their neighbours."""
    World, (Step, advance, _), forces_at = world(motion), method(motion), motion.route.column_forces

    @kernel
    def advance_columns(world: World, step: Step):
        column = wp.tid()
        stride = world.forces.stride
        i = column / stride * (COLUMN * stride) + column % stride
        forces = forces_at(world.forces, step.lost, step.x, step.v, i)
        for d in range(wp.static(COLUMN)):
            if i + d * stride < world.inverse_mass.shape[0]:
                advance(world, step, forces[d], i + d * stride)

    return advance_columns


@functools.cache
def particle_acceleration(motion: Composition):
    """Compose a_i = f_i / m_i + g; a pinned particle (inverse mass 0) has none.

    A pinned particle stands still, so no fixed collider ever finds it approaching: where none moves this is the
    only test for it, and it is compiled only where a particle is pinned.
    """
    scalar, World, pinned = motion.scalar, world(motion), motion.pinned
    V = vector(motion.dim, scalar)

    @wp.func
    def acceleration(world: World, force: V, i: int) -> V:
        w = world.inverse_mass[i]
        if wp.static(pinned):
            if w == scalar(0.0):
                return V()
        return w * force + world.gravity

    return acceleration


@functools.cache
def finish(motion: Composition):
    """Compose the end of a substep: the changes dx, dv are added, then contact is applied.

    What contact puts elsewhere has lost nothing by rounding.
    """
    V = vector(motion.dim, motion.scalar)
    Colliders, collide = motion.Colliders, motion.collide
    Lost, add = compensation(motion.dim, motion.scalar, motion.compensated)
    _, store, _ = records(motion.dim, motion.scalar)
    has_colliders, compensated = collide is not None, motion.compensated
    pinned_among_moving = motion.pinned and motion.moving

    @wp.func
    def finish_substep(colliders: Colliders, lost: Lost, x_old: V, v_old: V, dx: V, v_new: V, i: int):
        x_new = add(x_old, dx, lost.x, lost.x_out, i)
        if wp.static(pinned_among_moving):
            if colliders.inverse_mass[i] == motion.scalar(0.0):
                return x_new, v_new  # what moves passes through it
        if wp.static(has_colliders):
            x_free = x_new
            x_new, v_new = collide(colliders, x_free, v_new, x_old, v_old)
            if wp.static(compensated):
                if wp.length_sq(x_new - x_free) > motion.scalar(0.0):
                    store(lost.x_out, i, V())
                    store(lost.v, i, V())
        return x_new, v_new

    return finish_substep
