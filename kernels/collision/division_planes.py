"""Division planes: what did not cross when a substep began does not cross when it ends.

Near pairs of a vertex and a triangle, or of two edges, are listed. As a substep begins there is a plane between
the two of each pair. After the substep

1. pairs that have lost more than half of their gap exchange impulses, in a few rounds. All pairs act at a time, so
   that each takes a particle to be as many times as light as there are pairs that push it;
2. the way of each particle that would still reach the plane of a pair is shortened.

Both sides of a pair are then convex sets on the two sides of a plane, also on all of the straight way there. The
impulses of a pair add up to nothing and are summed as integers; a way is shortened to the least of what its pairs
allow. So nothing depends on the order of pairs.
References: Chen et al., Offset geometric contact, ACM TOG 44 (2025); Tonge et al., Mass splitting for jitter-free
parallel rigid body simulation, ACM TOG 31 (2012).
"""

import functools

import warp as wp

from ..basis import kernel, vector
from ..integrators.persistent import wait
from ..records import records
from .contact_data import FLAGS, HELD_BACK, BodyContactData
from .cpu_partition import raise_to
from .near_pairs import NearPairs, vertex_of
from .nearest_point import nearest_on_segments, nearest_on_triangle
from .pair_impulses import pair_impulses

ROUNDS = 4
"""Rounds of impulses. Without any a driven end of a folded cloth lags by 0.3 m, with these by some millimetres."""
ALLOWED = 0.8
"""The share of the way to its plane that a vertex may go."""
LEAST_SHARE = 0.05
"""The least share of the gap on either side of a plane."""
CATCH_UP = 50.0
"""How far a driven particle that stands may go in a substep to catch up, by the least gap."""
PHASES = 3 * ROUNDS + 3
"""The phases of a substep: gaps, three for each round, ways, cuts. One ends before the next begins."""
MOST_THREADS = 256
"""Threads in a block; the compiler leaves registers for this many."""
ROUNDING = 4.0
"""The least gap by how far apart the numbers of the device are there."""

LOWER = """
#if defined(__CUDA_ARCH__)
    atomicMin(reinterpret_cast<int*>(&wp::index(numbers, i)), __float_as_int(value));
#else
    float& number = wp::index(numbers, i);
    number = value < number ? value : number;
#endif
"""


@wp.func_native(LOWER)
def lower_to(numbers: wp.array(dtype=float), i: int, value: float):
    """Put a value in place of a larger number; neither is negative, so that their bits are in the same order."""
    ...


