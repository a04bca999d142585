"""Integrator kernels, one thread per particle; none knows how forces are computed.

The arguments up to `lost` are the same in each: they say what the motion is. Positions and velocities are read
from (x, v) and written to (x_out, v_out), which may be the same arrays where the route to the forces reads no
other particle.
"""

import functools

import warp as wp

from .basis import kernel, vector
from .motion import Motion


@functools.cache
def finish(motion: Motion):
    """Compose the end of a substep: the changes dx, dv are added, then contact is applied.

    What contact puts elsewhere has lost nothing by rounding.
    """
    V = vector(motion.dim, motion.scalar)
    Colliders, Lost, add, collide = motion.Colliders, motion.Lost, motion.add, motion.collide
    has_colliders, compensated = collide is not None, motion.compensated

    @wp.func
    def finish_substep(colliders: Colliders, lost: Lost, x_old: V, v_old: V, dx: V, v_new: V, i: int):
        x_new = add(x_old, dx, lost.x, i)
        if wp.static(has_colliders):
            x_free = x_new
            x_new, v_new = collide(colliders, x_free, v_new, x_old, v_old)
            if wp.static(compensated):
                if wp.length_sq(x_new - x_free) > motion.scalar(0.0):
                    lost.x[i] = V()
                    lost.v[i] = V()
        return x_new, v_new

    return finish_substep


@functools.cache
def symplectic_euler(motion: Motion):
    """Compose v += h a(x, v), then x += h v (report eq. 10), then contact."""
    scalar, Forces, Colliders, Lost = motion.scalar, motion.Forces, motion.Colliders, motion.Lost
    acceleration, add, finish_substep = motion.acceleration, motion.add, finish(motion)
    V = vector(motion.dim, scalar)

    @kernel
    def symplectic_euler_step(
        # Model:
        forces: Forces,
        inverse_mass: wp.array(dtype=scalar),
        gravity: V,
        colliders: Colliders,
        lost: Lost,
        h: scalar,
        # State in:
        x: wp.array(dtype=V),
        v: wp.array(dtype=V),
        # State out:
        x_out: wp.array(dtype=V),
        v_out: wp.array(dtype=V),
    ):
        i = wp.tid()
        v_old = v[i]
        v_new = add(v_old, h * acceleration(forces, inverse_mass, gravity, x, v, i), lost.v, i)
        x_new, v_end = finish_substep(colliders, lost, x[i], v_old, h * v_new, v_new, i)
        x_out[i] = x_new
        v_out[i] = v_end

    return symplectic_euler_step


@functools.cache
def extrapolated_leapfrog(motion: Motion):
    """Compose a leapfrog substep whose dampers see `v_seen`, the velocities extrapolated to the positions.

    v_seen for the next substep is v_new + theta (v_new − v_old); after a contact there is no past to go by.
    """
    scalar, Forces, Colliders, Lost = motion.scalar, motion.Forces, motion.Colliders, motion.Lost
    acceleration, add, finish_substep = motion.acceleration, motion.add, finish(motion)
    V = vector(motion.dim, scalar)

    @kernel
    def extrapolated_leapfrog_step(
        # Model:
        forces: Forces,
        inverse_mass: wp.array(dtype=scalar),
        gravity: V,
        colliders: Colliders,
        lost: Lost,
        h: scalar,
        theta: scalar,
        # State in:
        x: wp.array(dtype=V),
        v: wp.array(dtype=V),
        v_seen: wp.array(dtype=V),
        # State out:
        x_out: wp.array(dtype=V),
        v_out: wp.array(dtype=V),
        v_seen_out: wp.array(dtype=V),
    ):
        i = wp.tid()
        v_old = v[i]
        v_free = add(v_old, h * acceleration(forces, inverse_mass, gravity, x, v_seen, i), lost.v, i)
        x_new, v_new = finish_substep(colliders, lost, x[i], v_old, h * v_free, v_free, i)
        ahead = theta * (v_new - v_old)
        if wp.length_sq(v_new - v_free) > scalar(0.0):
            ahead = V()
        x_out[i] = x_new
        v_out[i] = v_new
        v_seen_out[i] = v_new + ahead

    return extrapolated_leapfrog_step


