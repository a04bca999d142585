"""Continuous collision detection: the solids that a particle hits in a substep, also those that it has passed.

All solids are convex, so along a straight path their signed distance is a convex function. At the point of a solid
nearest to an outside point, the tangent plane is a supporting plane: the whole solid is behind it.
"""

import functools

import warp as wp

from ..basis import vector

SLACK = 0.01
"""Depth at which a start still counts as on the surface; also how much of a corner a path may cut.

As a fraction of `inradius`: far above rounding errors of positions, even in float32, and too small to be visible.
"""
STEPS = 32
"""Maximal number of Newton steps to a surface; five are typical.

For a convex function each step at least quarters the product of value and slope. After all steps the distance
or the speed of approach is less than 2^−32 of its first value.
"""
NEAR = {wp.float32: 1e-4, wp.float64: 1e-10}
"""Distance that counts as on the surface, as a fraction of `inradius`: negligible, but above rounding errors."""


@functools.cache
def passing(dim: int, scalar: type):
    """Compose `passes`: whether the distance at a path's end does not suffice to tell if the path hit a solid.

    The normal n there belongs to a supporting plane. A particle that started in front of this plane either missed
    the solid or entered through that side. One that started behind it, way · n > distance, may have passed through
    the solid, or its middle. A path longer than the thinnest solid may also have crossed another solid.
    """
    V = vector(dim, scalar)
    zero, slack = wp.constant(scalar(0.0)), wp.constant(scalar(SLACK))

    @wp.func
    def passes(inradius: scalar, distance: scalar, normal: V, way: V) -> bool:
        if wp.dot(way, normal) > wp.max(distance, zero) + slack * inradius:
            return True
        return distance < zero and wp.dot(way, way) > inradius * inradius

    return passes


def entry(dim: int, scalar: type, Obstacles, look, carried):
    """Compose `enter(obstacles, p, x_old, x)` -> (t, distance, normal) where a path enters an obstacle.

    The path enters after the fraction t. `normal` is the tangent plane's normal there, and `distance` the distance
    of x from this plane; distance >= 0 means that the path misses the obstacle or starts inside.

    Newton's method solves distance = 0; each step ends on a supporting plane. As distances are convex, it never
    overshoots, and is never slower than sphere tracing (Hart, The Visual Computer 12, 1996), which advances by the
    distance itself. A flat face takes one step. A path misses if its end is in front of a supporting plane. A path
    that still approaches after all steps grazes, and ends in front of the last plane, which is safe.
    """
    V = vector(dim, scalar)
    zero, one = wp.constant(scalar(0.0)), wp.constant(scalar(1.0))
    slack, near = wp.constant(scalar(SLACK)), wp.constant(scalar(NEAR[scalar]))

    @wp.func
    def enter(obstacles: Obstacles, p: int, x_old: V, x: V):
        start = carried(obstacles, p, x_old)
        way = x - start
        t = scalar(0.0)
        distance = scalar(0.0)
        normal = V()
        for step in range(STEPS):
            gap, normal = look(obstacles, p, start + t * way)
            distance = gap + (one - t) * wp.dot(way, normal)
            if step == 0 and (gap < -slack * obstacles.inradius or distance >= gap):  # starts inside, or leaves
                distance = scalar(0.0)
            if distance >= zero or gap <= near * obstacles.inradius:
                break
            t += (one - t) * gap / (gap - distance)
        return t, distance, normal

    return enter


def sweep(dim: int, scalar: type, Obstacles, look, carried, answer):
    """Compose `sweep_way(obstacles, x, v, x_old, v_old)` -> (x, v) after contact with all obstacles on the path.

    Contacts are resolved in the order of entry, not of the list. After each contact the path ends on the tangent
    plane, and the rest of the path is checked again. The functions of the obstacles:
    `look(obstacles, p, x)`: (distance, normal) of point x from obstacle p at the substep's end;
    `carried(obstacles, p, x_old)`: x_old moved with the obstacle, so that the obstacle appears fixed;
    `answer(obstacles, p, distance, normal, x, v, start, x_old, v_old)`: (x, v) after contact; friction shortens
    the path after `start`.
    """
    V = vector(dim, scalar)
    slack, near = wp.constant(scalar(SLACK)), wp.constant(scalar(NEAR[scalar]))
    enter = entry(dim, scalar, Obstacles, look, carried)
    # In a corner each face removes one direction from the path; sharper corners need more rounds.
    meetings = 2 * dim

    @wp.func
    def first_on_way(obstacles: Obstacles, met: int, x_old: V, x: V):
        """Return (p, t, distance, normal) of the first obstacle on the path, except `met`; p = -1 for none."""
        first = int(-1)
        t_first = scalar(2.0)
        distance_first = scalar(0.0)
        normal_first = V()
        for p in range(obstacles.count):
            if p != met:
                t, distance, normal = enter(obstacles, p, x_old, x)
                if distance < -near * obstacles.inradius and t < t_first:
                    first = p
                    t_first = t
                    distance_first = distance
                    normal_first = normal
        return first, t_first, distance_first, normal_first

    @wp.func
    def sweep_way(obstacles: Obstacles, x: V, v: V, x_old: V, v_old: V):
        met = int(-1)
        for k in range(meetings + 1):
            met, t, distance, normal = first_on_way(obstacles, met, x_old, x)
            if met < 0:
                break
            start = carried(obstacles, met, x_old)
            entered = start + t * (x - start)
            if k == meetings:  # wedged between obstacles: the particle stays where it enters the first one
                x = entered
            else:
                free = x
                x, v = answer(obstacles, met, distance, normal, x, v, entered, x_old, v_old)
                # The rule ignores particles that move out; this one has turned back beyond the plane.
                x -= wp.min(distance + wp.dot(x - free, normal), scalar(0.0)) * normal
        # A particle that started inside obstacles is moved out from its final position, in the list's order.
        for p in range(obstacles.count):
            start = carried(obstacles, p, x_old)
            depth, normal = look(obstacles, p, start)
            if depth < -slack * obstacles.inradius:
                distance, normal = look(obstacles, p, x)
                x, v = answer(obstacles, p, distance, normal, x, v, start, x_old, v_old)
        return x, v

    return sweep_way
