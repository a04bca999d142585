"""The search for near pairs in three kernels: they list near facets, the tests that these need, and near pairs.

Each kernel appends to a list what the next one needs. So on a GPU all threads of a warp have work, though most
facets that are near each other need no test, and the others need up to 21.
"""

import functools

import warp as wp

from ..basis import fast_kernel
from ..lanes import WARP, ballot_of_lanes, count_bits, lowest_bit, lowest_of_lanes, reserve
from ..partition import count_up, first_of_part, next_of_part, raise_to
from ..threads import grid_thread
from .contact_data import NEAR_FACETS, BodyContactData, NearPairs
from .facet_tree import NEVER, FacetTree, facets_within, margin_of_boxes, overlap
from .near_pairs import FIRST_OF_EDGES, NO_PAIR, PairSearch, pairs_of_facets
from .pairs import pairs


@functools.cache
def searches(scalar: type):
    """Compose (searches_for, search_of, search_between, box_of): which bodies are searched, and how far.

    `searches_for` tells whether the facets of one body search for those of another: those of the body with shorter
    edges do, since they have fewer others near. `search_of` returns the search for pairs between two bodies whose
    sides may together move by `slack` [m] before the next search; `search_between` does so for two facets.
    `box_of` returns the box around the facet at `place` in the tree, which the boxes of near facets overlap; these
    hold facets until the next search.
    """
    Data, Pairs, Search = BodyContactData(scalar), NearPairs(scalar), PairSearch(scalar)
    (find_rule, pair_of), margin, doubt = pairs(scalar), margin_of_boxes(scalar), scalar(1.01)

    @wp.func
    def searches_for(pairs: Pairs, body: int, other: int) -> bool:
        return pairs.rank[body] <= pairs.rank[other]

    @wp.func
    def search_of(data: Data, body: int, other: int, slack: scalar, activation: scalar) -> Search:
        search = Search()
        search.alike = body == other
        search.x = data.surfaces.x
        search.reach = doubt * (slack + activation)
        if search.alike:
            search.touching = doubt * (pair_of(data, find_rule(data, body, body), body, body, 0).thickness + slack)
        return search

    @wp.func
    def search_between(data: Data, one: int, two: int, activation: scalar) -> Search:
        slack = data.neighbors.facet_slack[one] + data.neighbors.facet_slack[two]
        return search_of(data, data.surfaces.owner[one], data.surfaces.owner[two], slack, activation)

    @wp.func
    def box_of(tree: FacetTree, search: Search, place: int):
        low = tree.lower[place]
        high = tree.upper[place]
        wide = margin(low, high, wp.max(search.reach, search.touching))
        return low - wide, high + wide

    return searches_for, search_of, search_between, box_of


