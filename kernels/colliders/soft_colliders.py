"""Soft obstacles, which push particles out by a force with a continuous derivative, and so are differentiable.

At depth d an obstacle of stiffness k and ramp δ presses with f(d) = k d²/(2δ) for d ≤ δ, and k (d − δ/2) beyond:
the slope grows from 0 to k. The normal force is N = f max(0, 1 − c v·n) with the dissipation c (Hunt and Crossley,
Coefficient of restitution interpreted as damping in vibroimpact, J. Appl. Mech. 42 (1975) 440-445). Friction is
−μ N u/√(|u|² + s²) with the velocity u along the surface. The speed s is the larger of the obstacle's `rest_speed`
and 2 μ N Δt/m: so friction removes at most half of u in a substep Δt.
"""

import functools
from typing import Any, NamedTuple

import warp as wp

from ..basis import kernel, vector
from ..compensation import position_of
from ..effect import ForceTerm, instant
from ..records import records
from .signed_distance import signed_distance, solids


class SoftTerm(NamedTuple):
    """The device side of soft obstacles."""

    term: ForceTerm
    """The force term, for a scene's kernels."""
    add_blocks: Any
    """Kernel, over particles, that adds to the blocks of the stability bound (`Effect.add_blocks`)."""
    measure: Any
    """Kernel, over worlds and particles, that writes the stored energy [J] and the dissipated power [W]."""


@functools.cache
def soft_data(dim: int, scalar: type, round_particles: bool):
    """Compose the struct of soft obstacles; for `round_particles`, which have a radius against them."""
    Solids = solids(dim, scalar)

    class SoftData:
        count: int
        solids: Solids
        dt: scalar  # length of a substep [s]
        # Of each obstacle, shape [count]:
        stiffness: wp.array(dtype=scalar)  # k [N/m]
        ramp: wp.array(dtype=scalar)  # δ [m]
        dissipation: wp.array(dtype=scalar)  # c [s/m]
        friction: wp.array(dtype=scalar)  # μ
        rest_speed: wp.array(dtype=scalar)  # [m/s]
        if round_particles:
            radius: wp.array(dtype=scalar)  # of each particle [m]

    SoftData.__qualname__ += "Round" * round_particles
    return wp.struct(SoftData)


@functools.cache
def soft_force(dim: int, scalar: type, kinds: tuple[str, ...], round_particles: bool):
    """Compose (push, numbers) of obstacle p: the force on a particle of inverse mass w [N]; p's parameters."""
    V, Numbers, SoftData = vector(dim, scalar), vector(5, scalar), soft_data(dim, scalar, round_particles)
    distance_from = signed_distance(dim, scalar, kinds, round_particles)
    zero, one, half, two = (scalar(number) for number in (0.0, 1.0, 0.5, 2.0))

    @wp.func
    def numbers(data: SoftData, p: int) -> Numbers:
        return Numbers(data.stiffness[p], data.ramp[p], data.dissipation[p], data.friction[p], data.rest_speed[p])

    @wp.func
    def push(data: SoftData, p: int, own: Numbers, x: V, v: V, w: scalar) -> V:
        found = distance_from(data.solids, p, x)
        normal = V()
        for k in range(wp.static(dim)):
            normal[k] = found[k]
        depth = wp.max(-found[wp.static(dim)], zero)
        ramp = own[1]
        within = wp.min(depth, ramp)
        leaving = wp.dot(v, normal)
        pressing = own[0] * (depth - within + half * within * within / ramp)
        pressing = pressing * wp.max(one - own[2] * leaving, zero)
        along = v - leaving * normal
        grip = own[3] * pressing
        slow = two * grip * data.dt * w
        speed = wp.sqrt(wp.dot(along, along) + own[4] * own[4] + slow * slow)
        return pressing * normal - (grip / speed) * along

    return push, numbers


