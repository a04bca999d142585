"""Ties: springs in no lattice direction, such as between joined bodies, in a small table beside the stencil."""

import functools

import warp as wp

from ..basis import vector
from ..effect import ForceTerm, instant
from ..records import records
from .dampers import law_numbers
from .force_algorithm import difference, velocity_of
from .law import spring_damper
from .spring_laws import Laws


@functools.cache
def tie_force(dim: int, scalar: type, compensated: bool, laws: Laws) -> ForceTerm:
    """Return the term of ties: the sum of the forces of ties on a particle, in addition to the stencil.

    Ties obey the law of all springs. Each tie is in the table twice, once for each end, and both ends compute
    opposite forces of equal size.
    """
    V, Instant = vector(dim, scalar), instant(dim, scalar, compensated)
    load, velocity = records(dim, scalar).load, velocity_of(dim, scalar, laws.damper is not None)
    separation, density = difference(dim, scalar, compensated), spring_damper(dim, scalar, laws)

    @wp.struct
    class ExtraSprings:
        first: wp.array(dtype=int)  # row starts of the entries, shape [particle_count + 1]
        # Of each entry, shape [2 tie_count]:
        other: wp.array(dtype=int)  # particle at the other end
        rest_length: wp.array(dtype=scalar)  # l0 [m]
        stiffness: wp.array(dtype=scalar)  # k [N/m]
        damping: wp.array(dtype=scalar)  # b in the units of the law
        if not laws.linear:
            law: law_numbers(scalar)

    @wp.func
    def tied(data: ExtraSprings, now: Instant, i: int) -> V:
        x_i = load(now.x, i)
        total = V()
        for e in range(data.first[i], data.first[i + 1]):
            j = data.other[e]
            dx = separation(now.compensation, now.x, x_i, i, j)
            dv = velocity(now.v, i) - velocity(now.v, j)
            own = data
            if wp.static(laws.linear):
                q = density(dx, dv, own.rest_length[e], own.stiffness[e], own.damping[e])
            else:
                q = density(dx, dv, own.rest_length[e], own.stiffness[e], own.damping[e], own.law)
            total -= q * dx
        return total

    return ForceTerm("ties", ExtraSprings, force=tied, selective=True)
