"""Contact of particles with obstacles: one rule for all, fixed or moving, whatever their shape."""

import functools
from typing import NamedTuple

import warp as wp

from ..basis import vector


class Needed(NamedTuple):
    """The parts that the obstacles of a scene need beside the rule; others are not compiled."""

    bounces: bool = True
    """Whether anything bounces, by rule "coulomb"."""
    several: bool = False
    """Whether there are several, and so corners between them."""
    overlapping_at_start: bool = False
    """Whether anything starts inside one."""


@functools.cache
def contact_response(dim: int, scalar: type, rule: str):
    """Compose (velocity after, share) for a contact with surface normal n of a particle approaching it.

    The share |v_t'| / |v_t| is the rest of the tangential velocity. Rule "coulomb": with v_old the velocity before
    the force of this substep,

        v_n' = −e v_n_old where v_n_old < −rest_speed, else 0
        j    = v_n' − v_n                       normal impulse per mass, support of the load included
        v_t' = v_t (1 − min((1 − f)|v_t|, μ j) / |v_t|)

    so that neither bounce nor friction depends on the step. Rule "report" (the report's Algorithm 1) mirrors and
    multiplies at every touch, v_n' = −e v_n and v_t' = f v_t: both depend on the step.
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
        share = tangential_factor
        if wp.static(coulomb):
            speed = wp.length(v_t)
            loss = friction * (v_n_after - v_n)
            if loss <= scalar(0.0):  # whatever the speed: the way that it has come is not taken back either
                share = scalar(1.0)
            elif loss < (scalar(1.0) - tangential_factor) * speed:
                share = scalar(1.0) - loss / speed
        return share * v_t + v_n_after * normal, share

    return respond


@functools.cache
def touch(dim: int, scalar: type, rule: str, needed: Needed, flies: bool):
    """Compose the contact rule for a particle inside an obstacle of any shape.

    A particle that approaches is put back on the surface. By rule "coulomb" friction also undoes its share of this
    substep's path along the surface, so that a sticking particle does not creep. A particle already on its way out
    is left alone. Velocities and paths are relative to the surface. Returns (x, v).

    If it `flies`, a particle bounces where the substep began, and is never lifted through the forces of its
    neighbours. Their work would come from nothing, and with a restitution near 1 it would add up hit after hit.
    With velocities half a substep behind positions (leapfrog, symplectic Euler) the particle continues from there
    at its new speed. Leapfrog conserves the energy ½ m v_(n−½)·v_(n+½) + U(x_n). With the normal speed v_old
    before the substep, and v after its force, a hit takes from this energy

        ½ m (1 − e)|v_old| (e|v_old| + |v|)

    for every force: nothing at e = 1, and never less. A change of x other than h v' would add a share of the next
    force. With velocities at the instant of positions the particle stays there, and loses (1 − e²) ½ m v_old².

    If by rule "coulomb" particles start inside an obstacle (`overlapping_at_start`), they are moved out at a
    steady pace and gain no speed: put onto the surface at once they would strain their springs.
    """
    V, Surface = vector(dim, scalar), surface(scalar, needed)
    coulomb, overlapping_at_start = rule == "coulomb", needed.overlapping_at_start
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
            v, share = respond(
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
                x = x - (scalar(1.0) - share) * along
        return x, v

    return put_back


@functools.cache
def surface(scalar: type, needed: Needed):
    """Compose the struct of the coefficients of all obstacles."""

    @wp.struct
    class Surface:
        # Each of shape [obstacle_count]:
        restitution: wp.array(dtype=scalar)  # e
        friction: wp.array(dtype=scalar)  # μ
        tangential_factor: wp.array(dtype=scalar)  # f
        rest_speed: wp.array(dtype=scalar)  # a particle that approaches more slowly does not bounce [m/s]
        if needed.bounces:
            onward: scalar  # the share of a substep that a particle flies on for after a bounce
        if needed.overlapping_at_start:
            slack: scalar  # a particle that began a substep no deeper than this is on the surface [m]
            overlap_release_speed: scalar  # by how much one that began it deeper is moved out in a substep [m]

    return Surface
