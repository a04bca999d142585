"""Scatter: one thread per connection adds its force to one end and subtracts it from the other.

The report's Algorithm 3. The force of a connection is computed once, and atomics settle who adds first.
"""

import functools

import warp as wp

from .basis import kernel, vector
from .spring_damper import spring_damper_force


@functools.cache
def scattered_force(dim: int, scalar: type):
    """Compose (Forces, force_at): where scattered forces lie, and how an integrator takes one.

    Taking a force sets its place to zero for the next evaluation.
    """
    V = vector(dim, scalar)

    @wp.struct
    class ScatteredForces:
        f: wp.array(dtype=V)

    @wp.func
    def force_at(forces: ScatteredForces, x: wp.array(dtype=V), v: wp.array(dtype=V), i: int) -> V:
        f = forces.f[i]
        forces.f[i] = V()
        return f

    return ScatteredForces, force_at


@functools.cache
def scatter(dim: int, scalar: type, damped: bool, compensated: bool):
    """Compose the kernel, over connections, that adds every connection's force to f.

    With `compensated` the true positions are x − x_lost: what is lost far from the origin matters to a short
    spring.
    """
    V = vector(dim, scalar)
    spring_damper = spring_damper_force(dim, scalar, damped)

    @kernel
    def scatter_forces(
        # Model:
        connections: wp.array(dtype=wp.vec2i),
        rest_length: wp.array(dtype=scalar),
        stiffness: wp.array(dtype=scalar),
        damping: wp.array(dtype=scalar),
        # State in:
        x: wp.array(dtype=V),
        v: wp.array(dtype=V),
        x_lost: wp.array(dtype=V),
        # State out:
        f: wp.array(dtype=V),
    ):
        c = wp.tid()
        i = connections[c][0]
        j = connections[c][1]
        dv = V()
        b = scalar(0.0)
        if wp.static(damped):
            dv = v[i] - v[j]
            b = damping[c]
        dx = x[i] - x[j]
        if wp.static(compensated):
            dx = dx - (x_lost[i] - x_lost[j])
        force = spring_damper(dx, dv, rest_length[c], stiffness[c], b)
        wp.atomic_add(f, i, force)
        wp.atomic_sub(f, j, force)

    return scatter_forces
