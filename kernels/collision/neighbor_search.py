"""Narrow search: lists of the facets near each point, valid until a vertex has moved by half of the buffer."""

import functools

import warp as wp

from ..basis import kernel, vector
from .bounding_boxes import NEVER, margin_of_boxes
from .contact_data import HISTORY, LONGEST_ROW, BodyContactData, first_flag
from .cpu_partition import count_up, first_of_part, next_of_part, raise_to
from .lanes import FAST, bounds_of_blocks, least_of_lanes
from .pairs import pairs, places, unit_normal


@functools.cache
def find_candidates(scalar: type, worlds: bool = False):
    """Compose the kernel that lists the points which may be near a facet, or have ended contacts to clear.

    Its threads share the points; near points become adjacent in the list. Most points of large bodies are left out
    here, because idle threads in a search take as long as busy ones.
    """
    Data, place_of = BodyContactData(scalar, worlds), places(scalar)[0]

    @kernel
    def list_candidates(
        data: Data,
        least: wp.array(dtype=wp.vec3),  # box that holds all points of a body near others, shape [body_count]
        most: wp.array(dtype=wp.vec3),
        threads: int,  # in each part
        part: int,
        parts: int,  # number of parts, one for each CPU thread
    ):
        e = first_of_part(wp.tid(), part)
        while e < data.neighbors.candidate_count.shape[0]:
            p = data.neighbors.in_order[e]
            place = wp.vec3(place_of(data.surfaces.x, data.surfaces.ends[p], data.surfaces.share[p]))
            low = least[data.surfaces.body[p]]
            high = most[data.surfaces.body[p]]
            within = wp.min(place, low) == low and wp.max(place, high) == high
            if (
                within
                or data.neighbors.candidate_count[p] > 0
                or data.history.contact_body[0, p] >= 0
                or data.history.initial_overlap[p] > scalar(0.0)
            ):
                data.neighbors.search_points[count_up(data.neighbors.search_point_count, 0)] = p
            e = next_of_part(e, threads, parts)

    return list_candidates


