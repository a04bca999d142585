"""Near pairs: a vertex and a triangle, or two edges, that may meet before pairs are listed again."""

import functools

import warp as wp

from ..basis import kernel, vector
from ..partition import count_up, first_of_part, next_of_part, raise_to
from ..threads import grid_thread
from .contact_data import PAIRS, BodyContactData, NearPairs
from .facet_tree import FacetTree, facets_within, margin_of_boxes, overlap
from .nearest_point import nearest_on_segments
from .pairs import places

MARK = """
#if defined(__CUDA_ARCH__)
    return atomicExch(&wp::index(marks, i), 1) == 0;
#else
    return __atomic_exchange_n(&wp::index(marks, i), 1, __ATOMIC_RELAXED) == 0;
#endif
"""


@wp.func_native(MARK)
def mark(marks: wp.array(dtype=int), i: int) -> bool:
    """Set marks[i] to 1, and tell whether it was 0 before."""
    ...


@wp.func
def vertex_of(vertices: wp.vec4i, m: int) -> int:
    """Return the m-th vertex of a pair; ~v, which marks a pair of edges, stands for vertex v."""
    v = vertices[m]
    if v < 0:
        v = -1 - v
    return v


@wp.func
def both_closed(closed: wp.array(dtype=int), mine: int, other: int) -> bool:
    """Tell whether both bodies are closed: their drawn surfaces may overlap, their inner surfaces may not."""
    return closed[mine] != 0 and closed[other] != 0


@functools.cache
def clear_pairs(scalar: type):
    """Compose the kernel that empties the list of pairs, before `place_inner` and `find_pairs`.

    Its threads share the particles, which are at least as many as bodies.
    """
    Pairs = NearPairs(scalar)

    @kernel
    def clear(pairs: Pairs, threads: int):
        i = grid_thread()
        if i == 0:
            pairs.count[0] = 0
            pairs.near_count[0] = 0
            pairs.particle_count[0] = 0
        while i < pairs.in_pair.shape[0]:
            pairs.in_pair[i] = 0
            if i < pairs.inner.inset.shape[0]:
                pairs.inner.inset[i] = 0.0
            i += threads

    return clear


@functools.cache
def find_pair_candidates(scalar: type, inner: bool, worlds: bool = False):
    """Compose the kernel that lists the vertices and edges that may be in a pair; its threads share all of them.

    It tests boxes around bodies, for the inner surfaces of closed bodies (`inner`), too.
    """
    Data, Pairs = BodyContactData(scalar, worlds), NearPairs(scalar)
    margin, place_of, doubt = margin_of_boxes(scalar), places(scalar)[0], scalar(1.01)

    @wp.func
    def is_candidate(data: Data, tree: FacetTree, pairs: Pairs, e: int, ends: wp.vec2i, reach: scalar) -> bool:
        body = data.surfaces.body_of[ends[0]]
        x = wp.vec3(place_of(data.surfaces.x, ends, scalar(0.0)))
        y = wp.vec3(place_of(data.surfaces.x, ends, scalar(1.0)))
        wide = margin(x, y, reach)
        below = wp.min(x, y) - wide
        above = wp.max(x, y) + wide
        found = bool(False)
        if overlap(below, above, tree.near_lower[body], tree.near_upper[body]):
            for b in range(data.neighbors.body_pair_count[body]):
                other = data.neighbors.body_pairs[body, b]
                if e < 0 or pairs.rank[body] <= pairs.rank[other]:
                    if not both_closed(data.surfaces.closed, body, other):
                        found = found or overlap(below, above, tree.body_lower[other], tree.body_upper[other])
                    elif wp.static(inner) and body != other:
                        a = wp.vec3(place_of(pairs.inner.x, ends, scalar(0.0)))
                        c = wp.vec3(place_of(pairs.inner.x, ends, scalar(1.0)))
                        more = margin(a, c, reach + pairs.inner.more[body] + pairs.inner.more[other])
                        low = wp.min(a, c) - more
                        high = wp.max(a, c) + more
                        found = found or overlap(low, high, tree.body_lower[other], tree.body_upper[other])
        return found

    @kernel
    def find(
        data: Data,
        tree: FacetTree,
        pairs: Pairs,
        buffer: wp.array(dtype=scalar),  # the skin [m], shape [1]
        apart: scalar,  # [m]
        threads: int,  # in each part
        part: int,
        parts: int,  # number of parts, one for each CPU thread
    ):
        reach = doubt * (buffer[0] + apart)
        vertex_count = data.surfaces.x.shape[0]
        n = first_of_part(grid_thread(), part)
        while n < vertex_count + pairs.edge.shape[0]:
            ends = wp.vec2i(n, n)
            if n >= vertex_count:
                ends = pairs.edge[n - vertex_count]
            if is_candidate(data, tree, pairs, n - vertex_count, ends, reach):
                pairs.near[count_up(pairs.near_count, 0)] = n
            n = next_of_part(n, threads, parts)

    return find


