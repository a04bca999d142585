"""The adjoint of a kick, v' = v + s (F/m + g), and of the drift x' = x + h v' that may follow it."""

import functools

import warp as wp

from ..basis import kernel, vector
from ..lanes import WARP
from ..records import records
from ..springs.lanes import lane_of, sum_over_lanes

SUMMING = 8192
"""Maximal number of threads that sum the squares of a world."""


@functools.cache
def AdjointData(dim: int, scalar: type):
    """Compose the struct of a system's masses, and of the derivatives of a loss that kernels propagate and sum."""
    V, Numbers = vector(dim, scalar), wp.array(dtype=scalar)

    @wp.struct
    class AdjointData:
        inverse_mass: Numbers  # [1/kg], 0 where pinned
        gravity: V  # [m/s²]
        # Derivatives by:
        by_x: wp.array(dtype=V)
        by_v: wp.array(dtype=V)
        by_inverse_mass: Numbers  # times 1/m; or empty
        by_gravity: wp.array(dtype=V)  # by the gravity of each particle; or empty
        # By the constants of springs; see `Neighbours` for their entries:
        by_rest_length: Numbers
        by_stiffness: Numbers
        by_damping: Numbers
        by_strain: Numbers

    return AdjointData


@functools.cache
def kick_back(dim: int, scalar: type):
    """Compose wp.func that returns φ = s back/m, the derivative ∂L/∂F of the loss L for particle i.

    `back` is ∂L/∂v after a kick of s seconds from `v_before`. The function also adds what this kick, s (F/m + g),
    contributes to (1/m) ∂L/∂(1/m) and to ∂L/∂g.
    """
    V, Data, (load, store, _) = vector(dim, scalar), AdjointData(dim, scalar), records(dim, scalar)

    @wp.func
    def propagate(
        data: Data, i: int, kick: scalar, back: V, v_before: wp.array(dtype=V), v: wp.array(dtype=V)
    ) -> V:
        w = data.inverse_mass[i]
        if w > scalar(0.0):
            if data.by_inverse_mass.shape[0] > 0:
                push = (load(v, i) - load(v_before, i)) - kick * data.gravity
                data.by_inverse_mass[i] = data.by_inverse_mass[i] + wp.dot(back, push)
            if data.by_gravity.shape[0] > 0:
                store(data.by_gravity, i, load(data.by_gravity, i) + kick * back)
        return (kick * w) * back

    return propagate


@functools.cache
def kick_adjoint(dim: int, scalar: type):
    """Compose the kernel, over particles, that propagates derivatives back through a drift and a kick.

    From the derivatives of a loss L it computes ∂L/∂v = ∂L/∂v' + h ∂L/∂x', to which forces that depend on v add
    later, and φ = ∂L/∂F = s/m ∂L/∂v of each particle. h and s are the lengths of the drift and of the kick [s].
    """
    V, Data, (load, store, _) = vector(dim, scalar), AdjointData(dim, scalar), records(dim, scalar)
    propagate = kick_back(dim, scalar)

    @kernel
    def propagate_kick(
        data: Data,
        drift: scalar,  # h, 0 without a drift [s]
        kick: scalar,  # s [s]
        # State:
        v: wp.array(dtype=V),  # velocities before the kick; below, after it
        v_out: wp.array(dtype=V),
        # Out:
        phi: wp.array(dtype=V),
        begin: int,  # particles of this launch
        end: int,
        threads: int,  # of the launch
    ):
        i = begin + wp.tid()
        while i < end:
            back = load(data.by_v, i) + drift * load(data.by_x, i)
            store(data.by_v, i, back)
            store(phi, i, propagate(data, i, kick, back, v, v_out))
            i += threads

    return propagate_kick


@functools.cache
def add_given(dim: int, scalar: type):
    """Compose the kernel, over particles, that adds given vectors to others."""
    V, (load, store, _) = vector(dim, scalar), records(dim, scalar)

    @kernel
    def add_vectors(given: wp.array(dtype=V), total: wp.array(dtype=V)):  # only `total` must be `records`
        i = wp.tid()
        store(total, i, load(total, i) + given[i])

    return add_vectors