@functools.cache
def find_rows(scalar: type, worlds: bool = False):
    """Compose the kernel that lists the facets which each point may touch before the next search.

    Its threads share the points to search for. For each body it keeps the facets that may become the nearest, the
    current nearest first; none if the point is outside and cannot get in. Distances are stored, so that later most
    facets can be skipped. Results depend neither on listed facets without contact, nor on the buffer, nor on the
    order in which facets are found.
    """
    Data, margin, V = BodyContactData(scalar, worlds), margin_of_boxes(scalar), vector(3, scalar)
    (place_of, place_on, nearest_to), normal_of = places(scalar), unit_normal(scalar)
    (find_rule, thickness_of, reach_of, _), first_of = pairs(scalar, worlds), first_flag(scalar, worlds)
    zero, doubt = scalar(0.0), scalar(1.01)

    @wp.func
    def is_near(first_near: wp.array(dtype=int), near: wp.array(dtype=int), vertex: int, corner: wp.vec3i) -> bool:
        """Tell whether a corner of a facet is among the vertices that a vertex never touches."""
        found = bool(False)
        for e in range(first_near[vertex], first_near[vertex + 1]):
            other = near[e]
            if other == corner[0] or other == corner[1] or other == corner[2]:
                found = True
        return found

    @wp.func
    def is_outside(data: Data, p: int, x: V, begin: int, end: int, nearest: scalar) -> bool:
        """Tell whether point p at x is outside the closed body whose facets are entries begin … end of row p."""
        side = scalar(0.0)
        for e in range(begin, end):
            if data.neighbors.candidate_distance[p, e] <= doubt * nearest:
                corner = data.surfaces.corner[data.neighbors.candidates[p, e]]
                away = x - place_on(data.surfaces.x, corner, nearest_to(data.surfaces.x, corner, x))
                seen = wp.dot(away, normal_of(data.surfaces.x, corner))
                if wp.abs(seen) > wp.abs(side):
                    side = seen
        return side > zero

    @wp.func
    def keep_near(data: Data, p: int, other: int, begin: int, end: int, nearest: scalar, limit: scalar) -> int:
        """Keep the facets of body `other` in row p up to the distance `limit`, the nearest first.

        They are its entries begin … end. Return the end of those that are kept.
        """
        kept = int(begin)
        for e in range(begin, end):
            away = data.neighbors.candidate_distance[p, e]
            if away <= limit:
                facet = data.neighbors.candidates[p, e]
                to = int(kept)
                if away == nearest:  # swap it with the first one
                    data.neighbors.candidates[p, kept] = data.neighbors.candidates[p, begin]
                    data.neighbors.candidate_distance[p, kept] = data.neighbors.candidate_distance[p, begin]
                    to = begin
                data.neighbors.candidates[p, to] = facet
                data.neighbors.candidate_distance[p, to] = away
                data.neighbors.candidate_body[p, kept] = other
                kept += 1
        return kept

    @wp.func
    def find_one(
        data: Data,
        p: int,
        x: V,
        facets: wp.uint64,  # tree of the boxes around facets
        lower: wp.array(dtype=wp.vec3),  # boxes around bodies, shape [body_count]
        upper: wp.array(dtype=wp.vec3),
        farthest: scalar,  # largest distance of any contact [m]
        buffer: scalar,  # [m]
        flags: wp.array(dtype=float),
    ):
        # One function: with the tree query in its own function, a search took 1.8 times as long on an H200.
        ends = data.surfaces.ends[p]
        mine = data.surfaces.body[p]
        room = data.neighbors.candidates.shape[1]
        count = int(0)
        missed = int(0)  # not listed for lack of room
        most = int(0)
        known = int(-1)  # the facet that was nearest before
        if data.neighbors.candidate_count[p] > 0:
            known = data.neighbors.candidates[p, 0]
        wide = margin(wp.vec3(x), wp.vec3(x), farthest + buffer)
        low = wp.vec3(x) - wide
        high = wp.vec3(x) + wide
        for b in range(data.neighbors.body_pair_count[mine]):
            other = data.neighbors.body_pairs[mine, b]
            if wp.min(high, lower[other]) == lower[other] and wp.max(low, upper[other]) == upper[other]:
                rule = find_rule(data, mine, other)
                limit = reach_of(data, rule, mine, other) + buffer
                begin = int(count)
                nearest = scalar(limit)
                around = scalar(limit)
                if known >= 0:
                    if data.surfaces.owner[known] == other:
                        # The distance of the previous nearest facet bounds that of the nearest one now.
                        c = data.surfaces.corner[known]
                        nearest = wp.min(
                            limit, wp.length(x - place_on(data.surfaces.x, c, nearest_to(data.surfaces.x, c, x)))
                        )
                        around = wp.min(limit, doubt * (nearest + scalar(2.0) * buffer))
                close = margin(wp.vec3(x), wp.vec3(x), around)
                near_facets = wp.bvh_query_aabb(
                    facets, wp.vec3(x) - close, wp.vec3(x) + close, data.neighbors.root[other]
                )
                facet = int(0)
                while wp.bvh_query_next(near_facets, facet):
                    c = data.surfaces.corner[facet]
                    may = bool(True)
                    if mine == other:
                        may = not is_near(data.surfaces.first_near, data.surfaces.near, ends[0], c)
                        may = may and not is_near(data.surfaces.first_near, data.surfaces.near, ends[1], c)
                    if may:
                        away = wp.length(x - place_on(data.surfaces.x, c, nearest_to(data.surfaces.x, c, x)))
                        if away < limit and away <= doubt * (nearest + scalar(2.0) * buffer):
                            if count < room:
                                data.neighbors.candidates[p, count] = facet
                                data.neighbors.candidate_distance[p, count] = away
                                count += 1
                            else:
                                missed += 1
                            nearest = wp.min(nearest, away)
                most = wp.max(most, count + missed)
                if data.surfaces.closed[other] != 0 and mine != other and count > begin:
                    if nearest > doubt * (thickness_of(data, rule, mine, other) + buffer):
                        if is_outside(data, p, x, begin, count, nearest):
                            count = begin
                # Another facet can become the nearest only if it is at most two buffers further away.
                limit = doubt * (nearest + scalar(2.0) * buffer)
                count = keep_near(data, p, other, begin, count, nearest, limit)
        data.neighbors.candidate_count[p] = count
        if count + missed == 0:
            for k in range(wp.static(HISTORY)):
                data.history.contact_body[k, p] = -1
        at = first_of(data, mine) + wp.static(LONGEST_ROW)
        if most > int(flags[at]):
            raise_to(flags, at, float(most))

    def find(
        data: Data,
        facets: wp.uint64,
        lower: wp.array(dtype=wp.vec3),
        upper: wp.array(dtype=wp.vec3),
        farthest: scalar,
        buffer: wp.array(dtype=scalar),
        threads: int,
        part: int,
        parts: int,
        flags: wp.array(dtype=float),
    ):
        e = first_of_part(wp.tid(), part)
        while e < data.neighbors.search_point_count[0]:
            p = data.neighbors.search_points[e]
            x = place_of(data.surfaces.x, data.surfaces.ends[p], data.surfaces.share[p])
            find_one(data, p, x, facets, lower, upper, farthest, buffer[0], flags)
            if data.neighbors.candidate_count[p] > 0 or data.history.initial_overlap[p] > zero:
                data.neighbors.active_points[count_up(data.neighbors.active_count, 0)] = p
            e = next_of_part(e, threads, parts)

    return kernel(find, launch_bounds=bounds_of_blocks(scalar), module_options=FAST)


@functools.cache
def range_of_speeds(scalar: type, lanes: int):
    """Compose the kernel that finds the range of velocities of the active points.

    Its threads share these points; `lanes` of them combine their results.
    """
    Data, least_of = BodyContactData(scalar), least_of_lanes(wp.float32, lanes)
    place_of = places(scalar)[0]

    @wp.func
    def most_corner(v: wp.vec3) -> wp.vec3:
        return -wp.vec3(least_of(-v[0]), least_of(-v[1]), least_of(-v[2]))

    @kernel
    def find_range(data: Data, threads: int):
        k = wp.tid()
        fast = wp.vec3(wp.static(-NEVER), wp.static(-NEVER), wp.static(-NEVER))
        slow = wp.vec3(wp.static(-NEVER), wp.static(-NEVER), wp.static(-NEVER))
        while k < data.neighbors.active_count[0]:
            p = data.neighbors.active_points[k]
            v = wp.vec3(place_of(data.surfaces.v, data.surfaces.ends[p], data.surfaces.share[p]))
            fast = wp.max(fast, v)
            slow = wp.max(slow, -v)
            k += threads
        fast = most_corner(fast)
        slow = most_corner(slow)
        if wp.tid() % wp.static(lanes) == 0 and fast[0] > wp.static(-NEVER):
            wp.atomic_max(data.neighbors.speeds, 0, fast)
            wp.atomic_max(data.neighbors.speeds, 1, slow)

    return find_range
