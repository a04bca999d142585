"""Pressure on the triangles of a surface: given pressures and enclosed gases."""

import functools
from typing import Any

import warp as wp

from ..basis import kernel, vector
from ..effect import ElementForce, ForceTerm
from ..records import records
from .surface_triangles import on_triangles, triangles


@functools.cache
def pressure(dim: int, scalar: type, compensated: bool, mixed: bool, gas: bool) -> tuple[ForceTerm, ElementForce]:
    """Return the term and the law of pressures: p a on a triangle with the area vector a, a third on each corner.

    Given pressures have a row for each stage of a frame and one for its end; those of enclosed gases have one row,
    which `gas_law` computes in each stage.
    """
    V, Numbers, Rows = vector(dim, scalar), vector(1, scalar), wp.types.matrix((3, dim), scalar)
    Triangles: Any = triangles(dim, scalar, mixed)

    @wp.struct
    class Pressed:
        value: wp.array2d(dtype=scalar)  # [Pa], shape [rows, count]
        faces: Triangles
        of: wp.array(dtype=int)  # index of each triangle's pressure, shape [triangle_count]

    @wp.func
    def numbers(data: Pressed, t: int, stage: int) -> Numbers:
        row = int(0)
        if wp.static(not gas):
            row = stage
        return Numbers(data.value[row, data.of[t]])

    @wp.func
    def evaluate(data: Pressed, t: int, time: scalar, stage: int, x: Rows, v: Rows, own: Numbers) -> V:
        a = scalar(0.5) * wp.cross(x[1] - x[0], x[2] - x[0])  # outward by the right-hand rule
        if wp.static(mixed):
            return own[0] * a
        return own[0] / scalar(3.0) * a

    law = ElementForce(evaluate, numbers, 1, points=3, shared=mixed)
    force = on_triangles(dim, scalar, compensated, mixed, Pressed, law)
    return ForceTerm(
        "gas" if gas else "pressure", Pressed, force=force, selective=True, timed=True, works=True
    ), law


@functools.cache
def gas_law(dim: int, scalar: type, compensated: bool, mixed: bool = False):
    """Compose the kernel for the pressure p = p0 (V0 / V)^γ of each gas, with a block per gas and world.

    The volume is a sixth of Σ x_i·(x_j × x_k) over the triangles, in float64, relative to a corner. Each thread
    computes a partial sum, and partial sums are added in a fixed order.
    """
    V = vector(dim, scalar)
    load = records(dim, scalar).load

    @wp.func
    def place(x: wp.array(dtype=V), x_lost: wp.array(dtype=V), i: int) -> wp.vec3d:
        if wp.static(mixed):
            own = x[i]
        else:
            own = load(x, i)
        result = wp.vec3d(wp.float64(own[0]), wp.float64(own[1]), wp.float64(own[2]))
        if wp.static(compensated and not mixed):
            off = load(x_lost, i)
            result -= wp.vec3d(wp.float64(off[0]), wp.float64(off[1]), wp.float64(off[2]))
        return result

    @kernel
    def find_pressure(
        # Model:
        corner: wp.array(dtype=wp.vec3i),  # vertices of each triangle, shape [any]
        ends: wp.array(dtype=int),  # first triangle of each gas, and the end, shape [gas_count + 1]
        numbers: wp.array(dtype=wp.vec4d),  # of each gas: p0 and the ambient pressure [Pa], V0 [m³], and γ
        # State in:
        x: wp.array(dtype=V),  # positions [m] of particles, or of vertices if mixed
        x_lost: wp.array(dtype=V),  # compensation of particles' positions [m]
        stride: int,  # elements of x from one world to the next
        # Out:
        over: wp.array2d(dtype=scalar),  # excess over the ambient pressure [Pa], shape [worlds, gas_count]
    ):
        gas = (wp.tid() / wp.block_dim()) % numbers.shape[0]
        w = wp.tid() / wp.block_dim() / numbers.shape[0]
        thread = wp.tid() % wp.block_dim()
        here = w * stride
        origin = place(x, x_lost, here + corner[ends[gas]][0])
        own = wp.float64(0.0)
        t = ends[gas] + thread
        while t < ends[gas + 1]:
            a = place(x, x_lost, here + corner[t][0]) - origin
            b = place(x, x_lost, here + corner[t][1]) - origin
            c = place(x, x_lost, here + corner[t][2]) - origin
            own += wp.dot(a, wp.cross(b, c))
            t += wp.block_dim()
        total = wp.tile_extract(wp.tile_sum(wp.tile(own)), 0) / wp.float64(6.0)
        if thread == 0:
            # An inverted surface has no volume: the pressure is kept finite, and the run reported as diverged.
            of_gas = numbers[gas]
            part = wp.max(total / of_gas[2], wp.float64(1e-6))
            over[w, gas] = scalar(of_gas[0] * wp.pow(part, -of_gas[3]) - of_gas[1])

    return find_pressure


