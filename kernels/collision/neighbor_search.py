"""Narrow search: lists of the facets near each point, valid until a vertex has moved by more than its slack."""

import functools

import warp as wp

from ..basis import fast_kernel, vector
from ..lanes import ballot_of_lanes, count_before, count_bits, least_of_lanes, lowest_of_lanes, wait_for_lanes
from ..partition import count_up, extend_to, first_of_part, next_of_part, raise_to
from ..threads import grid_thread
from .contact_data import ACTIVE, HISTORY, LONGEST_ROW, BodyContactData, Substep, first_flag
from .facet_tree import NEVER, FacetTree, facets_within, margin_of_boxes, overlap
from .pairs import FAR, NONE, never_touches, places

ON_GPU, MANY_ON_GPU = 8, 1
"""Threads per point on a GPU in scenes with triangles. Several divide the facets around a point, but each of them
finds the force: for few points that is faster; many points fill a GPU anyway."""
MOST_BY_MORE = 2**14
"""Number of points of a world up to which ON_GPU is used."""
FEW_ON_GPU = 2
"""Threads per point for only grains and ropes, which need less computation."""
GRAINS_ON_GPU = 8
"""Threads per point for only grains: each thread tests different grains near the point."""
BLOCK = 64
"""Threads per block on a GPU: in larger blocks many threads wait for those with long rows."""
BLOCKS = 10
"""Concurrent blocks per multiprocessor: more of them hide memory latency better."""


def bounds_of_blocks(scalar: type) -> tuple[int, int]:
    """Return (threads per block, concurrent blocks), by which the compiler limits the registers of a thread."""
    return BLOCK, BLOCKS if scalar is wp.float32 else BLOCKS // 2  # float64 takes two registers


def each_active_point(evaluate_point, scalar: type, lanes: int, counts_time: bool):
    """Compose the kernel that calls `evaluate_point` for each active point, with `lanes` threads per point.

    In each substep one such kernel also sums the time since the last search (`counts_time`).
    """
    Data, Step = BodyContactData(scalar), Substep(scalar)

    def evaluate_points(
        data: Data,
        h: scalar,
        rate: scalar,
        per_unit: wp.float64,
        buffer: wp.array(dtype=scalar),
        threads: int,  # per part
        part: int,
        parts: int,
        flags: wp.array(dtype=float),
        stored: wp.array(dtype=wp.float64),  # [J], shape [point_count], if measuring
        heated: wp.array(dtype=wp.float64),  # [W]
    ):
        step = Step(h, rate, per_unit, buffer[0], parts)
        if wp.static(counts_time):
            if grid_thread() == 0 and part == 0:
                data.neighbors.since[0] += float(h)
                raise_to(flags, wp.static(ACTIVE), float(data.neighbors.active_count[0]))
        k = first_of_part(grid_thread(), part) / wp.static(lanes)
        lane = grid_thread() % wp.static(lanes)
        last = data.neighbors.active_points.shape[0] - 1
        p = data.neighbors.active_points[wp.min(k, last)]  # read together with the number of points
        while k < data.neighbors.active_count[0]:
            evaluate_point(data, p, lane, step, flags, stored, heated)
            k = next_of_part(k, threads / wp.static(lanes), parts)
            p = data.neighbors.active_points[wp.min(k, last)]

    return fast_kernel(evaluate_points, launch_bounds=bounds_of_blocks(scalar))


def each_search_point(find_one, scalar: type, lanes: int):
    """Compose the kernel that calls `find_one` for each point to search for, with `lanes` threads per point."""
    Data = BodyContactData(scalar)

    def find(
        data: Data,
        tree: FacetTree,
        farthest: scalar,  # largest distance of any contact [m]
        threads: int,  # per part
        part: int,
        parts: int,
        flags: wp.array(dtype=float),
    ):
        e = first_of_part(grid_thread(), part) / wp.static(lanes)
        lane = grid_thread() % wp.static(lanes)
        while e < data.neighbors.search_point_count[0]:
            find_one(data, tree, data.neighbors.search_points[e], lane, farthest, flags)
            e = next_of_part(e, threads / wp.static(lanes), parts)

    return fast_kernel(find, launch_bounds=bounds_of_blocks(scalar))


