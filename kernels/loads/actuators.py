"""Actuators: rest lengths that are functions of time; the change acts as an extra tension."""

import functools

import warp as wp

from ..basis import kernel, vector
from ..effect import ForceTerm, instant
from ..records import records
from ..springs.force_algorithm import difference


@functools.cache
def actuated_springs(dim: int, scalar: type, compensated: bool) -> ForceTerm:
    """Return the force term of actuators: the sum of k l0 s (x_i − x_j) / |x_i − x_j| over a particle's entries.

    A spring of rest length l0 (1 + s) has the tension k (l − l0 (1 + s)): the tension for l0, minus k l0 s. Both
    ends compute the force from the same numbers, so their forces are equal and opposite.
    """
    V, Instant = vector(dim, scalar), instant(dim, scalar, compensated)
    load, separation = records(dim, scalar).load, difference(dim, scalar, compensated)

    @wp.struct
    class Actuated:
        strain: wp.array2d(dtype=scalar)  # s in each stage of a frame and at its end; a column per delay
        first: wp.array(dtype=int)  # row starts of the entries, shape [particle_count + 1]
        other: wp.array(dtype=int)  # particle at the other end, shape [entry_count]
        column: wp.array(dtype=int)  # column of `strain`, shape [entry_count]
        strength: wp.array(dtype=scalar)  # k l0 [N], shape [entry_count]

    @wp.func
    def pull(data: Actuated, now: Instant, i: int) -> V:
        x_i = load(now.x, i)
        total = V()
        for e in range(data.first[i], data.first[i + 1]):
            s = data.strain[now.stage, data.column[e]]
            dx = separation(now.compensation, now.x, x_i, i, data.other[e])
            length = wp.length(dx)
            if length > scalar(0.0):
                total += (data.strength[e] * s / length) * dx
        return total

    return ForceTerm("actuated", Actuated, force=pull, selective=True, timed=True, works=True)


@functools.cache
def add_tension(dim: int, scalar: type):
    """Compose the kernel that adds the transverse stiffness due to actuators to the diagonal blocks of K.

    Sum over springs: k (max(0, 1 − l0 (1 + s)/l) − max(0, 1 − l0/l)) (1 − d dᵀ) for the axis d; see
    `msdwarp.kernels.springs.linearised`. The axial stiffness remains k.
    """
    V = vector(dim, scalar)
    Block = wp.types.matrix((dim, dim), wp.float64)

    @kernel
    def add_tension_blocks(
        # Actuated springs:
        ends: wp.array(dtype=wp.vec2i),  # two particles each, shape [actuated_count]
        rest_length: wp.array(dtype=wp.float64),  # l0 [m], shape [actuated_count]
        stiffness: wp.array(dtype=wp.float64),  # k [N/m], shape [actuated_count]
        strain: wp.array(dtype=wp.float64),  # minimum of s, at most 0, shape [actuated_count]
        # State in:
        x: wp.array(dtype=V),  # positions [m], shape [particle_count]
        # Out:
        stiffness_block: wp.array(dtype=Block),  # A_i [N/m], shape [particle_count]
    ):
        c = wp.tid()
        i = ends[c][0]
        j = ends[c][1]
        dx = x[i] - x[j]
        length = wp.float64(wp.length(dx))
        zero, one = wp.float64(0.0), wp.float64(1.0)
        if length == zero:
            return
        across = wp.max(zero, one - rest_length[c] * (one + strain[c]) / length)
        across = stiffness[c] * (across - wp.max(zero, one - rest_length[c] / length))
        tension = Block()
        for p in range(wp.static(dim)):
            for q in range(wp.static(dim)):
                tension[p, q] = -across * wp.float64(dx[p]) * wp.float64(dx[q]) / (length * length)
            tension[p, p] += across
        wp.atomic_add(stiffness_block, i, tension)
        wp.atomic_add(stiffness_block, j, tension)

    return add_tension_blocks