@functools.cache
def gas_adjoint(dim: int, scalar: type):
    """Compose (Gases, law, kernel) for the adjoint of gases: φ·F of a triangle, and sums for it.

    A gas' pressure depends on all of its triangles, so Warp cannot find it from one. With S = Σ a·φ over a gas'
    triangles with area vectors a and mean φ, φ·F = p S. Its derivative is p ∂S/∂x + p' S ∂V/∂x. The kernel sums S
    and V for each gas, with a block per gas. If wanted, it also adds to the derivatives by the gas' overpressure,
    outside pressure, volume and exponent.
    """
    V, load = vector(dim, scalar), records(dim, scalar).load
    Rows: Any = wp.types.matrix((3, dim), scalar)

    @wp.struct
    class Gases:
        of: wp.array(dtype=int)  # gas of each triangle
        over: wp.array(dtype=scalar)  # excess pressure p of each gas [Pa]
        slope: wp.array(dtype=scalar)  # p' S, with p' = dp/dV
        origin: wp.array(dtype=V)  # a reference point of each gas for its volume [m]

    @wp.func
    def projected(data: Gases, t: int, time: scalar, stage: int, x: Rows, v: Rows, phi: Rows) -> scalar:
        g = data.of[t]
        sixth = scalar(1.0) / scalar(6.0)
        doubled = wp.cross(x[1] - x[0], x[2] - x[0])
        a = x[0] - data.origin[g]
        volume = wp.dot(a, wp.cross(x[1] - data.origin[g], x[2] - data.origin[g]))
        return sixth * (data.over[g] * wp.dot(doubled, phi[0] + phi[1] + phi[2]) + data.slope[g] * volume)

    @wp.func
    def mean(
        values: wp.array(dtype=V), part: wp.array2d(dtype=int), weight: wp.array2d(dtype=scalar), row: int
    ) -> V:
        total = V()
        for m in range(part.shape[1]):
            total += weight[row, m] * load(values, part[row, m])
        return total

    @kernel
    def find_slopes(
        particle: wp.array2d(dtype=int),  # as for `adjoint.elements`
        weight: wp.array2d(dtype=scalar),
        ends: wp.array(dtype=int),  # first triangle of each gas, and the end, shape [gas_count + 1]
        numbers: wp.array(dtype=wp.vec4d),  # as in `gas_law`
        x: wp.array(dtype=V),
        phi: wp.array(dtype=V),
        # Out:
        data: Gases,
        by_numbers: wp.array2d(dtype=scalar),  # in and out, shape [any, 4]
    ):
        g = wp.tid() / wp.block_dim()
        thread = wp.tid() % wp.block_dim()
        origin = mean(x, particle, weight, 3 * ends[g])
        volume = wp.float64(0.0)
        along = wp.float64(0.0)
        t = ends[g] + thread
        while t < ends[g + 1]:
            a = mean(x, particle, weight, 3 * t) - origin
            b = mean(x, particle, weight, 3 * t + 1) - origin
            c = mean(x, particle, weight, 3 * t + 2) - origin
            push = mean(phi, particle, weight, 3 * t)
            push += mean(phi, particle, weight, 3 * t + 1) + mean(phi, particle, weight, 3 * t + 2)
            volume += wp.float64(wp.dot(a, wp.cross(b, c)))
            along += wp.float64(wp.dot(wp.cross(b - a, c - a), push))
            t += wp.block_dim()
        volume = wp.tile_extract(wp.tile_sum(wp.tile(volume)), 0) / wp.float64(6.0)
        along = wp.tile_extract(wp.tile_sum(wp.tile(along)), 0) / wp.float64(6.0)
        if thread == 0:
            of_gas = numbers[g]
            part = wp.max(volume / of_gas[2], wp.float64(1e-6))
            inside = of_gas[0] * wp.pow(part, -of_gas[3])
            data.over[g] = scalar(inside - of_gas[1])
            data.slope[g] = scalar(-of_gas[3] * inside / (part * of_gas[2]) * along)
            data.origin[g] = origin
            if g < by_numbers.shape[0]:
                ratio = inside / of_gas[0]
                by_numbers[g, 0] = by_numbers[g, 0] + scalar(along * ratio)
                by_numbers[g, 1] = by_numbers[g, 1] + scalar(along * (ratio - wp.float64(1.0)))
                by_numbers[g, 2] = by_numbers[g, 2] + scalar(along * of_gas[3] * inside / of_gas[2])
                by_numbers[g, 3] = by_numbers[g, 3] - scalar(along * inside * wp.log(part))

    return Gases, ElementForce(projected=projected, width=4, points=3), find_slopes