@functools.cache
def find_near_facets(scalar: type, by_warps: bool, grains: bool = False):
    """Compose the kernel that lists facets whose boxes are so near each other that they may have near pairs.

    If `by_warps` (on a GPU), a warp searches for all facets of a leaf of the tree at once, and each of its
    threads tests the box of its own facet. Otherwise each thread searches for one facet in a binary tree. If all
    bodies are `grains`, facets and bodies have the same indices, and the list of near bodies suffices.
    """
    Data, Pairs, Search = BodyContactData(scalar), NearPairs(scalar), PairSearch(scalar)
    margin, (begin, find_next) = margin_of_boxes(scalar), facets_within(WARP)
    searches_for, search_of, _, box_of = searches(scalar)
    ballot, lowest = ballot_of_lanes(WARP), lowest_of_lanes(WARP)

    @wp.func
    def add(pairs: Pairs, at: int, facet: int, found: int, flags: wp.array(dtype=float)):
        if at >= 0 and at < pairs.near_facets.shape[0]:  # what is below 0 has been counted beyond int32
            pairs.near_facets[at] = wp.vec2i(facet, found)
        else:
            raise_to(flags, wp.static(NEAR_FACETS), float(at + 1))

    @wp.func
    def search_for_facet(
        tree: FacetTree,
        pairs: Pairs,
        search: Search,
        other: int,
        place: int,
        flags: wp.array(dtype=float),
    ):
        """List the facets of a body that are near the facet at `place`, by a single thread."""
        facet = tree.facet[place]
        if wp.static(grains):
            if not search.alike:
                add(pairs, count_up(pairs.near_facet_count, 0), facet, other, flags)
        else:
            low, high = box_of(tree, search, place)
            if overlap(low, high, tree.body_lower[other], tree.body_upper[other]):
                near = wp.bvh_query_aabb(tree.binary, low, high, tree.root[other])
                k = int(0)
                while wp.bvh_query_next(near, k):
                    if not search.alike or tree.facet[k] > facet:
                        add(pairs, count_up(pairs.near_facet_count, 0), facet, tree.facet[k], flags)

    @wp.func
    def search_for_leaf(
        tree: FacetTree,
        pairs: Pairs,
        search: Search,
        other: int,
        place: int,  # of this thread's facet, if it is below `last`
        last: int,
        these: wp.uint32,  # which of the facets that are tested together this warp lists
        flags: wp.array(dtype=float),
    ):
        """List the facets of a body that are near the facets of a leaf, by a warp."""
        low = wp.vec3(wp.static(NEVER), wp.static(NEVER), wp.static(NEVER))
        high = -low
        near = bool(False)
        if place < last:
            low, high = box_of(tree, search, place)
            near = overlap(low, high, tree.body_lower[other], tree.body_upper[other])
        if ballot(near) != wp.uint32(0):
            below = lowest(low)
            above = -lowest(-high)
            lane = grid_thread() % wp.static(WARP)
            cursor = begin(tree, other)
            while not cursor.ended:
                cursor = find_next(tree, cursor, below, above, lane)
                first = cursor.place - wp.static(WARP)
                found = ballot(cursor.facet >= 0) & these  # near the leaf; of them, near this thread's facet:
                hits = wp.uint32(0)
                while found != wp.uint32(0):
                    bit = found & (~found + wp.uint32(1))
                    k = first + lowest_bit(found)
                    found ^= bit
                    if overlap(low, high, tree.lower[k], tree.upper[k]) and (not search.alike or k > place):
                        hits |= bit
                at = reserve(pairs.near_facet_count, 0, count_bits(hits))
                while hits != wp.uint32(0):
                    add(pairs, at, tree.facet[place], tree.facet[first + lowest_bit(hits)], flags)
                    hits &= hits - wp.uint32(1)
                    at += 1

    @wp.func
    def search_around(
        data: Data,
        tree: FacetTree,
        pairs: Pairs,
        body: int,
        low: wp.vec3,
        high: wp.vec3,
        place: int,
        last: int,
        these: wp.uint32,
        activation: scalar,
        flags: wp.array(dtype=float),
    ):
        """Search all bodies near `body` for facets near those in the box low … high."""
        wide = margin(low, high, activation)
        if overlap(low - wide, high + wide, tree.near_lower[body], tree.near_upper[body]):
            for b in range(data.neighbors.body_pair_count[body]):
                other = data.neighbors.body_pairs[body, b]
                if searches_for(pairs, body, other):
                    search = search_of(data, body, other, scalar(0.0), activation)
                    if wp.static(by_warps):
                        search_for_leaf(tree, pairs, search, other, place, last, these, flags)
                    else:
                        search_for_facet(tree, pairs, search, other, place, flags)

    @fast_kernel
    def find(
        data: Data,
        tree: FacetTree,
        pairs: Pairs,
        activation: scalar,  # [m]
        warps: int,  # of each leaf
        threads: int,  # in each part
        part: int,
        parts: int,  # number of parts, one for each CPU thread
        flags: wp.array(dtype=float),
    ):
        every = ~wp.uint32(0)
        if wp.static(not by_warps):
            k = first_of_part(grid_thread(), part)
            while k < tree.facet.shape[0]:
                body = data.surfaces.owner[tree.facet[k]]
                low = tree.lower[k]
                search_around(data, tree, pairs, body, low, tree.upper[k], k, k, every, activation, flags)
                k = next_of_part(k, threads, parts)
        else:
            n = grid_thread() / wp.static(WARP)
            while n < warps * tree.leaf.shape[0]:
                p = n / warps
                bit = wp.uint32(1) << wp.uint32(warps)  # its multiples are as far apart as a leaf has warps
                these = (every / (bit - wp.uint32(1))) << wp.uint32(n % warps)
                leaf = tree.leaf[p]
                low = tree.leaf_lower[p]
                high = tree.leaf_upper[p]
                place = leaf[2] + grid_thread() % wp.static(WARP)
                search_around(data, tree, pairs, leaf[0], low, high, place, leaf[3], these, activation, flags)
                n += threads / wp.static(WARP)

    return find


