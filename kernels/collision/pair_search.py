"""The search for near pairs, by the boxes around facets."""

import functools

import warp as wp

from ..basis import kernel
from ..lanes import WARP, ballot_of_lanes, count_before, count_bits, lowest_bit, lowest_of_lanes, wait_for_lanes
from ..partition import first_of_part, next_of_part
from ..threads import grid_thread
from .contact_data import BodyContactData, NearPairs
from .facet_tree import NEVER, FacetTree, facets_within, margin_of_boxes, overlap
from .near_pairs import FIRST_OF_EDGES, PairSearch, pairs_of_facets

ROOM = 2 * WARP
"""Entries in a queue: each thread may add one while there is not yet work for all threads."""
SHARES = 4
"""Warps that divide a piece: in a stack of many layers some pieces take four times as long as most."""
QUEUES = 3 * ROOM
"""Entries of a warp's queues: one of pairs of facets, one of tests of points and one of tests of edges."""


@functools.cache
def searches(scalar: type):
    """Compose (search_of, box_of): which bodies the facets of a body search for near pairs, and in which box.

    `search_of` returns the search for pairs with the b-th body near `body`. Its reach is below 0 if the other body
    searches: that is the one with shorter edges, whose facets have fewer others near. `box_of` returns the box
    around the facet at `place` in the tree, which the boxes of near facets overlap.
    """
    Data, Pairs, Search = BodyContactData(scalar), NearPairs(scalar), PairSearch(scalar)
    margin, doubt = margin_of_boxes(scalar), scalar(1.01)

    @wp.func
    def search_of(data: Data, pairs: Pairs, body: int, b: int, skin: scalar, activation: scalar) -> Search:
        search = Search()
        search.other = data.neighbors.body_pairs[body, b]
        search.alike = body == search.other
        search.x = data.surfaces.x
        search.reach = doubt * (skin + activation)
        if pairs.rank[body] > pairs.rank[search.other]:
            search.reach = scalar(-1.0)
        elif search.alike:
            search.touching = doubt * (data.neighbors.pairs[body, b].thickness + skin)
        return search

    @wp.func
    def box_of(tree: FacetTree, search: Search, place: int):
        low = tree.lower[place]
        high = tree.upper[place]
        wide = margin(low, high, wp.max(search.reach, search.touching))
        return low - wide, high + wide

    return search_of, box_of


