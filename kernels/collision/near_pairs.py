"""Near pairs: a vertex and a triangle, or two edges, that may come too near before pairs are listed again."""

import functools

import warp as wp

from ..basis import fast_kernel, fully_hashed, vector
from ..lanes import reserve
from ..partition import count_up, raise_to
from ..records import records
from ..threads import grid_thread
from .contact_data import PAIRS, BodyContactData, NearPairs
from .facet_tree import box_around, margin_of_boxes, overlap
from .nearest_point import nearest_on_segments, nearest_on_triangle
from .pairs import never_touches

FIRST_OF_EDGES = 12
"""Index of the first test of two sides among the tests of two facets."""
NO_PAIR = wp.vec4i(-1, -1, -1, -1)
"""The vertices of no pair."""
MARK = """
#if defined(__CUDA_ARCH__)
    return atomicExch(&wp::index(marks, i), 1) == 0;
#else
    return __atomic_exchange_n(&wp::index(marks, i), 1, __ATOMIC_RELAXED) == 0;
#endif
"""


@wp.func_native(MARK)
def mark(marks: wp.array(dtype=int), i: int) -> bool:
    """Set marks[i] to 1; return whether it was 0 before."""
    ...


@wp.func
def vertex_of(vertices: wp.vec4i, m: int) -> int:
    """Return vertex m of a pair, 0 to 3; the first vertex v of a pair of edges is stored as ~v (bitwise not)."""
    v = vertices[m]
    if v < 0:
        v = -1 - v
    return v


@functools.cache
def clear_pairs(scalar: type):
    """Compose the kernel that empties the list of pairs, before `find_pairs`.

    Its threads divide the particles; there are at least as many particles as bodies.
    """
    Pairs = NearPairs(scalar)

    @fast_kernel
    def clear(pairs: Pairs, threads: int):
        i = grid_thread()
        if i == 0:
            pairs.count[0] = 0
            pairs.particle_count[0] = 0
            pairs.near_facet_count[0] = 0
            pairs.test_counts[0] = 0
            pairs.test_counts[1] = 0
        while i < pairs.in_pair.shape[0]:
            pairs.in_pair[i] = 0
            i += threads

    return clear


def tests_at(k: int, n: int) -> int:
    """Return the bits of `tests_of` for corner k of the first facet, corner n of the second, and their sides.

    Tests between two sides count only if one ends at corner k and the other at corner n.
    """
    sides, others = (k, (k + 2) % 3), (n, (n + 2) % 3)
    points = (k, *(3 + side for side in sides), 6 + n, *(9 + side for side in others))
    return sum(1 << one for one in (*points, *(FIRST_OF_EDGES + 3 * a + b for a in sides for b in others)))


@functools.cache
def PairSearch(scalar: type):
    """Compose the struct of a search for near pairs between two bodies, or between the parts of one."""
    V = vector(3, scalar)

    @wp.struct
    class PairSearch:
        alike: bool  # whether both are the same body
        x: wp.array(dtype=V)  # positions of vertices [m]
        reach: scalar  # distance within which pairs are listed [m]
        touching: scalar  # distance within which points of the same body may touch it [m]

    return PairSearch


