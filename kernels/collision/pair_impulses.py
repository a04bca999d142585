"""Impulses between the two sides of pairs that come too near within a substep, or are held back in it.

The first side is the vertex or the first edge, the second side the triangle or the second edge.
"""

import functools

import warp as wp

from ..basis import vector
from ..partition import raise_to
from ..records import records
from .contact_data import NearPairs
from .near_pairs import vertex_of

KEPT = 0.5
"""Fraction of a pair's gap that impulses try to keep in a substep, unless the gap remains wide."""
LARGEST_APPROACH = 0.8
"""Fraction of gap − least gap that a pair may lose between any two vertices, unless the gap remains wide."""
LATE_APPROACH = 0.9
"""Late rounds ignore pairs that lose less than this fraction: rounds converge to LARGEST_APPROACH without end."""
HOLD_BEYOND = 0.95
"""Particles are held back if a pair loses more than this fraction of its gap, less half of the least gap. That is
more than late rounds ignore, by more than rounding: no pair is held back that impulses could keep apart."""
ALL_KEPT = 4.0
"""Below this multiple of the least gap, impulses try to keep all of the gap."""


@functools.cache
def pair_impulses(scalar: type):
    """Compose (may_lose, may_approach, lacks, count_pushes, push, apply).

    `may_lose` returns by how much the gap of a pair may shrink in a substep before impulses act [m],
    `may_approach` by how much any two of its vertices may approach before they are held back [m].
    `lacks` finds where the gap shrinks most. It returns (weights, nearest, way, lack): the weights of the vertices
    there; whether these are the nearest points; the displacement of the first side relative to the second in the
    substep [m]; and how far the gap shrinks beyond what is allowed [m], at most 0 if it is allowed.
    `late` rounds are only for pairs that would be held back otherwise.
    In a round each pair adds 1 to `pushes` of its particles, then its impulses; then each particle applies them.
    """
    V, W, Units = vector(3, scalar), wp.types.vector(4, scalar), wp.types.vector(3, wp.int64)
    Pairs, (load, store, _) = NearPairs(scalar), records(3, scalar)
    zero, kept = scalar(0.0), scalar(KEPT)

    @wp.func
    def way_of(pairs: Pairs, x: wp.array(dtype=V), x_out: wp.array(dtype=V), v: int) -> V:
        """Return the displacement of vertex v in the substep [m]."""
        way = V()
        for s in range(pairs.first_particle[v], pairs.first_particle[v + 1]):
            i = pairs.particle_of[s]
            way += pairs.weight[s] * (load(x_out, i) - load(x, i))
        return way

    @wp.func
    def count_pushes(pairs: Pairs, k: int, weights: W):
        vertices = pairs.vertices[k]
        for m in range(4):
            if weights[m] != zero:
                v = vertex_of(vertices, m)
                for s in range(pairs.first_particle[v], pairs.first_particle[v + 1]):
                    wp.atomic_add(pairs.pushes, pairs.particle_of[s], 1)

    @wp.func
    def push(pairs: Pairs, k: int, weights: W, nearest: bool, way: V, lack: scalar, per_unit: wp.float64):
        """Add the impulses of pair k, with each particle's mass divided by the number of pairs that push it.

        At the nearest points they reduce the approach by `lack` for restitution 0, reverse it for restitution 1,
        and include friction; at other points they only reduce the approach by `lack`.
        """
        vertices = pairs.vertices[k]
        normal = pairs.normal[k]
        mine = pairs.body_of[vertex_of(vertices, 0)]
        other = pairs.body_of[vertices[3]]
        rule = pairs.rules[pairs.kind[mine], pairs.kind[other]]
        approach = -wp.dot(way, normal)
        along = way + approach * normal
        e = pairs.restitution[rule]
        across = lack
        slip = wp.length(along)
        if nearest:
            across += e * (scalar(2.0) * approach - lack)
        change = across * normal
        if nearest and slip > zero:
            change -= (wp.min(pairs.friction[rule] * across, slip) / slip) * along
        mobility = zero
        for m in range(4):
            v = vertex_of(vertices, m)
            for s in range(pairs.first_particle[v], pairs.first_particle[v + 1]):
                i = pairs.particle_of[s]
                share = weights[m] * pairs.weight[s]
                mobility += share * share * scalar(pairs.pushes[i]) * pairs.inverse_mass[i]
        if mobility > zero:
            impulse = change / mobility
            total = Units()
            for c in range(3):
                total[c] = wp.int64(wp.float64(impulse[c]) * per_unit)
            # The impulses on both sides sum to exactly 0: one pushed vertex of the first side gets the rest that
            # rounding leaves.
            rest = Units()
            for m in range(3, -1, -1):
                v = vertex_of(vertices, m)
                begin = pairs.first_particle[v]
                on_vertex = Units()
                for c in range(3):
                    on_vertex[c] = wp.int64(wp.float64(total[c]) * wp.float64(weights[m]))
                    if m == 0 or (m == 1 and weights[0] == zero):
                        on_vertex[c] = rest[c]
                    rest[c] = rest[c] - on_vertex[c]
                for s in range(begin + 1, pairs.first_particle[v + 1]):
                    for c in range(3):
                        part = wp.int64(wp.float64(on_vertex[c]) * wp.float64(pairs.weight[s]))
                        on_vertex[c] = on_vertex[c] - part
                        wp.atomic_add(pairs.impulse, pairs.particle_of[s], c, part)
                for c in range(3):
                    wp.atomic_add(pairs.impulse, pairs.particle_of[begin], c, on_vertex[c])

    @wp.func
    def apply(
        pairs: Pairs,
        x: wp.array(dtype=V),
        x_out: wp.array(dtype=V),
        v_out: wp.array(dtype=V),
        h: scalar,
        unit: wp.float64,
        moves: bool,
        i: int,
    ):
        """Change the velocity of particle i, and if it `moves` its position, by the impulses of its pairs.

        Then clear the impulses.
        """
        if pairs.pushes[i] != 0:
            moved = V()
            impulse = wp.vec3d()
            for c in range(3):
                impulse[c] = wp.float64(pairs.impulse[i, c]) * unit
                moved[c] = scalar(impulse[c]) * pairs.inverse_mass[i]
                pairs.impulse[i, c] = wp.int64(0)
            impulse = impulse / wp.float64(h)
            pairs.pushes[i] = 0
            if pairs.contact_impulse.shape[0] > 0:
                pairs.contact_impulse[i] += impulse
            if pairs.done.shape[0] > 0 and pairs.inverse_mass[i] == zero:
                speed = wp.vec3d(load(x_out, i) - load(x, i)) / wp.float64(h)
                pairs.done[i] -= wp.dot(impulse, speed)
            store(v_out, i, load(v_out, i) + moved / h)
            if not moves:
                return
            shift = pairs.shift[i] + float(wp.length(moved))
            pairs.shift[i] = shift
            if shift > pairs.most_shift[pairs.body[i]]:
                raise_to(pairs.most_shift, pairs.body[i], shift)
            if shift > pairs.foreseen[pairs.body[i]]:
                pairs.exceeded[0] = 1
            store(x_out, i, load(x_out, i) + moved)

    @wp.func
    def may_lose(gap: scalar, least: scalar, apart: scalar) -> scalar:
        share = (scalar(1.0) - kept) * (gap - scalar(ALL_KEPT) * least)
        return wp.max(zero, wp.max(share, gap - apart))

    @wp.func
    def may_approach(gap: scalar, least: scalar, apart: scalar) -> scalar:
        return wp.max(scalar(HOLD_BEYOND) * gap - scalar(0.5) * least, gap - apart)

    @wp.func
    def lacks(pairs: Pairs, x: wp.array(dtype=V), x_out: wp.array(dtype=V), apart: scalar, late: bool, k: int):
        vertices = pairs.vertices[k]
        weights = pairs.weights[k]
        gap = pairs.gap[k]
        way = V()
        rises = W()
        for m in range(4):
            of_vertex = way_of(pairs, x, x_out, vertex_of(vertices, m))
            way += weights[m] * of_vertex
            rises[m] = wp.dot(of_vertex, pairs.normal[k])
        lack = -wp.dot(way, pairs.normal[k]) - may_lose(gap, pairs.least[k], apart)
        nearest = lack > zero and not late
        if not nearest:
            # If a side rotates, another of its vertices may be faster.
            first = int(0)
            second = int(3)
            if vertices[0] < 0 and rises[1] < rises[0]:
                first = int(1)
            if rises[2] > rises[second]:
                second = int(2)
            if vertices[0] >= 0 and rises[1] > rises[second]:
                second = int(1)
            approach = rises[second] - rises[first]
            room = wp.max(zero, gap - pairs.least[k])
            lack = approach - wp.max(scalar(LARGEST_APPROACH) * room, gap - apart)
            if late and approach <= wp.max(scalar(LATE_APPROACH) * room, gap - apart):
                lack = zero
            way = way_of(pairs, x, x_out, vertex_of(vertices, first))
            way -= way_of(pairs, x, x_out, vertex_of(vertices, second))
            weights = W()
            weights[first] = scalar(1.0)
            weights[second] = scalar(-1.0)
        return weights, nearest, way, lack

    return may_lose, may_approach, lacks, count_pushes, push, apply


