"""Corners: resolve a particle pushed from one obstacle into another by sliding it along the first."""

import warp as wp

from ..basis import vector

ROUNDS = 4
"""Times that all obstacles are looked at again. Two flat faces take one, three that meet in a point a few."""
PARALLEL = 1e-3
"""Where the sine squared between two normals is less, a particle is squeezed: along neither is a way out."""
NOTHING = 1e-3
"""A particle less deep than this share of the way that contact moved it is left to the next substep."""


def corner(dim: int, scalar: type, Obstacles, look, carried, speed, overlapping_at_start: bool):
    """Compose `settle(obstacles, x, v, x_free, x_old)` -> (x, v), for a particle that contact moved from x_free.

    Going from obstacle to obstacle, each putting the particle out by the shortest way, ends in a narrow corner
    only after many turns. Here the way out of one is taken along the face that was met before: two flat faces are
    both left at once, whatever their angle. The velocity loses its component into each in the same way.
    `look(obstacles, p, x)`: (distance, normal) of a place from obstacle p; `speed(obstacles, p, x_old)`: of
    the obstacle at the place [m/s]; `carried`: see `sweep`. `contact_rule` moves out what started inside.
    """
    V = vector(dim, scalar)
    zero = wp.constant(scalar(0.0))
    parallel, nothing = wp.constant(scalar(PARALLEL)), wp.constant(scalar(NOTHING))

    @wp.func
    def settle(obstacles: Obstacles, x: V, v: V, x_free: V, x_old: V):
        allowed = -nothing * wp.length(x - x_free)
        if allowed < zero:
            before = V()
            for _k in range(ROUNDS):
                again = bool(False)
                for p in range(obstacles.count):
                    distance, normal = look(obstacles, p, x)
                    inside = distance < allowed
                    if wp.static(overlapping_at_start):
                        began, _normal = look(obstacles, p, carried(obstacles, p, x_old))
                        inside = inside and began >= -obstacles.surface.slack
                    if inside:
                        along = normal - wp.dot(normal, before) * before
                        part = wp.dot(along, normal)
                        if part < parallel:
                            along = normal
                            part = scalar(1.0)
                        x -= distance / part * along
                        approach = wp.dot(v - speed(obstacles, p, x_old), normal)
                        v -= wp.min(approach, zero) / part * along
                        before = normal
                        again = bool(True)
                if not again:
                    break
        return x, v

    return settle
