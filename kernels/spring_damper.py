"""The force law: a spring and a damper along the axis of a connection."""

import functools

import warp as wp

from .basis import vector


@functools.cache
def spring_damper_force(dim: int, scalar: type, damped: bool):
    """Compose the force that a connection exerts on its first particle (report eq. 7).

    F = (−k (|Δx| − l0) − b Δv·Δx̂) Δx̂ with Δx = x_i − x_j, Δv = v_i − v_j; the second particle gets −F.
    Coincident particles have no axis and so no force. Without `damped` the damper term is not compiled.
    """
    V = vector(dim, scalar)

    @wp.func
    def force(dx: V, dv: V, rest_length: scalar, stiffness: scalar, damping: scalar) -> V:
        length = wp.length(dx)
        if length == scalar(0.0):
            return V()
        axis = dx / length
        tension = -stiffness * (length - rest_length)
        if wp.static(damped):
            tension -= damping * wp.dot(dv, axis)
        return tension * axis

    return force