@functools.cache
def find_candidates(scalar: type):
    """Compose the kernel that lists the points which may be near a facet, or have ended contacts to clear.

    Its threads divide the points; near points become adjacent in the list. Most points of large bodies are left
    out here, because idle threads in a search take as long as busy ones. `find_pairs` has marked the points of
    open bodies that may touch their own body.
    """
    Data, place_of, margin = BodyContactData(scalar), places(scalar)[0], margin_of_boxes(scalar)

    @wp.func
    def is_candidate(data: Data, tree: FacetTree, p: int, farthest: scalar) -> bool:
        ends = data.surfaces.ends[p]
        place = wp.vec3(place_of(data.surfaces.x, ends, data.surfaces.fraction[p]))
        body = data.surfaces.body[p]
        slack = scalar(wp.max(data.neighbors.slack[ends[0]], data.neighbors.slack[ends[1]]))
        wide = margin(place, place, slack)
        found = overlap(place - wide, place + wide, tree.near_lower[body], tree.near_upper[body])
        if found:
            found = data.neighbors.near_own[p] != 0
            wide = margin(place, place, farthest + slack)
            for b in range(data.neighbors.body_pair_count[body]):
                other = data.neighbors.body_pairs[body, b]
                if not found and other != body:
                    found = overlap(place - wide, place + wide, tree.body_lower[other], tree.body_upper[other])
        return found

    @fast_kernel
    def list_candidates(
        data: Data,
        tree: FacetTree,
        farthest: scalar,  # largest distance of any contact [m]
        threads: int,  # in each part
        part: int,
        parts: int,  # number of parts, one for each CPU thread
    ):
        e = first_of_part(grid_thread(), part)
        while e < data.neighbors.candidate_count.shape[0]:
            p = data.neighbors.in_order[e]
            if (
                is_candidate(data, tree, p, farthest)
                or data.neighbors.candidate_count[p] > 0
                or data.history.contact_body[0, p] >= 0
                or data.history.initial_overlap[p] > scalar(0.0)
            ):
                data.neighbors.search_points[count_up(data.neighbors.search_point_count, 0)] = p
            data.neighbors.near_own[p] = 0
            e = next_of_part(e, threads, parts)

    return list_candidates


@functools.cache
def Row(scalar: type):
    """Compose the struct of one point's row of facets during the search."""

    @wp.struct
    class Row:
        point: int
        ends: wp.vec2i
        x: vector(3, scalar)  # [m]
        mine: int
        other: int  # the body that is searched now
        place: int  # its index in the row of body_pairs
        begin: int  # where its facets begin in the row
        count: int  # entries so far
        missed: int  # facets not listed for lack of room
        slack: scalar  # how far the point may move before the next search [m]
        limit: scalar  # facets of this body that cannot come nearer than this do not count [m]
        nearest: scalar  # distance of the nearest facet of this body [m]
        bound: scalar  # upper bound on that distance until the next search [m]

    return Row