@wp.func
def whole_warps(count: int) -> int:
    """Round a number of items up to whole warps, whose threads reserve entries of a list together."""
    return (count + wp.static(WARP - 1)) / wp.static(WARP) * wp.static(WARP)


@functools.cache
def list_tests(scalar: type):
    """Compose the kernel that lists the tests which near facets need; its threads divide the pairs of facets."""
    Data, Pairs = BodyContactData(scalar), NearPairs(scalar)
    search_between, tests_of = searches(scalar)[2], pairs_of_facets(scalar, False)[0]
    points = wp.uint32((1 << FIRST_OF_EDGES) - 1)

    @wp.func
    def add(
        list: wp.array(dtype=wp.vec3i),
        counts: wp.array(dtype=int),
        kind: int,
        two: wp.vec2i,
        tests: wp.uint32,
        flags: wp.array(dtype=float),
    ):
        at = reserve(counts, kind, count_bits(tests))
        left = tests
        while left != wp.uint32(0):
            if at >= 0 and at < list.shape[0]:
                list[at] = wp.vec3i(two[0], two[1], lowest_bit(left))
            else:
                raise_to(flags, wp.static(NEAR_FACETS), float(at + 1))
            left &= left - wp.uint32(1)
            at += 1

    @fast_kernel
    def list_all(
        data: Data,
        pairs: Pairs,
        activation: scalar,
        threads: int,
        part: int,
        parts: int,
        flags: wp.array(dtype=float),
    ):
        count = wp.min(pairs.near_facet_count[0], pairs.near_facets.shape[0])
        n = first_of_part(grid_thread(), part)
        while n < whole_warps(count):
            two = wp.vec2i()
            tests = wp.uint32(0)
            if n < count:
                two = pairs.near_facets[n]
                search = search_between(data, two[0], two[1], activation)
                tests = tests_of(data.surfaces.corner, pairs.owned, search, two[0], two[1])
            add(pairs.point_tests, pairs.test_counts, 0, two, tests & points, flags)
            add(pairs.edge_tests, pairs.test_counts, 1, two, tests & ~points, flags)
            n = next_of_part(n, threads, parts)

    return list_all


@functools.cache
def find_pairs(scalar: type, tangled: bool):
    """Compose the kernel that lists the near pairs: pairs that may come too near before the next search.

    Until then each side of a pair moves by at most its slack, and a pair with a gap of more than `activation`
    needs no impulse. So pairs beyond both slacks + `activation` are not listed; listing one changes no result. Its
    threads divide the tests.
    """
    Data, Pairs = BodyContactData(scalar), NearPairs(scalar)
    search_between = searches(scalar)[2]
    _, test_point, test_edges, add_pair = pairs_of_facets(scalar, tangled)

    @fast_kernel
    def find(
        data: Data,
        pairs: Pairs,
        activation: scalar,
        threads: int,
        part: int,
        parts: int,
        flags: wp.array(dtype=float),
    ):
        room = pairs.point_tests.shape[0]
        of_points = wp.min(pairs.test_counts[0], room)
        first_of_edges = whole_warps(of_points)
        end = first_of_edges + wp.min(pairs.test_counts[1], room)
        n = first_of_part(grid_thread(), part)
        while n < whole_warps(end):
            found = wp.static(NO_PAIR)
            if n < of_points:
                test = pairs.point_tests[n]
                found = test_point(data, pairs, search_between(data, test[0], test[1], activation), test)
            elif n >= first_of_edges and n < end:
                test = pairs.edge_tests[n - first_of_edges]
                found = test_edges(data, search_between(data, test[0], test[1], activation), test)
            add_pair(pairs, found, flags)
            n = next_of_part(n, threads, parts)

    return find
