"""Methods of integration, as seen from one particle; none knows how forces are computed.

Each is a struct of what a stage reads and writes, and a function that advances particle i. What other particles
read (positions, velocities, what positions have lost) is never written where it is read.
"""

import functools
from typing import Any

import warp as wp

from .basis import kernel, vector
from .compensation import compensation
from .motion import Motion, Stage, world
from .records import records
from .stencil import COLUMN


@functools.cache
def each_connection(motion: Motion):
    """Compose the kernel, over connections, that evaluates scattered forces."""
    V, Lost = vector(motion.dim, motion.scalar), motion.Lost
    Forces, evaluate = motion.route.Forces, motion.route.evaluate

    def evaluate_forces(forces: Forces, lost: Lost, x: wp.array(dtype=V), v: wp.array(dtype=V)):
        evaluate(forces, lost, x, v, wp.tid())

    return kernel(evaluate_forces, grid_stride=False)


@functools.cache
def each_particle(motion: Motion, method: Any):
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
def each_column(motion: Motion, method: Any):
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
def particle_acceleration(motion: Motion):
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
def finish(motion: Motion):
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


def symplectic_euler(motion: Motion) -> Stage:
    """Compose v += h a(x, v), then x += h v (report eq. 10), then contact."""
    return _euler(motion, explicit=False)


def explicit_euler(motion: Motion) -> Stage:
    """Compose x += h v and v += h a(x, v), both from the old state, then contact."""
    return _euler(motion, explicit=True)


@functools.cache
def _euler(motion: Motion, explicit: bool) -> Stage:
    scalar, World, Lost = motion.scalar, world(motion), motion.Lost
    V = vector(motion.dim, scalar)
    load, store, _ = records(motion.dim, scalar)
    _, add = compensation(motion.dim, scalar, motion.compensated)
    acceleration, finish_substep = particle_acceleration(motion), finish(motion)

    @wp.struct
    class EulerStep:
        h: scalar
        lost: Lost
        x: wp.array(dtype=V)
        v: wp.array(dtype=V)
        x_out: wp.array(dtype=V)
        v_out: wp.array(dtype=V)

    @wp.func
    def advance(world: World, step: EulerStep, force: V, i: int):
        v_old = load(step.v, i)
        v_new = add(v_old, step.h * acceleration(world, force, i), step.lost.v, step.lost.v, i)
        dx = step.h * v_new
        if wp.static(explicit):
            dx = step.h * v_old
        x_new, v_end = finish_substep(world.colliders, step.lost, load(step.x, i), v_old, dx, v_new, i)
        store(step.x_out, i, x_new)
        store(step.v_out, i, v_end)

    return Stage(EulerStep, advance)


@functools.cache
def extrapolated_leapfrog(motion: Motion) -> Stage:
    """Compose a leapfrog substep whose dampers see `v`, the velocities extrapolated to the positions.

    `v` for the next substep is v_new + theta (v_new − v_old); after a contact there is no past to go by.
    """
    scalar, World, Lost = motion.scalar, world(motion), motion.Lost
    V = vector(motion.dim, scalar)
    load, store, _ = records(motion.dim, scalar)
    _, add = compensation(motion.dim, scalar, motion.compensated)
    acceleration, finish_substep = particle_acceleration(motion), finish(motion)

    @wp.struct
    class ExtrapolatedLeapfrogStep:
        h: scalar
        theta: scalar
        lost: Lost
        x: wp.array(dtype=V)
        v: wp.array(dtype=V)
        v_half: wp.array(dtype=V)
        x_out: wp.array(dtype=V)
        v_out: wp.array(dtype=V)
        v_half_out: wp.array(dtype=V)

    @wp.func
    def advance(world: World, step: ExtrapolatedLeapfrogStep, force: V, i: int):
        v_old = load(step.v_half, i)
        dv = step.h * acceleration(world, force, i)
        v_free = add(v_old, dv, step.lost.v, step.lost.v, i)
        x_old = load(step.x, i)
        x_new, v_new = finish_substep(world.colliders, step.lost, x_old, v_old, step.h * v_free, v_free, i)
        ahead = step.theta * (v_new - v_old)
        if wp.length_sq(v_new - v_free) > scalar(0.0):
            ahead = V()
        store(step.x_out, i, x_new)
        store(step.v_half_out, i, v_new)
        store(step.v_out, i, v_new + ahead)

    return Stage(ExtrapolatedLeapfrogStep, advance)


@functools.cache
def kick(motion: Motion) -> Stage:
    """Compose v_out = v_half + h a(x, v): a velocity moved in time, positions held."""
    scalar, World, Lost = motion.scalar, world(motion), motion.Lost
    V = vector(motion.dim, scalar)
    load, store, _ = records(motion.dim, scalar)
    acceleration = particle_acceleration(motion)

    @wp.struct
    class Kick:
        h: scalar
        lost: Lost
        x: wp.array(dtype=V)
        v: wp.array(dtype=V)
        v_half: wp.array(dtype=V)
        v_out: wp.array(dtype=V)

    @wp.func
    def advance(world: World, step: Kick, force: V, i: int):
        a = acceleration(world, force, i)
        store(step.v_out, i, load(step.v_half, i) + step.h * a)

    return Stage(Kick, advance)
