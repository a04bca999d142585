"""Contact of particles with fixed obstacles: one rule, and the shapes it is applied to."""

import functools

import warp as wp

from .basis import vector


@wp.struct
class NoColliders:
    """The colliders of a scene without any: nothing to read, nothing compiled."""


@functools.cache
def contact_response(dim: int, scalar: type, rule: str):
    """Compose (velocity after, share) for a contact with surface normal n of a particle approaching it.

    The share is |v_t'| / |v_t|, what is left of the tangential velocity. Rule "coulomb": with v_old the
    velocity before the force of this substep,

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
    ):
        v_n = wp.dot(v, normal)
        v_t = v - v_n * normal
        v_n_after = -restitution * v_n
        if wp.static(coulomb):
            v_n_old = wp.dot(v_old, normal)
            v_n_after = scalar(0.0)
            if v_n_old < -rest_speed:
                v_n_after = -restitution * v_n_old
        share = tangential_factor
        if wp.static(coulomb):
            speed = wp.length(v_t)
            loss = friction * (v_n_after - v_n)
            if loss < (scalar(1.0) - tangential_factor) * speed:
                share = scalar(1.0) - loss / speed
        return share * v_t + v_n_after * normal, share

    return respond


@functools.cache
def plane_contact(dim: int, scalar: type, rule: str):
    """Compose (Planes, collide): half-spaces n·x < offset that particles are kept out of.

    A particle found inside and approaching is put back on the surface. By rule "coulomb" friction also takes
    back its share of this substep's way along the surface, so that what sticks does not creep.
    """
    V = vector(dim, scalar)
    coulomb = rule == "coulomb"
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
    def collide(planes: Planes, x: V, v: V, x_old: V, v_old: V):
        for p in range(planes.normal.shape[0]):
            normal = planes.normal[p]
            distance = wp.dot(x, normal) - planes.offset[p]
            # A particle already on its way out is left alone.
            if distance < scalar(0.0) and wp.dot(v, normal) < scalar(0.0):
                v, share = respond(
                    v,
                    v_old,
                    normal,
                    planes.restitution[p],
                    planes.friction[p],
                    planes.tangential_factor[p],
                    planes.rest_speed[p],
                )
                x = x - distance * normal
                if wp.static(coulomb):
                    way = x - x_old
                    along = way - wp.dot(way, normal) * normal
                    x = x - (scalar(1.0) - share) * along
        return x, v

    return Planes, collide
