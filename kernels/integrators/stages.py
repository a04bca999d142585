"""Kernels that run a stage of a method, and common parts of methods: accelerations and contact.

A method is a struct that its stage reads and writes, and a function that advances particle i. Forces are computed
outside methods. Arrays that other particles read (positions, velocities, compensation) are never written in place.
"""

import functools
from typing import Any

import warp as wp

from ..basis import vector
from ..springs.lanes import lane_of
from ..springs.stencil import COLUMN
from .composition import Composition, Stage, beginning, driving, loads, tools
from .enter_world import enter_world, to_world


@functools.cache
def begin_each_connection(composition: Composition):
    """Compose the kernel, over connections (and worlds), that changes springs at a substep's start, by effects."""
    V, SceneData, Compensation, *_ = tools(composition)
    begin = beginning(composition)
    if composition.differs is None:

        @composition.kernel
        def begin_connections(scene: SceneData, compensation: Compensation, x: wp.array(dtype=V)):
            begin(scene, compensation, x, wp.tid())

        return begin_connections

    Step = force_on_each(composition).Step
    enter, shift = enter_world(composition), to_world(Step, composition.compensated)

    @composition.kernel
    def begin_connections_of_worlds(scene: SceneData, step: Step):
        w, c = wp.tid()
        own = enter(scene, w)
        shift(step, wp.int64(w) * scene.worlds.stride)
        begin(own, step.compensation, step.x, c)

    return begin_connections_of_worlds


@functools.cache
def each_connection(composition: Composition, method: Any = None):
    """Compose the kernel, over connections (and worlds), that adds forces of connections to their particles."""
    V, SceneData, Compensation, *_ = tools(composition)
    Forces, evaluate = composition.force_algorithm.Forces, composition.force_algorithm.evaluate
    if composition.differs is not None:
        Step = method(composition).Step
        enter, shift = enter_world(composition), to_world(Step, composition.compensated)

        def evaluate_forces_of_worlds(scene: SceneData, step: Step):
            w, c = wp.tid()
            own = enter(scene, w)
            shift(step, wp.int64(w) * scene.worlds.stride)
            evaluate(own.forces, step.compensation, step.x, step.v, c)

        return composition.kernel(evaluate_forces_of_worlds, grid_stride=False)

    def evaluate_forces(forces: Forces, compensation: Compensation, x: wp.array(dtype=V), v: wp.array(dtype=V)):
        evaluate(forces, compensation, x, v, wp.tid())

    return composition.kernel(evaluate_forces, grid_stride=False)


@functools.cache
def completion(composition: Composition, method: Any, deferred: bool = False):
    """Compose (scene, step, force, i): the rest of a stage of particle i, given the force of its connections.

    It adds loads and advances. If `deferred`, the force on a masked particle is stored for `each_masked` instead.
    """
    V, SceneData, _, _, store, _ = tools(composition)
    Step, advance, forced = method(composition)
    load, masked_particles = loads(composition), bool(composition.selective)
    loaded = forced and load is not None and not deferred

    @wp.func
    def complete(scene: SceneData, step: Step, force: V, i: int):
        if wp.static(deferred):
            if scene.effect_mask[i] != wp.uint8(0):
                store(scene.spring_force, i, force)
                return
        total = force
        if wp.static(loaded):
            mask = wp.uint8(0)
            if wp.static(masked_particles):
                mask = scene.effect_mask[i]
            total += load(scene, step.compensation, step.x, step.v, i, mask)
        advance(scene, step, total, i)

    return complete


@functools.cache
def stage_of(composition: Composition, method: Any, deferred: bool = False):
    """Compose (scene, step, i): a stage of particle i. Forces of connections, loads, advance; see `completion`.

    If several lanes share a particle, all sum its forces and the first completes the stage.
    """
    V, SceneData, *_ = tools(composition)
    (Step, _, forced), force_at = method(composition), composition.force_algorithm.force_at
    complete, lanes = completion(composition, method, deferred), composition.force_algorithm.lanes
    lane = lane_of(lanes)

    @wp.func
    def take_stage(scene: SceneData, step: Step, i: int):
        force = V()
        if wp.static(forced):
            force = force_at(scene.forces, step.compensation, step.x, step.v, i)
        if wp.static(lanes > 1):
            if lane() != 0:
                return
        complete(scene, step, force, i)

    return take_stage


@functools.cache
def each_particle(composition: Composition, method: Any):
    """Compose the kernel, over particles (and worlds), of one stage of a method.

    With a second pass it leaves masked particles to `each_masked`, and stores connection forces on them.
    """
    SceneData, lanes = tools(composition).SceneData, composition.force_algorithm.lanes
    Step, _, forced = method(composition)
    take_stage = stage_of(composition, method, composition.second_pass and forced)
    options = {
        "launch_bounds": composition.force_algorithm.bounds,
        "grid_stride": composition.force_algorithm.grid_stride,
    }

    def advance_particles(scene: SceneData, step: Step):
        take_stage(scene, step, wp.tid() / wp.static(lanes))

    if composition.differs is None:
        return composition.kernel(advance_particles, **options)
    enter, shift = enter_world(composition), to_world(Step, composition.compensated)

    # A separate kernel: a launch has as many dimensions as any branch of its kernel uses. With two dimensions each
    # thread divides to find its indices: 3 % of a substep of a single world of 16³ particles.
    def advance_particles_of_worlds(scene: SceneData, step: Step):
        w, i = wp.tid()
        shift(step, wp.int64(w) * scene.worlds.stride)
        take_stage(enter(scene, w), step, i / wp.static(lanes))

    return composition.kernel(advance_particles_of_worlds, **options)


