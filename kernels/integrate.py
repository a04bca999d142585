"""Integrator kernels, one thread per particle; none knows how forces are computed.

The arguments up to `colliders` are the same in each: they say what the motion is. Positions and velocities
are read from (x, v) and written to (x_out, v_out), which may be the same arrays where the route to the
forces reads no other particle.
"""

import functools

import warp as wp

from .basis import kernel, vector
from .motion import Motion


@functools.cache
def symplectic_euler(motion: Motion):
    """Compose v += h a(x, v), then x += h v (report eq. 10), then contact."""
    scalar, Forces, Colliders = motion.scalar, motion.Forces, motion.Colliders
    acceleration, collide = motion.acceleration, motion.collide
    V = vector(motion.dim, scalar)
    has_colliders = collide is not None

    @kernel
    def symplectic_euler_step(
        # Model:
        forces: Forces,
        inverse_mass: wp.array(dtype=scalar),
        gravity: V,
        colliders: Colliders,
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
        v_new = v_old + h * acceleration(forces, inverse_mass, gravity, x, v, i)
        x_old = x[i]
        x_new = x_old + h * v_new
        if wp.static(has_colliders):
            x_new, v_new = collide(colliders, x_new, v_new, x_old, v_old)
        x_out[i] = x_new
        v_out[i] = v_new

    return symplectic_euler_step


@functools.cache
def kick(motion: Motion):
    """Compose v_out = v + h a(x, v): a velocity moved in time, positions held."""
    scalar, Forces, Colliders = motion.scalar, motion.Forces, motion.Colliders
    acceleration = motion.acceleration
    V = vector(motion.dim, scalar)

    @kernel
    def kick_velocity(
        # Model:
        forces: Forces,
        inverse_mass: wp.array(dtype=scalar),
        gravity: V,
        colliders: Colliders,
        h: scalar,
        # State in:
        x: wp.array(dtype=V),
        v: wp.array(dtype=V),
        # State out:
        v_out: wp.array(dtype=V),
    ):
        i = wp.tid()
        v_out[i] = v[i] + h * acceleration(forces, inverse_mass, gravity, x, v, i)

    return kick_velocity


@functools.cache
def rk4_stage(motion: Motion):
    """Compose one of the first three stages of Runge-Kutta 4 (report eq. 6).

    From the stage (x, v): its slope (v, a) is added to the sums with `weight`, and the next stage is
    (x0, v0) + reach·(v, a). Stages see position and velocity alike.
    """
    scalar, Forces, Colliders = motion.scalar, motion.Forces, motion.Colliders
    acceleration = motion.acceleration
    V = vector(motion.dim, scalar)

    @kernel
    def rk4_next_stage(
        # Model:
        forces: Forces,
        inverse_mass: wp.array(dtype=scalar),
        gravity: V,
        colliders: Colliders,
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
    scalar, Forces, Colliders = motion.scalar, motion.Forces, motion.Colliders
    acceleration, collide = motion.acceleration, motion.collide
    V = vector(motion.dim, scalar)
    has_colliders = collide is not None

    @kernel
    def rk4_last_stage(
        # Model:
        forces: Forces,
        inverse_mass: wp.array(dtype=scalar),
        gravity: V,
        colliders: Colliders,
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
        x_old = x0[i]
        v_old = v0[i]
        x_new = x_old + x_sum[i] + weight * v[i]
        v_new = v_old + v_sum[i] + weight * acceleration(forces, inverse_mass, gravity, x, v, i)
        if wp.static(has_colliders):
            x_new, v_new = collide(colliders, x_new, v_new, x_old, v_old)
        x0[i] = x_new
        v0[i] = v_new
        x_sum[i] = V()
        v_sum[i] = V()

    return rk4_last_stage