@functools.cache
def pairs_of_facets(scalar: type, tangled: bool):
    """Compose (tests_of, test_point, test_edges, add_pair), which add the near pairs of two facets to the list.

    Each vertex and each edge belongs to one of the facets around it, so every pair is found once. If `tangled`,
    vertices that `find_tangles` has marked are left out. If both facets belong to one body, points that may touch
    the other facet are marked. Tests are numbered as the bits of `tests_of`.
    """
    V, Data, Pairs = vector(3, scalar), BodyContactData(scalar), NearPairs(scalar)
    Search, load, margin, half = PairSearch(scalar), records(3, scalar).load, margin_of_boxes(scalar), scalar(0.5)
    nearest, on_segments = nearest_on_triangle(scalar), nearest_on_segments(scalar)

    @wp.struct
    class Facet:
        corner: wp.vec3i
        a: V  # positions of its corners [m]
        b: V
        c: V

    @wp.func
    def add_pair(pairs: Pairs, vertices: wp.vec4i, flags: wp.array(dtype=float)):
        """Add a pair, if it is not `NO_PAIR`; all threads of a warp must call this together."""
        adds = vertices[3] >= 0
        if wp.static(tangled):
            if adds:
                for m in range(4):
                    adds = adds and pairs.tangled[vertex_of(vertices, m)] == 0
        k = reserve(pairs.count, 0, int(adds))
        if adds and (k < 0 or k >= pairs.vertices.shape[0]):
            raise_to(flags, wp.static(PAIRS), float(k + 1))
        elif adds:
            pairs.vertices[k] = vertices
            pairs.bodies[k] = wp.vec2i(pairs.body_of[vertex_of(vertices, 0)], pairs.body_of[vertices[3]])
            for m in range(4):
                v = vertex_of(vertices, m)
                for s in range(pairs.first_particle[v], pairs.first_particle[v + 1]):
                    i = pairs.particle_of[s]
                    if mark(pairs.in_pair, i):
                        pairs.particle[count_up(pairs.particle_count, 0)] = i

    @wp.func
    def facet_at(corner: wp.array(dtype=wp.vec3i), x: wp.array(dtype=V), number: int) -> Facet:
        facet = Facet()
        facet.corner = corner[number]
        facet.a = load(x, facet.corner[0])
        facet.b = load(x, facet.corner[1])
        facet.c = load(x, facet.corner[2])
        return facet

    @wp.func
    def corner_of(facet: Facet, k: int):
        """Return the vertex at corner k and its position; an index into the vector would move it to memory."""
        vertex = facet.corner[0]
        x = facet.a
        if k == 1:
            vertex = facet.corner[1]
            x = facet.b
        if k == 2:
            vertex = facet.corner[2]
            x = facet.c
        return vertex, x

    @wp.func
    def parts_near(facet: Facet, low: wp.vec3, high: wp.vec3) -> int:
        """Return which corners and sides of a facet, as bits, have boxes that overlap the box low ... high."""
        a = wp.vec3(facet.a)
        b = wp.vec3(facet.b)
        c = wp.vec3(facet.c)
        near = int(overlap(low, high, a, a))
        near |= int(overlap(low, high, b, b)) << 1
        near |= int(overlap(low, high, c, c)) << 2
        near |= int(overlap(low, high, wp.min(a, b), wp.max(a, b))) << 3
        near |= int(overlap(low, high, wp.min(b, c), wp.max(b, c))) << 4
        near |= int(overlap(low, high, wp.min(c, a), wp.max(c, a))) << 5
        return near

    @fully_hashed
    def tests_of(
        corner: wp.array(dtype=wp.vec3i), owned: wp.array(dtype=int), search: Search, mine: int, found: int
    ) -> wp.uint32:
        """Return the tests that two facets need, as bits.

        Bits 0 to 2 test the corners of the first facet against the second, bits 3 to 5 the midpoints of its sides.
        Bits 6 to 11 do the same with the facets exchanged. Bit 12 + 3 k + n tests side k of the first against side
        n of the second.
        """
        one = facet_at(corner, search.x, mine)
        other = facet_at(corner, search.x, found)
        low, high = box_around(wp.vec3(one.a), wp.vec3(one.b), wp.vec3(one.c))
        wide = margin(low, high, wp.max(search.reach, search.touching))
        others = owned[found] & parts_near(other, low - wide, high + wide)
        low, high = box_around(wp.vec3(other.a), wp.vec3(other.b), wp.vec3(other.c))
        own = owned[mine] & parts_near(one, low - wide, high + wide)
        edges = int(0)
        for k in range(3):
            if (own & (8 << k)) != 0:
                edges |= (others >> 3) << (3 * k)
        tests = own | others << 6 | edges << wp.static(FIRST_OF_EDGES)
        if not search.alike:  # midpoints of sides need no marks
            tests &= ~wp.static(0b111000 << 6 | 0b111000)
        for k in range(3):
            for n in range(3):
                if one.corner[k] == other.corner[n]:
                    tests &= ~wp.static(tests_at(k, n))
        return wp.uint32(tests)

    @wp.func
    def test_point(data: Data, pairs: Pairs, search: Search, between: wp.vec3i) -> wp.vec4i:
        """Return the pair of a corner and a facet, if they are near.

        Mark the contact point at the corner, or at a side's midpoint, if it may touch the facet.
        """
        number = between[0]
        facing = between[1]
        if between[2] >= 6:
            number, facing = facing, number
        k = between[2] % 6
        one = facet_at(data.surfaces.corner, search.x, number)
        other = facet_at(data.surfaces.corner, search.x, facing)
        i, x = corner_of(one, k % 3)
        j, y = corner_of(one, (k + k / 3) % 3)  # k < 3: the same corner
        x = half * (x + y)
        w = nearest(x, other.a, other.b, other.c)
        away = wp.length(x - w[0] * other.a - w[1] * other.b - w[2] * other.c)
        c = other.corner
        pair = wp.static(NO_PAIR)
        if k < 3 and away < search.reach and c[1] != c[2]:
            pair = wp.vec4i(i, c[0], c[1], c[2])
        if search.alike and away < search.touching:
            point = pairs.points[6 * number + k]
            if point >= 0 and not never_touches(data.surfaces.first_near, data.surfaces.near, wp.vec2i(i, j), c):
                data.neighbors.near_own[point] = 1
        return pair

    @wp.func
    def test_edges(data: Data, search: Search, between: wp.vec3i) -> wp.vec4i:
        """Return the pair of two sides of different facets, if they are near."""
        one = facet_at(data.surfaces.corner, search.x, between[0])
        other = facet_at(data.surfaces.corner, search.x, between[1])
        k = (between[2] - wp.static(FIRST_OF_EDGES)) / 3
        n = (between[2] - wp.static(FIRST_OF_EDGES)) % 3
        i, a = corner_of(one, k)
        j, b = corner_of(one, (k + 1) % 3)
        m, c = corner_of(other, n)
        o, d = corner_of(other, (n + 1) % 3)
        if (i == j or m == o) and (one.corner[1] != one.corner[2] or other.corner[1] != other.corner[2]):
            return wp.static(NO_PAIR)  # the pair of a grain and a triangle is listed by `test_point`
        shares = on_segments(a, b, c, d)
        away = wp.length(a + shares[0] * (b - a) - c - shares[1] * (d - c))
        pair = wp.static(NO_PAIR)
        if away < search.reach:
            first = wp.vec2i(wp.min(i, j), wp.max(i, j))
            second = wp.vec2i(wp.min(m, o), wp.max(m, o))
            # Within one body the order of the two edges does not depend on which facet found the other.
            if search.alike and second[0] < first[0]:
                first, second = second, first
            pair = wp.vec4i(-1 - first[0], first[1], second[0], second[1])
        return pair

    return tests_of, test_point, test_edges, add_pair
