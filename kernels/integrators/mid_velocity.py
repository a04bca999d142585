"""Forces that are functions of velocity, in kicks of methods whose velocities lag behind positions.

A kick v' = v + h F(x, v)/m by the old velocity would heat a charge in a magnetic field. So F is taken at u = v + θ
(v' − v), the velocity of the positions' time. With θ = 1/2 a magnetic force keeps the speed: this is Boris' scheme
(Birdsall & Langdon, Plasma Physics via Computer Simulation, 1985, 4.3).
"""

import functools

import warp as wp

from ..basis import fully_hashed
from ..loads.forces import APART
from .composition import Composition, tools

MOST_ITERATIONS = 20
"""One suffices if the force is linear in velocity."""


@functools.cache
def velocity_force(composition: Composition):
    """Compose the forces that are functions of velocity [N], (scene, x, u, i, mask); None if there are none."""
    V, SceneData, *_ = tools(composition)
    found = [(k, one.at_velocity) for k, one in enumerate(composition.selective) if one.at_velocity is not None]
    bits, forces, count = [1 << k for k, _ in found], [one for _, one in found], len(found)

    @fully_hashed
    def sum_at_velocity(scene: SceneData, x: V, u: V, i: int, mask: wp.uint8) -> V:
        total = V()
        for k in range(wp.static(count)):
            if (mask & wp.uint8(wp.static(bits[k]))) != wp.uint8(0):
                total += wp.static(forces[k])(x, u, scene.time[scene.stage], i)
        return total

    return sum_at_velocity if found else None


@functools.cache
def inverse_of_kick(composition: Composition):
    """Compose (1 − s ∂F/∂u)⁻¹, for the velocity forces F: (scene, x, u, scale, s, i, mask).

    By central differences, at velocities that differ by a fraction of `scale` [m/s]: a function of one's own need
    not have an adjoint (native code has none), and Newton's method corrects what differences leave.
    """
    dim, scalar, force = composition.dim, composition.scalar, velocity_force(composition)
    V, SceneData, *_ = tools(composition)
    Matrix = wp.types.matrix((dim, dim), scalar)

    @wp.func
    def inverse(scene: SceneData, x: V, u: V, scale: scalar, s: scalar, i: int, mask: wp.uint8) -> Matrix:
        apart = scalar(wp.static(APART[scalar])) * scale
        result = Matrix()
        for k in range(wp.static(dim)):
            off = V()
            off[k] = apart
            slope = (force(scene, x, u + off, i, mask) - force(scene, x, u - off, i, mask)) / (apart + apart)
            for j in range(wp.static(dim)):
                result[j, k] = -s * slope[j]
            result[k, k] += scalar(1.0)
        if wp.static(dim == 1):
            result[0, 0] = scalar(1.0) / result[0, 0]
        else:
            result = wp.inverse(result)
        return result

    return inverse


@functools.cache
def mid_velocity(composition: Composition, alone: bool = False):
    """Compose what velocity forces at u, the velocity of the positions' time, add to `force`; None without any.

    (scene, compensation, x, v_given, v, force, h, θ, i): `force` [N] on particle i has them at `v_given`. v' is
    found by Newton's method, whose steps are halved where they do not help. If `alone`, no other force changes v.
    The work is corrected as well.
    """
    scalar, at, inverse = composition.scalar, velocity_force(composition), inverse_of_kick(composition)
    V, SceneData, Compensation, load, *_ = tools(composition)
    if at is None:
        return None
    compensated, precise = composition.compensated, 1e-6 if scalar is wp.float32 else 1e-14
    bits = sum(1 << k for k, term in enumerate(composition.selective) if term.at_velocity is not None)

    @wp.func
    def added(
        scene: SceneData, compensation: Compensation, x: wp.array(dtype=V), v_given: V, v: V, force: V, h: scalar,
        theta: scalar, i: int,
    ) -> V:  # fmt: skip
        w = scene.inverse_mass[i]
        mask = scene.effect_mask[i]
        if w == scalar(0.0) or (mask & wp.uint8(wp.static(bits))) == wp.uint8(0):
            return V()
        x_i = load(x, i)
        if wp.static(compensated):
            x_i = x_i - load(compensation.x, i)
        given = at(scene, x_i, v_given, i, mask)
        free = h * (w * force + scene.gravity)
        if wp.static(alone):
            free = h * w * given
        scale = wp.length(v) + wp.length(free) + wp.abs(h) * w * wp.length(given)
        if scale == scalar(0.0):
            return V()
        dv = free
        off = h * w * (at(scene, x_i, v + theta * dv, i, mask) - given)
        way = off
        step = scalar(1.0)
        n = int(0)
        while n == 0 or (n < wp.static(MOST_ITERATIONS) and wp.length(off) > scalar(wp.static(precise)) * scale):
            if step == scalar(1.0):
                way = inverse(scene, x_i, v + theta * dv, scale, theta * h * w, i, mask) * off
            trial = dv + step * way
            rest = free + h * w * (at(scene, x_i, v + theta * trial, i, mask) - given) - trial
            step *= scalar(0.5)
            if wp.length(rest) < wp.length(off):
                dv = trial
                off = rest
                step = scalar(1.0)
            n += 1
        change = (dv - free) / (h * w)
        weight = scene.worked.weight[scene.stage]
        if weight > wp.float64(0.0):
            worked = wp.dot(change, v_given)
            if wp.static(alone):
                scene.worked.last[i] += change
            elif scene.worked.weight_of_last[scene.stage] > wp.float64(0.0):
                # It is h F·u, now that u is known; half of it was to be summed in the next substep.
                scene.worked.last[i] -= given
                worked = scalar(2.0) * wp.dot(given + change, v + theta * dv) - wp.dot(given, v_given)
            scene.worked.done[i] += weight * wp.float64(worked)
        return change

    return added
