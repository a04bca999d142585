"""Contact with a scene's obstacles, fixed or moving: the contact rule is applied to each in turn.

The rule is applied at the end of a substep. If a particle has moved so far that it may have passed through an
obstacle, its whole path is swept instead. A particle cannot pass through a plane, since all points below are
inside: if all obstacles are planes, no sweep is compiled.
"""

import functools
from typing import Any, NamedTuple

import warp as wp

from ..basis import vector
from .contact_rule import surface, touch
from .corner import corner
from .signed_distance import signed_distance, solids
from .sweep import passing, sweep


@wp.struct
class NoColliders:
    """The struct of colliders for a scene without obstacles; it is empty."""


class ColliderTerm(NamedTuple):
    """The term that keeps particles out of obstacles; hashable, so that equal scenes share kernels."""

    Colliders: Any
    """Type of the struct of obstacles."""
    collide: Any
    """wp.func (colliders, x, v, x_old, v_old) -> (x, v) after contact; None without obstacles."""
    moving: bool
    """Whether any obstacle moves."""
    contact_forces: bool = False
    """Whether the forces of obstacles on particles are summed."""
    overlapping_at_start: bool = False
    """Whether any particle starts inside an obstacle, to be moved out."""
    spares: bool = False
    """Whether obstacles ignore some particles, because the surface of their body meets obstacles instead.

    A test for them at run time would take a fifth of a substep beside moving obstacles, by registers.
    """
    round_particles: bool = False
    """Whether any particle has a radius against obstacles."""


NO_COLLIDERS = ColliderTerm(NoColliders, None, False)
"""The term of a scene without obstacles."""


