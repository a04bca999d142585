"""The facet of a body nearest to a point, the side where the point is, and how far the surfaces face each other.

Only facets that `neighbor_search` has listed for the point are examined.
"""

import functools

import warp as wp

from ..basis import vector
from ..lanes import chosen_of_lanes, least_of_lanes
from ..records import records, table
from ..springs.lanes import sum_over_lanes
from .contact_data import BodyContactData, Pair
from .pairs import ALMOST, FAR, NONE, places, points, unit_normal

LEAST_FACING = 0.1
"""Below this cosine between the normal at the point and minus the facet's normal there is no damping."""
FULL_FACING = 0.4
"""Above this cosine there is full damping. The corner of a block against a plane has 0.41 or more."""


@functools.cache
def nearest_facets(scalar: type, lanes: int, worlds: bool):
    """Compose (Nearest, find_nearest, separate).

    `find_nearest` finds, among the facets of one body in a point's list, the one nearest to the point. `lanes`
    threads divide the list, and all get the result. `separate` returns the signed distance of the point from the
    facet [m], negative on the wrong side, and the unit vector along which it grows.
    """
    V, Data = vector(3, scalar), BodyContactData(scalar, worlds)
    Point, PointAndBody = points(scalar, worlds)[0], Pair(scalar)
    (_, place_on, nearest_to), normal_of = places(scalar), unit_normal(scalar)
    least_of, least_number = least_of_lanes(scalar, lanes), least_of_lanes(int, lanes)
    pick, load, corner_of = chosen_of_lanes(scalar, lanes), records(3, scalar).load, table(wp.vec3i)
    zero, almost, far = scalar(0.0), scalar(ALMOST), scalar(FAR)

    @wp.struct
    class Nearest:
        facet: int  # NONE if the row has none
        corner: wp.vec3i
        squared: scalar  # distance² [m²]
        w: V  # weights of its corners at the nearest point
        first: int  # index in the row of the body's first facet
        until: int  # end of the body's facets in the row
        # The nearest of the facets that this thread has tested:
        entry: int
        w_own: V

    @wp.func
    def find_nearest(
        data: Data,
        point: Point,
        lane: int,  # index among the threads of the point
        pair: PointAndBody,
        first: int,
        buffer: scalar,  # bound on how much distances have shrunk since the last search [m]
    ) -> Nearest:
        found = Nearest()
        p = point.number
        n = data.neighbors.candidate_count[p]
        best = far
        near = far
        facet = int(wp.static(NONE))
        entry = int(-1)
        w = V()
        until = int(n)
        for e in range(first + lane, n, wp.static(lanes)):
            f = data.neighbors.candidates[p, e]  # read three values early, to overlap their latencies
            listed = data.neighbors.candidate_distance[p, e]
            if data.neighbors.candidate_pair[p, e] != pair.place:
                until = e
                break
            if almost * listed <= near:
                c = corner_of(data.surfaces.corner, f)
                w_f = nearest_to(data.surfaces.x, c, point.x)
                away = point.x - place_on(data.surfaces.x, c, w_f)
                if wp.dot(away, away) < best or (wp.dot(away, away) == best and f < facet):
                    best = wp.dot(away, away)
                    near = wp.sqrt(best) + buffer
                    facet = f
                    entry = e
                    w = w_f
        found.first = first
        found.entry = entry
        found.w_own = w
        if wp.static(lanes > 1):
            until = least_number(until)
            nearest = least_of(best)
            if best > nearest:
                facet = int(wp.static(NONE))
            best = nearest
            own = facet
            facet = least_number(facet)
            for k in range(3):
                w[k] = pick(own == facet, found.w_own[k])
        found.facet = facet
        found.corner = corner_of(data.surfaces.corner, facet % wp.static(NONE))  # facet 0 if there is none
        found.squared = best
        found.w = w
        found.until = until
        return found

    @wp.func
    def steepest(
        data: Data,
        point: Point,
        lane: int,
        nearest: Nearest,
        height: scalar,  # above the plane of the nearest facet [m]
        buffer: scalar,
    ) -> scalar:
        """Return the signed height of a point above a facet at its nearest edge or corner [m]; negative inside.

        Of the facets that meet there, it is the one above which the height is largest in magnitude.
        """
        p = point.number
        x = data.surfaces.x
        edge = load(x, nearest.corner[1]) - load(x, nearest.corner[0])
        tie = nearest.squared * scalar(1.001) + scalar(1.0e-12) * wp.length_sq(edge)
        near = wp.sqrt(tie) + buffer
        side = height
        for e in range(nearest.first + lane, nearest.until, wp.static(lanes)):
            if almost * data.neighbors.candidate_distance[p, e] <= near:
                c = corner_of(data.surfaces.corner, data.neighbors.candidates[p, e])
                w = nearest.w_own
                if e != nearest.entry:
                    w = nearest_to(x, c, point.x)
                to = point.x - place_on(x, c, w)
                if wp.dot(to, to) <= tie:
                    seen = wp.dot(to, normal_of(x, c))
                    steeper = wp.abs(seen) - wp.abs(side)
                    if steeper > zero or (steeper == zero and seen > side):
                        side = seen
        if wp.static(lanes > 1):
            if wp.abs(side) < -least_of(-wp.abs(side)):
                side = -far
            side = -least_of(-side)
        return side

    @wp.func
    def separate(
        data: Data, point: Point, lane: int, pair: PointAndBody, nearest: Nearest, away: V, buffer: scalar
    ):
        closed = pair.closed != 0
        normal = normal_of(data.surfaces.x, nearest.corner)
        height = wp.dot(away, normal)
        within = nearest.w[0] > zero and nearest.w[1] > zero and nearest.w[2] > zero
        if closed and not within:
            height = steepest(data, point, lane, nearest, height, buffer)
        gap = wp.sqrt(nearest.squared)
        if within and wp.length_sq(normal) > zero:
            gap = wp.abs(height)
            if height < zero:
                normal = -normal
        elif nearest.squared > zero:
            normal = away / gap
        if closed and height < zero:
            gap = -gap
            normal = -normal
        return gap, normal

    return Nearest, find_nearest, separate


