"""Pairs of a point and a facet: their positions, their contact rule, its range and its stiffness."""

import functools

import warp as wp

from ..basis import vector
from ..partition import add_whole
from ..records import records, table
from .contact_data import WHOLE, BodyContactData, Pair
from .nearest_point import nearest_on_triangle

NONE = 2**31 - 1
"""No body or no facet: greater than any index."""
ALMOST = 0.9999
"""Factor for listed distances, which may be too large by rounding."""
DOUBT = 0.01
"""Part of the skin that covers the rounding of paths since the last search."""
ROUNDING = {wp.float32: 1.0e-6, wp.float64: 2.0e-15}
"""By how much distances may be wrong by rounding, as a fraction of coordinates."""
FAR = 1.0e30
"""A distance greater than any [m]."""


@wp.func
def never_touches(first_near: wp.array(dtype=int), near: wp.array(dtype=int), ends: wp.vec2i, c: wp.vec3i) -> bool:
    """Tell whether a point between the vertices `ends` is so near facet c of its own body that they never touch.

    `near` lists the vertices near each vertex, from row starts `first_near`.
    """
    found = bool(False)
    for k in range(2):
        for e in range(first_near[ends[k]], first_near[ends[k] + 1]):
            found = found or near[e] == c[0] or near[e] == c[1] or near[e] == c[2]
    return found


@functools.cache
def places(scalar: type):
    """Compose (place_of, place_on, nearest_to).

    `place_of` returns the position of a point; `place_on` the position on a facet for given weights of its corners
    (or the velocity, for an array of velocities); `nearest_to` the weights of the point of a facet nearest to p.
    They take arrays, since on the CPU a call would copy the whole data struct.
    """
    V, nearest, load = vector(3, scalar), nearest_on_triangle(scalar), records(3, scalar).load

    @wp.func
    def place_of(x: wp.array(dtype=V), ends: wp.vec2i, fraction: scalar) -> V:
        first = load(x, ends[0])
        return first + fraction * (load(x, ends[1]) - first)

    @wp.func
    def place_on(x: wp.array(dtype=V), corner: wp.vec3i, w: V) -> V:
        return w[0] * load(x, corner[0]) + w[1] * load(x, corner[1]) + w[2] * load(x, corner[2])

    @wp.func
    def nearest_to(x: wp.array(dtype=V), corner: wp.vec3i, p: V) -> V:
        return nearest(p, load(x, corner[0]), load(x, corner[1]), load(x, corner[2]))

    return place_of, place_on, nearest_to


@functools.cache
def pairs(scalar: type):
    """Compose (find_rule, pair_of) for points of body `mine` and facets of body `other`.

    `find_rule` returns the index of their contact rule, `pair_of` the constants that follow from it.
    """
    Data, PointAndBody = BodyContactData(scalar), Pair(scalar)

    @wp.func
    def find_rule(data: Data, mine: int, other: int) -> int:
        """Return the index of the contact rule of two bodies; −1 if they pass through each other."""
        rule = data.rules.table[data.rules.kind[mine], data.rules.kind[other]]
        if mine == other and rule >= 0:
            if data.rules.self_contact[rule] == 0 or data.surfaces.solid[mine] != 0:
                rule = -1
        return rule

    @wp.func
    def pair_of(data: Data, rule: int, mine: int, other: int, place: int) -> PointAndBody:
        pair = PointAndBody()
        pair.mine = mine
        pair.other = other
        pair.place = place
        pair.thickness = data.rules.thickness[rule]
        if pair.thickness < scalar(0.0):
            pair.thickness = data.surfaces.radius[mine] + data.surfaces.radius[other]
        pair.stiffness = data.rules.stiffness[rule]
        if pair.stiffness < scalar(0.0):  # the harmonic mean for both bodies
            a = data.surfaces.stiffness[mine]
            b = data.surfaces.stiffness[other]
            pair.stiffness = scalar(2.0) * a * b / (a + b)
        pair.damping = data.rules.damping[rule]
        pair.hysteresis = data.rules.hysteresis[rule]
        spacing = data.surfaces.spacing[mine]
        if spacing <= scalar(0.0):
            spacing = pair.thickness
        ratio = data.surfaces.spacing[other] / spacing
        pair.crowd = wp.max(scalar(1.0), ratio * ratio)
        pair.friction = data.rules.friction[rule]
        return pair

    return find_rule, pair_of