@functools.cache
def each_column(composition: Composition, method: Any):
    """Compose the kernel of a stage for a lattice, over columns of particles, which read each neighbour once.

    With a second pass it leaves masked particles to `each_masked`, as in `each_particle`: the code of selective
    effects would slow down all columns.
    """
    SceneData, force_algorithm = tools(composition).SceneData, composition.force_algorithm
    Step, forces_at = method(composition).Step, force_algorithm.column_forces
    complete = completion(composition, method, composition.second_pass)

    def advance_columns(scene: SceneData, step: Step):
        column = wp.tid()
        stride = scene.forces.stride
        i = column / stride * (COLUMN * stride) + column % stride
        forces = forces_at(scene.forces, step.compensation, step.x, step.v, i)
        for d in range(wp.static(COLUMN)):
            if i + d * stride < scene.inverse_mass.shape[0]:
                complete(scene, step, forces[d], i + d * stride)

    return composition.kernel(
        advance_columns, launch_bounds=force_algorithm.column_bounds, grid_stride=force_algorithm.grid_stride
    )


@functools.cache
def each_masked(composition: Composition, method: Any):
    """Compose the kernel of the second pass: complete a stage for masked particles, after all columns."""
    _, SceneData, _, read, *_ = tools(composition)
    Step, complete = method(composition).Step, completion(composition, method)

    def advance_marked(scene: SceneData, step: Step):
        i = scene.masked_particles[wp.tid()]
        complete(scene, step, read(scene.spring_force, i), i)

    return composition.kernel(advance_marked)


@functools.cache
def particle_acceleration(composition: Composition):
    """Compose a_i = f_i / m_i + g; for a pinned particle (inverse mass 0) it is 0, for a driven one prescribed.

    A pinned particle does not move, so it never approaches a fixed collider. Without moving colliders this is the
    only test for pinned particles. It is compiled only if there are any: it takes 3 % of a substep of 100³
    particles.
    """
    V, SceneData, *_ = tools(composition)
    scalar, pinned, driven = composition.scalar, composition.pinned, driving(composition).acceleration

    @wp.func
    def acceleration(scene: SceneData, force: V, i: int) -> V:
        w = scene.inverse_mass[i]
        if wp.static(pinned):
            if w == scalar(0.0):
                if wp.static(driven is not None):
                    return driven(scene, force, i)
                return V()
        return w * force + scene.gravity

    return acceleration


@functools.cache
def finish(composition: Composition):
    """Compose the end of a substep: add the changes dx and dv, then apply contact.

    Contact sets positions directly, so it clears their compensation. If contact forces are summed, the change of
    velocity is added to `impulse` (per mass). Pinned particles are not moved by moving obstacles, nor out of
    obstacles in which they start.
    """
    V, _, Compensation, _, store, add = tools(composition)
    Colliders, collide, *how = composition.collider_term
    moving, contact_forces, overlapping_at_start, spares, round_particles = how
    scalar, compensated, pinned = composition.scalar, composition.compensated, composition.pinned
    Wide = vector(composition.dim, wp.float64)

    @wp.func
    def finish_substep(
        colliders: Colliders, compensation: Compensation, x_old: V, v_old: V, dx: V, v_new: V, i: int
    ):
        x_new = add(x_old, dx, compensation.x, compensation.x_out, i)
        if wp.static(collide is not None):
            if wp.static(pinned and (moving or overlapping_at_start)):
                if colliders.inverse_mass[i] == scalar(0.0):
                    return x_new, v_new
            if wp.static(spares):
                if colliders.spared[i] != 0:
                    return x_new, v_new
            if wp.static(moving):
                colliders.particle = i
            if wp.static(round_particles):
                colliders.solids.margin = colliders.radius[i]
            x_free = x_new
            if wp.static(contact_forces):
                v_free = v_new
            x_new, v_new = collide(colliders, x_free, v_new, x_old, v_old)
            if wp.static(compensated):
                if wp.length_sq(x_new - x_free) > scalar(0.0):
                    store(compensation.x_out, i, V())
                    store(compensation.v, i, V())
            if wp.static(contact_forces):
                colliders.impulse[i] = colliders.impulse[i] + (Wide(v_new) - Wide(v_free))
        return x_new, v_new

    return finish_substep


@functools.cache
def force_on_each(composition: Composition) -> Stage:
    """Compose the stage that writes the force of connections and loads on each particle, without moving any."""
    V, SceneData, Compensation, _, store, _ = tools(composition)

    @wp.struct
    class ForceOnEach:
        compensation: Compensation
        x: wp.array(dtype=V)
        v: wp.array(dtype=V)
        force: wp.array(dtype=V)  # out [N]

    @wp.func
    def advance(scene: SceneData, step: ForceOnEach, force: V, i: int):
        store(step.force, i, force)

    return Stage(ForceOnEach, advance)