@functools.cache
def facing(scalar: type, lanes: int):
    """Compose (first_facet, facet, corner, x, ends, normal, closed, lane) -> the fraction of damping, 0 to 1.

    A point that slides past an edge of another body may enter through a side face. There the spring pushes along
    the direction of sliding, and returns the work where the point leaves. A damper would brake the body as in a
    collision; so would friction on a side along which the body slides. So both act only where the two surfaces
    face each other. The point lies between the vertices `ends`; `closed` tells whether its body has an inside;
    `normal` points out of the other body, which is closed. The fraction is 1 for a point without a surface. The
    `lanes` threads of the point divide the facets around it.
    """
    V, normal_of, sum_of = vector(3, scalar), unit_normal(scalar), sum_over_lanes(3, scalar, lanes)
    entry, corner_of = table(int), table(wp.vec3i)
    zero, one, least = scalar(0.0), scalar(1.0), scalar(LEAST_FACING)
    by = scalar(1.0 / (FULL_FACING - LEAST_FACING))

    @wp.func
    def facing_of(
        first_facet: wp.array(dtype=int),
        facet: wp.array(dtype=int),
        corner: wp.array(dtype=wp.vec3i),
        x: wp.array(dtype=V),
        ends: wp.vec2i,
        normal: V,
        closed: int,
        lane: int,
    ) -> scalar:
        outward = V()
        first = entry(first_facet, ends[0])
        count = entry(first_facet, ends[0] + 1) - first
        second = int(0)  # start of the facets around the second vertex, if the ends differ
        both = int(count)
        if ends[0] != ends[1]:
            second = entry(first_facet, ends[1])
            both += entry(first_facet, ends[1] + 1) - second
        for e in range(lane, both, wp.static(lanes)):
            at = first + e
            if e >= count:
                at = second + e - count
            outward += normal_of(x, corner_of(corner, entry(facet, at)))
        outward = sum_of(outward)
        share = one
        if wp.length_sq(outward) > zero:
            towards = -wp.dot(wp.normalize(outward), normal)
            if closed == 0:
                towards = wp.abs(towards)  # a sheet has two sides
            share = wp.clamp(by * (towards - least), zero, one)
        return share

    return facing_of