@functools.cache
def keep_apart(scalar: type, blocks: int, worlds: bool = False):
    """Compose the kernel that keeps the near pairs apart, in phases; its threads share pairs and particles.

    Where one launch has several phases, all threads belong to one cluster of `blocks` blocks, on the CPU to one
    thread. What a pair knows of the start of the substep is computed once.
    """
    V, W = vector(3, scalar), wp.types.vector(4, scalar)
    Data, Pairs = BodyContactData(scalar, worlds), NearPairs(scalar)
    load, store, _ = records(3, scalar)
    on_triangle, on_segments = nearest_on_triangle(scalar), nearest_on_segments(scalar)
    lacks, count_pushes, push, apply = pair_impulses(scalar, worlds)
    zero, one = scalar(0.0), scalar(1.0)
    rounding = scalar(ROUNDING * (1.2e-7 if scalar is wp.float32 else 2.3e-16))

    @wp.func
    def place_of(
        first: wp.array(dtype=int),
        particle: wp.array(dtype=int),
        weight: wp.array(dtype=scalar),
        x: wp.array(dtype=V),
        v: int,
    ) -> V:
        place = V()
        for s in range(first[v], first[v + 1]):
            place += weight[s] * load(x, particle[s])
        return place

    @wp.func
    def gap_along(normal: V, b: V, c: V, d: V, edges: bool) -> scalar:
        """Return how far apart the two of a pair are along a direction [m]; its first vertex is at 0."""
        lowest = zero
        highest = wp.max(wp.dot(normal, c), wp.dot(normal, d))
        if edges:
            lowest = wp.min(zero, wp.dot(normal, b))
        else:
            highest = wp.max(highest, wp.dot(normal, b))
        return lowest - highest

    @wp.func
    def measure(data: Data, pairs: Pairs, x: wp.array(dtype=V), least: scalar, k: int):
        """Find the nearest points of a pair and the direction of its plane, where the substep begins."""
        vertices = pairs.vertices[k]
        f, p, w = data.surfaces.first, data.surfaces.particle, data.surfaces.weight
        a = place_of(f, p, w, x, vertex_of(vertices, 0))
        b = place_of(f, p, w, x, vertices[1]) - a
        c = place_of(f, p, w, x, vertices[2]) - a
        d = place_of(f, p, w, x, vertices[3]) - a
        weights = W()
        away = V()
        across = V()
        edges = vertices[0] < 0
        if edges:
            shares = on_segments(V(), b, c, d)
            s = shares[0]
            t = shares[1]
            weights = W(one - s, s, t - one, -t)
            away = s * b - (one - t) * c - t * d
            across = wp.normalize(wp.cross(b, d - c))
        else:
            on = on_triangle(V(), b, c, d)
            weights = W(one, -on[0], -on[1], -on[2])
            away = -(on[0] * b + on[1] * c + on[2] * d)
            across = wp.normalize(wp.cross(c - b, d - b))
        # The nearest points of edges that are almost parallel, or very near, are not exact: of two directions that
        # one is taken along which the two are farther apart.
        away = wp.normalize(away)
        if wp.dot(across, away) < zero:
            across = -across
        normal = away
        gap = gap_along(away, b, c, d, edges)
        other_gap = gap_along(across, b, c, d, edges)
        if other_gap > gap:
            normal = across
            gap = other_gap
        pairs.weights[k] = weights
        pairs.gap[k] = gap
        pairs.normal[k] = normal
        # With smaller gaps rounding would decide on which side a vertex is.
        pairs.least[k] = wp.max(least, rounding * wp.max(wp.abs(a)))

    @wp.func
    def follow(
        x: wp.array(dtype=V),
        x_out: wp.array(dtype=V),
        v_out: wp.array(dtype=V),
        h: scalar,
        least: scalar,
        i: int,
    ):
        """Let a driven particle that was held back catch up no faster than at twice its speed."""
        way = h * load(v_out, i)
        behind = load(x_out, i) - load(x, i) - way
        most = wp.max(wp.length(way), scalar(CATCH_UP) * least)
        if wp.length(behind) > most:
            store(x_out, i, load(x, i) + way + (most / wp.length(behind)) * behind)

    @wp.func
    def way_towards(data: Data, x: wp.array(dtype=V), x_out: wp.array(dtype=V), v: int, normal: V) -> scalar:
        """Return how far a vertex goes against a direction, at most, if its particles go a part of their ways."""
        way = zero
        for s in range(data.surfaces.first[v], data.surfaces.first[v + 1]):
            i = data.surfaces.particle[s]
            way += data.surfaces.weight[s] * wp.max(zero, -wp.dot(load(x_out, i) - load(x, i), normal))
        return way

    @wp.func
    def shorten(data: Data, pairs: Pairs, x: wp.array(dtype=V), x_out: wp.array(dtype=V), k: int):
        """Shorten the ways of the particles of a pair where they lead to its plane."""
        normal = pairs.normal[k]
        gap = pairs.gap[k]
        if gap <= zero:
            return
        vertices = pairs.vertices[k]
        firsts = int(1)
        if vertices[0] < 0:
            firsts = 2
        ways = W()
        furthest_first = zero
        furthest_second = zero
        mobility_first = zero
        mobility_second = zero
        for m in range(4):
            v = vertex_of(vertices, m)
            mobility = data.surfaces.mobility[v]
            if m < firsts:
                ways[m] = way_towards(data, x, x_out, v, normal)
                furthest_first = wp.max(furthest_first, ways[m])
                mobility_first += mobility
            else:
                ways[m] = way_towards(data, x, x_out, v, -normal)
                furthest_second = wp.max(furthest_second, ways[m])
                mobility_second += mobility
        if furthest_first + furthest_second <= scalar(ALLOWED) * (gap - scalar(2.0) * pairs.least[k]):
            return
        # Where the plane is, from the second one on: the faster one has more room, and one that is driven as much
        # as it needs.
        share = furthest_second / (furthest_first + furthest_second)
        if mobility_first == zero and mobility_second > zero:
            share = one - (furthest_first / scalar(ALLOWED) + pairs.least[k]) / gap
        if mobility_second == zero and mobility_first > zero:
            share = (furthest_second / scalar(ALLOWED) + pairs.least[k]) / gap
        share = wp.clamp(share, scalar(LEAST_SHARE), one - scalar(LEAST_SHARE))
        f, p, w = data.surfaces.first, data.surfaces.particle, data.surfaces.weight
        origin = place_of(f, p, w, x, vertices[3])
        highest = zero  # of the second one
        for m in range(firsts, 3):
            highest = wp.max(highest, wp.dot(place_of(f, p, w, x, vertices[m]) - origin, normal))
        for m in range(4):
            if ways[m] > zero:
                v = vertex_of(vertices, m)
                height = wp.dot(place_of(f, p, w, x, v) - origin, normal) - highest - share * gap
                if m >= firsts:
                    height = -height
                allowed = scalar(ALLOWED) * wp.max(zero, height - pairs.least[k])
                if ways[m] > allowed:
                    for s in range(f[v], f[v + 1]):
                        lower_to(pairs.share, p[s], wp.float32(0.9999 * wp.float32(allowed / ways[m])))

    @wp.func
    def hold_back(
        pairs: Pairs, x: wp.array(dtype=V), x_out: wp.array(dtype=V), v_out: wp.array(dtype=V), h: scalar, i: int
    ) -> float:
        """Shorten the way of a particle; return by how much [m]."""
        share = scalar(pairs.share[i])
        if share == one:
            return float(0.0)
        pairs.share[i] = 1.0
        way = load(x_out, i) - load(x, i)
        lost = (share - one) * way
        store(x_out, i, load(x, i) + share * way)
        store(v_out, i, load(v_out, i) + lost / h)
        if pairs.contact_impulse.shape[0] > 0 and pairs.inverse_mass[i] > zero:
            pairs.contact_impulse[i] += wp.vec3d(lost) / wp.float64(h * pairs.inverse_mass[i])
        return float(wp.length(lost))

    @wp.func
    def act(
        data: Data,
        pairs: Pairs,
        x: wp.array(dtype=V),
        x_out: wp.array(dtype=V),
        per_unit: wp.float64,
        phase: int,
        k: int,
    ):
        """Do a phase's part for a pair."""
        if phase == wp.static(PHASES - 2):
            shorten(data, pairs, x, x_out, k)
        elif pairs.gap[k] > zero:
            way, lack = lacks(data, pairs, x, x_out, k)
            if lack > zero:
                if phase % 3 == 1:
                    count_pushes(data, pairs, k)
                else:
                    push(data, pairs, k, way, lack, per_unit)

    def keep(
        data: Data,
        pairs: Pairs,
        x: wp.array(dtype=V),  # where the substep began
        h: scalar,  # its length [s]
        per_unit: wp.float64,  # of impulses [1/(kg m)]
        least: scalar,  # the least distance from a plane [m]
        particles: int,  # of a world
        first_phase: int,
        last_phase: int,
        threads: int,
        # In and out: where it ends
        x_out: wp.array(dtype=V),
        v_out: wp.array(dtype=V),
        flags: wp.array(dtype=float),
    ):
        count = wp.min(pairs.count[0], pairs.vertices.shape[0])
        if count == 0 and pairs.driven.shape[0] == 0:
            return
        for phase in range(first_phase, last_phase + 1):
            of_particles = phase == wp.static(PHASES - 1) or (phase % 3 == 0 and phase > 0)
            n = wp.tid()
            if of_particles:
                while n < pairs.particle_count[0]:
                    i = pairs.particle[n]
                    if phase < wp.static(PHASES - 2):
                        apply(pairs, x, x_out, v_out, h, wp.float64(1.0) / per_unit, i)
                    else:
                        lost = hold_back(pairs, x, x_out, v_out, h, i)
                        if lost > 0.0:
                            raise_to(flags, (i / particles) * wp.static(FLAGS) + wp.static(HELD_BACK), lost)
                    n += threads
            else:
                while n < count:
                    if phase == 0:
                        measure(data, pairs, x, least, n)
                    else:
                        act(data, pairs, x, x_out, per_unit, phase, n)
                    n += threads
            if phase == 0:
                n = wp.tid()
                while n < pairs.driven.shape[0]:
                    follow(x, x_out, v_out, h, least, pairs.driven[n])
                    n += threads
            if phase < last_phase:
                wait()

    return kernel(keep, launch_bounds=MOST_THREADS, cluster_dim=blocks)
