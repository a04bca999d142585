"""Contact between grains (particles) and ropes, which have no triangles. The law is that of `body_contact`."""

import functools

import warp as wp

from ..basis import vector
from ..lanes import ballot_of_lanes, chosen_of_lanes, count_before, count_bits, least_of_lanes
from ..records import records
from .contact_data import HISTORY, BodyContactData, Substep
from .facet_tree import FacetTree
from .force_sums import Units, exert_on_segments
from .history import memories, recall
from .law import contact_law
from .nearest_point import fraction_of_length
from .neighbor_search import each_active_point, each_search_point, row_end
from .pairs import ALMOST, DOUBT, FAR, NONE, crowding, places, points


@functools.cache
def evaluate_segments_and_spheres(
    scalar: type,
    overlapping_at_start: bool,
    lanes: int,
    worlds: bool = False,
    grains: bool = False,
):
    """Compose the kernel that sums the contact forces of points if no facet is a triangle.

    There are many such bodies, with few facets each. So each of the `lanes` threads of a point handles different
    bodies near it. For `overlapping_at_start` see `evaluate_contact`. If `grains`, each body is a grain.
    """
    V, Data, Step = vector(3, scalar), BodyContactData(scalar), Substep(scalar)
    (place_of, place_on, _), (Point, point_of, mobility_of) = places(scalar), points(scalar)
    Memory, no_memory, remember, keep, shrink_overlap = memories(scalar)
    press, record, per_unit_of = contact_law(scalar, overlapping_at_start, worlds)
    (held, moved_along), (damping_fraction, count_touching) = recall(scalar), crowding(scalar)
    in_units, take_from = exert_on_segments(scalar)
    load, fraction = records(3, scalar).load, fraction_of_length(scalar)
    least_number, pick = least_of_lanes(int, lanes), chosen_of_lanes(scalar, lanes)
    zero, one, almost, far = scalar(0.0), scalar(1.0), scalar(ALMOST), scalar(FAR)

    @wp.func
    def find_nearest(data: Data, point: Point, first: int, place: int, shrunk: scalar):
        """Return a body's facet nearest to a point, its squared distance [m²], and the weight of its second end.

        `place` is the body's index in `body_pairs`, `first` the index of its first facet in the point's list, and
        `shrunk` a bound on how much distances have shrunk since the last search [m].
        """
        p = point.number
        best = far
        near = far
        facet = wp.vec4i(0, 0, 0, wp.static(NONE))
        t = scalar(0.0)
        if wp.static(grains):
            only = data.neighbors.candidates[p, first]
            return only, wp.length_sq(point.x - load(data.surfaces.x, only[0])), t
        for e in range(first, data.neighbors.candidate_count[p]):
            if data.neighbors.candidate_pair[p, e] != place:
                break
            if almost * data.neighbors.candidate_distance[p, e] <= near:
                f = data.neighbors.candidates[p, e]
                corner = wp.vec3i(f[0], f[1], f[2])
                start = load(data.surfaces.x, corner[0])
                along = load(data.surfaces.x, corner[1]) - start
                t_f = fraction(wp.dot(point.x - start, along), wp.length_sq(along))
                squared = wp.length_sq(point.x - place_on(data.surfaces.x, corner, V(one - t_f, t_f, zero)))
                if squared < best or (squared == best and f[3] < facet[3]):
                    best = squared
                    near = wp.sqrt(best) + shrunk
                    facet = f
                    t = t_f
        return facet, best, t

    @wp.func
    def least_of_all(own: Memory) -> Memory:
        """Return the two bodies with the lowest indices among those that the threads of the point have found."""
        found = no_memory()
        body = own.body_0
        moved = own.moved_0
        fastest = own.fastest_0
        for k in range(wp.static(HISTORY)):
            least = least_number(body)
            mine = body == least
            held = V(pick(mine, moved[0]), pick(mine, moved[1]), pick(mine, moved[2]))
            if least < wp.static(NONE):
                found = remember(found, least, held, pick(mine, fastest))
            if mine and k == 0:
                body = own.body_1
                moved = own.moved_1
                fastest = own.fastest_1
        return found

    @wp.func
    def evaluate_point(
        data: Data,
        p: int,
        lane: int,  # index among the threads of the point
        step: Step,
        flags: wp.array(dtype=float),
        stored: wp.array(dtype=wp.float64),  # not used here
        heated: wp.array(dtype=wp.float64),
    ):
        point = point_of(data, p)
        memory = no_memory()  # the bodies in contact that this thread finds
        total = Units()  # sum of the forces on the point
        for first in range(lane, data.neighbors.candidate_count[p], wp.static(lanes)):
            place = data.neighbors.candidate_pair[p, first]
            begins = bool(True)  # whether a body's facets, which are adjacent, start here
            if wp.static(not grains) and first > 0:
                begins = data.neighbors.candidate_pair[p, first - 1] != place
            if begins:
                pair = data.neighbors.pairs[point.body, place]
                paths = data.neighbors.moved[point.body] + data.neighbors.moved[pair.other]
                shrunk = scalar(paths) + scalar(DOUBT) * step.buffer
                facet, best, t = find_nearest(data, point, first, place, shrunk)
                corner = wp.vec3i(facet[0], facet[1], facet[2])
                w = V(one - t, t, zero)
                away = point.x - place_on(data.surfaces.x, corner, w)
                u = place_of(data.surfaces.v, point.ends, point.fraction) - place_on(data.surfaces.v, corner, w)
                gap = wp.sqrt(best)
                normal = V()
                if gap > zero:
                    normal = away / gap
                overlap = pair.thickness - gap
                if wp.static(overlapping_at_start):
                    overlap = overlap - data.history.initial_overlap[p]
                mobility = zero
                of_facet = zero
                if overlap > zero:  # memory is read only in contact: most listed facets are not
                    mobility = mobility_of(data.surfaces.mobility, point.ends, point.fraction)
                    of_facet = w[0] * w[0] * data.surfaces.mobility[corner[0]]
                    of_facet += t * t * data.surfaces.mobility[corner[1]]
                    mobility += of_facet
                if mobility > zero:
                    before, fastest_before = moved_along(held(data, p), pair.other)
                    k_n, f_n, f_t, moved, fastest, _u_n, _u_t, _slides = press(
                        pair,
                        point.density,
                        damping_fraction(data, point, 0),
                        mobility,
                        of_facet,
                        overlap,
                        normal,
                        V(),
                        u,
                        u,
                        before,
                        fastest_before,
                        step,
                    )
                    units = in_units(f_n * normal + f_t, per_unit_of(data, pair.mine, step))
                    take_from(data.surfaces.force, corner[0], corner[1], t, units, step.parts)
                    total += units
                    record(data, p, pair.mine, k_n, overlap, step, flags)
                    memory = remember(memory, pair.other, moved, fastest)
        take_from(data.surfaces.force, point.ends[0], point.ends[1], point.fraction, -total, step.parts)
        memory = least_of_all(memory)
        if lane == 0:
            if step.h > zero or data.history.contact_body[0, p] < 0:  # as in `body_contact`
                keep(data, p, memory)
                if memory.body_0 < wp.static(NONE):
                    count_touching(data, point, step.parts)
            if wp.static(overlapping_at_start):
                shrink_overlap(data, p, step.h)

    return each_active_point(evaluate_point, scalar, lanes, counts_time=True)