@functools.cache
def collider_contact(
    dim: int,
    scalar: type,
    rule: str,
    kinds: tuple[str, ...],
    several: bool = False,
    moving: bool = False,
    contact_forces: bool = False,
    overlapping_at_start: bool = False,
    round_particles: bool = False,
):
    """Compose (Obstacles, collide): obstacles of these kinds, applied to a particle one after the other.

    If there are `several` they may form corners. If `contact_forces`, velocity changes by obstacles are summed for
    each particle. These, and that particles start inside obstacles, are compiled in: either takes a fifth more
    registers with several obstacles. The rule is the same for moving and fixed obstacles.

    At the start of substep n of a frame, point y of obstacle p in its given pose is at turn[n, p] y + shift[n, p].
    Its velocity in the previous substep was turning[n, p] y + speed[n, p]. v_old is relative to this velocity, so
    the obstacle's acceleration acts as gravity would on a particle resting on it.

    A moving obstacle does the work m Δv·u on a particle; u is the mean of the surface's velocities in this substep
    and the previous one. The work of other forces is computed likewise: half with the velocity before the force,
    half with the velocity after.

    For `round_particles` obstacles are larger by the radius of each particle, and the rule is applied to its
    centre: so friction turns nothing, and sees the velocity that a turning obstacle would have at the centre.
    """
    V, Solids, Surface = vector(dim, scalar), solids(dim, scalar), surface(scalar)
    Turn, Wide, bounces = wp.types.matrix((dim, dim), scalar), vector(dim, wp.float64), rule == "coulomb"
    distance_from = signed_distance(dim, scalar, kinds, round_particles)
    put_back, put_on = (touch(dim, scalar, rule, flies, overlapping_at_start) for flies in (bounces, False))
    swept, passes = kinds != ("Plane",), passing(dim, scalar)

    class Obstacles:
        count: int
        solids: Solids  # shapes of the obstacles
        surface: Surface  # coefficients of the contact rule
        if moving:
            # Poses in a frame, each of shape [substeps + 1, count]:
            turn: wp.array2d(dtype=Turn)  # orthogonal
            shift: wp.array2d(dtype=V)  # [m]
            turning: wp.array2d(dtype=Turn)  # [1/s]
            speed: wp.array2d(dtype=V)  # [m/s]
            substep: int  # n, from 0 on
            done: wp.array(dtype=wp.float64)  # work on each particle [J], shape [particle_count]
            particle: int  # index of the current particle
        if swept:
            inradius: scalar  # smallest inradius of all obstacles [m]
        if contact_forces:
            impulse: wp.array(dtype=Wide)  # sum of impulses per mass [m/s], shape [particle_count]
        # Of each particle, or empty:
        inverse_mass: wp.array(dtype=scalar)  # [1/kg], 0 where pinned; if obstacles move or overlap at the start
        spared: wp.array(dtype=int)  # whether obstacles ignore it, as its body's surface meets them instead
        if round_particles:
            radius: wp.array(dtype=scalar)  # [m], shape [particle_count]

    # Generated code of other obstacles needs another name.
    kind = "Moving" * moving + "Round" * round_particles + "Obstacles"
    Obstacles.__qualname__ = Obstacles.__qualname__.replace("Obstacles", kind)
    Obstacles = wp.struct(Obstacles)

    @wp.func
    def add_work(obstacles: Obstacles, twice: wp.float64):
        i = obstacles.particle
        if twice != wp.float64(0.0):
            mass = wp.float64(1.0) / wp.float64(obstacles.inverse_mass[i])
            obstacles.done[i] = obstacles.done[i] + wp.float64(0.5) * mass * twice

    # Obstacles' functions for `sweep` and `corner`. Generated code depends on where a function returns.
    if moving:

        @wp.func
        def look(obstacles: Obstacles, p: int, x: V):
            turn = obstacles.turn[obstacles.substep + 1, p]
            y = wp.transpose(turn) * (x - obstacles.shift[obstacles.substep + 1, p])
            found = distance_from(obstacles.solids, p, y)
            normal = V()
            for k in range(wp.static(dim)):
                normal[k] = found[k]
            return found[wp.static(dim)], turn * normal

        @wp.func
        def carried(obstacles: Obstacles, p: int, x_old: V) -> V:
            n = obstacles.substep
            y_old = wp.transpose(obstacles.turn[n, p]) * (x_old - obstacles.shift[n, p])
            return obstacles.turn[n + 1, p] * y_old + obstacles.shift[n + 1, p]

        @wp.func
        def speed(obstacles: Obstacles, p: int, x_old: V) -> V:
            n = obstacles.substep
            y_old = wp.transpose(obstacles.turn[n, p]) * (x_old - obstacles.shift[n, p])
            return obstacles.turning[n + 1, p] * y_old + obstacles.speed[n + 1, p]

        @wp.func
        def answer(
            obstacles: Obstacles, p: int, distance: scalar, normal: V, x: V, v: V, start: V, x_old: V, v_old: V
        ):
            n = obstacles.substep
            y_old = wp.transpose(obstacles.turn[n, p]) * (x_old - obstacles.shift[n, p])
            u = obstacles.turning[n + 1, p] * y_old + obstacles.speed[n + 1, p]
            u_old = obstacles.turning[n, p] * y_old + obstacles.speed[n, p]
            v_free = v - u
            x, v = put_on(obstacles.surface, p, distance, normal, x, v_free, start, v_old - u_old)
            add_work(obstacles, wp.float64(wp.dot(v - v_free, u + u_old)))
            return x, v + u

    else:

        @wp.func
        def look(obstacles: Obstacles, p: int, x: V):
            found = distance_from(obstacles.solids, p, x)
            normal = V()
            for k in range(wp.static(dim)):
                normal[k] = found[k]
            return found[wp.static(dim)], normal

        @wp.func
        def carried(obstacles: Obstacles, p: int, x_old: V) -> V:
            return x_old

        @wp.func
        def speed(obstacles: Obstacles, p: int, x_old: V) -> V:
            return V()

        @wp.func
        def answer(
            obstacles: Obstacles, p: int, distance: scalar, normal: V, x: V, v: V, start: V, x_old: V, v_old: V
        ):
            return put_on(obstacles.surface, p, distance, normal, x, v, start, v_old)

    sweep_way = sweep(dim, scalar, Obstacles, look, carried, answer) if swept else None
    settle = corner(dim, scalar, Obstacles, look, carried, speed, overlapping_at_start) if several else None

    @wp.func
    def collide(obstacles: Obstacles, x: V, v: V, x_old: V, v_old: V):
        if wp.static(moving):
            n = obstacles.substep
            twice = wp.float64(0.0)  # twice the work per mass
        if wp.static(swept or several):
            x_free = x
        if wp.static(several):
            entered = int(0)
            clear = scalar(1.0e30)
        if wp.static(swept):
            v_free = v
            passed = bool(False)
        if wp.static(moving):
            for p in range(obstacles.count):
                turn = obstacles.turn[n + 1, p]
                shift = obstacles.shift[n + 1, p]
                y = wp.transpose(turn) * (x - shift)
                found = distance_from(obstacles.solids, p, y)
                normal = V()
                for k in range(wp.static(dim)):
                    normal[k] = found[k]
                normal = turn * normal
                # The particle's old position relative to the obstacle, and the obstacle's velocities there.
                y_old = wp.transpose(obstacles.turn[n, p]) * (x_old - obstacles.shift[n, p])
                u = obstacles.turning[n + 1, p] * y_old + obstacles.speed[n + 1, p]
                u_old = obstacles.turning[n, p] * y_old + obstacles.speed[n, p]
                start = turn * y_old + shift
                if wp.static(swept):
                    passed = passed or passes(obstacles.inradius, found[wp.static(dim)], normal, x - start)
                if wp.static(several):
                    if found[wp.static(dim)] < scalar(0.0):
                        entered += 1
                    else:
                        clear = wp.min(clear, found[wp.static(dim)])
                seen = v - u
                x, v = put_back(obstacles.surface, p, found[wp.static(dim)], normal, x, seen, start, v_old - u_old)
                twice += wp.float64(wp.dot(v - seen, u + u_old))
                v = v + u
        else:
            count = int(1)  # a constant, so that data of a single obstacle are read early
            if wp.static(several):
                count = obstacles.count
            for p in range(count):
                found = distance_from(obstacles.solids, p, x)
                normal = V()
                for k in range(wp.static(dim)):
                    normal[k] = found[k]
                if wp.static(swept):
                    passed = passed or passes(obstacles.inradius, found[wp.static(dim)], normal, x - x_old)
                if wp.static(several):
                    if found[wp.static(dim)] < scalar(0.0):
                        entered += 1
                    else:
                        clear = wp.min(clear, found[wp.static(dim)])
                x, v = put_back(obstacles.surface, p, found[wp.static(dim)], normal, x, v, x_old, v_old)
        if wp.static(swept and bounces):
            if not passed and wp.dot(v - v_free, v) > scalar(0.0):  # a rebound, perhaps through another obstacle
                for p in range(obstacles.count):
                    distance, normal = look(obstacles, p, x)
                    way = x - carried(obstacles, p, x_old)
                    passed = passed or passes(obstacles.inradius, distance, normal, way)
        if wp.static(swept):
            if passed:
                if wp.static(moving):
                    twice = wp.float64(0.0)
                x, v = sweep_way(obstacles, x_free, v_free, x_old, v_old)
        if wp.static(moving):
            add_work(obstacles, twice)
        if wp.static(several):  # a particle moved by more than `clear` may be in another obstacle
            if entered > 1 or (entered == 1 and wp.length(x - x_free) > clear):
                x, v = settle(obstacles, x, v, x_free, x_old)
        return x, v

    return Obstacles, collide
