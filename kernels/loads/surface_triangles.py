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
            weight: wp.array(dtype=scalar)  # of the particle in the triangle's force, shape [any]
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
            own = numbers(data, t, now.stage)  # before the corners: for an H200 that takes 8 registers less
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
            force = evaluate(data, t, now.time, now.stage, x, v, own)
            if wp.static(mixed):
                force = data.faces.weight[n] * force
            total += force
        return total

    return force_of_triangles


@functools.cache
def mix_vertices(dim: int, scalar: type, compensated: bool):
    """Compose the kernel, over vertices of all worlds, that computes Σ weight · x and Σ weight · v."""
    V, Vectors, Compensation = state_types(dim, scalar, compensated)
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
        # Out, of vertices:
        place: wp.array(dtype=V),  # [m]
        speed: wp.array(dtype=V),  # [m/s]
    ):
        i = wp.tid()
        first = i / particle.shape[0] * stride
        n = i % particle.shape[0]
        mean_x = V()
        mean_v = V()
        for k in range(particle.shape[1]):
            j = first + particle[n, k]
            mean_x += weight[n, k] * position(compensation, x, j)
            mean_v += weight[n, k] * load(v, j)
        place[i] = mean_x
        speed[i] = mean_v

    return mix