@functools.cache
def find_rows_of_grains(scalar: type, lanes: int, worlds: bool = False):
    """Compose the kernel that makes the lists of `find_rows` if all bodies are grains: facet i is body i.

    Each of the `lanes` threads of a point tests different bodies near it.
    """
    Data, load, ballot = BodyContactData(scalar), records(3, scalar).load, ballot_of_lanes(lanes)
    end_row, far = row_end(scalar, worlds), scalar(FAR)

    @wp.func
    def find_one(
        data: Data,
        tree: FacetTree,  # not used here
        p: int,
        lane: int,  # index among the threads of the point
        farthest: scalar,  # not used here
        flags: wp.array(dtype=float),
    ):
        mine = data.surfaces.body[p]
        x = load(data.surfaces.x, data.surfaces.ends[p][0])
        slack = scalar(data.neighbors.slack[data.surfaces.ends[p][0]])
        near = data.neighbors.body_pair_count[mine]
        room = data.neighbors.candidates.shape[1]
        count = int(0)
        for begin in range(0, near, wp.static(lanes)):
            b = begin + lane
            other = int(0)
            away = far
            if b < near:
                other = data.neighbors.body_pairs[mine, b]
                if other != mine:
                    away = wp.length(x - load(data.surfaces.x, data.surfaces.corner[other][0]))
                    reach = data.neighbors.pairs[mine, b].thickness + slack + data.neighbors.facet_slack[other]
                    if away >= reach:
                        away = far
            those = ballot(away < far)
            at = count + count_before(those, lane)
            if away < far and at < room:
                corner = data.surfaces.corner[other]
                data.neighbors.candidates[p, at] = wp.vec4i(corner[0], corner[1], corner[2], other)
                data.neighbors.candidate_distance[p, at] = away
                data.neighbors.candidate_pair[p, at] = b
            count += count_bits(those)
        if lane == 0:
            listed = wp.min(count, room)
            end_row(data, p, mine, listed, count - listed, count, flags)

    return each_search_point(find_one, scalar, lanes)
