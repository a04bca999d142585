"""The adjoint of a kick, v' = v + s (F/m + g), and of the drift x' = x + h v' that may follow it."""

import functools

import warp as wp

from ..basis import kernel, vector
from ..records import records

SUMMING = 8192
"""Threads that sum squares."""


@functools.cache
def kick_adjoint(dim: int, scalar: type, by_mass: bool, by_gravity: bool):
    """Compose the kernel, over particles, that leads derivatives back through a drift and a kick.

    Given those by x' and v' it adds h ∂/∂x' to the one by v', which then is that by v as far as forces do not
    depend on v, and writes φ = s ∂/∂v' /m, the derivative by the force on each particle.
    """
    V, load, store = vector(dim, scalar), records(dim, scalar).load, records(dim, scalar).store

    @kernel
    def lead_back(
        drift: scalar,  # h, 0 without a drift [s]
        kick: scalar,  # s [s]
        inverse_mass: wp.array(dtype=scalar),  # [1/kg], 0 where pinned
        gravity: V,  # [m/s²]
        # State:
        v: wp.array(dtype=V),  # velocities before the kick, and after it
        v_out: wp.array(dtype=V),
        # In and out, derivatives by:
        by_x: wp.array(dtype=V),
        by_v: wp.array(dtype=V),
        by_inverse_mass: wp.array(dtype=scalar),  # times 1/m
        by_gravity_of: wp.array(dtype=V),  # by that of each particle
        # Out:
        phi: wp.array(dtype=V),
        begin: int,  # particles of this launch
        end: int,
        threads: int,  # of the launch
    ):
        i = begin + wp.tid()
        while i < end:
            w = inverse_mass[i]
            back = load(by_v, i) + drift * load(by_x, i)
            store(by_v, i, back)
            store(phi, i, (kick * w) * back)
            if w > scalar(0.0):
                if wp.static(by_mass):
                    push = (load(v_out, i) - load(v, i)) - kick * gravity  # s F/m
                    by_inverse_mass[i] = by_inverse_mass[i] + wp.dot(back, push)
                if wp.static(by_gravity):
                    store(by_gravity_of, i, load(by_gravity_of, i) + kick * back)
            i += threads

    return lead_back


@functools.cache
def add_given(dim: int, scalar: type):
    """Compose the kernel, over particles, that adds given vectors to others."""
    V, (load, store, _) = vector(dim, scalar), records(dim, scalar)

    @kernel
    def add_vectors(given: wp.array(dtype=V), total: wp.array(dtype=V)):  # `given` may be no records
        i = wp.tid()
        store(total, i, load(total, i) + given[i])

    return add_vectors


@functools.cache
def widen(dtype: type, wide: type):
    """Compose the kernel that adds numbers, or vectors, to others of float64, and sets them to 0."""
    zero = wp.constant(getattr(dtype, "_wp_scalar_type_", dtype)(0.0))

    @kernel
    def add_widened(narrow: wp.array(dtype=dtype), total: wp.array(dtype=wide)):
        i = wp.tid()
        total[i] = total[i] + wide(narrow[i])
        narrow[i] = dtype(zero)

    return add_widened


@functools.cache
def squares(dim: int, scalar: type):
    """Compose the kernel that adds the squares of two arrays of vectors to a row of sums."""
    V, load = vector(dim, scalar), records(dim, scalar).load

    @kernel
    def add_squares(
        first: wp.array(dtype=V),
        second: wp.array(dtype=V),
        row: int,
        # Out:
        sums: wp.array2d(dtype=wp.float64),  # shape [rows, 2]
    ):
        share = wp.tid()
        a = wp.float64(0.0)
        b = wp.float64(0.0)
        i = share
        while i < first.shape[0]:
            x = load(first, i)
            v = load(second, i)
            a += wp.float64(wp.dot(x, x))
            b += wp.float64(wp.dot(v, v))
            i += wp.static(SUMMING)
        wp.atomic_add(sums, row, 0, a)
        wp.atomic_add(sums, row, 1, b)

    return add_squares
