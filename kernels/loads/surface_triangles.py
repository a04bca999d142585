"""Triangles of surfaces, for loads that act on them."""

import functools
from typing import Any

import warp as wp

from ..basis import kernel, vector
from ..compensation import position_of, state_types
from ..effect import ElementForce, instant
from ..records import records


@functools.cache
def triangles(dim: int, scalar: type, mixed: bool) -> Any:
    """Compose the struct of triangles with the particles around them.

    If `mixed`, vertices are weighted means of particles, which `mix_vertices` computes. A triangle's force is then
    shared by particles in proportion to their weights in the corners.
    """
    V = vector(dim, scalar)

    @wp.struct
    class Triangles:
        corner: wp.array(dtype=wp.vec3i)  # vertices of each triangle, shape [triangle_count]
        first: wp.array(dtype=int)  # row starts of `number`, shape [particle_count + 1]
        number: wp.array(dtype=int)  # triangles of each particle, shape [3 triangle_count], or [any] if mixed
        if mixed:
            share: wp.array(dtype=scalar)  # of the particle in the triangle's force, shape [any]
            x: wp.array(dtype=V)  # of vertices [m], shape [vertex_count]
            v: wp.array(dtype=V)  # [m/s]

    return Triangles


@functools.cache
def on_triangles(dim: int, scalar: type, compensated: bool, mixed: bool, Data: Any, law: ElementForce) -> Any:
    """Compose `ForceTerm.force` of elements that are triangles, `data.faces`: the sum of those at a particle."""
    V, Instant = vector(dim, scalar), instant(dim, scalar, compensated)
    Rows, (evaluate, numbers, *_) = wp.types.matrix((3, dim), scalar), law
    load, position = records(dim, scalar).load, position_of(dim, scalar, compensated)

    @wp.func
    def force_of_triangles(data: Data, now: Instant, i: int) -> V:
        total = V()
        for n in range(data.faces.first[i], data.faces.first[i + 1]):
            t = data.faces.number[n]
            x = Rows()
            v = Rows()
            for k in range(3):
                corner = data.faces.corner[t][k]
                if wp.static(mixed):
                    x[k] = data.faces.x[corner]
                    v[k] = data.faces.v[corner]
                else:
                    x[k] = position(now.compensation, now.x, corner)
                    v[k] = load(now.v, corner)
            force = evaluate(data, t, now.time, now.stage, x, v, numbers(data, t, now.stage))
            if wp.static(mixed):
                force = data.faces.share[n] * force
            total += force
        return total

    return force_of_triangles


@functools.cache
def area_vector(dim: int, scalar: type) -> Any:
    """Compose wp.func (x) -> half the cross product of a triangle's edges, outward by the right-hand rule [m²]."""
    V, Rows = vector(dim, scalar), wp.types.matrix((3, dim), scalar)

    @wp.func
    def area(x: Rows) -> V:
        return scalar(0.5) * wp.cross(x[1] - x[0], x[2] - x[0])

    return area


@functools.cache
def mixed_vertices(dim: int, scalar: type) -> Any:
    """Compose the struct of vertices that are weighted means of particles: their positions and velocities."""
    V = vector(dim, scalar)

    @wp.struct
    class Skin:
        x: wp.array(dtype=V)  # [m], shape [vertex_count]
        v: wp.array(dtype=V)  # [m/s]

    return Skin


@functools.cache
def mix_vertices(dim: int, scalar: type, compensated: bool):
    """Compose the kernel, over vertices of all worlds, that computes Σ weight · x and Σ weight · v."""
    V, Vectors, Compensation = state_types(dim, scalar, compensated)
    Skin: Any = mixed_vertices(dim, scalar)
    load, position = records(dim, scalar).load, position_of(dim, scalar, compensated)

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
            place += weight[n, k] * position(compensation, x, j)
            speed += weight[n, k] * load(v, j)
        skin.x[i] = place
        skin.v[i] = speed

    return mix
