"""The facet of a body nearest to a point, and its distance.

Only facets that `neighbor_search` has listed for the point are examined.
"""

import functools

import warp as wp

from ..basis import vector
from ..lanes import chosen_of_lanes, least_of_lanes
from ..records import records
from .contact_data import BodyContactData, Pair
from .nearest_point import nearest_on_triangle
from .pairs import ALMOST, FAR, NONE, points

UNLIKE = {wp.float32: 2.0**-12, wp.float64: 2.0**-30}
"""How much squared distances count more, relatively: by a fraction for each facet, larger than their rounding.

Two facets are equally near where their common edge is nearest. Rounding must not choose between them, since the
couple of friction is borne by the chosen one: the motion would depend on the last digit of every number.
"""


@functools.cache
def nearest_facets(scalar: type, lanes: int, worlds: bool):
    """Compose (Nearest, candidate_at, find_nearest).

    `find_nearest` finds, among the facets of one body in a point's list, the one nearest to the point. `lanes`
    threads divide the list, and all get the result. `candidate_at` reads an entry of the list. It may be beyond
    the end: on a GPU entries are read before it is known whether they count, since memory is slow.
    """
    V, Data = vector(3, scalar), BodyContactData(scalar)
    Point, PointAndBody = points(scalar)[0], Pair(scalar)
    nearest_on, load = nearest_on_triangle(scalar), records(3, scalar).load
    least_of, least_number = least_of_lanes(scalar, lanes), least_of_lanes(int, lanes)
    pick, pick_number = chosen_of_lanes(scalar, lanes), chosen_of_lanes(int, lanes)
    almost, far = scalar(ALMOST), scalar(FAR)
    unlike = scalar(UNLIKE[scalar] / 1024.0)

    @wp.func
    def weighted(f: int, each: int) -> scalar:
        return scalar(1.0) + unlike * scalar(((f % each) * 40503) & 1023)  # Knuth, TAOCP 3, 6.4

    @wp.struct
    class Candidate:
        facet: wp.vec4i  # its corners and its number
        place: int  # its body, as an index in the row of body_pairs
        distance: scalar  # at the last search [m]

    @wp.struct
    class Nearest:
        facet: int  # NONE if the row has none
        corner: wp.vec3i
        squared: scalar  # distance² [m²]
        away: V  # from the facet to the point [m]
        w: V  # weights of its corners at the nearest point
        until: int  # end of the body's facets in the row

    @wp.func
    def candidate_at(data: Data, p: int, e: int) -> Candidate:
        at = wp.min(e, data.neighbors.candidates.shape[1] - 1)
        return Candidate(
            data.neighbors.candidates[p, at],
            data.neighbors.candidate_pair[p, at],
            data.neighbors.candidate_distance[p, at],
        )

    @wp.func
    def find_nearest(
        data: Data,
        point: Point,
        n: int,  # length of the point's list
        lane: int,  # index among the threads of the point
        first: int,  # where the facets of the body begin in the list
        mine: Candidate,  # entry first + lane
        a_mine: V,  # positions of its corners [m]
        b_mine: V,
        c_mine: V,
        pair: PointAndBody,
        shrunk: scalar,  # bound on how much distances have shrunk since the last search [m]
    ) -> Nearest:
        found = Nearest()
        candidate = mine
        a = a_mine
        b = b_mine
        c = c_mine
        x = data.surfaces.x
        best = far
        near = far
        facet = wp.vec4i(0, 0, 0, wp.static(NONE))
        each = data.surfaces.corner.shape[0]  # facets of a world
        if wp.static(worlds):
            each = each / (data.surfaces.solid.shape[0] / data.surfaces.bodies_each)
        e = first + lane
        while e < n and candidate.place == pair.place:
            following = candidate_at(data, point.number, e + wp.static(lanes))
            if almost * candidate.distance <= near:
                w = nearest_on(point.x, a, b, c)
                away = point.x - (w[0] * a + w[1] * b + w[2] * c)
                counted = weighted(candidate.facet[3], each) * wp.dot(away, away)
                if counted < best or (counted == best and candidate.facet[3] < facet[3]):
                    best = counted
                    near = wp.sqrt(best) + shrunk
                    facet = candidate.facet
                    found.w = w
                    found.away = away
            candidate = following
            if almost * candidate.distance <= near:
                a = load(x, candidate.facet[0])
                b = load(x, candidate.facet[1])
                c = load(x, candidate.facet[2])
            e += wp.static(lanes)
        until = wp.min(e, n)
        if wp.static(lanes > 1):
            until = least_number(until)
            nearest = least_of(best)
            number = facet[3]
            if best > nearest:
                number = int(wp.static(NONE))
            best = nearest
            least = least_number(number)
            for k in range(3):
                facet[k] = pick_number(number == least, facet[k])
                found.w[k] = pick(number == least, found.w[k])
                found.away[k] = pick(number == least, found.away[k])
            facet[3] = least
        found.facet = facet[3]
        found.corner = wp.vec3i(facet[0], facet[1], facet[2])
        found.squared = best / weighted(found.facet, each)
        found.until = until
        return found

    return Nearest, candidate_at, find_nearest
