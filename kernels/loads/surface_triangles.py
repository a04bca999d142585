"""Triangles of surfaces, for loads that act on them."""

import functools
from typing import Any

import warp as wp

from ..basis import kernel, vector
from ..compensation import state_types
from ..effect import ForceTerm
from ..records import records


@functools.cache
def face(dim: int, scalar: type, compensated: bool, mixed: bool = False):
    """Compose (Faces, corners): triangles with the particles at their corners, and a triangle's geometry.

    If `mixed`, vertices are weighted means of particles; `mix_vertices` computes their x and v. A triangle's force
    on a particle is then in proportion to the particle's weights in the corners.

    corners(faces, compensation, x, v, t) -> (centre, velocity, area vector) of triangle t: means over corners, and
    half the cross product of two edges, outward by the right-hand rule. Area vectors exist only in 3D.
    """
    V, Vectors, Compensation = state_types(dim, scalar, compensated)
    load = records(dim, scalar).load

    @wp.struct
    class Faces:
        corner: wp.array(dtype=wp.vec3i)  # vertices of each triangle, shape [triangle_count]
        first: wp.array(dtype=int)  # row starts of `number`, shape [particle_count + 1]
        number: wp.array(dtype=int)  # triangles of each particle, shape [3 triangle_count], or [any] if mixed
        if mixed:
            share: wp.array(dtype=scalar)  # weight of the particle in each triangle, shape [any]

    @wp.func
    def place(compensation: Compensation, x: Vectors, i: int) -> V:
        if wp.static(mixed):
            return x[i]
        x_i = load(x, i)
        if wp.static(compensated):
            x_i = x_i - load(compensation.x, i)
        return x_i

    @wp.func
    def corners(faces: Faces, compensation: Compensation, x: Vectors, v: Vectors, t: int):
        i = faces.corner[t][0]
        j = faces.corner[t][1]
        k = faces.corner[t][2]
        x_i = place(compensation, x, i)
        x_j = place(compensation, x, j)
        x_k = place(compensation, x, k)
        third = scalar(1.0) / scalar(3.0)
        area = V()
        if wp.static(dim == 3):
            area = scalar(0.5) * wp.cross(x_j - x_i, x_k - x_i)
        if wp.static(mixed):
            velocity = third * (v[i] + v[j] + v[k])
        else:
            velocity = third * (load(v, i) + load(v, j) + load(v, k))
        return third * (x_i + x_j + x_k), velocity, area

    return Faces, corners


@functools.cache
def mixed_vertices(dim: int, scalar: type) -> ForceTerm:
    """Return the term of vertices that are weighted means of particles: their positions and velocities."""
    V = vector(dim, scalar)

    @wp.struct
    class Skin:
        x: wp.array(dtype=V)  # [m], shape [vertex_count]
        v: wp.array(dtype=V)  # [m/s]

    return ForceTerm("skin", Skin)


@functools.cache
def mix_vertices(dim: int, scalar: type, compensated: bool):
    """Compose the kernel, over vertices of all worlds, that computes Σ weight · x and Σ weight · v."""
    V, Vectors, Compensation = state_types(dim, scalar, compensated)
    Skin: Any = mixed_vertices(dim, scalar).Data
    load = records(dim, scalar).load

    @kernel
    def mix(
        # Model:
        particle: wp.array2d(dtype=int),  # k particles of each vertex, shape [vertex_count, k]
        weight: wp.array2d(dtype=scalar),  # weights of these particles, shape [vertex_count, k]
        stride: int,  # particles from one world to the next
        # State in:
        compensation: Compensation,
        x: Vectors,  # [m], shape [particle_count]
        v: Vectors,  # [m/s], shape [particle_count]
        # Out:
        skin: Skin,
    ):
        i = wp.tid()
        first = i / particle.shape[0] * stride
        n = i % particle.shape[0]
        place = V()
        speed = V()
        for k in range(particle.shape[1]):
            j = first + particle[n, k]
            x_j = load(x, j)
            if wp.static(compensated):
                x_j = x_j - load(compensation.x, j)
            place += weight[n, k] * x_j
            speed += weight[n, k] * load(v, j)
        skin.x[i] = place
        skin.v[i] = speed

    return mix
