"""Pressure on the triangles of a surface: given, or that of an enclosed gas."""

import functools
from typing import Any

import warp as wp

from ..basis import kernel, vector
from ..compensation import state_types
from ..effect import ForceTerm
from ..records import records
from .surface_triangles import face


@functools.cache
def _pressed(dim: int, scalar: type, compensated: bool, mixed: bool):
    """Compose (Pressed, press): pressures on triangles, and the force Σ p a / 3 on a particle by its triangles."""
    V, Vectors, Compensation = state_types(dim, scalar, compensated)
    Faces, corners = face(dim, scalar, compensated, mixed)

    @wp.struct
    class Pressed:
        value: wp.array2d(dtype=scalar)  # [Pa], shape [rows, count]
        faces: Faces
        of: wp.array(dtype=int)  # index of each triangle's pressure, shape [triangle_count]

    @wp.func
    def press(p: Pressed, compensation: Compensation, x: Vectors, v: Vectors, i: int, row: int) -> V:
        total = V()
        for e in range(p.faces.first[i], p.faces.first[i + 1]):
            t = p.faces.number[e]
            _centre, _velocity, a = corners(p.faces, compensation, x, v, t)
            if wp.static(mixed):
                total += p.value[row, p.of[t]] * p.faces.share[e] * a
            else:
                total += p.value[row, p.of[t]] / scalar(3.0) * a
        return total

    return Pressed, press


@functools.cache
def given_pressure(dim: int, scalar: type, compensated: bool, mixed: bool = False) -> ForceTerm:
    """Return the term of given pressures, with a row for each stage of a frame, and for its end."""
    V, Vectors, Compensation = state_types(dim, scalar, compensated)
    Pressed, press = _pressed(dim, scalar, compensated, mixed)

    def force(SceneData: Any):
        @wp.func
        def press_by_time(scene: SceneData, compensation: Compensation, x: Vectors, v: Vectors, i: int) -> V:
            if wp.static(mixed):
                return press(scene.pressure, compensation, scene.skin.x, scene.skin.v, i, scene.stage)
            return press(scene.pressure, compensation, x, v, i, scene.stage)

        return press_by_time

    return ForceTerm("pressure", Pressed, force=force, selective=True, timed=True, works=True)


@functools.cache
def gas_pressure(dim: int, scalar: type, compensated: bool, mixed: bool = False) -> ForceTerm:
    """Return the term of enclosed gases, with a single row that `gas_law` computes in each stage."""
    V, Vectors, Compensation = state_types(dim, scalar, compensated)
    Pressed, press = _pressed(dim, scalar, compensated, mixed)

    def force(SceneData: Any):
        @wp.func
        def press_by_volume(scene: SceneData, compensation: Compensation, x: Vectors, v: Vectors, i: int) -> V:
            if wp.static(mixed):
                return press(scene.gas, compensation, scene.skin.x, scene.skin.v, i, 0)
            return press(scene.gas, compensation, x, v, i, 0)

        return press_by_volume

    return ForceTerm("gas", Pressed, force=force, selective=True, timed=True, works=True)


@functools.cache
def gas_law(dim: int, scalar: type, compensated: bool, mixed: bool = False):
    """Compose the kernel for the pressure of each gas, p = p0 (V0 / V)^γ; a block for each gas and world.

    The volume is a sixth of Σ x_i·(x_j × x_k) over the triangles, in float64, relative to one of the corners. Each
    thread sums a share, and the shares are added in a fixed order.
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
        corner: wp.array(dtype=wp.vec3i),  # the vertices of each triangle, shape [any]
        ends: wp.array(dtype=int),  # where the triangles around each gas begin, shape [gas_count + 1]
        numbers: wp.array(dtype=wp.vec4d),  # of each gas: p0 and the ambient pressure [Pa], V0 [m³], and γ
        # State in:
        x: wp.array(dtype=V),  # positions [m] of particles, or of vertices if mixed
        x_lost: wp.array(dtype=V),  # compensation of particles' positions [m]
        stride: int,  # from one world to the next, in elements of x
        # Out:
        over: wp.array2d(dtype=scalar),  # excess over the ambient pressure [Pa], shape [worlds, gas_count]
    ):
        gas = (wp.tid() / wp.block_dim()) % numbers.shape[0]
        w = wp.tid() / wp.block_dim() / numbers.shape[0]
        thread = wp.tid() % wp.block_dim()
        here = w * stride
        origin = place(x, x_lost, here + corner[ends[gas]][0])
        share = wp.float64(0.0)
        t = ends[gas] + thread
        while t < ends[gas + 1]:
            a = place(x, x_lost, here + corner[t][0]) - origin
            b = place(x, x_lost, here + corner[t][1]) - origin
            c = place(x, x_lost, here + corner[t][2]) - origin
            share += wp.dot(a, wp.cross(b, c))
            t += wp.block_dim()
        total = wp.tile_extract(wp.tile_sum(wp.tile(share)), 0) / wp.float64(6.0)
        if thread == 0:
            # An inverted surface has no volume: keep the pressure finite; the run is reported as diverged.
            of_gas = numbers[gas]
            part = wp.max(total / of_gas[2], wp.float64(1e-6))
            over[w, gas] = scalar(of_gas[0] * wp.pow(part, -of_gas[3]) - of_gas[1])

    return find_pressure
