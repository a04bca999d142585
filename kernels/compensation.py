"""Compensated sums.

In float32 a small change added to a large position is rounded away: at 400 m and h = 1/2640 s a particle slower
than 4 cm/s would not move. Kahan's summation adds the rounding error of each sum to the next change.
The compiler must not reorder these sums.
Reference: Higham, Accuracy and Stability of Numerical Algorithms, 2nd ed. (2002), 4.3.
"""

import functools
from typing import Any

import warp as wp

from .basis import vector
from .records import records


@functools.cache
def compensated_sum(dim: int, scalar: type, compensated: bool):
    """Compose (Compensation, add): the rounding errors of sums, and a function that adds to a sum.

    `add(total, change, compensation, lost_out, i)` returns total + change.

    The true total is total − compensation[i] before, and the result − lost_out[i] after. Neighbours also read the
    rounding errors of positions, so new errors are written to `x_out`, not in place. Unless `compensated`, `add`
    is a plain sum.
    """
    V = vector(dim, scalar)
    load, store, _ = records(dim, scalar)

    @wp.struct
    class Compensation:
        x: wp.array(dtype=V)
        x_out: wp.array(dtype=V)
        v: wp.array(dtype=V)

    @wp.func
    def add(total: V, change: V, compensation: wp.array(dtype=V), lost_out: wp.array(dtype=V), i: int) -> V:
        new = total + change
        if wp.static(compensated):
            rest = change - load(compensation, i)
            new = total + rest
            store(lost_out, i, (new - total) - rest)
        return new

    return Compensation, add


def state_types(dim: int, scalar: type, compensated: bool) -> tuple[Any, Any, Any]:
    """Return the types of a position, of an array of positions or velocities, and of their compensation."""
    V = vector(dim, scalar)
    return V, wp.array(dtype=V), compensated_sum(dim, scalar, compensated)[0]


@functools.cache
def position_of(dim: int, scalar: type, compensated: bool) -> Any:
    """Compose wp.func (compensation, x, i) -> position of particle i [m], less the rounding errors of its sum."""
    V, Vectors, Compensation = state_types(dim, scalar, compensated)
    load = records(dim, scalar).load

    @wp.func
    def position(compensation: Compensation, x: Vectors, i: int) -> V:
        x_i = load(x, i)
        if wp.static(compensated):
            x_i = x_i - load(compensation.x, i)
        return x_i

    return position
