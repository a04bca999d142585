"""The kernels that run a stage of a method, and what all methods share: accelerations, and contact at the end.

A method is a struct of what a stage reads and writes, and a function that advances particle i; none knows how
forces are computed. What other particles read (positions, velocities, what positions have lost) is never written
where it is read.
"""

import functools
from typing import Any

import warp as wp

from ..basis import kernel, vector
from ..forces import COLUMN
from .composition import Composition, Stage, beginning, by_first_lane, driving, loads, tools


@functools.cache
def begin_each_connection(composition: Composition):
    """Compose the kernel, over connections, of what effects do when a substep begins."""
    V, World, Lost, *_ = tools(composition)
    begin = beginning(composition)

    @kernel
    def begin_connections(world: World, lost: Lost, x: wp.array(dtype=V)):
        begin(world, lost, x, wp.tid())

    return begin_connections


@functools.cache
def each_connection(composition: Composition):
    """Compose the kernel, over connections, that evaluates scattered forces."""
    V, _, Lost, *_ = tools(composition)
    Forces, evaluate = composition.route.Forces, composition.route.evaluate

    def evaluate_forces(forces: Forces, lost: Lost, x: wp.array(dtype=V), v: wp.array(dtype=V)):
        evaluate(forces, lost, x, v, wp.tid())

    return kernel(evaluate_forces, grid_stride=False)


@functools.cache
def each_particle(composition: Composition, method: Any):
    """Compose the kernel, over particles, of one stage of a method.

    Where particles that have marks are apart, the forces of their connections are handed to `each_marked`.
    """
    V, World, _, _, store, _ = tools(composition)
    route, marked = composition.route, bool(composition.selective)
    (Step, _, forced), force_at, lanes = method(composition), route.force_at, route.lanes
    advance, load = by_first_lane(composition, method)
    apart = composition.apart and forced

    def advance_particles(world: World, step: Step):
        i = wp.tid()
        if wp.static(lanes > 1):
            i = i / wp.static(lanes)
        force = V()
        if wp.static(forced):
            force = force_at(world.forces, step.lost, step.x, step.v, i)
        if wp.static(forced and load is not None and not apart):
            mark = wp.uint8(0)
            if wp.static(marked):
                mark = world.marks[i]
            force += load(world, step.lost, step.x, step.v, i, mark)
        if wp.static(apart):
            if world.marks[i] != wp.uint8(0):
                store(world.handed, i, force)
            else:
                advance(world, step, force, i)
        else:
            advance(world, step, force, i)

    return kernel(advance_particles, launch_bounds=route.bounds, grid_stride=route.grid_stride)


@functools.cache
def each_column(composition: Composition, method: Any):
    """Compose the same for a lattice, over columns of particles that share what they read of their neighbours.

    Where particles that have marks are apart, the forces of their connections are handed to `each_marked`: in this
    kernel the code of what acts on a few would make all columns slower.
    """
    _, World, _, _, store, _ = tools(composition)
    load, forces_at = loads(composition), composition.route.column_forces
    Step, advance, _ = method(composition)
    marked, apart = bool(composition.selective), composition.apart

    def advance_columns(world: World, step: Step):
        column = wp.tid()
        stride = world.forces.stride
        i = column / stride * (COLUMN * stride) + column % stride
        forces = forces_at(world.forces, step.lost, step.x, step.v, i)
        for d in range(wp.static(COLUMN)):
            if i + d * stride < world.inverse_mass.shape[0]:
                if wp.static(apart):
                    if world.marks[i + d * stride] != wp.uint8(0):
                        store(world.handed, i + d * stride, forces[d])
                    else:
                        advance(world, step, forces[d], i + d * stride)
                else:
                    if wp.static(load is not None):
                        mark = wp.uint8(0)
                        if wp.static(marked):
                            mark = world.marks[i + d * stride]  # asked for earlier, it was slower
                        forces[d] += load(world, step.lost, step.x, step.v, i + d * stride, mark)
                    advance(world, step, forces[d], i + d * stride)

    route = composition.route
    return kernel(advance_columns, launch_bounds=route.column_bounds, grid_stride=route.grid_stride)


@functools.cache
def each_marked(composition: Composition, method: Any):
    """Compose the kernel, over particles that have marks, of the rest of a stage that columns have begun."""
    _, World, _, read, *_ = tools(composition)
    load = loads(composition)
    Step, advance, _ = method(composition)

    def advance_marked(world: World, step: Step):
        i = world.marked[wp.tid()]
        force = read(world.handed, i)
        force += load(world, step.lost, step.x, step.v, i, world.marks[i])
        advance(world, step, force, i)

    return kernel(advance_marked)


@functools.cache
def particle_acceleration(composition: Composition):
    """Compose a_i = f_i / m_i + g; a pinned particle (inverse mass 0) has none, a driven one its own.

    A pinned particle stands still, so no fixed collider ever finds it approaching: where none moves this is the
    only test for it, and it is compiled only where a particle is pinned.
    """
    V, World, *_ = tools(composition)
    scalar, pinned, driven = composition.scalar, composition.pinned, driving(composition).acceleration

    @wp.func
    def acceleration(world: World, force: V, i: int) -> V:
        w = world.inverse_mass[i]
        if wp.static(pinned):
            if w == scalar(0.0):
                if wp.static(driven is not None):
                    return driven(world, force, i)
                return V()
        return w * force + world.gravity

    return acceleration


@functools.cache
def finish(composition: Composition):
    """Compose the end of a substep: the changes dx, dv are added, then contact is applied.

    Contact sets positions directly, so that what their sums had lost by rounding is forgotten. Where it is felt,
    the change of velocity that it makes is added up.
    """
    V, _, Lost, _, store, add = tools(composition)
    Colliders, collide, moving, felt, sunk = composition.contact
    scalar, compensated = composition.scalar, composition.compensated
    Wide = vector(composition.dim, wp.float64)
    has_colliders, pinned_apart = collide is not None, composition.pinned and (moving or sunk)

    @wp.func
    def finish_substep(colliders: Colliders, lost: Lost, x_old: V, v_old: V, dx: V, v_new: V, i: int):
        x_new = add(x_old, dx, lost.x, lost.x_out, i)
        if wp.static(pinned_apart):
            if colliders.inverse_mass[i] == scalar(0.0):
                return x_new, v_new  # what moves passes through it, and it is not led out
        if wp.static(moving):
            colliders.particle = i
        if wp.static(has_colliders):
            x_free = x_new
            if wp.static(felt):
                v_free = v_new
            x_new, v_new = collide(colliders, x_free, v_new, x_old, v_old)
            if wp.static(compensated):
                if wp.length_sq(x_new - x_free) > scalar(0.0):
                    store(lost.x_out, i, V())
                    store(lost.v, i, V())
            if wp.static(felt):
                colliders.impulse[i] = colliders.impulse[i] + (Wide(v_new) - Wide(v_free))
        return x_new, v_new

    return finish_substep


@functools.cache
def force_on_each(composition: Composition) -> Stage:
    """Compose the stage that writes the force of connections and loads on each particle, and moves nothing."""
    V, World, Lost, _, store, _ = tools(composition)

    @wp.struct
    class ForceOnEach:
        lost: Lost
        x: wp.array(dtype=V)
        v: wp.array(dtype=V)
        force: wp.array(dtype=V)  # out [N]

    @wp.func
    def advance(world: World, step: ForceOnEach, force: V, i: int):
        store(step.force, i, force)

    return Stage(ForceOnEach, advance)
