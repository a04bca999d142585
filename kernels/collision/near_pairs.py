"""Near pairs: a vertex and a triangle, or two edges, that may meet before pairs are listed again."""

import functools

import warp as wp

from ..basis import kernel, vector
from ..records import records
from ..threads import grid_thread
from .body_contact import both_closed
from .contact_data import PAIRS, BodyContactData
from .cpu_partition import count_up, first_of_part, next_of_part, raise_to
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


@functools.cache
def NearPairs(scalar: type):
    """Compose the struct of near pairs, and of the impulses and shortened displacements that keep them apart."""
    V, W = vector(3, scalar), wp.types.vector(4, scalar)

    @wp.struct
    class NearPairs:
        # Edges; a grain is an edge whose ends are the same:
        edge: wp.array(dtype=wp.vec2i)  # the ends of each, shape [edge_count]
        bare: wp.array(dtype=int)  # whether it is an edge of no triangle
        of_facet: wp.array(dtype=wp.vec3i)  # the edges that a search finds by each facet, -1: none
        rank: wp.array(dtype=int)  # of each body by the length of its edges, the shortest first
        # Pairs:
        vertices: wp.array(dtype=wp.vec4i)  # a vertex and a triangle; or the ends of two edges, the first end as ~
        count: wp.array(dtype=int)  # number of pairs, shape [1]
        weights: wp.array(dtype=W)  # of the vertices in the shortest line from the second side to the first
        normal: wp.array(dtype=V)  # of the plane between the two sides, towards the first
        gap: wp.array(dtype=scalar)  # from the second side to the first along it [m], at most 0 where they cross
        least: wp.array(dtype=scalar)  # the least that may be left on either side of the plane [m]
        # Particles:
        in_pair: wp.array(dtype=int)  # whether each is in a pair, shape [particle_count]
        particle: wp.array(dtype=int)  # the particles in pairs, in any order
        particle_count: wp.array(dtype=int)  # number of particles in pairs, shape [1]
        inverse_mass: wp.array(dtype=scalar)  # [1/kg], of the particles of all worlds
        pushes: wp.array(dtype=int)  # pairs that push each particle in a round
        impulse: wp.array2d(dtype=wp.int64)  # of pairs on each particle, times the substep [kg m], in units
        share: wp.array(dtype=float)  # of its displacement in the substep that each particle may make
        held: wp.array(dtype=int)  # whether that is less than all, as of an earlier round
        driven: wp.array(dtype=int)  # indices of the driven particles
        done: wp.array(dtype=wp.float64)  # work of driven particles on others [J]; empty if none is driven
        contact_impulse: wp.array(dtype=wp.vec3d)  # on each particle [N s]; empty if not asked for
        restitution: wp.array(dtype=scalar)  # of each contact rule
        tangles: wp.array(dtype=int)  # whether any edge crosses a triangle, shape [1]
        tangled: wp.array(dtype=int)  # whether `find_tangles` has marked each vertex
        alarm: wp.array(dtype=int)  # in which substep of a frame a pair last came too near, from 1
        unsettled: wp.array(dtype=int)  # in which substep particles were last held back in the last round but one

    return NearPairs


@functools.cache
def clear_pairs(scalar: type):
    """Compose the kernel that empties the list of pairs, before `find_pairs`; its threads share the particles."""
    Pairs = NearPairs(scalar)

    @kernel
    def clear(pairs: Pairs, threads: int):
        i = grid_thread()
        if i == 0:
            pairs.count[0] = 0
            pairs.particle_count[0] = 0
        while i < pairs.in_pair.shape[0]:
            pairs.in_pair[i] = 0
            i += threads

    return clear


