"""Springs that break permanently, like threads of a cloth."""

import functools
from typing import Any, NamedTuple

import warp as wp

NO_SUBSTEP = -1
"""Substep number in force evaluations that do not begin a substep: nothing breaks then."""


class Breaking(NamedTuple):
    """The device side of fracture."""

    Data: Any
    """Type of the struct with the thresholds of springs, and the state of broken springs."""
    is_suspect: Any
    """wp.func (b, rest, square) -> bool: whether a spring of this rest length may be overstretched."""
    breaks: Any
    """wp.func (b, c, rest, square) -> bool: whether spring c breaks at this substep's start; if so, this is
    recorded."""


@functools.cache
def breaking(scalar: type) -> Breaking:
    """Compose the tests for breaking of a spring of rest length l0, given `square` = |Δx|² between its ends.

    It breaks if |Δx| > min(l0 (1 + ε), l0 + F/k) at a substep's start, with its break strain ε and its break force
    F, the largest tension k (|Δx| − l0). Its ends compute Δx and −Δx, and so the same |Δx|² to the last bit: if
    each particle sums its own forces, both drop the spring in the same substep. A limit common to all springs is
    tested first; only springs beyond this limit read limits of their own.
    """

    @wp.struct
    class Breaks:
        substep: int  # substep of the frame; NO_SUBSTEP if none begins
        h: wp.float64  # length of a substep [s]
        start: wp.array(dtype=wp.float64)  # time of the frame's start [s], shape [1]
        least: scalar  # (length / l0)² up to which no spring of the scene breaks
        number: wp.array(dtype=int)  # index of the spring in each slot of the algorithm
        # Of each neighbour in a uniform lattice, in the order of sums. Arrays, since indexing kernel arguments
        # would copy all of them:
        offset: wp.array(dtype=int)  # index offset, shape [neighbour_count]
        own: wp.array2d(dtype=scalar)  # rest length, stiffness and damping, shape [neighbour_count, 3]
        # By spring, shape [connection_count]:
        strain: wp.array(dtype=scalar)  # break strain ε
        stretch: wp.array(dtype=scalar)  # F/k [m]
        broken_at: wp.array(dtype=wp.float32)  # time of breaking [s], inf if unbroken
        # The constants that energies and bounds use, 0 for broken springs:
        stiffness: wp.array(dtype=scalar)  # k [N/m]
        damping: wp.array(dtype=scalar)  # b in the units of the law
        steepest: wp.array(dtype=scalar)  # steepest slope of the law [N s/m]

    @wp.func
    def is_suspect(b: Breaks, rest: scalar, square: scalar) -> bool:
        return square > b.least * (rest * rest)

    @wp.func
    def breaks(b: Breaks, c: int, rest: scalar, square: scalar) -> bool:
        if b.substep < 0:
            return False
        longest = wp.min(rest * (scalar(1.0) + b.strain[c]), rest + b.stretch[c])
        if square <= longest * longest:
            return False
        # Both ends may write here, the same value.
        b.broken_at[c] = wp.float32(b.start[0] + wp.float64(b.substep) * b.h)
        b.stiffness[c] = scalar(0.0)
        b.damping[c] = scalar(0.0)
        b.steepest[c] = scalar(0.0)
        return True

    return Breaking(Breaks, is_suspect, breaks)
