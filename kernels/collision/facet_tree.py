"""The tree of boxes around the facets of each body, and the broad phase: which bodies are near each other.

The facets of a body are sorted so that near ones follow each other. Consecutive facets form a leaf, consecutive
leaves a group; each leaf and group has a box. The boxes are updated as facets move; the tree is not. On a GPU
several threads search together, each tests a box, and few memory accesses wait for each other; a single thread in
a binary tree would wait for hundreds. But a binary tree needs fewer tests: on the CPU one thread searches one
(`wp.Bvh`) of the same facets.
"""

import functools

import warp as wp

from ..basis import kernel
from ..lanes import ballot_of_lanes, count_before, count_bits, least_of_lanes, lowest_bit, lowest_of_lanes
from ..partition import extend_to, raise_to
from ..records import records
from ..threads import grid_thread
from .contact_data import MOST_BODY_PAIRS, NOT_DUE, BodyContactData, first_flag
from .pairs import ALMOST, pairs

NEVER = 1e30
"""A speed that no point reaches [m/s], and a coordinate beyond all others [m]."""


@wp.struct
class FacetTree:
    """The tree of boxes, see the module's docstring."""

    # Facets in the order of the tree, shape [facet_count]:
    facet: wp.array(dtype=int)
    binary: wp.uint64  # binary tree of their boxes, for single threads
    root: wp.array(dtype=int)  # root of each body's subtree in `binary`
    lower: wp.array(dtype=wp.vec3)  # box of each facet [m]
    upper: wp.array(dtype=wp.vec3)
    # Leaves:
    leaf: wp.array(dtype=wp.vec4i)  # body, group, first facet and end in the order above, shape [leaf_count]
    leaf_lower: wp.array(dtype=wp.vec3)
    leaf_upper: wp.array(dtype=wp.vec3)
    # Groups:
    group: wp.array(dtype=wp.vec2i)  # first leaf and end, shape [group_count]
    group_lower: wp.array(dtype=wp.vec3)
    group_upper: wp.array(dtype=wp.vec3)
    # Bodies:
    first_group: wp.array(dtype=int)  # row starts of the groups, shape [body_count + 1]
    body_lower: wp.array(dtype=wp.vec3)
    body_upper: wp.array(dtype=wp.vec3)
    near_lower: wp.array(dtype=wp.vec3)  # box outside of which no part of the body is near another
    near_upper: wp.array(dtype=wp.vec3)


@wp.struct
class Cursor:
    """State of a search through the facets of one body."""

    facet: int  # the facet found by this thread, or -1
    ended: bool
    place: int  # the next facet in the order of the tree, and the end of its leaf
    last_place: int
    first_leaf: int  # first of the leaves that were tested together, and the end of their group
    last_leaf: int
    leaves: wp.uint32  # which of these leaves are still to be searched, as bits
    first_group: int
    last_group: int
    groups: wp.uint32


@wp.func
def overlap(low: wp.vec3, high: wp.vec3, lower: wp.vec3, upper: wp.vec3) -> bool:
    """Tell whether two boxes overlap or touch."""
    return wp.min(high, lower) == lower and wp.max(low, upper) == upper


@wp.func
def overlaps_box(
    low: wp.vec3, high: wp.vec3, lower: wp.array(dtype=wp.vec3), upper: wp.array(dtype=wp.vec3), k: int, end: int
) -> bool:
    """Tell whether a box overlaps box k of an array of boxes; False unless k < end."""
    if k >= end:
        return False
    return overlap(low, high, lower[k], upper[k])


@wp.func
def box_around(a: wp.vec3, b: wp.vec3, c: wp.vec3):
    """Return the lowest and the highest corner of the box around three points."""
    return wp.min(wp.min(a, b), c), wp.max(wp.max(a, b), c)


@wp.func
def extend(low: wp.array(dtype=wp.vec3), high: wp.array(dtype=wp.vec3), i: int, least: wp.vec3, most: wp.vec3):
    """Extend box i to hold the box from `least` to `most`, atomically."""
    if not (wp.min(least, low[i]) == low[i] and wp.max(most, high[i]) == high[i]):  # seldom
        extend_to(low, high, i, least, most)