@functools.cache
def entries(scalar: type, lanes: int):
    """Compose (enter, keep_near) for the entries of one body in the row of a point.

    `enter` adds the facets that the threads of the point have found. `keep_near` removes entries that cannot come
    nearer than a distance.
    """
    Data, SearchedRow = BodyContactData(scalar), Row(scalar)
    _, place_on, nearest_to = places(scalar)
    least_of, least_number = least_of_lanes(scalar, lanes), least_of_lanes(int, lanes)
    ballot, wait = ballot_of_lanes(lanes), wait_for_lanes(lanes)
    doubt, far = scalar(1.01), scalar(FAR)

    @wp.func
    def enter(data: Data, before: SearchedRow, facet: int, lane: int) -> SearchedRow:
        row = before
        away = far
        slack = row.slack
        c = wp.vec3i()
        if facet >= 0:
            slack += data.neighbors.facet_slack[facet]
            c = data.surfaces.corner[facet]
            may = bool(True)
            if row.mine == row.other:
                may = not never_touches(data.surfaces.first_near, data.surfaces.near, row.ends, c)
            for k in range(3):
                may = may and data.surfaces.tangled[c[k]] == 0
            for k in range(2):
                may = may and data.surfaces.tangled[row.ends[k]] == 0
            if may:
                away = wp.length(row.x - place_on(data.surfaces.x, c, nearest_to(data.surfaces.x, c, row.x)))
        listed = away - slack < row.limit and away - slack <= doubt * row.bound
        those = ballot(listed)
        at = row.count + count_before(those, lane)
        if listed and at < data.neighbors.candidates.shape[1]:
            data.neighbors.candidates[row.point, at] = wp.vec4i(c[0], c[1], c[2], facet)
            data.neighbors.candidate_distance[row.point, at] = away
        count = row.count + count_bits(those)
        row.count = wp.min(count, data.neighbors.candidates.shape[1])
        row.missed += count - row.count
        row.nearest = wp.min(row.nearest, least_of(away))
        row.bound = wp.min(row.bound, least_of(away + slack))
        return row

    @wp.func
    def keep_near(data: Data, row: SearchedRow, limit: scalar, lane: int) -> int:
        """Keep the body's entries that may come to `limit` [m], the nearest first; return the end of the row."""
        p = row.point
        kept = int(row.begin)
        first = int(wp.static(NONE))
        for chunk in range(row.begin, row.count, wp.static(lanes)):
            e = chunk + lane
            facet = wp.vec4i()
            away = far
            keeps = bool(False)
            if e < row.count:
                facet = data.neighbors.candidates[p, e]
                away = data.neighbors.candidate_distance[p, e]
                keeps = away - row.slack - data.neighbors.facet_slack[facet[3]] <= limit
            wait()
            those = ballot(keeps)
            if keeps:
                at = kept + count_before(those, lane)
                data.neighbors.candidates[p, at] = facet
                data.neighbors.candidate_distance[p, at] = away
                data.neighbors.candidate_pair[p, at] = row.place
                if away == row.nearest:
                    first = wp.min(first, at)
            kept += count_bits(those)
        first = least_number(first)
        wait()
        if lane == 0 and first < wp.static(NONE):
            facet = data.neighbors.candidates[p, first]
            data.neighbors.candidates[p, first] = data.neighbors.candidates[p, row.begin]
            data.neighbors.candidate_distance[p, first] = data.neighbors.candidate_distance[p, row.begin]
            data.neighbors.candidates[p, row.begin] = facet
            data.neighbors.candidate_distance[p, row.begin] = row.nearest
        return kept

    return enter, keep_near


@functools.cache
def row_end(scalar: type, worlds: bool):
    """Compose wp.func (data, p, body, count, missed, most, flags) that stores the length of point p's list.

    The list has `count` facets; `missed` more had no room; `most` is the largest number found at any time.
    """
    Data, first_of = BodyContactData(scalar), first_flag(scalar, worlds)

    @wp.func
    def end_row(data: Data, p: int, body: int, count: int, missed: int, most: int, flags: wp.array(dtype=float)):
        data.neighbors.candidate_count[p] = count
        if count + missed == 0:
            for k in range(wp.static(HISTORY)):
                data.history.contact_body[k, p] = -1
        at = first_of(data, body) + wp.static(LONGEST_ROW)
        if most > int(flags[at]):
            raise_to(flags, at, float(most))
        if count > 0 or data.history.initial_overlap[p] > scalar(0.0):
            data.neighbors.active_points[count_up(data.neighbors.active_count, 0)] = p

    return end_row


