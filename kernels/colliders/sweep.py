"""The solids that a particle meets within a substep, even thin ones that it has passed at the end.

All solids are convex. Over a straight way their signed distance is then a convex function, and the tangent plane
at the point of a solid nearest to any place outside has the whole solid behind it: it is a supporting plane.
"""

import functools

import warp as wp

from ..basis import vector

SLACK = 0.01
"""How deep inside a start still counts as on the surface, and how little of a corner may be cut.

A share of `inradius`: far more than roundings of places, also in float32, and too little to be seen.
"""
STEPS = 32
"""Newton's steps to a surface, of which five are common.

Of a convex function each leaves a quarter at most of its value times its slope: after all of them the distance, or
the speed of approach, is less than 2^−32 of its first value.
"""
NEAR = {wp.float32: 1e-4, wp.float64: 1e-10}
"""The distance that counts as on the surface, as a share of `inradius`: more than roundings, and negligible."""


@functools.cache
def passing(dim: int, scalar: type):
    """Compose `passes`: whether the end of a way leaves open which solids it met, by its distance from one.

    The normal n there belongs to a supporting plane. A particle that came from before this plane missed the solid,
    or came in by that side; one that came from behind it, way · n > distance, may have gone through, or past the
    middle. And a way longer than the thinnest solid is thick may have come to its end by way of another.
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
    """Compose `enter(obstacles, p, x_old, x)` -> (t, distance, normal) where a way from outside enters obstacle p.

    t is the share of the way before it. The last two are those of x from the tangent plane there; distance >= 0
    means that the way misses the obstacle, or begins in it.

    Newton's method for distance = 0: from each place on to its supporting plane. Distances being convex, it never
    goes too far, and never less far than sphere tracing (Hart, The Visual Computer 12, 1996), which goes on by the
    distance itself. A flat face takes one step. As soon as the end lies before such a plane the way is a miss;
    a way that after all steps still comes nearer grazes; it is kept before the last plane, which is safe.
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
            if step == 0 and (gap < -slack * obstacles.inradius or distance >= gap):  # begins inside, or leaves
                distance = scalar(0.0)
            if distance >= zero or gap <= near * obstacles.inradius:
                break
            t += (one - t) * gap / (gap - distance)
        return t, distance, normal

    return enter


def sweep(dim: int, scalar: type, Obstacles, look, carried, answer):
    """Compose `sweep_way(obstacles, x, v, x_old, v_old)` -> (x, v) after contact with all that lies on the way.

    The first obstacle entered is met first, in whatever order they are listed. By the rule the way then ends on
    the tangent plane there, and is looked at again. The functions of the obstacles:
    `look(obstacles, p, x)`: (distance, normal) of a place from obstacle p where that is when the substep ends;
    `carried(obstacles, p, x_old)`: where x_old is then if it goes with the obstacle, from which that stands still;
    `answer(obstacles, p, distance, normal, x, v, start, x_old, v_old)`: (x, v) by the rule, friction taking its
    share of the way from `start` on.
    """
    V = vector(dim, scalar)
    slack, near = wp.constant(scalar(SLACK)), wp.constant(scalar(NEAR[scalar]))
    enter = entry(dim, scalar, Obstacles, look, carried)
    # In a corner each face takes one direction from the way; those of sharper ones take more in turn.
    meetings = 2 * dim

    @wp.func
    def first_on_way(obstacles: Obstacles, met: int, x_old: V, x: V):
        """Return (p, t, distance, normal) of the first obstacle entered but the one just met; p = -1: none."""
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
            if k == meetings:  # wedged in between: it stays where it meets the first of them
                x = entered
            else:
                free = x
                x, v = answer(obstacles, met, distance, normal, x, v, entered, x_old, v_old)
                # The rule leaves alone a particle on its way out; this one, turned back too late, is beyond.
                x -= wp.min(distance + wp.dot(x - free, normal), scalar(0.0)) * normal
        # A particle that began inside is put out where it ends, in the order of the list.
        for p in range(obstacles.count):
            start = carried(obstacles, p, x_old)
            depth, normal = look(obstacles, p, start)
            if depth < -slack * obstacles.inradius:
                distance, normal = look(obstacles, p, x)
                x, v = answer(obstacles, p, distance, normal, x, v, start, x_old, v_old)
        return x, v

    return sweep_way