@functools.cache
def find_pairs(scalar: type, tangled: bool, lanes: int, worlds: bool = False):
    """Compose the kernel that lists the near pairs: those that may come too near before the next search.

    Each side of a pair moves by half of a skin at most until then, and pairs beyond the distance `apart` are left
    alone. So a pair beyond a skin plus `apart` need not be listed; listing it changes no result. `lanes` threads
    share a vertex or an edge. A pair of edges is found from the body with shorter edges, near which fewer facets
    are.
    """
    V, Data, Pairs = vector(3, scalar), BodyContactData(scalar, worlds), NearPairs(scalar)
    (place_of, place_on, nearest_to), on_segments = places(scalar), nearest_on_segments(scalar)
    margin, (begin, find_next) = margin_of_boxes(scalar), facets_within(lanes)
    doubt = scalar(1.01)

    @wp.func
    def add_pair(
        pairs: Pairs,
        vertices: wp.vec4i,
        first: wp.array(dtype=int),
        particle: wp.array(dtype=int),
        flags: wp.array(dtype=float),
    ):
        k = count_up(pairs.count, 0)
        if k >= pairs.vertices.shape[0]:
            raise_to(flags, wp.static(PAIRS), float(k + 1))
        else:
            pairs.vertices[k] = vertices
            for m in range(4):
                v = vertex_of(vertices, m)
                for s in range(first[v], first[v + 1]):
                    i = particle[s]
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
        reach: scalar,
        flags: wp.array(dtype=float),
    ):
        """Add the near pairs of a vertex, or of edge e if e >= 0, with a facet to the list."""
        c = data.surfaces.corner[facet]
        if e < 0:
            if c[1] != c[2] and c[0] != vertex and c[1] != vertex and c[2] != vertex:
                if is_tangled(pairs, c[0], c[1]) or is_tangled(pairs, c[2], c[2]):
                    return
                away = x - place_on(data.surfaces.x, c, nearest_to(data.surfaces.x, c, x))
                if wp.length(away) < reach:
                    vertices = wp.vec4i(vertex, c[0], c[1], c[2])
                    add_pair(pairs, vertices, data.surfaces.first, data.surfaces.particle, flags)
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
                    if not is_tangled(pairs, to[0], to[1]):
                        a = place_of(data.surfaces.x, to, scalar(0.0))
                        b = place_of(data.surfaces.x, to, scalar(1.0))
                        shares = on_segments(x, y, a, b)
                        away = x + shares[0] * (y - x) - a - shares[1] * (b - a)
                        if wp.length(away) < reach:
                            vertices = wp.vec4i(-1 - ends[0], ends[1], to[0], to[1])
                            add_pair(pairs, vertices, data.surfaces.first, data.surfaces.particle, flags)

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
        reach: scalar,
        flags: wp.array(dtype=float),
    ):
        """Add the near pairs of a vertex or an edge, of which a box goes from `below` to `above`, with a body."""
        if wp.static(lanes == 1):
            near = wp.bvh_query_aabb(tree.binary, below, above, tree.root[other])
            found = int(0)
            while wp.bvh_query_next(near, found):
                pairs_of_facet(data, pairs, vertex, e, ends, x, y, tree.facet[found], reach, flags)
        else:
            cursor = begin(tree, other)
            while not cursor.ended:
                cursor = find_next(tree, cursor, below, above, lane)
                if cursor.facet >= 0:
                    pairs_of_facet(data, pairs, vertex, e, ends, x, y, cursor.facet, reach, flags)

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
        vertex_count = data.surfaces.x.shape[0]
        n = first_of_part(grid_thread(), part) / wp.static(lanes)
        lane = grid_thread() % wp.static(lanes)
        while n < vertex_count + pairs.edge.shape[0]:
            e = n - vertex_count
            ends = wp.vec2i(n, n)
            if e >= 0:
                ends = pairs.edge[e]
            x = place_of(data.surfaces.x, ends, scalar(0.0))
            y = place_of(data.surfaces.x, ends, scalar(1.0))
            body = data.surfaces.body_of[ends[0]]
            below = wp.min(wp.vec3(x), wp.vec3(y))
            above = wp.max(wp.vec3(x), wp.vec3(y))
            wide = margin(below, above, reach)
            below -= wide
            above += wide
            near = overlap(below, above, tree.near_lower[body], tree.near_upper[body])
            if near and not is_tangled(pairs, ends[0], ends[1]):
                for b in range(data.neighbors.body_pair_count[body]):
                    other = data.neighbors.body_pairs[body, b]
                    if both_closed(data.surfaces.closed, body, other):
                        continue  # they press into each other, and are pushed out
                    if e >= 0 and pairs.rank[body] > pairs.rank[other]:
                        continue
                    if overlap(below, above, tree.body_lower[other], tree.body_upper[other]):
                        pairs_with(data, tree, pairs, n, e, ends, x, y, below, above, other, lane, reach, flags)
            n = next_of_part(n, threads / wp.static(lanes), parts)

    return find


@functools.cache
def find_tangles(scalar: type, lanes: int, worlds: bool = False):
    """Compose the kernel that marks the vertices that no near pair may have: surfaces cross there since the start.

    They are the vertices of an edge that goes through a triangle, those of this triangle, and those of points
    inside another body since the start. Its threads share edges and points, `lanes` of them one.
    """
    V, Data, Pairs = vector(3, scalar), BodyContactData(scalar, worlds), NearPairs(scalar)
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
            p = load(data.surfaces.x, c[0])
            if crosses(a, b, p, load(data.surfaces.x, c[1]), load(data.surfaces.x, c[2])):
                for k in range(3):
                    pairs.tangled[c[k]] = 1
                pairs.tangled[ends[0]] = 1
                pairs.tangled[ends[1]] = 1
                pairs.tangles[0] = 1

    @wp.func
    def find_crossings(data: Data, tree: FacetTree, pairs: Pairs, ends: wp.vec2i, lane: int):
        a = load(data.surfaces.x, ends[0])
        b = load(data.surfaces.x, ends[1])
        low = wp.min(wp.vec3(a), wp.vec3(b))
        high = wp.max(wp.vec3(a), wp.vec3(b))
        mine = data.surfaces.body_of[ends[0]]
        for n in range(data.neighbors.body_pair_count[mine]):
            other = data.neighbors.body_pairs[mine, n]
            if both_closed(data.surfaces.closed, mine, other):
                continue
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
        while n < edge_count + data.surfaces.ends.shape[0]:
            if n < edge_count:
                find_crossings(data, tree, pairs, pairs.edge[n], lane)
            elif data.history.initial_overlap[n - edge_count] > zero:
                ends = data.surfaces.ends[n - edge_count]
                pairs.tangled[ends[0]] = 1
                pairs.tangled[ends[1]] = 1
            n = next_of_part(n, threads / wp.static(lanes), parts)

    return find
