"""Euler methods and leapfrog, for one particle."""

import functools

import warp as wp

from .composition import Composition, Stage, driving, tools
from .mid_velocity import mid_velocity
from .stages import finish, particle_acceleration


def symplectic_euler(composition: Composition) -> Stage:
    """Compose v += h a(x, v), then x += h v (2014 report, eq. 10), then contact."""
    return _euler(composition, explicit=False)


def explicit_euler(composition: Composition) -> Stage:
    """Compose x += h v and v += h a(x, v), both with the old state, then contact."""
    return _euler(composition, explicit=True)


@functools.cache
def _euler(composition: Composition, explicit: bool) -> Stage:
    scalar = composition.scalar
    V, SceneData, Compensation, load, store, add = tools(composition)
    acceleration, finish_substep = particle_acceleration(composition), finish(composition)
    at_end, correction = driving(composition).at_end, None if explicit else mid_velocity(composition)

    @wp.struct
    class EulerStep:
        h: scalar
        compensation: Compensation
        x: wp.array(dtype=V)
        v: wp.array(dtype=V)
        x_out: wp.array(dtype=V)
        v_out: wp.array(dtype=V)

    @wp.func
    def advance(scene: SceneData, step: EulerStep, force: V, i: int):
        v_old = load(step.v, i)
        if wp.static(correction is not None):
            force += correction(scene, step.compensation, step.x, v_old, v_old, force, step.h, scalar(0.5), i)
        v_new = add(v_old, step.h * acceleration(scene, force, i), step.compensation.v, step.compensation.v, i)
        dx = step.h * v_new
        if wp.static(explicit):
            dx = step.h * v_old
        x_new, v_end = finish_substep(scene.colliders, step.compensation, load(step.x, i), v_old, dx, v_new, i)
        if wp.static(at_end is not None):
            x_new, v_end = at_end(scene, step.compensation, x_new, v_end, i)
        store(step.x_out, i, x_new)
        store(step.v_out, i, v_end)

    return Stage(EulerStep, advance)


@functools.cache
def extrapolated_leapfrog(composition: Composition) -> Stage:
    """Compose a leapfrog substep whose dampers use `v`, velocities extrapolated to the time of the positions.

    `v` for the next substep is v_new + theta (v_new − v_old), or v_new after a contact.
    """
    scalar = composition.scalar
    V, SceneData, Compensation, load, store, add = tools(composition)
    acceleration, finish_substep = particle_acceleration(composition), finish(composition)
    (holds, *_, at_end), correction = driving(composition), mid_velocity(composition)

    @wp.struct
    class ExtrapolatedLeapfrogStep:
        h: scalar
        theta: scalar
        compensation: Compensation
        x: wp.array(dtype=V)
        v: wp.array(dtype=V)
        v_half: wp.array(dtype=V)
        x_out: wp.array(dtype=V)
        v_out: wp.array(dtype=V)
        v_half_out: wp.array(dtype=V)

    @wp.func
    def advance(scene: SceneData, step: ExtrapolatedLeapfrogStep, force: V, i: int):
        v_old = load(step.v_half, i)
        if wp.static(correction is not None):
            v = load(step.v, i)
            force += correction(scene, step.compensation, step.x, v, v_old, force, step.h, scalar(0.5), i)
        dv = step.h * acceleration(scene, force, i)
        v_free = add(v_old, dv, step.compensation.v, step.compensation.v, i)
        x_old = load(step.x, i)
        x_new, v_new = finish_substep(scene.colliders, step.compensation, x_old, v_old, step.h * v_free, v_free, i)
        if wp.static(at_end is not None):
            x_new, v_new = at_end(scene, step.compensation, x_new, v_new, i)
        ahead = step.theta * (v_new - v_old)
        if wp.length_sq(v_new - v_free) > scalar(0.0):
            if wp.static(at_end is not None):
                if not holds(scene, i):
                    ahead = V()
            else:
                ahead = V()
        store(step.x_out, i, x_new)
        store(step.v_half_out, i, v_new)
        store(step.v_out, i, v_new + ahead)

    return Stage(ExtrapolatedLeapfrogStep, advance)


@functools.cache
def kick(composition: Composition) -> Stage:
    """Compose v_out = v_half + h a(x, v), which advances only velocities, at fixed positions.

    Forces that are functions of velocity are at v_out, the time of the positions, unless h is negative.
    """
    scalar = composition.scalar
    V, SceneData, Compensation, load, store, _ = tools(composition)
    acceleration, correction = particle_acceleration(composition), mid_velocity(composition)

    @wp.struct
    class Kick:
        h: scalar
        compensation: Compensation
        x: wp.array(dtype=V)
        v: wp.array(dtype=V)
        v_half: wp.array(dtype=V)
        v_out: wp.array(dtype=V)

    @wp.func
    def advance(scene: SceneData, step: Kick, force: V, i: int):
        if wp.static(correction is not None):
            if step.h > scalar(0.0):
                v = load(step.v, i)
                v_half = load(step.v_half, i)
                force += correction(scene, step.compensation, step.x, v, v_half, force, step.h, scalar(1.0), i)
        a = acceleration(scene, force, i)
        store(step.v_out, i, load(step.v_half, i) + step.h * a)

    return Stage(Kick, advance)