@functools.cache
def forget(dim: int, scalar: type):
    """Compose the kernel, over driven particles, that sets the derivatives by their state to 0.

    First it adds them to the derivatives by poses (R, o) and by rates of poses. A particle that started at y is at
    R y + o, so the derivative by a coordinate, times (y, 1), is the derivative by a row of (R, o).
    """
    V, Wide, (load, store, _) = vector(dim, scalar), vector(dim, wp.float64), records(dim, scalar)

    @kernel
    def forget_driven(
        member: wp.array(dtype=int),  # driven particles, of one world after those of another
        start: wp.array(dtype=Wide),  # y of those of a world [m]
        # In and out, derivatives by:
        by_x: wp.array(dtype=V),
        by_v: wp.array(dtype=V),
        by_poses: wp.array2d(dtype=scalar),  # shape [member_count, 2 d (d + 1)], or [0, any] if not requested
        begin: int,  # members of this launch
        end: int,
        threads: int,  # of the launch
    ):
        k = begin + wp.tid()
        while k < end:
            if k < by_poses.shape[0]:
                y = V(start[k % start.shape[0]])
                x = load(by_x, member[k])
                v = load(by_v, member[k])
                for a in range(wp.static(dim)):
                    of_x = wp.static(dim + 1) * a
                    of_v = wp.static(dim + 1) * (wp.static(dim) + a)
                    for b in range(wp.static(dim)):
                        by_poses[k, of_x + b] = by_poses[k, of_x + b] + x[a] * y[b]
                        by_poses[k, of_v + b] = by_poses[k, of_v + b] + v[a] * y[b]
                    by_poses[k, of_x + wp.static(dim)] = by_poses[k, of_x + wp.static(dim)] + x[a]
                    by_poses[k, of_v + wp.static(dim)] = by_poses[k, of_v + wp.static(dim)] + v[a]
            store(by_x, member[k], V())
            store(by_v, member[k], V())
            k += threads

    return forget_driven


@functools.cache
def widen(dtype: type, wide: type):
    """Compose the kernel that adds numbers or vectors to float64 sums, and sets the former to 0."""
    zero = wp.constant(getattr(dtype, "_wp_scalar_type_", dtype)(0.0))

    @kernel
    def add_widened(narrow: wp.array(dtype=dtype), total: wp.array(dtype=wide)):
        i = wp.tid()
        total[i] = total[i] + wide(narrow[i])
        narrow[i] = dtype(zero)

    return add_widened


@functools.cache
def squares(dim: int, scalar: type):
    """Compose the kernel that adds the sums of squares of two arrays of vectors, by world, to a row of `sums`."""
    V, load = vector(dim, scalar), records(dim, scalar).load
    lane_here, sum_of_warp = lane_of(WARP), sum_over_lanes(2, wp.float64, WARP)

    @kernel
    def add_squares(
        first: wp.array(dtype=V),
        second: wp.array(dtype=V),
        count: int,  # particles of a world
        stride: int,  # from one world to the next
        threads: int,  # of a world, a multiple of a warp
        row: int,
        # Out:
        sums: wp.array3d(dtype=wp.float64),  # shape [rows, worlds, 2]
    ):
        w = wp.tid() / threads
        i = wp.tid() % threads
        a = wp.float64(0.0)
        b = wp.float64(0.0)
        while i < count:
            x = load(first, w * stride + i)
            v = load(second, w * stride + i)
            a += wp.float64(wp.dot(x, x))
            b += wp.float64(wp.dot(v, v))
            i += threads
        own = sum_of_warp(wp.vec2d(a, b))
        if lane_here() == 0:
            wp.atomic_add(sums, row, w, 0, own[0])
            wp.atomic_add(sums, row, w, 1, own[1])

    return add_squares