@functools.cache
def soft_colliders(
    dim: int, scalar: type, compensated: bool, kinds: tuple[str, ...], round_particles: bool = False
) -> SoftTerm:
    """Compose a scene's soft obstacles, given their kinds, and whether any particle has a radius against them."""
    V, Instant, position = (
        vector(dim, scalar),
        instant(dim, scalar, compensated),
        position_of(dim, scalar, compensated),
    )
    Data, load = soft_data(dim, scalar, round_particles), records(dim, scalar).load
    push, numbers = soft_force(dim, scalar, kinds, round_particles)
    distance_from = signed_distance(dim, scalar, kinds, round_particles)
    Block: Any = wp.types.matrix((dim, dim), wp.float64)

    @wp.func
    def push_out(data: Data, now: Instant, i: int) -> V:
        x_i = position(now.compensation, now.x, i)
        v_i = load(now.v, i)
        total = V()
        if wp.static(round_particles):
            data.solids.margin = data.radius[i]
        for p in range(data.count):
            if distance_from(data.solids, p, x_i)[wp.static(dim)] < scalar(0.0):
                total += push(data, p, numbers(data, p), x_i, v_i, now.inverse_mass[i])
        return total

    @kernel
    def add_soft_blocks(
        stiffness: wp.float64,  # largest stiffness of all obstacles [N/m]
        damped: wp.float64,  # 1 if any obstacle dissipates, else 0
        inverse_mass: wp.array(dtype=scalar),  # [1/kg], 0 where pinned, shape [particle_count]
        # Out, one block per particle, shape [particle_count]:
        stiffness_block: wp.array(dtype=Block),  # [N/m]
        damping_block: wp.array(dtype=Block),  # [N s/m]
    ):
        i = wp.tid()
        w = wp.float64(inverse_mass[i])
        if w > wp.float64(0.0):
            b = damped * wp.sqrt(stiffness / w)
            for c in range(wp.static(dim)):
                stiffness_block[i][c, c] += wp.float64(0.5) * stiffness
                damping_block[i][c, c] += wp.float64(0.5) * b

    @kernel
    def measure_soft(
        data: Data,
        inverse_mass: wp.array2d(dtype=scalar),  # [1/kg], shape [rows, particle_count]
        stride: int,  # particles from one world to the next
        x: wp.array(dtype=V),
        v: wp.array(dtype=V),
        # Out, shape [worlds, particle_count]:
        energy: wp.array2d(dtype=wp.float64),
        power: wp.array2d(dtype=wp.float64),
    ):
        world, i = wp.tid()
        w = inverse_mass[world % inverse_mass.shape[0], i]
        stored = wp.float64(0.0)
        lost = wp.float64(0.0)
        if w > scalar(0.0):
            x_i = x[world * stride + i]
            v_i = v[world * stride + i]
            if wp.static(round_particles):
                data.solids.margin = data.radius[i]
            for p in range(data.count):
                depth = -wp.float64(distance_from(data.solids, p, x_i)[wp.static(dim)])
                if depth > wp.float64(0.0):
                    ramp = wp.float64(data.ramp[p])
                    a = wp.min(depth, ramp)
                    e = depth - a
                    k = wp.float64(data.stiffness[p])
                    stored += k * (a * a * a / (wp.float64(6.0) * ramp) + wp.float64(0.5) * e * depth)
                    own = numbers(data, p)
                    springing = push(data, p, own, x_i, V(), w)  # elastic force only: v = 0
                    lost += wp.float64(wp.dot(springing - push(data, p, own, x_i, v_i, w), v_i))
        energy[world, i] = stored
        power[world, i] = lost

    return SoftTerm(ForceTerm("soft", Data, force=push_out), add_soft_blocks, measure_soft)


@functools.cache
def soft_adjoint(dim: int, scalar: type, kinds: tuple[str, ...], by_mass: bool, by_own: bool):
    """Compose the kernel, over particles, that adds (∂F/∂x)ᵀ φ and (∂F/∂v)ᵀ φ of soft obstacles to derivatives.

    If `by_own`, also to those by obstacles' parameters and positions, with a row for each particle and obstacle.
    """
    V, (load, store, _) = vector(dim, scalar), records(dim, scalar)
    # Only contact between bodies gives particles a radius, and has no gradients.
    Data, (push, numbers) = soft_data(dim, scalar, False), soft_force(dim, scalar, kinds, False)
    Numbers = vector(5, scalar)

    @wp.func
    def projected(data: Data, p: int, own: Numbers, x: V, v: V, w: scalar, phi: V) -> scalar:
        return wp.dot(push(data, p, own, x, v, w), phi)

    # In Warp 1.19 a function that a kernel calls before its `wp.grad` has no adjoint: only `wp.grad` uses `push`.
    @kernel
    def add_soft_adjoint(
        data: Data,
        inverse_mass: wp.array(dtype=scalar),  # [1/kg], 0 where pinned
        # State, at which the force was evaluated:
        x: wp.array(dtype=V),
        v: wp.array(dtype=V),
        phi: wp.array(dtype=V),  # ∂L/∂F of each particle
        # In and out, derivatives by:
        by_x: wp.array(dtype=V),
        by_v: wp.array(dtype=V),
        by_inverse_mass: wp.array(dtype=scalar),  # times 1/m
        by_numbers: wp.array2d(dtype=scalar),
        begin: int,  # particles of this launch
        end: int,
        threads: int,  # threads of the launch
    ):
        i = begin + wp.tid()
        while i < end:
            x_i = load(x, i)
            v_i = load(v, i)
            phi_i = load(phi, i)
            w = inverse_mass[i]
            sum_x = V()
            sum_v = V()
            sum_w = scalar(0.0)
            for p in range(data.count):
                _data, _p, of_own, of_x, of_v, of_w, _phi = wp.grad(projected)(
                    data, p, numbers(data, p), x_i, v_i, w, phi_i
                )
                if wp.static(by_own):
                    row = i * data.count + p
                    for k in range(5):
                        by_numbers[row, k] = by_numbers[row, k] + of_own[k]
                    for k in range(wp.static(dim)):
                        by_numbers[row, 5 + k] = by_numbers[row, 5 + k] - of_x[k]
                sum_x += of_x
                sum_v += of_v
                sum_w += of_w
            store(by_x, i, load(by_x, i) + sum_x)
            store(by_v, i, load(by_v, i) + sum_v)
            if wp.static(by_mass):
                by_inverse_mass[i] = by_inverse_mass[i] + w * sum_w
            i += threads

    return add_soft_adjoint
