"""Contact forces on vertices, as integers in a small unit: integer sums do not depend on their order.

Also the impulses of these forces on particles, summed over a frame, for probes, pictures and files.
"""

import functools

import warp as wp

from ..basis import kernel, vector
from ..partition import add_whole
from .contact_data import body_contact_term
from .law import triangles

Units = wp.types.vector(3, wp.int64)
"""A force in units."""


@functools.cache
def exert_force(scalar: type, lanes: int):
    """Compose wp.func that adds a force f [N] to a facet, with a couple [N m] if the facet takes one.

    Of the force f_1 and f_2 act on its second and third corners. In units of 1 / per_unit [N] the forces on the
    corners sum to exactly f. The `lanes` threads of a contact divide the coordinates.
    """
    V, (Triangle, _, turn_by) = vector(3, scalar), triangles(scalar)
    third = scalar(1.0 / 3.0)

    @wp.func
    def exert(
        force: wp.array2d(dtype=wp.int64),
        corner: wp.vec3i,
        triangle: Triangle,
        f: V,
        f_1: V,
        f_2: V,
        couple: V,
        per_unit: wp.float64,  # [1/N]
        lane: int,
        parts: int,  # number of parts for threads of the CPU
    ):
        turn = turn_by(triangle, couple)
        middle = third * (triangle.first + triangle.second)
        first = f_1 + wp.cross(turn, triangle.first - middle)
        second = f_2 + wp.cross(turn, triangle.second - middle)
        for k in range(lane, 3, wp.static(lanes)):
            total = wp.int64(wp.float64(f[k]) * per_unit)
            on_1 = wp.int64(wp.float64(first[k]) * per_unit)
            on_2 = wp.int64(wp.float64(second[k]) * per_unit)
            add_whole(force, corner[0], k, total - on_1 - on_2, parts)
            add_whole(force, corner[1], k, on_1, parts)
            add_whole(force, corner[2], k, on_2, parts)

    return exert


@functools.cache
def exert_on_segments(scalar: type):
    """Compose (in_units, take_from), for points that touch only segments or grains.

    `in_units` converts a force [N] to integers; `take_from` subtracts them from the ends of a segment, or from the
    two vertices of a point. The forces of several contacts on a point may be summed first, since atomic additions
    dominate the cost.
    """
    V = vector(3, scalar)
    zero = wp.int64(0)

    @wp.func
    def in_units(f: V, per_unit: wp.float64) -> Units:
        """Return a force [N] as integers, in units of 1 / per_unit [N]."""
        return Units(
            wp.int64(wp.float64(f[0]) * per_unit),
            wp.int64(wp.float64(f[1]) * per_unit),
            wp.int64(wp.float64(f[2]) * per_unit),
        )

    @wp.func
    def take_from(force: wp.array2d(dtype=wp.int64), first: int, second: int, t: scalar, total: Units, parts: int):
        """Subtract a force from two vertices: t times it from the second, the rest from the first."""
        for k in range(3):
            on_second = wp.int64(wp.float64(total[k]) * wp.float64(t))
            if on_second != zero:
                add_whole(force, second, k, -on_second, parts)
            if total[k] != on_second:
                add_whole(force, first, k, on_second - total[k], parts)

    return in_units, take_from


@functools.cache
def add_impulses(dim: int, scalar: type, compensated: bool, by_obstacles: bool):
    """Compose the kernel, over particles, that sums the impulses of contact, in float64.

    `seconds` is the weight of the current stage in the method's sum over the substep. If `by_obstacles`, only the
    forces of obstacles count, which are the increase of forces since `before`. Their impulses are divided by the
    particles' masses [m/s].
    """
    VertexForces = body_contact_term(dim, scalar, compensated).Data
    Wide = vector(dim, wp.float64)

    @kernel
    def add_impulse(
        body_contact: VertexForces,
        before: wp.array2d(dtype=wp.int64),  # in units, shape [vertex_count, 3]; not used for other bodies
        inverse_mass: wp.array(dtype=scalar),  # [1/kg], shape [particle_count]
        seconds: wp.float64,  # duration for which the forces count [s]
        # In and out:
        impulse: wp.array(dtype=Wide),  # [N s], shape [particle_count]
    ):
        i = wp.tid()
        total = Wide()
        for s in range(body_contact.first[i], body_contact.first[i + 1]):
            vertex = body_contact.vertex[s]
            for k in range(wp.static(dim)):
                whole = body_contact.force[vertex, k]
                if wp.static(by_obstacles):
                    whole = whole - before[vertex, k]
                f = wp.float64(whole) * body_contact.unit
                total[k] = total[k] + wp.float64(body_contact.weight[s]) * f
        if wp.static(by_obstacles):
            total = wp.float64(inverse_mass[i]) * total
        impulse[i] = impulse[i] + seconds * total

    return add_impulse
