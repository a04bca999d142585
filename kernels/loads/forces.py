"""Forces on particles: given ones, by numbers for each stage of a frame, and functions of place and time."""

import functools
from typing import Any

import warp as wp

from ..basis import vector
from ..compensation import compensation
from ..effect import Piece
from ..records import records


@functools.cache
def applied_force(dim: int, scalar: type, compensated: bool) -> Piece:
    """Return what given forces add to kernels: the sum of those that act on a particle.

    Several forces may act on a particle. They are found as the entries of a sparse matrix are, by rows.
    """
    V = vector(dim, scalar)
    Lost, _ = compensation(dim, scalar, compensated)

    @wp.struct
    class Applied:
        value: wp.array2d(dtype=V)  # each force in each stage of a frame, and at its end [N]
        varies: wp.array(dtype=int)  # 1 where it depends on time; others have one row, shape [force_count]
        first: wp.array(dtype=int)  # where the forces on each particle begin, shape [particle_count + 1]
        number: wp.array(dtype=int)  # which force it is, shape [entry_count]
        share: wp.array(dtype=scalar)  # how much of it the particle feels, shape [entry_count]

    def force(World: Any):
        @wp.func
        def applied(world: World, lost: Lost, x: wp.array(dtype=V), v: wp.array(dtype=V), i: int) -> V:
            total = V()
            for e in range(world.applied.first[i], world.applied.first[i + 1]):
                n = world.applied.number[e]
                total += world.applied.share[e] * world.applied.value[world.stage * world.applied.varies[n], n]
            return total

        return applied

    return Piece("applied", Applied, force=force, selective=True, timed=True, works=True)


@functools.cache
def function_force(dim: int, scalar: type, compensated: bool, function: Any, number: int) -> Piece:
    """Return what a force that is a function of place, speed and time adds to kernels.

    `function` is a wp.func (x, v, t, i) -> force [N] on particle i, which is at x and moves at v at time t.
    `number` tells several of a scene apart.
    """
    V = vector(dim, scalar)
    Lost, _ = compensation(dim, scalar, compensated)
    load = records(dim, scalar).load

    @wp.struct
    class Nothing:
        """The function has all that it needs."""

    def force(World: Any):
        @wp.func
        def function_of_place(world: World, lost: Lost, x: wp.array(dtype=V), v: wp.array(dtype=V), i: int) -> V:
            x_i = load(x, i)
            if wp.static(compensated):
                x_i = x_i - load(lost.x, i)
            return function(x_i, load(v, i), world.time[world.stage], i)

        return function_of_place

    return Piece(f"function_force_{number}", Nothing, force=force, selective=True, timed=True, works=True)