@functools.cache
def shared_velocities(scalar: type):
    """Compose (count_shared, share_velocity), by which holding back keeps momentum.

    Where a particle of a pair is held back, the pair collides plastically by the same fraction: f = 1 − the least
    fraction of displacement that any of its particles makes. Particle i in n_i such pairs has the velocity
    v_i + Σ f_k (c_k − v_i) / n_i afterwards, where c_k is the mean velocity of pair k, weighted by m_i / n_i. The
    impulses of each pair sum to 0. New velocities are means of old ones, so kinetic energy cannot rise. If a
    particle of the pair is pinned, c_k is 0: it takes the momentum. Not for systems with driven particles.
    `count_shared` counts n_i in `pushes`, then `share_velocity` adds the impulses.
    """
    V, Units = vector(3, scalar), wp.types.vector(3, wp.int64)
    Pairs, load = NearPairs(scalar), records(3, scalar).load
    zero, one = scalar(0.0), scalar(1.0)

    @wp.func
    def held_fraction(pairs: Pairs, k: int) -> scalar:
        """Return the largest fraction of its displacement that a particle of pair k loses, else 0."""
        least = one
        if pairs.gap[k] > zero:
            for m in range(4):
                v = vertex_of(pairs.vertices[k], m)
                for s in range(pairs.first_particle[v], pairs.first_particle[v + 1]):
                    least = wp.min(least, scalar(pairs.share[pairs.particle_of[s]]))
        return one - least

    @wp.func
    def count_shared(pairs: Pairs, k: int):
        if held_fraction(pairs, k) > zero:
            for m in range(4):
                v = vertex_of(pairs.vertices[k], m)
                for s in range(pairs.first_particle[v], pairs.first_particle[v + 1]):
                    wp.atomic_add(pairs.pushes, pairs.particle_of[s], 1)

    @wp.func
    def share_velocity(pairs: Pairs, x: wp.array(dtype=V), x_out: wp.array(dtype=V), per_unit: wp.float64, k: int):
        fraction = held_fraction(pairs, k)
        if fraction == zero:
            return
        mass = zero
        moved = V()  # sum of mass times displacement [kg m]
        pinned = bool(False)
        last = int(0)
        for m in range(4):
            v = vertex_of(pairs.vertices[k], m)
            for s in range(pairs.first_particle[v], pairs.first_particle[v + 1]):
                i = pairs.particle_of[s]
                if pairs.inverse_mass[i] == zero:
                    pinned = True
                    last = i
                else:
                    part = one / (pairs.inverse_mass[i] * scalar(pairs.pushes[i]))
                    mass += part
                    moved += part * (load(x_out, i) - load(x, i))
        if mass == zero:
            return
        mean = moved / mass
        if pinned:
            mean = V()
        rest = Units()
        for m in range(4):
            v = vertex_of(pairs.vertices[k], m)
            for s in range(pairs.first_particle[v], pairs.first_particle[v + 1]):
                i = pairs.particle_of[s]
                if pairs.inverse_mass[i] > zero:
                    part = fraction / (pairs.inverse_mass[i] * scalar(pairs.pushes[i]))
                    change = part * (mean - (load(x_out, i) - load(x, i)))
                    if not pinned:
                        last = i
                    for c in range(3):
                        units = wp.int64(wp.float64(change[c]) * per_unit)
                        rest[c] = rest[c] - units
                        wp.atomic_add(pairs.impulse, i, c, units)
        # The impulses of the pair sum to exactly 0: one particle gets the rest, a pinned one if there is any.
        for c in range(3):
            wp.atomic_add(pairs.impulse, last, c, rest[c])

    return count_shared, share_velocity
