"""The facet of a body nearest to a point, its distance, and the normal of the surface at the point.

Only facets that `neighbor_search` has listed for the point are examined.
"""

import functools

import warp as wp

from ..basis import vector
from ..lanes import chosen_of_lanes, least_of_lanes
from ..records import table
from ..springs.lanes import sum_over_lanes
from .contact_data import BodyContactData, Pair
from .pairs import ALMOST, FAR, NONE, places, points, unit_normal

UNLIKE = {wp.float32: 2.0**-12, wp.float64: 2.0**-30}
"""How much squared distances count more, relatively: by a share for each facet, larger than their rounding.

Two facets are equally near where their common edge is nearest. Rounding must not choose between them, since the
couple of friction is borne by the chosen one: the motion would depend on the last digit of every number.
"""


@functools.cache
def nearest_facets(scalar: type, lanes: int, worlds: bool):
    """Compose (Nearest, find_nearest, separate).

    `find_nearest` finds, among the facets of one body in a point's list, the one nearest to the point. `lanes`
    threads divide the list, and all get the result. `separate` returns the distance of the point from the facet
    [m], never negative, and the unit vector along which it grows.
    """
    V, Data = vector(3, scalar), BodyContactData(scalar, worlds)
    Point, PointAndBody = points(scalar, worlds)[0], Pair(scalar)
    _, place_on, nearest_to = places(scalar)
    least_of, least_number = least_of_lanes(scalar, lanes), least_of_lanes(int, lanes)
    pick, corner_of = chosen_of_lanes(scalar, lanes), table(wp.vec3i)
    zero, almost, far = scalar(0.0), scalar(ALMOST), scalar(FAR)
    unlike = scalar(UNLIKE[scalar] / 1024.0)

    @wp.func
    def weighted(f: int, each: int) -> scalar:
        return scalar(1.0) + unlike * scalar(((f % each) * 40503) & 1023)  # Knuth, TAOCP 3, 6.4

    @wp.struct
    class Nearest:
        facet: int  # NONE if the row has none
        corner: wp.vec3i
        squared: scalar  # distance² [m²]
        w: V  # weights of its corners at the nearest point
        until: int  # end of the body's facets in the row
        w_own: V  # weights at the nearest of the facets that this thread has tested

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
        w = V()
        until = int(n)
        each = data.surfaces.corner.shape[0]  # facets of a world
        if wp.static(worlds):
            each = each / (data.surfaces.solid.shape[0] / data.surfaces.bodies_each)
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
                counted = weighted(f, each) * wp.dot(away, away)
                if counted < best or (counted == best and f < facet):
                    best = counted
                    near = wp.sqrt(best) + buffer
                    facet = f
                    w = w_f
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
        found.squared = best / weighted(found.facet, each)
        found.w = w
        found.until = until
        return found

    @wp.func
    def separate(nearest: Nearest, away: V):
        gap = wp.sqrt(nearest.squared)
        normal = V()
        if gap > zero:
            normal = away / gap
        return gap, normal

    return Nearest, find_nearest, separate


@functools.cache
def own_normals(scalar: type, lanes: int):
    """Compose (first_facet, facet, corner, x, ends, lane) -> the unit normal of the surface at a point; 0 if none.

    The point lies between the vertices `ends`; its `lanes` threads divide the facets around it.
    """
    V, normal_of, sum_of = vector(3, scalar), unit_normal(scalar), sum_over_lanes(3, scalar, lanes)
    entry, corner_of = table(int), table(wp.vec3i)

    @wp.func
    def normal_at(
        first_facet: wp.array(dtype=int),
        facet: wp.array(dtype=int),
        corner: wp.array(dtype=wp.vec3i),
        x: wp.array(dtype=V),
        ends: wp.vec2i,
        lane: int,
    ) -> V:
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
        return wp.normalize(sum_of(outward))

    return normal_at
