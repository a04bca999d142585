"""Wind: drag and lift on the triangles of a surface, or drag on particles."""

import functools
from typing import Any

import warp as wp

from ..basis import kernel, vector
from ..effect import ElementForce, ForceTerm, on_particles
from .surface_triangles import on_triangles, triangles


@functools.cache
def _blowing(dim: int, scalar: type, function: Any) -> Any:
    """Compose (Winds, numbers, air): data of winds; drag, lift and velocity of wind w; the air velocity at x."""
    V, Numbers = vector(dim, scalar), vector(2 + dim, scalar)

    @wp.struct
    class Winds:
        velocity: wp.array2d(dtype=V)  # of the air [m/s], shape [stages of a frame + 1, wind_count]
        drag: wp.array(dtype=scalar)  # ½ ρ C_d [kg/m³], shape [wind_count]
        lift: wp.array(dtype=scalar)  # ½ ρ C_l [kg/m³], shape [wind_count]

    @wp.func
    def numbers(winds: Winds, w: int, stage: int) -> Numbers:
        own = Numbers()
        own[0] = winds.drag[w]
        own[1] = winds.lift[w]
        for k in range(wp.static(dim)):
            own[2 + k] = winds.velocity[stage, w][k]
        return own

    @wp.func
    def air(own: Numbers, x: V, time: scalar) -> V:
        if wp.static(function is not None):
            return function(x, time)
        velocity = V()
        for k in range(wp.static(dim)):
            velocity[k] = own[2 + k]
        return velocity

    return Winds, numbers, air


@functools.cache
def velocity_of_air(dim: int, scalar: type, function: Any):
    """Compose the kernel, over times and particles, of the air's velocity at each, for a `function` of place."""
    V = vector(dim, scalar)

    @kernel
    def find_velocities(
        x: wp.array(dtype=V),  # [m], shape [particle_count]
        every: int,  # one of so many particles
        time: wp.array(dtype=scalar),  # [s], shape [time_count]
        # Out:
        velocity: wp.array2d(dtype=V),  # [m/s], shape [time_count, particle_count / every]
    ):
        k, n = wp.tid()
        velocity[k, n] = function(x[n * every], time[k])

    return find_velocities


@functools.cache
def wind_on_faces(
    dim: int, scalar: type, compensated: bool, function: Any, mixed: bool, any_closed: bool
) -> tuple[ForceTerm, ElementForce]:
    """Return the term and the law of wind on a surface: the forces of air on the triangles around a particle.

    With u the velocity of a triangle relative to the air, a its area vector and n = a/|a|,

        F = −½ ρ (C_d |u·a| u + C_l (u·a) (|u| n − (u·n) u/|u|))

    and each corner takes a third. Drag is against u, as on a plate of the area projected along u; lift is across,
    towards the lee side. Both sides of the surface count. A closed surface has air only outside, so only triangles
    moving against the air have a force, u·a > 0: together they have the area projected along u. Without relative
    velocity the force is exactly 0.
    Reference: Wejchert & Haumann, Computer Graphics 25 (4) (1991) 19-22, for flow undisturbed by other triangles;
    the quadratic drag is as on a plate.

    `function` is a wp.func (x, t) -> air velocity [m/s]; None if velocities are tabulated. `mixed`: vertices
    are weighted means of particles (see `triangles`). `any_closed`: some triangle is part of a closed surface.
    """
    V, Numbers, Rows = vector(dim, scalar), vector(2 + dim, scalar), wp.types.matrix((3, dim), scalar)
    Triangles: Any = triangles(dim, scalar, mixed)
    Winds, of_wind, air = _blowing(dim, scalar, function)

    @wp.struct
    class WindOnFaces:
        winds: Winds
        faces: Triangles
        wind: wp.array(dtype=int)  # index of the wind on each triangle, shape [triangle_count]
        if any_closed:
            closed: wp.array(dtype=bool)  # whether the triangle's surface is closed, shape [triangle_count]

    @wp.func
    def numbers(data: WindOnFaces, t: int, stage: int) -> Numbers:
        return of_wind(data.winds, data.wind[t], stage)

    @wp.func
    def evaluate(data: WindOnFaces, t: int, time: scalar, stage: int, x: Rows, v: Rows, own: Numbers) -> V:
        third = scalar(1.0) / scalar(3.0)
        a = scalar(0.5) * wp.cross(x[1] - x[0], x[2] - x[0])  # outward by the right-hand rule
        u = third * (v[0] + v[1] + v[2]) - air(own, third * (x[0] + x[1] + x[2]), time)
        through = wp.dot(u, a)
        if wp.static(any_closed):
            if data.closed[t] and through < scalar(0.0):
                return V()
        force = -own[0] * wp.abs(through) * u
        speed = wp.length(u)
        area = wp.length(a)
        if own[1] * speed * area > scalar(0.0):
            force -= own[1] * through / area * (speed * a - through / speed * u)
        if wp.static(mixed):
            return force
        return force / scalar(3.0)

    law = ElementForce(evaluate, numbers, 2 + dim, points=3, shared=mixed)
    force = on_triangles(dim, scalar, compensated, mixed, WindOnFaces, law)
    return ForceTerm("wind", WindOnFaces, force=force, selective=True, timed=True, works=True), law


@functools.cache
def wind_on_particles(dim: int, scalar: type, compensated: bool, function: Any) -> tuple[ForceTerm, ElementForce]:
    """Return the term and the law of wind on particles: −½ ρ C_d A |u| u on a particle of area A."""
    V, Numbers, Rows = vector(dim, scalar), vector(2 + dim, scalar), wp.types.matrix((1, dim), scalar)
    Winds, of_wind, air = _blowing(dim, scalar, function)

    @wp.struct
    class WindOnParticles:
        winds: Winds
        wind: wp.array(dtype=int)  # index of the wind on each particle, shape [particle_count]
        area: wp.array(dtype=scalar)  # [m²], shape [particle_count]

    @wp.func
    def numbers(data: WindOnParticles, i: int, stage: int) -> Numbers:
        return of_wind(data.winds, data.wind[i], stage)

    @wp.func
    def evaluate(data: WindOnParticles, i: int, time: scalar, stage: int, x: Rows, v: Rows, own: Numbers) -> V:
        u = v[0] - air(own, x[0], time)
        return -own[0] * data.area[i] * wp.length(u) * u

    law = ElementForce(evaluate, numbers, 2 + dim, of_particles=True)
    force = on_particles(dim, scalar, compensated, WindOnParticles, law)
    return ForceTerm("drag", WindOnParticles, force=force, selective=True, timed=True, works=True), law
