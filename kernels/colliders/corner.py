"""Corners: a particle that one obstacle pushes into another slides out along the first obstacle."""

import warp as wp

from ..basis import vector

ROUNDS = 4
"""Maximal number of passes over all obstacles. Two flat faces need one pass, three that meet in a point a few."""
PARALLEL = 1e-3
"""If the squared sine between two normals is smaller, the particle is squeezed, and sliding cannot free it."""
NOTHING = 1e-3
"""Fraction of the contact displacement; a smaller depth is left to the next substep."""


def corner(dim: int, scalar: type, Obstacles, look, carried, speed, overlapping_at_start: bool):
    """Compose `settle(obstacles, x, v, x_free, x_old)` -> (x, v), for a particle that contact moved from x_free.

    In a narrow corner, pushing the particle out of each obstacle in turn by the shortest displacement takes many
    rounds. So it is pushed out of an obstacle along the face of the previous one. Between two flat faces one push
    suffices at any angle. The velocity component into each face is removed likewise. `look(obstacles, p, x)`:
    (distance, normal) of point x from obstacle p; `speed(obstacles, p, x_old)`: the obstacle's velocity at the
    point [m/s]; `carried`: see `sweep`. Particles that start inside are moved out by `contact_rule` instead.
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
