"""Surfaces that have crossed since the start: they are left out of near pairs until they have separated."""

import functools

import warp as wp

from ..basis import kernel, vector
from ..partition import first_of_part, next_of_part
from ..records import records
from ..threads import grid_thread
from .contact_data import BodyContactData, NearPairs
from .facet_tree import FacetTree, facets_within


@functools.cache
def find_tangles(scalar: type, lanes: int):
    """Compose the kernel that marks vertices of surfaces that have crossed since the start.

    Near pairs may not contain these: the vertices of an edge through a triangle and of this triangle. Each edge
    has `lanes` threads.
    """
    V, Data, Pairs = vector(3, scalar), BodyContactData(scalar), NearPairs(scalar)
    load, (begin, find_next) = records(3, scalar).load, facets_within(lanes)
    zero = scalar(0.0)

    @wp.func
    def crosses(a: V, b: V, p: V, q: V, r: V) -> bool:
        """Tell whether segment ab goes through triangle pqr."""
        normal = wp.cross(q - p, r - p)
        above = wp.dot(a - p, normal)
        below = wp.dot(b - p, normal)
        if above * below >= zero:
            return False
        y = a + (above / (above - below)) * (b - a)
        on_pq = wp.dot(wp.cross(q - p, y - p), normal)
        on_qr = wp.dot(wp.cross(r - q, y - q), normal)
        on_rp = wp.dot(wp.cross(p - r, y - r), normal)
        return on_pq >= zero and on_qr >= zero and on_rp >= zero

    @wp.func
    def mark_crossing(data: Data, pairs: Pairs, facet: int, ends: wp.vec2i, a: V, b: V):
        c = data.surfaces.corner[facet]
        joined = bool(False)
        for k in range(3):
            joined = joined or c[k] == ends[0] or c[k] == ends[1]
        if c[1] != c[2] and not joined:
            x = data.surfaces.x
            if crosses(a, b, load(x, c[0]), load(x, c[1]), load(x, c[2])):
                for k in range(3):
                    pairs.tangled[c[k]] = 1
                pairs.tangled[ends[0]] = 1
                pairs.tangled[ends[1]] = 1
                pairs.tangles[0] = 1

    @wp.func
    def crossings_with(
        data: Data,
        tree: FacetTree,
        pairs: Pairs,
        ends: wp.vec2i,
        other: int,
        lane: int,
    ):
        a = load(data.surfaces.x, ends[0])
        b = load(data.surfaces.x, ends[1])
        low = wp.min(wp.vec3(a), wp.vec3(b))
        high = wp.max(wp.vec3(a), wp.vec3(b))
        if wp.static(lanes == 1):
            near = wp.bvh_query_aabb(tree.binary, low, high, tree.root[other])
            found = int(0)
            while wp.bvh_query_next(near, found):
                mark_crossing(data, pairs, tree.facet[found], ends, a, b)
        else:
            cursor = begin(tree, other)
            while not cursor.ended:
                cursor = find_next(tree, cursor, low, high, lane)
                if cursor.facet >= 0:
                    mark_crossing(data, pairs, cursor.facet, ends, a, b)

    @wp.func
    def find_crossings(data: Data, tree: FacetTree, pairs: Pairs, ends: wp.vec2i, lane: int):
        mine = data.surfaces.body_of[ends[0]]
        for n in range(data.neighbors.body_pair_count[mine]):
            other = data.neighbors.body_pairs[mine, n]
            crossings_with(data, tree, pairs, ends, other, lane)

    @kernel
    def find(
        data: Data,
        tree: FacetTree,
        pairs: Pairs,
        threads: int,  # in each part
        part: int,
        parts: int,  # number of parts, one for each CPU thread
    ):
        edge_count = pairs.edge.shape[0]
        n = first_of_part(grid_thread(), part) / wp.static(lanes)
        lane = grid_thread() % wp.static(lanes)
        while n < edge_count:
            find_crossings(data, tree, pairs, pairs.edge[n], lane)
            n = next_of_part(n, threads / wp.static(lanes), parts)

    return find