@functools.cache
def explicit_euler(motion: Motion):
    """Compose x += h v and v += h a(x, v), both from the old state, then contact."""
    scalar, Forces, Colliders, Lost = motion.scalar, motion.Forces, motion.Colliders, motion.Lost
    acceleration, add, finish_substep = motion.acceleration, motion.add, finish(motion)
    V = vector(motion.dim, scalar)

    @kernel
    def explicit_euler_step(
        # Model:
        forces: Forces,
        inverse_mass: wp.array(dtype=scalar),
        gravity: V,
        colliders: Colliders,
        lost: Lost,
        h: scalar,
        # State in:
        x: wp.array(dtype=V),
        v: wp.array(dtype=V),
        # State out:
        x_out: wp.array(dtype=V),
        v_out: wp.array(dtype=V),
    ):
        i = wp.tid()
        v_old = v[i]
        v_new = add(v_old, h * acceleration(forces, inverse_mass, gravity, x, v, i), lost.v, i)
        x_new, v_end = finish_substep(colliders, lost, x[i], v_old, h * v_old, v_new, i)
        x_out[i] = x_new
        v_out[i] = v_end

    return explicit_euler_step


@functools.cache
def kick(motion: Motion):
    """Compose v_out = v + h a(x, v_seen): a velocity moved in time, positions held."""
    scalar, Forces, Colliders, Lost = motion.scalar, motion.Forces, motion.Colliders, motion.Lost
    acceleration = motion.acceleration
    V = vector(motion.dim, scalar)

    @kernel
    def kick_velocity(
        # Model:
        forces: Forces,
        inverse_mass: wp.array(dtype=scalar),
        gravity: V,
        colliders: Colliders,
        lost: Lost,
        h: scalar,
        # State in:
        x: wp.array(dtype=V),
        v: wp.array(dtype=V),
        v_seen: wp.array(dtype=V),
        # State out:
        v_out: wp.array(dtype=V),
    ):
        i = wp.tid()
        v_out[i] = v[i] + h * acceleration(forces, inverse_mass, gravity, x, v_seen, i)

    return kick_velocity


@functools.cache
def rk4_stage(motion: Motion):
    """Compose one of the first three stages of Runge-Kutta 4 (report eq. 6).

    From the stage (x, v): its slope (v, a) is added to the sums with `weight`, and the next stage is
    (x0, v0) + reach·(v, a). Stages see position and velocity alike.
    """
    scalar, Forces, Colliders, Lost = motion.scalar, motion.Forces, motion.Colliders, motion.Lost
    acceleration = motion.acceleration
    V = vector(motion.dim, scalar)

    @kernel
    def rk4_next_stage(
        # Model:
        forces: Forces,
        inverse_mass: wp.array(dtype=scalar),
        gravity: V,
        colliders: Colliders,
        lost: Lost,
        reach: scalar,
        weight: scalar,
        # State in:
        x0: wp.array(dtype=V),
        v0: wp.array(dtype=V),
        x: wp.array(dtype=V),
        v: wp.array(dtype=V),
        # State out:
        x_out: wp.array(dtype=V),
        v_out: wp.array(dtype=V),
        x_sum: wp.array(dtype=V),
        v_sum: wp.array(dtype=V),
    ):
        i = wp.tid()
        slope_x = v[i]
        slope_v = acceleration(forces, inverse_mass, gravity, x, v, i)
        x_out[i] = x0[i] + reach * slope_x
        v_out[i] = v0[i] + reach * slope_v
        x_sum[i] = x_sum[i] + weight * slope_x
        v_sum[i] = v_sum[i] + weight * slope_v

    return rk4_next_stage


@functools.cache
def rk4_finish(motion: Motion):
    """Compose the last stage of Runge-Kutta 4: (x0, v0) + sum + weight·slope, contact, sums to zero."""
    scalar, Forces, Colliders, Lost = motion.scalar, motion.Forces, motion.Colliders, motion.Lost
    acceleration, add, finish_substep = motion.acceleration, motion.add, finish(motion)
    V = vector(motion.dim, scalar)

    @kernel
    def rk4_last_stage(
        # Model:
        forces: Forces,
        inverse_mass: wp.array(dtype=scalar),
        gravity: V,
        colliders: Colliders,
        lost: Lost,
        weight: scalar,
        # State in:
        x: wp.array(dtype=V),
        v: wp.array(dtype=V),
        # State in and out:
        x0: wp.array(dtype=V),
        v0: wp.array(dtype=V),
        x_sum: wp.array(dtype=V),
        v_sum: wp.array(dtype=V),
    ):
        i = wp.tid()
        v_old = v0[i]
        dv = v_sum[i] + weight * acceleration(forces, inverse_mass, gravity, x, v, i)
        v_new = add(v_old, dv, lost.v, i)
        dx = x_sum[i] + weight * v[i]
        x_new, v_end = finish_substep(colliders, lost, x0[i], v_old, dx, v_new, i)
        x0[i] = x_new
        v0[i] = v_end
        x_sum[i] = V()
        v_sum[i] = V()

    return rk4_last_stage


