"""Impulses between near pairs that come too near each other within a substep."""

import functools

import warp as wp

from ..basis import vector
from ..records import records
from .contact_data import BodyContactData
from .near_pairs import NearPairs, vertex_of

KEPT = 0.5
"""The share of its gap that a pair keeps in a substep, where impulses can, unless it stays far apart."""
ALL_KEPT = 4.0
"""Near its least gap, by this factor, a pair keeps all of it."""


@functools.cache
def pair_impulses(scalar: type, worlds: bool):
    """Compose (may_lose, lacks, count_pushes, push, apply).

    `may_lose` returns how much of its gap a pair may lose in a substep [m]; `lacks` the way of its first one
    relative to the second, and by how much that is too long. In a round each pair counts its pushes, then adds its
    impulses; then each particle applies them.
    """
    V, Units = vector(3, scalar), wp.types.vector(3, wp.int64)
    Data, Pairs = BodyContactData(scalar, worlds), NearPairs(scalar)
    load, store, _ = records(3, scalar)
    zero, kept = scalar(0.0), scalar(KEPT)

    @wp.func
    def way_between(data: Data, pairs: Pairs, x: wp.array(dtype=V), x_out: wp.array(dtype=V), k: int) -> V:
        """Return the way of the first one's nearest point, less that of the second one's [m]."""
        vertices = pairs.vertices[k]
        weights = pairs.weights[k]
        way = V()
        for m in range(4):
            v = vertex_of(vertices, m)
            for s in range(data.surfaces.first[v], data.surfaces.first[v + 1]):
                i = data.surfaces.particle[s]
                way += weights[m] * data.surfaces.weight[s] * (load(x_out, i) - load(x, i))
        return way

    @wp.func
    def count_pushes(data: Data, pairs: Pairs, k: int):
        vertices = pairs.vertices[k]
        weights = pairs.weights[k]
        for m in range(4):
            if weights[m] != zero:
                v = vertex_of(vertices, m)
                for s in range(data.surfaces.first[v], data.surfaces.first[v + 1]):
                    wp.atomic_add(pairs.pushes, data.surfaces.particle[s], 1)

    @wp.func
    def push(data: Data, pairs: Pairs, k: int, way: V, lack: scalar, per_unit: wp.float64):
        """Add the impulses of a pair, which takes each particle for as light as others leave it.

        They leave it the gap that it lacks, or throw it back with the restitution of its rule, with friction.
        """
        vertices = pairs.vertices[k]
        weights = pairs.weights[k]
        normal = pairs.normal[k]
        mine = data.surfaces.body_of[vertex_of(vertices, 0)]
        other = data.surfaces.body_of[vertices[3]]
        rule = data.rules.table[data.rules.kind[mine], data.rules.kind[other]]
        approach = -wp.dot(way, normal)
        along = way + approach * normal
        e = pairs.restitution[rule]
        across = lack + e * (scalar(2.0) * approach - lack)
        slip = wp.length(along)
        change = across * normal
        if slip > zero:
            change -= (wp.min(data.rules.friction[rule] * across, slip) / slip) * along
        mobility = zero
        for m in range(4):
            v = vertex_of(vertices, m)
            for s in range(data.surfaces.first[v], data.surfaces.first[v + 1]):
                i = data.surfaces.particle[s]
                share = weights[m] * data.surfaces.weight[s]
                mobility += share * share * scalar(pairs.pushes[i]) * pairs.inverse_mass[i]
        if mobility > zero:
            impulse = change / mobility
            total = Units()
            for c in range(3):
                total[c] = wp.int64(wp.float64(impulse[c]) * per_unit)
            # The second ones get exactly the opposite of what the first ones get.
            rest = Units()
            for m in range(3, -1, -1):
                v = vertex_of(vertices, m)
                begin = data.surfaces.first[v]
                on_vertex = Units()
                for c in range(3):
                    on_vertex[c] = wp.int64(wp.float64(total[c]) * wp.float64(weights[m]))
                    if m == 0:
                        on_vertex[c] = rest[c]
                    rest[c] = rest[c] - on_vertex[c]
                for s in range(begin + 1, data.surfaces.first[v + 1]):
                    for c in range(3):
                        part = wp.int64(wp.float64(on_vertex[c]) * wp.float64(data.surfaces.weight[s]))
                        on_vertex[c] = on_vertex[c] - part
                        wp.atomic_add(pairs.impulse, data.surfaces.particle[s], c, part)
                for c in range(3):
                    wp.atomic_add(pairs.impulse, data.surfaces.particle[begin], c, on_vertex[c])

    @wp.func
    def apply(
        pairs: Pairs,
        x: wp.array(dtype=V),
        x_out: wp.array(dtype=V),
        v_out: wp.array(dtype=V),
        h: scalar,
        unit: wp.float64,
        i: int,
    ):
        """Move a particle by the impulses of its pairs."""
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
            store(x_out, i, load(x_out, i) + moved)
            store(v_out, i, load(v_out, i) + moved / h)

    @wp.func
    def may_lose(gap: scalar, least: scalar, apart: scalar) -> scalar:
        share = (scalar(1.0) - kept) * (gap - scalar(ALL_KEPT) * least)
        return wp.max(zero, wp.max(share, gap - apart))

    @wp.func
    def lacks(data: Data, pairs: Pairs, x: wp.array(dtype=V), x_out: wp.array(dtype=V), apart: scalar, k: int):
        way = way_between(data, pairs, x, x_out, k)
        return way, -wp.dot(way, pairs.normal[k]) - may_lose(pairs.gap[k], pairs.least[k], apart)

    return may_lose, lacks, count_pushes, push, apply
