"""The rule of contact between particles and obstacles: one for all shapes, fixed or moving."""

import functools

import warp as wp

from ..basis import vector


@functools.cache
def contact_response(dim: int, scalar: type, rule: str):
    """Compose the function that returns (velocity after, remaining) for a particle hitting a surface of normal n.

    The fraction |v_t'| / |v_t| of the tangential velocity remains. In the rule "coulomb", with v_old the velocity
    before the force of this substep,

        v_n' = −e v_n_old where v_n_old < −rest_speed, else 0
        j    = v_n' − v_n                       normal impulse per mass, support of the load included
        v_t' = v_t (1 − min((1 − f)|v_t|, μ j) / |v_t|)

    so neither bounce nor friction depends on the step. Rule "report" (2014 report, Algorithm 1) has v_n' = −e v_n
    and v_t' = f v_t in every substep of contact: both depend on the step.
    e: restitution, μ: friction, f: tangential factor.
    """
    V = vector(dim, scalar)
    coulomb = rule == "coulomb"

    @wp.func
    def respond(
        # State in:
        v: V,  # [m/s]
        v_old: V,  # [m/s]
        # The obstacle:
        normal: V,
        restitution: scalar,
        friction: scalar,
        tangential_factor: scalar,
        rest_speed: scalar,  # [m/s]
    ):
        v_n = wp.dot(v, normal)
        v_t = v - v_n * normal
        v_n_after = -restitution * v_n
        if wp.static(coulomb):
            v_n_old = wp.dot(v_old, normal)
            v_n_after = scalar(0.0)
            if v_n_old < -rest_speed:
                v_n_after = -restitution * v_n_old
        kept = tangential_factor
        if wp.static(coulomb):
            speed = wp.length(v_t)
            loss = friction * (v_n_after - v_n)
            if loss <= scalar(0.0):  # no friction, even at speed 0: the path along the surface is not shortened
                kept = scalar(1.0)
            elif loss < (scalar(1.0) - tangential_factor) * speed:
                kept = scalar(1.0) - loss / speed
        return kept * v_t + v_n_after * normal, kept

    return respond


@functools.cache
def touch(dim: int, scalar: type, rule: str, flies: bool, overlapping_at_start: bool):
    """Compose the contact rule for a particle inside an obstacle of any shape.

    An approaching particle is put back on the surface. Under the rule "coulomb", friction also shortens this
    substep's displacement along the surface, so that a sticking particle does not creep. A particle that already
    moves out is not changed. Velocities and displacements are relative to the surface. Returns (x, v).

    If `flies`, a bouncing particle is not moved to the surface, but starts from where the substep started.
    Moving it against the forces of its neighbours would create energy, which accumulates over bounces if the
    restitution is near 1. With velocities half a substep behind positions (leapfrog, symplectic Euler) a particle
    continues from there at its new speed. Leapfrog conserves the energy ½ m v_(n−½)·v_(n+½) + U(x_n). With the
    normal speed v_old before the substep, and v after its force, a hit reduces this energy by

        ½ m (1 − e)|v_old| (e|v_old| + |v|)

    for every force; this is 0 at e = 1 and never negative. Any change of x other than h v' would add a term with
    the next force. With velocities at the time of positions the particle stays and loses (1 − e²) ½ m v_old².

    Under the rule "coulomb", particles that start inside an obstacle (`overlapping_at_start`) are moved out at a
    constant speed and gain no velocity: moving them to the surface at once would strain their springs.
    """
    V, Surface, coulomb = vector(dim, scalar), surface(scalar), rule == "coulomb"
    respond = contact_response(dim, scalar, rule)

    @wp.func
    def put_back(s: Surface, p: int, distance: scalar, normal: V, x: V, v: V, x_old: V, v_old: V):
        if wp.static(overlapping_at_start):
            began = distance - wp.dot(x - x_old, normal)
            approach = wp.dot(v, normal)
            if distance < scalar(0.0) and approach <= scalar(0.0) and began < -s.slack:
                x += wp.max(wp.min(began + s.overlap_release_speed, scalar(0.0)) - distance, scalar(0.0)) * normal
                return x, v - approach * normal
        if distance < scalar(0.0) and wp.dot(v, normal) < scalar(0.0):
            if wp.static(flies):
                v_n = wp.dot(v, normal)
            v, kept = respond(
                v,
                v_old,
                normal,
                s.restitution[p],
                s.friction[p],
                s.tangential_factor[p],
                s.rest_speed[p],
            )
            if wp.static(flies):
                v_n_after = -s.restitution[p] * wp.dot(v_old, normal)
                if v_n_after > s.restitution[p] * s.rest_speed[p]:
                    back = scalar(1.0) - s.onward * v_n_after / v_n
                    distance = wp.min(distance, back * wp.dot(x - x_old, normal))
            x = x - distance * normal
            if wp.static(coulomb):
                way = x - x_old
                along = way - wp.dot(way, normal) * normal
                x = x - (scalar(1.0) - kept) * along
        return x, v

    return put_back


@functools.cache
def surface(scalar: type):
    """Compose the struct of the contact coefficients of all obstacles."""

    @wp.struct
    class Surface:
        # Each of shape [obstacle_count]:
        restitution: wp.array(dtype=scalar)  # e
        friction: wp.array(dtype=scalar)  # μ
        tangential_factor: wp.array(dtype=scalar)  # f
        rest_speed: wp.array(dtype=scalar)  # slower particles do not bounce [m/s]
        onward: scalar  # fraction of a substep for which a particle moves on after a bounce
        slack: scalar  # maximal depth of a particle at a substep's start that counts as on the surface [m]
        overlap_release_speed: scalar  # displacement by which a deeper particle is moved out per substep [m]

    return Surface