@functools.cache
def chebyshev_first(motion: Motion):
    """Compose stage 1 of Runge-Kutta-Chebyshev: Y1 = Y0 + reach·F0; F0 is kept."""
    scalar, Forces, Colliders, Lost = motion.scalar, motion.Forces, motion.Colliders, motion.Lost
    acceleration = motion.acceleration
    V = vector(motion.dim, scalar)

    @kernel
    def chebyshev_first_stage(
        # Model:
        forces: Forces,
        inverse_mass: wp.array(dtype=scalar),
        gravity: V,
        colliders: Colliders,
        lost: Lost,
        reach: scalar,
        # State in:
        x0: wp.array(dtype=V),
        v0: wp.array(dtype=V),
        # State out, as changes from (x0, v0):
        dx: wp.array(dtype=V),
        dv: wp.array(dtype=V),
        x_out: wp.array(dtype=V),
        v_out: wp.array(dtype=V),
        a0: wp.array(dtype=V),
    ):
        i = wp.tid()
        a = acceleration(forces, inverse_mass, gravity, x0, v0, i)
        a0[i] = a
        dx[i] = reach * v0[i]
        dv[i] = reach * a
        x_out[i] = x0[i] + dx[i]
        v_out[i] = v0[i] + dv[i]

    return chebyshev_first_stage


@functools.cache
def chebyshev_stage(motion: Motion):
    """Compose stages 2 … s of Runge-Kutta-Chebyshev; the last adds its change to the state, with contact.

    With D_j = Y_j − Y0, which keeps small numbers small,
    D_j = mu D_{j−1} + nu D_{j−2} + reach F_{j−1} + reach0 F0.
    """
    scalar, Forces, Colliders, Lost = motion.scalar, motion.Forces, motion.Colliders, motion.Lost
    acceleration, add, finish_substep = motion.acceleration, motion.add, finish(motion)
    V = vector(motion.dim, scalar)

    @kernel
    def chebyshev_next_stage(
        # Model:
        forces: Forces,
        inverse_mass: wp.array(dtype=scalar),
        gravity: V,
        colliders: Colliders,
        lost: Lost,
        mu: scalar,
        nu: scalar,
        reach: scalar,
        reach0: scalar,
        last: int,
        # State in:
        x: wp.array(dtype=V),
        v: wp.array(dtype=V),
        dx: wp.array(dtype=V),
        dv: wp.array(dtype=V),
        a0: wp.array(dtype=V),
        # State in and out: the changes of stage j − 2 in, of stage j out
        dx_out: wp.array(dtype=V),
        dv_out: wp.array(dtype=V),
        x_out: wp.array(dtype=V),
        v_out: wp.array(dtype=V),
        x0: wp.array(dtype=V),
        v0: wp.array(dtype=V),
    ):
        i = wp.tid()
        v_old = v0[i]
        a = acceleration(forces, inverse_mass, gravity, x, v, i)
        new_dx = mu * dx[i] + nu * dx_out[i] + reach * v[i] + reach0 * v_old
        new_dv = mu * dv[i] + nu * dv_out[i] + reach * a + reach0 * a0[i]
        if last == 1:
            v_new = add(v_old, new_dv, lost.v, i)
            x_new, v_end = finish_substep(colliders, lost, x0[i], v_old, new_dx, v_new, i)
            x0[i] = x_new
            v0[i] = v_end
        else:
            dx_out[i] = new_dx
            dv_out[i] = new_dv
            x_out[i] = x0[i] + new_dx
            v_out[i] = v_old + new_dv

    return chebyshev_next_stage
