"""Impulses between the two sides of pairs that come too near within a substep, or are held back in it.

The first side is the vertex or the first edge, the second side the triangle or the second edge.
"""

import functools

import warp as wp

from ..basis import fast_kernel, vector
from ..partition import count_up
from ..records import records
from ..threads import grid_thread
from .contact_data import Motion, NearPairs
from .near_pairs import vertex_of

KEPT = 0.8
"""Fraction of its gap that a pair keeps in a substep, unless the gap stays wide; below the floor it keeps all."""
LARGEST_APPROACH = 0.8
"""Fraction of gap − least gap that a pair may lose between any two vertices, unless the gap remains wide."""
HOLD_BEYOND = 0.95
"""Particles are held back if a pair loses more than this fraction of its gap, less half of the least gap."""
WATCHED = 0.5
"""Pairs are tested again after impulses only if they may then come too near by this fraction of `activation`. If
any particle moves more than half as far, all are tested."""


@functools.cache
def limits(scalar: type):
    """Compose (may_lose, may_approach), for a pair k with some gap [m].

    `may_lose` returns by how much the gap may shrink in a substep before impulses act [m], `may_approach` by how
    much any two vertices of the pair may approach before they are held back [m].
    """
    Pairs, zero, kept = NearPairs(scalar), scalar(0.0), scalar(KEPT)

    @wp.func
    def may_lose(pairs: Pairs, k: int, gap: scalar, activation: scalar) -> scalar:
        bodies = pairs.bodies[k]
        floor = pairs.floor[bodies[0]] + pairs.floor[bodies[1]]
        loss = wp.min((scalar(1.0) - kept) * gap, gap - floor)
        return wp.max(zero, wp.max(loss, gap - activation))

    @wp.func
    def may_approach(gap: scalar, least: scalar, activation: scalar) -> scalar:
        return wp.max(scalar(HOLD_BEYOND) * gap - scalar(0.5) * least, gap - activation)

    return may_lose, may_approach


@functools.cache
def find_violations(scalar: type):
    """Compose the kernel that begins a round: it lists pairs which come too near, and counts them on particles.

    The threads divide the pairs. `number` is that of the round, from 0; if negative, `pairs.round` is used.
    """
    V, W = vector(3, scalar), wp.types.vector(4, scalar)
    Pairs, Moving, load = NearPairs(scalar), Motion(scalar), records(3, scalar).load
    may_lose, zero = limits(scalar)[0], scalar(0.0)

    @wp.func
    def displacement_of(pairs: Pairs, x: wp.array(dtype=V), x_out: wp.array(dtype=V), v: int) -> V:
        """Return the displacement of vertex v in the substep [m]."""
        total = V()
        for s in range(pairs.first_particle[v], pairs.first_particle[v + 1]):
            i = pairs.particle_of[s]
            total += pairs.weight[s] * (load(x_out, i) - load(x, i))
        return total

    @wp.func
    def violation(pairs: Pairs, motion: Moving, k: int):
        """Return where the gap of pair k shrinks most, and by how much the approach there is to be reduced [m].

        The place is given by the weights of the vertices. The reduction is at most 0 if the approach is allowed.
        """
        x, x_out, activation = motion.x, motion.x_out, motion.activation
        vertices = pairs.vertices[k]
        weights = pairs.weights[k]
        gap = pairs.gap[k]
        approach = zero
        rises = W()
        for m in range(4):
            of_vertex = displacement_of(pairs, x, x_out, vertex_of(vertices, m))
            approach -= weights[m] * wp.dot(of_vertex, pairs.normal[k])
            rises[m] = wp.dot(of_vertex, pairs.normal[k])
        change = approach - may_lose(pairs, k, gap, activation)
        if change > zero:
            # What bounces is back where it began. What is fast has hardly met springs of contact, which would have
            # thrown it back; what is pressed slowly would get more energy than it loses.
            bodies = pairs.bodies[k]
            e = pairs.restitution[pairs.rules[pairs.kind[bodies[0]], pairs.kind[bodies[1]]]]
            change += e * (approach - change)
            if approach > activation:
                change += e * approach
        else:
            # If a side rotates, another of its vertices may be faster. This exerts a moment, unlike the above.
            first = int(0)
            second = int(3)
            if vertices[0] < 0 and rises[1] < rises[0]:
                first = int(1)
            if rises[2] > rises[second]:
                second = int(2)
            if vertices[0] >= 0 and rises[1] > rises[second]:
                second = int(1)
            room = wp.max(zero, gap - pairs.least[k])
            change = rises[second] - rises[first] - wp.max(scalar(LARGEST_APPROACH) * room, gap - activation)
            weights = W()
            weights[first] = scalar(1.0)
            weights[second] = scalar(-1.0)
        return weights, change

    @wp.func
    def count_pushes(pairs: Pairs, k: int, weights: W):
        for m in range(4):
            if weights[m] != zero:
                v = vertex_of(pairs.vertices[k], m)
                for s in range(pairs.first_particle[v], pairs.first_particle[v + 1]):
                    wp.atomic_add(pairs.pushes, pairs.particle_of[s], 1)

    @fast_kernel
    def find(pairs: Pairs, motion: Moving, number: int, threads: int):
        this = number
        if number < 0:
            this = pairs.round[0]
        every = pairs.exceeded[0] != 0
        last = pairs.watched_count[0]
        if every:
            last = wp.min(pairs.count[0], pairs.vertices.shape[0])
        n = grid_thread()
        while n < last:
            k = n
            if not every:
                k = pairs.watched[n]
            if pairs.gap[k] > zero:
                weights, change = violation(pairs, motion, k)
                if change > zero:
                    pairs.violated[0] = this + 1
                    at = count_up(pairs.pushing_count, 0)
                    pairs.pushing[at] = k
                    pairs.pushed[at] = weights
                    pairs.change[at] = change
                    count_pushes(pairs, k, weights)
            n += threads

    return find