@functools.cache
def facets_within(lanes: int):
    """Compose (begin, find_next), which find the facets of a body whose boxes overlap a box low … high.

    `lanes` threads search together; each call finds up to `lanes` facets. The box may shrink between calls.
    """
    ballot = ballot_of_lanes(lanes)

    @wp.func
    def begin(tree: FacetTree, body: int) -> Cursor:
        cursor = Cursor()
        cursor.facet = -1
        cursor.first_group = tree.first_group[body] - wp.static(lanes)
        cursor.last_group = tree.first_group[body + 1]
        return cursor

    @wp.func
    def find_next(tree: FacetTree, before: Cursor, low: wp.vec3, high: wp.vec3, lane: int) -> Cursor:
        cursor = before
        cursor.facet = -1
        found = bool(False)
        while not found and not cursor.ended:
            if cursor.place < cursor.last_place:
                own = cursor.place + lane
                hit = overlaps_box(low, high, tree.lower, tree.upper, own, cursor.last_place)
                if hit:
                    cursor.facet = tree.facet[own]
                found = ballot(hit) != wp.uint32(0)
                cursor.place += wp.static(lanes)
            elif cursor.leaves != wp.uint32(0):
                leaf = tree.leaf[cursor.first_leaf + lowest_bit(cursor.leaves)]
                cursor.leaves &= cursor.leaves - wp.uint32(1)
                cursor.place = leaf[2]
                cursor.last_place = leaf[3]
            elif cursor.first_leaf + wp.static(lanes) < cursor.last_leaf:
                cursor.first_leaf += wp.static(lanes)
                own = cursor.first_leaf + lane
                end = cursor.last_leaf
                cursor.leaves = ballot(overlaps_box(low, high, tree.leaf_lower, tree.leaf_upper, own, end))
            elif cursor.groups != wp.uint32(0):
                group = tree.group[cursor.first_group + lowest_bit(cursor.groups)]
                cursor.groups &= cursor.groups - wp.uint32(1)
                cursor.first_leaf = group[0] - wp.static(lanes)
                cursor.last_leaf = group[1]
            elif cursor.first_group + wp.static(lanes) < cursor.last_group:
                cursor.first_group += wp.static(lanes)
                own = cursor.first_group + lane
                end = cursor.last_group
                cursor.groups = ballot(overlaps_box(low, high, tree.group_lower, tree.group_upper, own, end))
            else:
                cursor.ended = True
        return cursor

    return begin, find_next


@functools.cache
def drifts(scalar: type):
    """Compose (data) -> the velocity common to all points in contact [m/s], which changes no distance."""
    Data = BodyContactData(scalar)

    @wp.func
    def drift_of(data: Data) -> wp.vec3:
        return 0.5 * (data.neighbors.fastest[0] + data.neighbors.slowest[0])

    return drift_of


@functools.cache
def begin_search(scalar: type):
    """Compose the kernel that begins a search at the current positions of vertices, and empties the boxes.

    It also sets the slack of each vertex: how far it may move before the next search. The slack is half of the
    skin; for a fast vertex it is the path in a time of `soon` [s], or its overrun, at most `most` [m], if that is
    longer. So a fast body lengthens only the lists around it. `after` is the time since the end of the last
    substep [s]. The threads divide the vertices, groups and bodies.
    """
    Data, (load, store, _) = BodyContactData(scalar), records(3, scalar)
    drift_of = drifts(scalar)

    @kernel
    def begin(
        data: Data,
        tree: FacetTree,
        buffer: wp.array(dtype=scalar),
        soon: float,
        most: float,
        after: float,
        starts: int,  # 1 at the start of a frame, else 0
        threads: int,
    ):
        beyond = wp.vec3(wp.static(NEVER), wp.static(NEVER), wp.static(NEVER))
        i = grid_thread()
        if i == 0:
            data.neighbors.since[0] = -after
            data.neighbors.started[0] = starts
            data.neighbors.active_count[0] = 0
            data.neighbors.search_point_count[0] = 0
        drift = drift_of(data)
        while i < data.surfaces.x.shape[0] or i < tree.group.shape[0] or i < tree.body_lower.shape[0]:
            if i < data.surfaces.x.shape[0]:
                store(data.neighbors.x_found, i, load(data.surfaces.x, i))
                fast = wp.length(wp.vec3(load(data.surfaces.v, i)) - drift)
                far = wp.min(wp.max(soon * fast, data.neighbors.overrun[starts, i]), most)
                data.neighbors.slack[i] = wp.max(0.5 * float(buffer[0]), far)
            if i < tree.group.shape[0]:
                tree.group_lower[i] = beyond
                tree.group_upper[i] = -beyond
            if i < tree.body_lower.shape[0]:
                tree.body_lower[i] = beyond
                tree.body_upper[i] = -beyond
                data.neighbors.moved[i] = 0.0
            i += threads

    return begin


