"""Forces on particles: constant, tabulated by stages of a frame, or functions of position and time."""

import functools
from typing import Any

import warp as wp

from ..basis import kernel, vector
from ..effect import ElementForce, ForceTerm, instant, on_particles
from ..reductions.rate_bounds import largest_eigenvalue
from .work import Nothing

APART = {wp.float32: 5e-3, wp.float64: 1e-5}
"""Half the distance of points in central differences, as a fraction of their scale: the cube root of rounding."""


@functools.cache
def given_force(dim: int, scalar: type, compensated: bool, varies: bool) -> tuple[ForceTerm, ElementForce]:
    """Return the term and the law of forces that are constant, or, if it `varies`, functions of time.

    Particles with equal combinations of forces read the same precomputed sum: the few sums fit into caches.
    """
    V, Rows = vector(dim, scalar), wp.types.matrix((1, dim), scalar)

    @wp.struct
    class Given:
        value: wp.array2d(dtype=V)  # sums of combined forces [N], the first one 0; shape [rows, combination_count]
        combination: wp.array(dtype=int)  # index of the sum for each particle, shape [particle_count]

    @wp.func
    def numbers(data: Given, i: int, stage: int) -> V:
        row = int(0)
        if wp.static(varies):
            row = stage
        return data.value[row, data.combination[i]]

    @wp.func
    def evaluate(data: Given, i: int, time: scalar, stage: int, x: Rows, v: Rows, own: V) -> V:
        return own

    law = ElementForce(evaluate, numbers, dim, of_particles=True)
    force = on_particles(dim, scalar, compensated, Given, law)
    field = "varying" if varies else "steady"
    return ForceTerm(field, Given, force=force, selective=True, timed=varies, works=varies), law


@functools.cache
def weight_force(dim: int, scalar: type, compensated: bool) -> ForceTerm:
    """Return the force term of time-dependent gravity: m g(t)."""
    V, Instant = vector(dim, scalar), instant(dim, scalar, compensated)

    @wp.struct
    class Falling:
        gravity: wp.array2d(dtype=V)  # for each stage of a frame and its end [m/s²], shape [any, 1]

    @wp.func
    def fall(data: Falling, now: Instant, i: int) -> V:
        return data.gravity[now.stage, 0] / now.inverse_mass[i]

    return ForceTerm("falling", Falling, force=fall, selective=True, timed=True, works=True)


@functools.cache
def function_force(
    dim: int, scalar: type, compensated: bool, function: Any, number: int, of_velocity: bool
) -> tuple[ForceTerm, ElementForce]:
    """Return the term and the law of a force that is a function of position, velocity and time.

    `function` is a wp.func (x, v, t, i) -> force [N] on particle i at position x with velocity v at time t.
    `number` distinguishes the functions of a scene; `of_velocity`: whether v matters.
    """
    V, Rows = vector(dim, scalar), wp.types.matrix((1, dim), scalar)

    @wp.func
    def no_numbers(data: Nothing, i: int, stage: int) -> scalar:
        return scalar(0.0)

    @wp.func
    def evaluate(data: Nothing, i: int, time: scalar, stage: int, x: Rows, v: Rows, own: scalar) -> V:
        return function(x[0], v[0], time, i)

    law = ElementForce(evaluate, no_numbers, of_particles=True)
    force = on_particles(dim, scalar, compensated, Nothing, law)
    kind = {"selective": True, "timed": True, "works": True}
    at_velocity = function if of_velocity else None
    return ForceTerm(f"function_force_{number}", Nothing, force=force, at_velocity=at_velocity, **kind), law


@functools.cache
def function_values(dim: int, scalar: type, function: Any):
    """Compose the kernel, over times and particles, of a force given by a function, at present places."""
    V = vector(dim, scalar)

    @kernel
    def find_values(
        member: wp.array(dtype=int),
        x: wp.array(dtype=V),
        v: wp.array(dtype=V),
        time: wp.array(dtype=scalar),  # [s], shape [time_count]
        # Out:
        value: wp.array2d(dtype=V),  # [N], shape [time_count, member_count]
    ):
        k, n = wp.tid()
        i = member[n]
        value[k, n] = function(x[i], v[i], time[k], i)

    return find_values


@functools.cache
def add_function_slopes(dim: int, scalar: type, function: Any):
    """Compose the kernel, over worlds and particles, that adds half of |∂F/∂x| and |∂F/∂v| to the bound's blocks.

    By differences, not by Warp: they also see a wall that a particle is about to touch, and a function without an
    adjoint, such as one with native code, whose derivatives Warp takes for 0.

    |J| is the largest singular value: forces across the motion count as those along it. The steepest counts of the
    present place and, if asked for, two ahead, where the velocity leads to in half a frame and in one.
    """
    V, Block = vector(dim, scalar), wp.types.matrix((dim, dim), wp.float64)
    largest, apart = largest_eigenvalue(dim), APART[scalar]

    @kernel
    def add_slopes(
        member: wp.array(dtype=int),
        inverse_mass: wp.array2d(dtype=scalar),  # [1/kg], row w mod (number of rows) for world w
        x: wp.array(dtype=V),
        v: wp.array(dtype=V),
        first: int,  # world
        stride: int,  # particles from one world to the next
        time: scalar,  # present [s]
        seconds: scalar,  # of a frame
        size: scalar,  # of the system [m]
        most: wp.float64,  # largest rate that is believed ahead [1/s]
        places: int,  # 1, or 3 to look ahead
        # In and out:
        stiffness_block: wp.array2d(dtype=Block),  # [N/m], shape [worlds, particle_count]
        damping_block: wp.array2d(dtype=Block),  # [N s/m]
    ):
        world, k = wp.tid()
        i = member[k]
        row = (first + world) % inverse_mass.shape[0]
        w = wp.max(wp.float64(inverse_mass[row, i]), wp.float64(1e-300))
        u = v[world * stride + i]
        steepest = wp.vec2d()
        for ahead in range(places):
            t = time + scalar(0.5) * scalar(ahead) * seconds
            place = x[world * stride + i] + (t - time) * u
            by_x = Block()
            by_v = Block()
            for d in range(wp.static(dim)):
                dx = V()
                dv = V()
                dx[d] = scalar(wp.static(apart)) * (size + wp.length(place))
                dv[d] = scalar(wp.static(apart)) * (size / seconds + wp.length(u))
                of_x = (function(place + dx, u, t, i) - function(place - dx, u, t, i)) / (dx[d] + dx[d])
                of_v = (function(place, u + dv, t, i) - function(place, u - dv, t, i)) / (dv[d] + dv[d])
                for j in range(wp.static(dim)):
                    by_x[j, d] = wp.float64(of_x[j])
                    by_v[j, d] = wp.float64(of_v[j])
            here = wp.vec2d(largest(wp.transpose(by_x) * by_x), largest(wp.transpose(by_v) * by_v))
            for n in range(2):
                slope = wp.sqrt(here[n])
                if wp.isfinite(slope):  # a function may be undefined nearby
                    if ahead > 0:
                        slope = wp.min(slope, wp.pow(most, wp.float64(2 - n)) / w)
                    steepest[n] = wp.max(steepest[n], slope)
        for d in range(wp.static(dim)):
            stiffness_block[world, i][d, d] += wp.float64(0.5) * steepest[0]
            damping_block[world, i][d, d] += wp.float64(0.5) * steepest[1]

    return add_slopes