@functools.cache
def find_pairs(scalar: type, tangled: bool, lanes: int, grains: bool = False):
    """Compose the kernel that lists the near pairs: pairs that may come too near before the next search.

    Until then each side of a pair moves by at most half of the search margin (the skin), and a pair with a gap of
    more than `activation` needs no impulse. So pairs beyond skin + `activation` are not listed; listing one
    changes no result. Each facet has `lanes` threads. If all bodies are `grains`, facets and bodies have the same
    indices.
    """
    Data, Pairs, Search = BodyContactData(scalar), NearPairs(scalar), PairSearch(scalar)
    margin, (begin, find_next) = margin_of_boxes(scalar), facets_within(lanes)
    tests_of, test_point, test_edges = pairs_of_facets(scalar, tangled)
    search_of, box_of = searches(scalar)

    @wp.func
    def test_all(data: Data, pairs: Pairs, search: Search, facet: int, found: int, flags: wp.array(dtype=float)):
        bits = tests_of(data.surfaces.corner, pairs.owned, search, facet, found)
        while bits != wp.uint32(0):
            test = lowest_bit(bits)
            bits &= bits - wp.uint32(1)
            if test < wp.static(FIRST_OF_EDGES):
                test_point(data, pairs, search, facet, found, test, flags)
            else:
                test_edges(data, pairs, search, facet, found, test, flags)

    @wp.func
    def find_with(
        data: Data,
        tree: FacetTree,
        pairs: Pairs,
        search: Search,
        facet: int,
        low: wp.vec3,
        high: wp.vec3,
        lane: int,
        flags: wp.array(dtype=float),
    ):
        """Add the near pairs of a facet with the facets whose boxes overlap the box from `low` to `high`."""
        if wp.static(grains):
            if lane == 0 and not search.alike:
                test_all(data, pairs, search, facet, search.other, flags)
        elif wp.static(lanes == 1):
            near = wp.bvh_query_aabb(tree.binary, low, high, tree.root[search.other])
            k = int(0)
            while wp.bvh_query_next(near, k):
                found = tree.facet[k]
                if not search.alike or found > facet:
                    test_all(data, pairs, search, facet, found, flags)
        else:
            cursor = begin(tree, search.other)
            while not cursor.ended:
                cursor = find_next(tree, cursor, low, high, lane)
                if cursor.facet >= 0 and (not search.alike or cursor.facet > facet):
                    test_all(data, pairs, search, facet, cursor.facet, flags)

    @wp.func
    def find_one(
        data: Data,
        tree: FacetTree,
        pairs: Pairs,
        place: int,
        lane: int,
        skin: scalar,
        activation: scalar,
        flags: wp.array(dtype=float),
    ):
        """Add the near pairs of the facet at `place` in the order of the tree."""
        facet = tree.facet[place]
        body = data.surfaces.owner[facet]
        wide = margin(tree.lower[place], tree.upper[place], skin + activation)
        low, high = tree.lower[place] - wide, tree.upper[place] + wide
        if overlap(low, high, tree.near_lower[body], tree.near_upper[body]):
            for b in range(data.neighbors.body_pair_count[body]):
                search = search_of(data, pairs, body, b, skin, activation)
                if search.reach >= scalar(0.0):
                    low, high = box_of(tree, search, place)
                    if overlap(low, high, tree.body_lower[search.other], tree.body_upper[search.other]):
                        find_with(data, tree, pairs, search, facet, low, high, lane, flags)

    @kernel
    def find(
        data: Data,
        tree: FacetTree,
        pairs: Pairs,
        buffer: wp.array(dtype=scalar),  # the skin [m], shape [1]
        activation: scalar,  # [m]
        threads: int,  # in each part
        part: int,
        parts: int,  # number of parts, one for each CPU thread
        flags: wp.array(dtype=float),
    ):
        place = first_of_part(grid_thread(), part) / wp.static(lanes)
        lane = grid_thread() % wp.static(lanes)
        while place < tree.facet.shape[0]:
            find_one(data, tree, pairs, place, lane, buffer[0], activation, flags)
            place = next_of_part(place, threads / wp.static(lanes), parts)

    return find


