"""Contact of particles with fixed obstacles: one rule, and the shapes it is applied to."""

import functools

import warp as wp

from .basis import vector


@wp.struct
class NoColliders:
    """The colliders of a scene without any: nothing to read, nothing compiled."""


@functools.cache
def contact_response(dim: int, scalar: type, rule: str):
    """Compose the velocity after a contact with surface normal n, for a particle approaching (v·n < 0).

    Rule "coulomb": with v_old the velocity before the force of this substep,

        v_n' = −e v_n_old where v_n_old < −rest_speed, else 0
        j    = v_n' − v_n                       normal impulse per mass, support of the load included
        v_t' = v_t (1 − min((1 − f)|v_t|, μ j) / |v_t|)

    so that neither bounce nor friction depends on the step. Rule "report" (its Algorithm 1) mirrors and
    multiplies at every touch, v_n' = −e v_n and v_t' = f v_t: both depend on the step.
    e: restitution, μ: friction, f: tangential factor.
    """
    V = vector(dim, scalar)
    coulomb = rule == "coulomb"

    @wp.func
    def respond(
        v: V,
        v_old: V,
        normal: V,
        restitution: scalar,
        friction: scalar,
        tangential_factor: scalar,
        rest_speed: scalar,
    ) -> V:
        v_n = wp.dot(v, normal)
        v_t = v - v_n * normal
        v_n_after = -restitution * v_n
        if wp.static(coulomb):
            v_n_old = wp.dot(v_old, normal)
            v_n_after = scalar(0.0)
            if v_n_old < -rest_speed:
                v_n_after = -restitution * v_n_old
        speed = wp.length(v_t)
        if speed > scalar(0.0):
            loss = (scalar(1.0) - tangential_factor) * speed
            if wp.static(coulomb):
                loss = wp.min(loss, friction * (v_n_after - v_n))
            v_t = v_t * (scalar(1.0) - loss / speed)
        return v_t + v_n_after * normal

    return respond


@functools.cache
def plane_contact(dim: int, scalar: type, rule: str):
    """Compose (Planes, collide): half-spaces n·x < offset that particles are kept out of."""
    V = vector(dim, scalar)
    respond = contact_response(dim, scalar, rule)

    @wp.struct
    class Planes:
        normal: wp.array(dtype=V)
        offset: wp.array(dtype=scalar)
        restitution: wp.array(dtype=scalar)
        friction: wp.array(dtype=scalar)
        tangential_factor: wp.array(dtype=scalar)
        rest_speed: wp.array(dtype=scalar)

    @wp.func
    def collide(planes: Planes, x: V, v: V, v_old: V):
        for p in range(planes.normal.shape[0]):
            normal = planes.normal[p]
            distance = wp.dot(x, normal) - planes.offset[p]
            # A particle already on its way out is left alone.
            if distance < scalar(0.0) and wp.dot(v, normal) < scalar(0.0):
                v = respond(
                    v,
                    v_old,
                    normal,
                    planes.restitution[p],
                    planes.friction[p],
                    planes.tangential_factor[p],
                    planes.rest_speed[p],
                )
                x = x - distance * normal
        return x, v

    return Planes, collide
