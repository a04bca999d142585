"""The gap of each near pair where a substep begins, and whether the pair comes too near in the substep."""

import functools

import warp as wp

from ..basis import fast_kernel, vector
from ..partition import count_up, first_of_part, next_of_part, raise_to
from ..records import records
from ..threads import grid_thread
from .contact_data import PAIRS, BodyContactData, NearPairs
from .near_pairs import vertex_of
from .nearest_point import shortest_line
from .pair_impulses import WATCHED, limits

ROUNDING = 4.0
"""The least gap, as a multiple of the spacing of floating-point numbers at the coordinates of the pair."""

AHEAD = 2.0
"""Surfaces must be kept apart if they may come near each other in this many substeps at their present speed,
which may increase."""


@functools.cache
def displacements(scalar: type):
    """Compose (place_of, displacement_towards, approach_of).

    `place_of` returns a vertex's position. `displacement_towards` returns the most that it may move against a
    normal [m], whichever of its particles are held back: only particles that move against the normal count.
    `approach_of` returns how far the two sides of a pair approach along its normal if no particle is held back
    [m].
    """
    V, load = vector(3, scalar), records(3, scalar).load
    Pairs, W = NearPairs(scalar), wp.types.vector(4, scalar)

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
    def displacement_towards(
        pairs: Pairs, x: wp.array(dtype=V), x_out: wp.array(dtype=V), v: int, normal: V
    ) -> scalar:
        total = scalar(0.0)  # each particle may make only a part of its displacement; weights may be negative
        for s in range(pairs.first_particle[v], pairs.first_particle[v + 1]):
            i = pairs.particle_of[s]
            total += wp.max(scalar(0.0), -pairs.weight[s] * wp.dot(load(x_out, i) - load(x, i), normal))
        return total

    @wp.func
    def approach_of(pairs: Pairs, x: wp.array(dtype=V), x_out: wp.array(dtype=V), k: int) -> scalar:
        vertices = pairs.vertices[k]
        f, p, w = pairs.first_particle, pairs.particle_of, pairs.weight
        rise = W()
        for m in range(4):
            v = vertex_of(vertices, m)
            rise[m] = wp.dot(place_of(f, p, w, x_out, v) - place_of(f, p, w, x, v), pairs.normal[k])
        second = wp.max(rise[2], rise[3])
        first = rise[0]
        if vertices[0] < 0:
            first = wp.min(first, rise[1])
        else:
            second = wp.max(second, rise[1])
        return second - first

    return place_of, displacement_towards, approach_of