@functools.cache
def find_pairs_of_pieces(scalar: type, tangled: bool):
    """Compose the kernel that lists the same pairs as `find_pairs`, for so many facets that they fill a GPU.

    `SHARES` warps divide a piece of the tree. A warp searches the tree for all facets of the piece at once; each
    thread tests the box of its own facet. Found facets, and then the tests between them, wait in queues until all
    threads of the warp have work: without queues most would be idle.
    """
    Data, Pairs, Search = BodyContactData(scalar), NearPairs(scalar), PairSearch(scalar)
    margin, (begin, find_next) = margin_of_boxes(scalar), facets_within(WARP)
    tests_of, test_point, test_edges = pairs_of_facets(scalar, tangled)
    search_of, box_of = searches(scalar)
    ballot, wait, lowest = ballot_of_lanes(WARP), wait_for_lanes(WARP), lowest_of_lanes(WARP)

    @wp.func
    def find_with(
        data: Data,
        tree: FacetTree,
        pairs: Pairs,
        search: Search,
        queue: int,
        share: int,  # which of the facets near the piece this warp takes
        place: int,
        low: wp.vec3,  # the box of this thread's facet
        high: wp.vec3,
        lane: int,
        flags: wp.array(dtype=float),
    ):
        """Add the near pairs of the facets of a piece with facets of the body that is searched."""
        below = lowest(low)
        above = -lowest(-high)
        cursor = begin(tree, search.other)
        found = wp.uint32(0)  # which of the facets tested together are near the piece
        facets = int(0)  # number of waiting pairs of facets; below, of waiting tests
        points = int(0)
        edges = int(0)
        tests = wp.uint32(0)  # the tests, as bits, of this thread's pair of facets
        mine = int(0)
        other = int(0)
        done = bool(False)
        while not done:
            if ballot(tests != wp.uint32(0)) != wp.uint32(0):
                test = int(-1)
                if tests != wp.uint32(0):
                    test = lowest_bit(tests)
                    tests &= tests - wp.uint32(1)
                of_edges = test >= wp.static(FIRST_OF_EDGES)
                those = ballot(test >= 0 and not of_edges)
                if test >= 0 and not of_edges:
                    at = queue + wp.static(ROOM) + points + count_before(those, lane)
                    pairs.queue[at] = wp.vec3i(mine, other, test)
                points += count_bits(those)
                those = ballot(of_edges)
                if of_edges:
                    at = queue + wp.static(2 * ROOM) + edges + count_before(those, lane)
                    pairs.queue[at] = wp.vec3i(mine, other, test)
                edges += count_bits(those)
            elif facets >= wp.static(WARP) or (cursor.ended and facets > 0):
                taken = wp.min(facets, wp.static(WARP))
                facets -= taken
                if lane < taken:
                    two = pairs.queue[queue + facets + lane]
                    mine = two[0]
                    other = two[1]
                    tests = tests_of(data.surfaces.corner, pairs.owned, search, mine, other)
            elif found != wp.uint32(0):
                k = cursor.place - wp.static(WARP) + lowest_bit(found)
                found &= found - wp.uint32(1)
                hit = overlap(low, high, tree.lower[k], tree.upper[k]) and (not search.alike or k > place)
                those = ballot(hit)
                if hit:
                    at = queue + facets + count_before(those, lane)
                    pairs.queue[at] = wp.vec3i(tree.facet[place], tree.facet[k], 0)
                facets += count_bits(those)
            elif not cursor.ended:
                cursor = find_next(tree, cursor, below, above, lane)
                found = ballot(cursor.facet >= 0 and lane % wp.static(SHARES) == share)
            else:
                done = True
            wait()
            if points >= wp.static(WARP) or (done and points > 0):
                taken = wp.min(points, wp.static(WARP))
                points -= taken
                if lane < taken:
                    one = pairs.queue[queue + wp.static(ROOM) + points + lane]
                    test_point(data, pairs, search, one[0], one[1], one[2], flags)
            if edges >= wp.static(WARP) or (done and edges > 0):
                taken = wp.min(edges, wp.static(WARP))
                edges -= taken
                if lane < taken:
                    one = pairs.queue[queue + wp.static(2 * ROOM) + edges + lane]
                    test_edges(data, pairs, search, one[0], one[1], one[2], flags)
            wait()

    @wp.func
    def find_of_piece(
        data: Data,
        tree: FacetTree,
        pairs: Pairs,
        p: int,
        share: int,
        queue: int,
        lane: int,
        skin: scalar,
        activation: scalar,
        flags: wp.array(dtype=float),
    ):
        piece = tree.piece[p]
        body = piece[0]
        place = piece[2] + lane
        wide = margin(tree.piece_lower[p], tree.piece_upper[p], skin + activation)
        low, high = tree.piece_lower[p] - wide, tree.piece_upper[p] + wide
        if overlap(low, high, tree.near_lower[body], tree.near_upper[body]):
            for b in range(data.neighbors.body_pair_count[body]):
                search = search_of(data, pairs, body, b, skin, activation)
                if search.reach >= scalar(0.0):
                    low = wp.vec3(wp.static(NEVER), wp.static(NEVER), wp.static(NEVER))
                    high = -low
                    near = bool(False)
                    if place < piece[3]:
                        low, high = box_of(tree, search, place)
                        near = overlap(low, high, tree.body_lower[search.other], tree.body_upper[search.other])
                    if ballot(near) != wp.uint32(0):
                        find_with(data, tree, pairs, search, queue, share, place, low, high, lane, flags)

    @kernel
    def find(
        data: Data,
        tree: FacetTree,
        pairs: Pairs,
        buffer: wp.array(dtype=scalar),  # the skin [m], shape [1]
        activation: scalar,  # [m]
        threads: int,
        part: int,
        parts: int,
        flags: wp.array(dtype=float),
    ):
        n = grid_thread() / wp.static(WARP)
        queue = wp.static(QUEUES) * n
        lane = grid_thread() % wp.static(WARP)
        while n < wp.static(SHARES) * tree.piece.shape[0]:
            p = n / wp.static(SHARES)
            find_of_piece(data, tree, pairs, p, n % wp.static(SHARES), queue, lane, buffer[0], activation, flags)
            n += threads / wp.static(WARP)

    return find