@functools.cache
def points(scalar: type):
    """Compose (Point, point_of, mobility_of): a contact point, its constructor, and its mobility [1/kg]."""
    V, Data, one = vector(3, scalar), BodyContactData(scalar), scalar(1.0)
    place_of, body_of, ends_of, number_of = places(scalar)[0], table(int), table(wp.vec2i), table(scalar)
    corner_of = table(wp.vec3i)

    @wp.struct
    class Point:
        number: int
        body: int
        ends: wp.vec2i  # the two vertices between which it lies
        fraction: scalar  # weight of the second vertex
        density: scalar  # of the stiffness of a vertex
        host: wp.vec3i  # corners of a facet that it lies on
        x: V  # [m]

    @wp.func
    def point_of(data: Data, p: int) -> Point:
        point = Point()
        point.number = p
        point.body = body_of(data.surfaces.body, p)
        point.ends = ends_of(data.surfaces.ends, p)
        point.fraction = number_of(data.surfaces.fraction, p)
        point.density = number_of(data.surfaces.density, p)
        host = body_of(data.surfaces.host, p)
        point.host = corner_of(data.surfaces.corner, wp.max(host, 0))
        if host < 0 or point.host[1] == point.host[2]:  # there is none, or it has torn
            point.host = wp.vec3i(point.ends[0], point.ends[1], point.ends[1])
        point.x = place_of(data.surfaces.x, point.ends, point.fraction)
        return point

    @wp.func
    def mobility_of(mobility: wp.array(dtype=scalar), ends: wp.vec2i, s: scalar) -> scalar:
        found = number_of(mobility, ends[0])
        if ends[0] != ends[1]:
            found = (one - s) * (one - s) * found + s * s * number_of(mobility, ends[1])
        return found

    return Point, point_of, mobility_of


@functools.cache
def crowding(scalar: type):
    """Compose (damping_fraction, count_touching), which divide the damping of a surface among touching points.

    `damping_fraction` returns the fraction of a point: its density (`contact_surfaces.densities`), times the sum
    of the densities of all points around it, divided by the sum for those of them that touched in the substep
    before (if `measuring`, between substeps: in the last one). `count_touching` adds the point to the second sum
    for this substep.
    """
    Data, Point = BodyContactData(scalar), points(scalar)[0]
    one, whole, number_of = scalar(1.0), scalar(WHOLE), table(scalar)

    @wp.func
    def damping_fraction(data: Data, point: Point, measuring: int) -> scalar:
        at = 1 - measuring
        first = scalar(data.surfaces.touching[point.ends[0], at])
        second = scalar(data.surfaces.touching[point.ends[1], at])
        touching = (first + point.fraction * (second - first)) / whole
        touching = wp.max(wp.max(point.density, touching), scalar(1.0e-9))  # of a flat triangle it may be 0
        return point.density * number_of(data.surfaces.crowd, point.number) / touching

    @wp.func
    def count_touching(data: Data, point: Point, parts: int):
        first = wp.int64(whole * (one - point.fraction) * point.density)
        add_whole(data.surfaces.touching, point.ends[0], 0, first, parts)
        if point.fraction > scalar(0.0):
            add_whole(
                data.surfaces.touching, point.ends[1], 0, wp.int64(whole * point.fraction * point.density), parts
            )

    return damping_fraction, count_touching


@functools.cache
def weights_on_host(scalar: type):
    """Compose (point) -> the weights of a contact point among the corners of the facet that it lies on."""
    V, Point, zero, one = vector(3, scalar), points(scalar)[0], scalar(0.0), scalar(1.0)

    @wp.func
    def weights(point: Point) -> V:
        first = int(2)
        second = int(2)
        for k in range(3):  # a segment or a vertex has the same corner more than once: the first counts
            first = wp.where(point.host[2 - k] == point.ends[0], 2 - k, first)
            second = wp.where(point.host[2 - k] == point.ends[1], 2 - k, second)
        w = V()
        for k in range(3):
            w[k] = wp.where(k == first, one - point.fraction, wp.where(k == second, point.fraction, zero))
        return w

    return weights


@wp.func
def next_in_order(
    candidate_pair: wp.array2d(dtype=int),
    body_pairs: wp.array2d(dtype=int),
    p: int,
    mine: int,
    n: int,
    before: int,
) -> int:
    """Return where the facets of the body with the lowest index above `before` start in point p's list.

    Return the list's length n if there is no such body. The point belongs to body `mine`.
    """
    least = int(wp.static(NONE))
    first = int(n)
    for e in range(n):
        body = body_pairs[mine, candidate_pair[p, e]]
        if body > before and body < least:
            least = body
            first = e
    return first