@functools.cache
def find_rows(scalar: type, lanes: int, worlds: bool = False):
    """Compose the kernel that lists the facets which each point may touch before the next search.

    Each point to search for has `lanes` threads. For each body it keeps the facets that may become the nearest,
    the current nearest first; none if the point is outside and cannot get in. Distances are stored, so that most
    facets can be skipped later. No result depends on listed facets without contact, on the skin, or on the order
    in which facets are found.
    """
    Data, margin, SearchedRow = BodyContactData(scalar), margin_of_boxes(scalar), Row(scalar)
    place_of, place_on, nearest_to = places(scalar)
    end_row = row_end(scalar, worlds)
    (begin, find_next), (enter, keep_near) = facets_within(lanes), entries(scalar, lanes)
    wait, doubt, far = wait_for_lanes(lanes), scalar(1.01), scalar(FAR)

    @wp.func
    def search_body(data: Data, tree: FacetTree, before: SearchedRow, reach: scalar, known: int, lane: int):
        """Return the row `before` with facets of the body `other` added; `known`: the nearest so far, or -1."""
        row = before
        row.limit = reach
        row.begin = row.count
        row.nearest = far
        row.bound = far
        if known >= 0:
            if data.surfaces.owner[known] == row.other:
                # The distance of the previous nearest facet bounds that of the nearest one now.
                c = data.surfaces.corner[known]
                nearest = row.x - place_on(data.surfaces.x, c, nearest_to(data.surfaces.x, c, row.x))
                row.bound = wp.length(nearest) + row.slack + data.neighbors.facet_slack[known]
        x = wp.vec3(row.x)
        wide = margin(x, x, row.slack + wp.min(row.limit, doubt * row.bound))
        if wp.static(lanes == 1):
            near = wp.bvh_query_aabb(tree.binary, x - wide, x + wide, tree.root[row.other])
            found = int(0)
            while wp.bvh_query_next(near, found):
                row = enter(data, row, tree.facet[found], lane)
        else:
            cursor = begin(tree, row.other)
            while not cursor.ended:
                cursor = find_next(tree, cursor, x - wide, x + wide, lane)
                if not cursor.ended:
                    row = enter(data, row, cursor.facet, lane)
                    wide = margin(x, x, row.slack + wp.min(row.limit, doubt * row.bound))
        wait()  # before a thread reads the row, all have entered their facets
        return row

    @wp.func
    def find_one(
        data: Data,
        tree: FacetTree,
        p: int,
        lane: int,  # index among the threads of the point
        farthest: scalar,  # largest distance of any contact [m]
        flags: wp.array(dtype=float),
    ):
        row = SearchedRow()
        row.point = p
        row.ends = data.surfaces.ends[p]
        row.x = place_of(data.surfaces.x, row.ends, data.surfaces.fraction[p])
        row.mine = data.surfaces.body[p]
        row.slack = scalar(wp.max(data.neighbors.slack[row.ends[0]], data.neighbors.slack[row.ends[1]]))
        most = int(0)
        known = int(-1)  # the previous nearest facet
        if data.neighbors.candidate_count[p] > 0:
            known = data.neighbors.candidates[p, 0][3]
        wait()
        wide = margin(wp.vec3(row.x), wp.vec3(row.x), farthest + row.slack)
        low = wp.vec3(row.x) - wide
        high = wp.vec3(row.x) + wide
        for b in range(data.neighbors.body_pair_count[row.mine]):
            row.other = data.neighbors.body_pairs[row.mine, b]
            if overlap(low, high, tree.body_lower[row.other], tree.body_upper[row.other]):
                pair = data.neighbors.pairs[row.mine, b]
                row.place = b
                row = search_body(data, tree, row, pair.thickness, known, lane)
                most = wp.max(most, row.count + row.missed)
                # Another facet can become the nearest only if it can come as near as the nearest surely stays.
                row.count = keep_near(data, row, doubt * row.bound, lane)
        if lane == 0:
            end_row(data, p, row.mine, row.count, row.missed, most, flags)

    return each_search_point(find_one, scalar, lanes)


@functools.cache
def range_of_speeds(scalar: type, lanes: int):
    """Compose the kernel that finds the range of velocities of the active points.

    Its threads divide the points; each group of `lanes` threads combines its results.
    """
    Data, place_of, lowest = BodyContactData(scalar), places(scalar)[0], lowest_of_lanes(lanes)

    @fast_kernel
    def find_range(data: Data, threads: int):
        k = grid_thread()
        slow = wp.vec3(wp.static(NEVER), wp.static(NEVER), wp.static(NEVER))
        fast = -slow
        while k < data.neighbors.active_count[0]:
            p = data.neighbors.active_points[k]
            v = wp.vec3(place_of(data.surfaces.v, data.surfaces.ends[p], data.surfaces.fraction[p]))
            slow = wp.min(slow, v)
            fast = wp.max(fast, v)
            k += threads
        slow = lowest(slow)
        fast = -lowest(-fast)
        if grid_thread() % wp.static(lanes) == 0 and fast[0] > wp.static(-NEVER):
            extend_to(data.neighbors.slowest, data.neighbors.fastest, 0, slow, fast)

    return find_range