@functools.cache
def push_pairs(scalar: type):
    """Compose the kernel that adds the impulses of the pairs of a round; its threads divide these pairs."""
    W, Pairs, Moving, zero = wp.types.vector(4, scalar), NearPairs(scalar), Motion(scalar), scalar(0.0)

    @wp.func
    def push(pairs: Pairs, k: int, weights: W, change: scalar, per_unit: wp.float64):
        """Add the impulses of pair k, with each particle's mass divided by the number of pairs that push it.

        They act along the normal, at nearest points, so that they exert no moment. They reduce the approach by
        `change` [m].
        """
        vertices = pairs.vertices[k]
        mobility = zero
        for m in range(4):
            v = vertex_of(vertices, m)
            for s in range(pairs.first_particle[v], pairs.first_particle[v + 1]):
                i = pairs.particle_of[s]
                weight = weights[m] * pairs.weight[s]
                mobility += weight * weight * scalar(pairs.pushes[i]) * pairs.inverse_mass[i]
        if mobility == zero:
            return
        impulse = change / mobility * pairs.normal[k]
        for c in range(3):
            total = wp.int64(wp.float64(impulse[c]) * per_unit)
            # The impulses on both sides sum to exactly 0: one pushed vertex of the first side gets the rest that
            # rounding leaves.
            rest = wp.int64(0)
            for m in range(3, -1, -1):
                v = vertex_of(vertices, m)
                begin = pairs.first_particle[v]
                on_vertex = wp.int64(wp.float64(total) * wp.float64(weights[m]))
                if m == 0 or (m == 1 and weights[0] == zero):
                    on_vertex = rest
                rest -= on_vertex
                for s in range(begin + 1, pairs.first_particle[v + 1]):
                    part = wp.int64(wp.float64(on_vertex) * wp.float64(pairs.weight[s]))
                    on_vertex -= part
                    wp.atomic_add(pairs.impulse, pairs.particle_of[s], c, part)
                wp.atomic_add(pairs.impulse, pairs.particle_of[begin], c, on_vertex)

    @fast_kernel
    def push_apart(pairs: Pairs, motion: Moving, number: int, threads: int):
        n = grid_thread()
        while n < pairs.pushing_count[0]:
            push(pairs, pairs.pushing[n], pairs.pushed[n], pairs.change[n], motion.per_unit)
            n += threads

    return push_apart


@functools.cache
def move_pushed(scalar: type):
    """Compose the kernel that ends a round: particles move by their impulses. Its threads divide the particles."""
    V, (load, store, _) = vector(3, scalar), records(3, scalar)
    Pairs, Moving, zero = NearPairs(scalar), Motion(scalar), scalar(0.0)

    @wp.func
    def apply(pairs: Pairs, motion: Moving, i: int):
        """Change the velocity of particle i, and its position, by the impulses of its pairs.

        Then clear the impulses.
        """
        if pairs.pushes[i] != 0:
            x_out, h, unit = motion.x_out, motion.h, wp.float64(1.0) / motion.per_unit
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
                speed = wp.vec3d(load(x_out, i) - load(motion.x, i)) / wp.float64(h)
                pairs.done[i] -= wp.dot(impulse, speed)
            store(motion.v_out, i, load(motion.v_out, i) + moved / h)
            shift = pairs.shift[i] + float(wp.length(moved))
            pairs.shift[i] = shift
            if pairs.most_weight * shift > wp.static(0.5 * WATCHED) * float(motion.activation):
                pairs.exceeded[0] = 1
            store(x_out, i, load(x_out, i) + moved)

    @fast_kernel
    def move(pairs: Pairs, motion: Moving, number: int, threads: int):
        n = grid_thread()
        if n == 0:
            pairs.pushing_count[0] = 0
        while n < pairs.particle_count[0]:
            apply(pairs, motion, pairs.particle[n])
            n += threads

    return move
