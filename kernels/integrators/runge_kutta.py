"""Multi-stage methods, for one particle."""

import functools

import warp as wp

from .composition import Composition, Stage, driving, tools
from .stages import finish, particle_acceleration


@functools.cache
def rk4(composition: Composition) -> Stage:
    """Compose a stage of Runge-Kutta 4 (2014 report, eq. 6).

    A stage (x, v) adds its acceleration times `weight` to v_sum; the next stage is (x0, v0) + reach·(v, a). The
    first stage starts the sum. The last stage adds the sum to v0, advances x0 by the weighted velocities v0, v_a,
    v_b and v of the four stages, and applies contact.
    """
    scalar = composition.scalar
    V, SceneData, Compensation, load, store, add = tools(composition)
    acceleration, finish_substep = particle_acceleration(composition), finish(composition)
    *_, at_stage, at_end = driving(composition)

    @wp.struct
    class RK4Step:
        reach: scalar
        weight: scalar
        first: int
        last: int
        compensation: Compensation
        x0: wp.array(dtype=V)
        v0: wp.array(dtype=V)
        x: wp.array(dtype=V)
        v: wp.array(dtype=V)
        x_out: wp.array(dtype=V)
        v_out: wp.array(dtype=V)
        v_sum: wp.array(dtype=V)
        v_a: wp.array(dtype=V)
        v_b: wp.array(dtype=V)

    @wp.func
    def advance(scene: SceneData, step: RK4Step, force: V, i: int):
        v = load(step.v, i)
        a = acceleration(scene, force, i)
        x0 = load(step.x0, i)
        v0 = load(step.v0, i)
        dv = step.weight * a
        if step.first == 0:
            dv = dv + load(step.v_sum, i)
        if step.last == 1:
            middle = load(step.v_a, i) + load(step.v_b, i)
            dx = step.weight * (v0 + middle + middle + v)
            v_new = add(v0, dv, step.compensation.v, step.compensation.v, i)
            x_new, v_end = finish_substep(scene.colliders, step.compensation, x0, v0, dx, v_new, i)
            if wp.static(at_end is not None):
                x_new, v_end = at_end(scene, step.compensation, x_new, v_end, i)
            store(step.x_out, i, x_new)
            store(step.v_out, i, v_end)
        else:
            store(step.v_sum, i, dv)
            if wp.static(at_end is None):
                store(step.x_out, i, x0 + step.reach * v)
                store(step.v_out, i, v0 + step.reach * a)
            else:
                x_next, v_next = at_stage(scene, step.compensation, x0 + step.reach * v, v0 + step.reach * a, i)
                store(step.x_out, i, x_next)
                store(step.v_out, i, v_next)

    return Stage(RK4Step, advance)


@functools.cache
def chebyshev(composition: Composition) -> Stage:
    """Compose a stage of Runge-Kutta-Chebyshev; the last stage also advances (x0, v0) and applies contact.

    Stages store D_j = Y_j − Y0, whose small values lose less to rounding. D_j = mu D_{j−1} + nu D_{j−2} + reach
    F_{j−1} + reach0 F0. The first stage computes D_1 = reach F0, and stores F0.
    """
    scalar = composition.scalar
    V, SceneData, Compensation, load, store, add = tools(composition)
    acceleration, finish_substep = particle_acceleration(composition), finish(composition)
    *_, at_stage, at_end = driving(composition)

    @wp.struct
    class ChebyshevStep:
        mu: scalar
        nu: scalar
        reach: scalar
        reach0: scalar
        first: int
        last: int
        compensation: Compensation
        x0: wp.array(dtype=V)
        v0: wp.array(dtype=V)
        a0: wp.array(dtype=V)
        x: wp.array(dtype=V)
        v: wp.array(dtype=V)
        dx: wp.array(dtype=V)
        dv: wp.array(dtype=V)
        # Changes: of stage j − 2 on input, of stage j on output.
        dx_out: wp.array(dtype=V)
        dv_out: wp.array(dtype=V)
        x_out: wp.array(dtype=V)
        v_out: wp.array(dtype=V)

    @wp.func
    def advance(scene: SceneData, step: ChebyshevStep, force: V, i: int):
        x0 = load(step.x0, i)
        v0 = load(step.v0, i)
        a = acceleration(scene, force, i)
        dx = step.reach * load(step.v, i)
        dv = step.reach * a
        if step.first == 1:
            store(step.a0, i, a)
        else:
            dx += step.mu * load(step.dx, i) + step.nu * load(step.dx_out, i) + step.reach0 * v0
            dv += step.mu * load(step.dv, i) + step.nu * load(step.dv_out, i) + step.reach0 * load(step.a0, i)
        if step.last == 1:
            v_new = add(v0, dv, step.compensation.v, step.compensation.v, i)
            x_new, v_end = finish_substep(scene.colliders, step.compensation, x0, v0, dx, v_new, i)
            if wp.static(at_end is not None):
                x_new, v_end = at_end(scene, step.compensation, x_new, v_end, i)
            store(step.x_out, i, x_new)
            store(step.v_out, i, v_end)
        else:
            store(step.dx_out, i, dx)
            store(step.dv_out, i, dv)
            if wp.static(at_end is None):
                store(step.x_out, i, x0 + dx)
                store(step.v_out, i, v0 + dv)
            else:
                x_next, v_next = at_stage(scene, step.compensation, x0 + dx, v0 + dv, i)
                store(step.x_out, i, x_next)
                store(step.v_out, i, v_next)

    return Stage(ChebyshevStep, advance)
