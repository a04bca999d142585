"""The facet of a body nearest to a point, and its distance.

Only facets that `neighbor_search` has listed for the point are examined.
"""

import functools

import warp as wp

from ..basis import vector
from ..lanes import chosen_of_lanes, least_of_lanes
from ..records import table
from .contact_data import BodyContactData, Pair
from .pairs import ALMOST, FAR, NONE, places, points

UNLIKE = {wp.float32: 2.0**-12, wp.float64: 2.0**-30}
"""How much squared distances count more, relatively: by a fraction for each facet, larger than their rounding.

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
    V, Data = vector(3, scalar), BodyContactData(scalar)
    Point, PointAndBody = points(scalar)[0], Pair(scalar)
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

    @wp.func
    def find_nearest(
        data: Data,
        point: Point,
        lane: int,  # index among the threads of the point
        pair: PointAndBody,
        first: int,
        shrunk: scalar,  # bound on how much distances have shrunk since the last search [m]
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
                    near = wp.sqrt(best) + shrunk
                    facet = f
                    w = w_f
        if wp.static(lanes > 1):
            until = least_number(until)
            nearest = least_of(best)
            if best > nearest:
                facet = int(wp.static(NONE))
            best = nearest
            own = facet
            w_own = w
            facet = least_number(facet)
            for k in range(3):
                w[k] = pick(own == facet, w_own[k])
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
