"""Which facet of a body is the nearest to a point, and on which side of it the point is."""

import functools

import warp as wp

from ..basis import vector
from ..records import records
from .contact_data import BodyContactData
from .lanes import chosen_of_lanes, least_of_lanes
from .pairs import ALMOST, FAR, NONE, Pair, places, points, unit_normal


@functools.cache
def nearest_facets(scalar: type, lanes: int, worlds: bool):
    """Compose (Nearest, find_nearest, separate).

    `find_nearest` finds the facet of one body that is the nearest to a point, by the row of the point. Its threads
    (`lanes`) share the row, and all of them learn the facet. `separate` returns the distance of the point from it
    [m], below 0 on the wrong side, and the unit vector in which the distance grows.
    """
    V, Data = vector(3, scalar), BodyContactData(scalar, worlds)
    Point, PointAndBody = points(scalar, worlds)[0], Pair(scalar)
    (_, place_on, nearest_to), normal_of = places(scalar), unit_normal(scalar)
    least_of, least_number = least_of_lanes(scalar, lanes), least_of_lanes(int, lanes)
    pick, load = chosen_of_lanes(scalar, lanes), records(3, scalar).load
    zero, almost, far = scalar(0.0), scalar(ALMOST), scalar(FAR)

    @wp.struct
    class Nearest:
        facet: int  # NONE where there is none
        corner: wp.vec3i
        squared: scalar  # distance² [m²]
        w: V  # weights of its corners in the nearest place
        first: int  # where the facets of its body begin in the row
        until: int  # where those of another body begin
        # Of the facets that this thread has looked at, the nearest:
        entry: int
        w_own: V

    @wp.func
    def find_nearest(
        data: Data,
        point: Point,
        lane: int,  # which of the threads that share the point this is
        pair: PointAndBody,
        first: int,
        buffer: scalar,  # by how much distances may have become less since rows were found [m]
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
            f = data.neighbors.candidates[p, e]  # before anything is known of it: these three are read at once
            listed = data.neighbors.candidate_distance[p, e]
            if data.neighbors.candidate_body[p, e] != pair.other:
                until = e
                break
            if almost * listed <= near:
                w_f = nearest_to(data.surfaces.x, data.surfaces.corner[f], point.x)
                away = point.x - place_on(data.surfaces.x, data.surfaces.corner[f], w_f)
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
        found.corner = data.surfaces.corner[facet % wp.static(NONE)]  # 0 where nothing is anywhere
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
        """Return the height above that triangle around an edge or a corner which is seen most steeply."""
        p = point.number
        x = data.surfaces.x
        edge = load(x, nearest.corner[1]) - load(x, nearest.corner[0])
        tie = nearest.squared * scalar(1.001) + scalar(1.0e-12) * wp.length_sq(edge)
        near = wp.sqrt(tie) + buffer
        side = height
        for e in range(nearest.first + lane, nearest.until, wp.static(lanes)):
            if almost * data.neighbors.candidate_distance[p, e] <= near:
                c = data.surfaces.corner[data.neighbors.candidates[p, e]]
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
        closed = data.surfaces.closed[pair.other] != 0 and pair.mine != pair.other
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
