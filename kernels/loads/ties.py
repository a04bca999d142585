"""Ties: the connections of lattices that lie in no direction, as rows of a small table beside the stencil."""

import functools
from typing import Any

import warp as wp

from ..basis import vector
from ..compensation import compensation
from ..effect import Piece
from ..forces.dampers import Law
from ..forces.law import spring_damper
from ..forces.route import difference
from ..records import records


@functools.cache
def tie_force(dim: int, scalar: type, compensated: bool, damper: Law | None) -> Piece:
    """Return what ties add to the kernels of a stencil: the sum of the forces of those that a particle has.

    The law is that of all connections. A tie is in the table twice, once for each of its ends, and both find the
    same force but for its sign.
    """
    V = vector(dim, scalar)
    Lost, _ = compensation(dim, scalar, compensated)
    load, damped = records(dim, scalar).load, damper is not None
    apart, force_density = difference(dim, scalar, compensated), spring_damper(dim, scalar, damper)

    @wp.struct
    class Ties:
        first: wp.array(dtype=int)  # where the ends at each particle begin, shape [particle_count + 1]
        # Of each end, shape [2 tie_count]:
        other: wp.array(dtype=int)  # the particle at the other one
        rest_length: wp.array(dtype=scalar)  # l0 [m]
        stiffness: wp.array(dtype=scalar)  # k [N/m]
        damping: wp.array(dtype=scalar)  # b in the units of the law

    def force(World: Any):
        @wp.func
        def tied(world: World, lost: Lost, x: wp.array(dtype=V), v: wp.array(dtype=V), i: int) -> V:
            x_i = load(x, i)
            dv = V()
            total = V()
            for e in range(world.ties.first[i], world.ties.first[i + 1]):
                j = world.ties.other[e]
                dx = apart(lost, x, x_i, i, j)
                if wp.static(damped):
                    dv = load(v, i) - load(v, j)
                q = force_density(
                    dx, dv, world.ties.rest_length[e], world.ties.stiffness[e], world.ties.damping[e]
                )
                total -= q * dx
            return total

        return tied

    return Piece("ties", Ties, force=force, selective=True)