@functools.cache
def box_facets(scalar: type, lanes: int):
    """Compose the kernel that computes boxes around facets and leaves, and extends those of groups and bodies.

    Boxes hold the facets until the next search: they are wider by their slack. Each leaf has `lanes` threads.
    """
    Data, load, lowest = BodyContactData(scalar), records(3, scalar).load, lowest_of_lanes(lanes)

    @wp.func
    def box_leaf(data: Data, tree: FacetTree, p: int, lane: int):
        leaf = tree.leaf[p]
        least = wp.vec3(wp.static(NEVER), wp.static(NEVER), wp.static(NEVER))
        most = -least
        for e in range(leaf[2] + lane, leaf[3], wp.static(lanes)):
            facet = tree.facet[e]
            c = data.surfaces.corner[facet]
            slack = data.neighbors.slack[c[0]]
            slack = wp.max(slack, wp.max(data.neighbors.slack[c[1]], data.neighbors.slack[c[2]]))
            data.neighbors.facet_slack[facet] = scalar(slack)
            a = wp.vec3(load(data.surfaces.x, c[0]))
            b = wp.vec3(load(data.surfaces.x, c[1]))
            d = wp.vec3(load(data.surfaces.x, c[2]))
            below, above = box_around(a, b, d)
            below -= wp.vec3(slack, slack, slack)
            above += wp.vec3(slack, slack, slack)
            tree.lower[e] = below
            tree.upper[e] = above
            least = wp.min(least, below)
            most = wp.max(most, above)
        least = lowest(least)
        most = -lowest(-most)
        if lane == 0:
            tree.leaf_lower[p] = least
            tree.leaf_upper[p] = most
            extend(tree.group_lower, tree.group_upper, leaf[1], least, most)
            extend(tree.body_lower, tree.body_upper, leaf[0], least, most)

    @kernel
    def write_boxes(data: Data, tree: FacetTree, threads: int):
        p = grid_thread() / wp.static(lanes)
        while p < tree.leaf.shape[0]:
            box_leaf(data, tree, p, grid_thread() % wp.static(lanes))
            p += threads / wp.static(lanes)

    return write_boxes


@functools.cache
def find_roots():
    """Compose the kernel, over groups, that finds the root of each group's subtree in a tree of boxes."""

    @kernel
    def find(tree: wp.uint64, root: wp.array(dtype=int)):
        i = wp.tid()
        root[i] = wp.bvh_get_group_root(tree, i)

    return find