@functools.cache
def find_pairs(scalar: type, tangled: bool, lanes: int, inner: bool, worlds: bool = False):
    """Compose the kernel that lists the near pairs: those that may come too near before the next search.

    Each side of a pair moves by half of a skin at most until then, and pairs beyond the distance `apart` are left
    alone. So a pair beyond a skin plus `apart` need not be listed; listing it changes no result. `lanes` threads
    share a vertex or an edge. A pair of edges is found from the body with shorter edges, near which fewer facets
    are. With `inner` pairs of the inner surfaces of closed bodies are listed, too.
    """
    V, Data, Pairs = vector(3, scalar), BodyContactData(scalar, worlds), NearPairs(scalar)
    (place_of, place_on, nearest_to), on_segments = places(scalar), nearest_on_segments(scalar)
    margin, (begin, find_next) = margin_of_boxes(scalar), facets_within(lanes)
    doubt = scalar(1.01)

    @wp.func
    def add_pair(pairs: Pairs, vertices: wp.vec4i, flags: wp.array(dtype=float)):
        k = count_up(pairs.count, 0)
        if k >= pairs.vertices.shape[0]:
            raise_to(flags, wp.static(PAIRS), float(k + 1))
        else:
            pairs.vertices[k] = vertices
            for m in range(4):
                v = vertex_of(vertices, m)
                for s in range(pairs.first_particle[v], pairs.first_particle[v + 1]):
                    i = pairs.particle_of[s]
                    if mark(pairs.in_pair, i):
                        pairs.particle[count_up(pairs.particle_count, 0)] = i

    @wp.func
    def is_tangled(pairs: Pairs, a: int, b: int) -> bool:
        found = bool(False)
        if wp.static(tangled):
            found = pairs.tangled[a] != 0 or pairs.tangled[b] != 0
        return found

    @wp.func
    def pairs_of_facet(
        data: Data,
        pairs: Pairs,
        vertex: int,
        e: int,
        ends: wp.vec2i,
        x: V,
        y: V,
        facet: int,
        at: wp.array(dtype=V),
        further: int,
        reach: scalar,
        flags: wp.array(dtype=float),
    ):
        """Add the near pairs of a vertex, or of edge e if e >= 0, with a facet to the list.

        `at` has the positions of drawn or of inner vertices, whose indices among those of pairs are `further` on.
        """
        c = data.surfaces.corner[facet]
        if e < 0:
            if c[1] != c[2] and c[0] != vertex and c[1] != vertex and c[2] != vertex:
                if is_tangled(pairs, c[0] + further, c[1] + further):
                    return
                if is_tangled(pairs, c[2] + further, c[2] + further):
                    return
                away = x - place_on(at, c, nearest_to(at, c, x))
                if wp.length(away) < reach:
                    corners = wp.vec4i(vertex, c[0], c[1], c[2])
                    add_pair(pairs, corners + wp.vec4i(further, further, further, further), flags)
            return
        for k in range(3):
            other = pairs.of_facet[facet][k]
            # Of two edges of the same body, the edge with the lower index finds the other.
            if other > e or (other >= 0 and data.surfaces.owner[facet] != data.surfaces.body_of[ends[0]]):
                to = pairs.edge[other]
                alone = ends[0] == ends[1] or to[0] == to[1]
                joined = ends[0] == to[0] or ends[0] == to[1] or ends[1] == to[0] or ends[1] == to[1]
                # A grain and a triangle are a pair already.
                if not joined and not (alone and (pairs.bare[e] == 0 or pairs.bare[other] == 0)):
                    if not is_tangled(pairs, to[0] + further, to[1] + further):
                        a = place_of(at, to, scalar(0.0))
                        b = place_of(at, to, scalar(1.0))
                        shares = on_segments(x, y, a, b)
                        away = x + shares[0] * (y - x) - a - shares[1] * (b - a)
                        if wp.length(away) < reach:
                            corners = wp.vec4i(-1 - ends[0], ends[1], to[0], to[1])
                            add_pair(pairs, corners + wp.vec4i(-further, further, further, further), flags)

    @wp.func
    def pairs_with(
        data: Data,
        tree: FacetTree,
        pairs: Pairs,
        vertex: int,
        e: int,
        ends: wp.vec2i,
        x: V,
        y: V,
        below: wp.vec3,
        above: wp.vec3,
        other: int,
        lane: int,
        at: wp.array(dtype=V),
        further: int,
        reach: scalar,
        flags: wp.array(dtype=float),
    ):
        """Add the near pairs of a vertex or an edge, of which a box goes from `below` to `above`, with a body."""
        if wp.static(lanes == 1):
            near = wp.bvh_query_aabb(tree.binary, below, above, tree.root[other])
            found = int(0)
            while wp.bvh_query_next(near, found):
                pairs_of_facet(data, pairs, vertex, e, ends, x, y, tree.facet[found], at, further, reach, flags)
        else:
            cursor = begin(tree, other)
            while not cursor.ended:
                cursor = find_next(tree, cursor, below, above, lane)
                if cursor.facet >= 0:
                    pairs_of_facet(data, pairs, vertex, e, ends, x, y, cursor.facet, at, further, reach, flags)

    @wp.func
    def inner_pairs_with(
        data: Data,
        tree: FacetTree,
        pairs: Pairs,
        vertex: int,
        e: int,
        ends: wp.vec2i,
        other: int,
        lane: int,
        reach: scalar,
        flags: wp.array(dtype=float),
    ):
        """Add the near pairs of an inner vertex or edge with the inner surface of another body."""
        further = data.surfaces.x.shape[0]
        if is_tangled(pairs, ends[0] + further, ends[1] + further):
            return
        x = place_of(pairs.inner.x, ends, scalar(0.0))
        y = place_of(pairs.inner.x, ends, scalar(1.0))
        below = wp.min(wp.vec3(x), wp.vec3(y))
        above = wp.max(wp.vec3(x), wp.vec3(y))
        # The boxes in the tree are around drawn facets.
        wide = margin(below, above, reach + scalar(pairs.inner.inset[other]))
        low = below - wide
        high = above + wide
        at = pairs.inner.x
        pairs_with(data, tree, pairs, vertex, e, ends, x, y, low, high, other, lane, at, further, reach, flags)

    @wp.func
    def find_one(
        data: Data,
        tree: FacetTree,
        pairs: Pairs,
        n: int,
        e: int,
        ends: wp.vec2i,
        lane: int,
        reach: scalar,
        flags: wp.array(dtype=float),
    ):
        """Add the near pairs of vertex n, or of edge e if e >= 0."""
        x = place_of(data.surfaces.x, ends, scalar(0.0))
        y = place_of(data.surfaces.x, ends, scalar(1.0))
        body = data.surfaces.body_of[ends[0]]
        below = wp.min(wp.vec3(x), wp.vec3(y))
        above = wp.max(wp.vec3(x), wp.vec3(y))
        wide = margin(below, above, reach)
        below -= wide
        above += wide
        entangled = is_tangled(pairs, ends[0], ends[1])
        for b in range(data.neighbors.body_pair_count[body]):
            other = data.neighbors.body_pairs[body, b]
            if e >= 0 and pairs.rank[body] > pairs.rank[other]:
                continue
            if both_closed(data.surfaces.closed, body, other):
                if wp.static(inner):
                    within = reach + pairs.inner.more[body] + pairs.inner.more[other]
                    if body != other:
                        inner_pairs_with(data, tree, pairs, n, e, ends, other, lane, within, flags)
            elif not entangled and overlap(below, above, tree.body_lower[other], tree.body_upper[other]):
                at = data.surfaces.x
                pairs_with(data, tree, pairs, n, e, ends, x, y, below, above, other, lane, at, 0, reach, flags)

    @kernel
    def find(
        data: Data,
        tree: FacetTree,
        pairs: Pairs,
        buffer: wp.array(dtype=scalar),  # the skin [m], shape [1]
        apart: scalar,  # [m]
        threads: int,  # in each part
        part: int,
        parts: int,  # number of parts, one for each CPU thread
        flags: wp.array(dtype=float),
    ):
        reach = doubt * (buffer[0] + apart)
        k = first_of_part(grid_thread(), part) / wp.static(lanes)
        lane = grid_thread() % wp.static(lanes)
        while k < pairs.near_count[0]:
            n = pairs.near[k]
            e = n - data.surfaces.x.shape[0]
            ends = wp.vec2i(n, n)
            if e >= 0:
                ends = pairs.edge[e]
            find_one(data, tree, pairs, n, e, ends, lane, reach, flags)
            k = next_of_part(k, threads / wp.static(lanes), parts)

    return find