@functools.cache
def measure_pairs(scalar: type, watched: bool):
    """Compose the kernel that finds the gap of each near pair, and sets `alarm` if any comes too near.

    Only the current substep is tested. Without an alarm `keep_apart` does nothing. The kernel also lists the pairs
    that impulses may bring too near. Its threads divide the pairs. If `watched`, it does nothing unless
    `find_alarm` has found that surfaces may meet.
    """
    V, Pairs, zero, shortest = vector(3, scalar), NearPairs(scalar), scalar(0.0), shortest_line(scalar)
    (place_of, _, approach_of), (may_lose, may_approach) = displacements(scalar), limits(scalar)
    rounding = scalar(ROUNDING * (1.2e-7 if scalar is wp.float32 else 2.3e-16))

    @wp.func
    def gap_along(normal: V, b: V, c: V, d: V, edges: bool) -> scalar:
        """Return the gap along a normal [m], negative if the two sides of the pair overlap.

        The sides are vertex a and triangle bcd or, with `edges`, edges ab and cd. a is the origin; the normal
        points from the triangle to the vertex, or from cd to ab.
        """
        lowest = zero
        highest = wp.max(wp.dot(normal, c), wp.dot(normal, d))
        if edges:
            lowest = wp.min(zero, wp.dot(normal, b))
        else:
            highest = wp.max(highest, wp.dot(normal, b))
        return lowest - highest

    @wp.func
    def measure(pairs: Pairs, x: wp.array(dtype=V), least: scalar, k: int):
        """Store the nearest points of pair k, the normal of its plane and its gap at the substep's start."""
        vertices = pairs.vertices[k]
        f, p, w = pairs.first_particle, pairs.particle_of, pairs.weight
        a = place_of(f, p, w, x, vertex_of(vertices, 0))
        b = place_of(f, p, w, x, vertices[1]) - a
        c = place_of(f, p, w, x, vertices[2]) - a
        d = place_of(f, p, w, x, vertices[3]) - a
        edges = vertices[0] < 0
        weights, away = shortest(b, c, d, edges)
        across = wp.cross(c - b, d - b)
        if edges:
            across = wp.cross(b, d - c)
        across = wp.normalize(across)
        # The nearest points of almost parallel or very near edges are inexact. So of two directions the normal
        # is the one along which the gap is larger.
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
        # With a smaller gap, rounding would decide on which side a vertex is.
        pairs.least[k] = wp.max(least, rounding * wp.max(wp.abs(a)))

    @fast_kernel
    def find(
        pairs: Pairs,
        x: wp.array(dtype=V),  # positions at the substep's start [m]
        x_out: wp.array(dtype=V),  # positions at its end [m]
        least: scalar,  # the least distance from a plane [m]
        activation: scalar,  # beyond this distance pairs are left alone [m]
        threads: int,  # in each part
        part: int,
        parts: int,  # number of parts, one for each CPU thread
    ):
        if wp.static(watched):
            if pairs.may_meet[0] == 0:
                return
        count = wp.min(pairs.count[0], pairs.vertices.shape[0])
        k = first_of_part(grid_thread(), part)
        if k == 0:
            pairs.violated[0] = 0
            pairs.cutting[0] = 0
        while k < count:
            measure(pairs, x, least, k)
            gap = pairs.gap[k]
            if gap > zero:
                approach = approach_of(pairs, x, x_out, k)
                allowed = may_lose(pairs, k, gap, activation)
                if approach > allowed:
                    pairs.alarm[0] = 1
                slack = wp.min(allowed, may_approach(gap, pairs.least[k], activation)) - approach
                if slack - pairs.least[k] <= scalar(wp.static(1.001 * WATCHED)) * activation:
                    pairs.watched[count_up(pairs.watched_count, 0)] = k
            k = next_of_part(k, threads, parts)

    return find


@functools.cache
def find_alarm(scalar: type):
    """Compose the kernel that tests whether surfaces may meet; then it sets `may_meet` and counts pairs.

    Two sides of a pair may meet if they can come within `activation` in `AHEAD` substeps, from the vertices'
    positions when the substep begins. `measure_pairs` would find that later, and takes ten times as long. The
    threads divide the pairs. `flags` gets the number of pairs.
    """
    Data, Pairs = BodyContactData(scalar), NearPairs(scalar)
    load, zero, shortest = records(3, scalar).load, scalar(0.0), shortest_line(scalar)

    @fast_kernel
    def find(
        data: Data,
        pairs: Pairs,
        activation: scalar,  # beyond this distance pairs are left alone [m]
        h: scalar,  # length of the substep [s]
        threads: int,  # in each part
        part: int,
        parts: int,  # number of parts, one for each CPU thread
        flags: wp.array(dtype=float),
    ):
        count = wp.min(pairs.count[0], pairs.vertices.shape[0])
        k = first_of_part(grid_thread(), part)
        while k < count:
            vertices = pairs.vertices[k]
            first = vertex_of(vertices, 0)
            a = load(data.surfaces.x, first)
            u = load(data.surfaces.v, first)
            b = load(data.surfaces.x, vertices[1]) - a
            c = load(data.surfaces.x, vertices[2]) - a
            d = load(data.surfaces.x, vertices[3]) - a
            fastest = zero
            second = load(data.surfaces.v, vertices[1])
            if vertices[0] >= 0:
                fastest = wp.length(second - u)
                second = u
            for m in range(2, 4):
                v = load(data.surfaces.v, vertices[m])
                fastest = wp.max(fastest, wp.max(wp.length(v - u), wp.length(v - second)))
            _weights, away = shortest(b, c, d, vertices[0] < 0)
            if wp.length(away) < activation + scalar(AHEAD) * h * fastest:
                pairs.may_meet[0] = 1
                if not (flags[wp.static(PAIRS)] >= float(count)):
                    raise_to(flags, wp.static(PAIRS), float(count))
            k = next_of_part(k, threads, parts)

    return find