@functools.cache
def box_neighbours(scalar: type, lanes: int, worlds: bool = False):
    """Compose the kernel that lists the bodies that each body may touch, and finds a box around all of them.

    A point outside this box touches none of them and is not tested further; most points of a large body are
    outside. Each body has `lanes` threads that test all other bodies of its world; if 0, one that searches a tree.
    The kernel also finds how much further than their slack the vertices of a lone body may move: half of the
    distance between it and the nearest body, less the range of contact. So a body that flies alone causes no
    search.
    """
    Data, margin, by_tree = BodyContactData(scalar), margin_of_boxes(scalar), lanes == 0
    (find_rule, pair_of), first_of = pairs(scalar), first_flag(scalar, worlds)
    lanes = max(lanes, 1)
    ballot, least_of = ballot_of_lanes(lanes), least_of_lanes(wp.float32, lanes)
    lowest = lowest_of_lanes(lanes)

    @wp.func
    def list_pair(data: Data, rule: int, i: int, j: int, at: int):
        if at < data.neighbors.body_pairs.shape[1]:
            data.neighbors.body_pairs[i, at] = j
            data.neighbors.pairs[i, at] = pair_of(data, rule, i, j, at)

    @wp.func
    def find_neighbours(
        data: Data,
        tree: FacetTree,
        bodies: wp.uint64,
        farthest: scalar,
        flags: wp.array(dtype=float),
        i: int,
        lane: int,  # index among the threads of body i
    ):
        lower = wp.vec3(wp.static(NEVER), wp.static(NEVER), wp.static(NEVER))
        upper = -lower
        wide = margin(tree.body_lower[i], tree.body_upper[i], farthest)
        low = tree.body_lower[i] - wide
        high = tree.body_upper[i] + wide
        j = int(0)
        count = int(0)
        free = float(wp.static(NEVER))  # least distance from a box around a body that it may touch [m]
        if wp.static(by_tree):
            free = 0.0
            if wp.static(worlds):
                own = data.neighbors.root_of_world[i / data.surfaces.bodies_each]
                near_bodies = wp.bvh_query_aabb(bodies, low, high, own)
            else:
                near_bodies = wp.bvh_query_aabb(bodies, low, high)
            while wp.bvh_query_next(near_bodies, j):
                rule = find_rule(data, i, j)
                if rule >= 0:
                    list_pair(data, rule, i, j, count)
                    count += 1
                    wide = margin(tree.body_lower[j], tree.body_upper[j], farthest)
                    lower = wp.min(lower, tree.body_lower[j] - wide)
                    upper = wp.max(upper, tree.body_upper[j] + wide)
        else:
            begin = int(0)
            end = tree.body_lower.shape[0]
            if wp.static(worlds):
                begin = i / data.surfaces.bodies_each * data.surfaces.bodies_each
                end = begin + data.surfaces.bodies_each
            for first in range(begin, end, wp.static(lanes)):
                j = first + lane
                rule = int(-1)
                if j < end:
                    rule = find_rule(data, i, j)
                if rule >= 0 and not overlap(low, high, tree.body_lower[j], tree.body_upper[j]):
                    rule = -1
                    below = tree.body_lower[j] - tree.body_upper[i]
                    away = wp.max(wp.max(below, tree.body_lower[i] - tree.body_upper[j]), wp.vec3())
                    free = wp.min(free, wp.length(away))
                those = ballot(rule >= 0)
                if rule >= 0:
                    list_pair(data, rule, i, j, count + count_before(those, lane))
                    wide = margin(tree.body_lower[j], tree.body_upper[j], farthest)
                    lower = wp.min(lower, tree.body_lower[j] - wide)
                    upper = wp.max(upper, tree.body_upper[j] + wide)
                count += count_bits(those)
        lower = lowest(lower)
        upper = -lowest(-upper)
        free = least_of(free)
        if lane == 0:
            data.neighbors.spare[i] = 0.0
            if count == 0:
                data.neighbors.spare[i] = wp.static(0.5 * ALMOST) * wp.max(0.0, free - wide[0])
            data.neighbors.body_pair_count[i] = wp.min(count, data.neighbors.body_pairs.shape[1])
            at = first_of(data, i) + wp.static(MOST_BODY_PAIRS)
            if count > int(flags[at]):
                raise_to(flags, at, float(count))
            tree.near_lower[i] = lower
            tree.near_upper[i] = upper

    @kernel
    def extend_neighbours(
        data: Data,
        tree: FacetTree,
        bodies: wp.uint64,  # tree of the boxes around bodies, if needed
        farthest: scalar,  # largest distance of any contact [m]
        threads: int,
        flags: wp.array(dtype=float),
    ):
        if grid_thread() == 0:
            data.neighbors.due[0] = wp.static(NOT_DUE)
            data.neighbors.slowest[0] = wp.vec3(wp.static(NEVER), wp.static(NEVER), wp.static(NEVER))
            data.neighbors.fastest[0] = -data.neighbors.slowest[0]
        i = grid_thread() / wp.static(lanes)
        while i < tree.body_lower.shape[0]:
            lane = grid_thread() % wp.static(lanes)
            find_neighbours(data, tree, bodies, farthest, flags, i, lane)
            i += threads / wp.static(lanes)

    return extend_neighbours


@functools.cache
def margin_of_boxes(scalar: type):
    """Compose (low, high, around) -> the distance by which a box must grow to hold all points within `around` [m].

    It is `around` plus a bound on the rounding of float32.
    """

    @wp.func
    def margin(low: wp.vec3, high: wp.vec3, around: scalar) -> wp.vec3:
        reach = wp.float32(around)
        reach += wp.float32(2.0e-6) * (wp.length(wp.max(wp.abs(low), wp.abs(high))) + reach)
        return wp.vec3(reach, reach, reach)

    return margin
