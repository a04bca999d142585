"""Wind: drag and lift on the triangles of a surface, or drag on particles."""

import functools
from typing import Any

import warp as wp

from ..basis import kernel, vector
from ..compensation import state_types
from ..effect import ForceTerm
from ..records import records
from .surface_triangles import face


@functools.cache
def _blows(dim: int, scalar: type, function: Any):
    """Compose (Winds, air): data of winds, and the air velocity at x of wind w in a stage of a frame."""
    V = vector(dim, scalar)

    @wp.struct
    class Winds:
        velocity: wp.array2d(dtype=V)  # of the air [m/s], shape [stages of a frame + 1, wind_count]
        drag: wp.array(dtype=scalar)  # ½ ρ C_d [kg/m³], shape [wind_count]
        lift: wp.array(dtype=scalar)  # ½ ρ C_l [kg/m³], shape [wind_count]

    @wp.func
    def air(winds: Winds, x: V, time: scalar, stage: int, w: int) -> V:
        if wp.static(function is not None):
            return function(x, time)
        return winds.velocity[stage, w]

    return Winds, air


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
def _force_on_face(dim: int, scalar: type):
    """Compose push(drag, lift, u, a): the force on a triangle, see `wind_on_faces`."""
    V = vector(dim, scalar)

    @wp.func
    def push(drag: scalar, lift: scalar, u: V, a: V) -> V:
        through = wp.dot(u, a)
        force = -drag * wp.abs(through) * u
        speed = wp.length(u)
        area = wp.length(a)
        if lift * speed * area > scalar(0.0):
            force -= lift * through / area * (speed * a - through / speed * u)
        return force

    return push


@functools.cache
def wind_on_faces(
    dim: int, scalar: type, compensated: bool, function: Any, mixed: bool = False, any_closed: bool = False
) -> ForceTerm:
    """Return the term of wind on a surface: the forces of air on the triangles around a particle.

    With u the velocity of a triangle relative to the air, a its area vector and n = a/|a|,

        F = −½ ρ (C_d |u·a| u + C_l (u·a) (|u| n − (u·n) u/|u|))

    and each corner takes a third. Drag is against u, as on a plate of the area projected along u; lift is across,
    towards the lee side. Both sides of the surface count. A closed surface has air only outside, so only triangles
    moving against the air have a force, u·a > 0: together they have the area projected along u. Without relative
    velocity the force is exactly 0.
    Reference: Wejchert & Haumann, Computer Graphics 25 (4) (1991) 19-22, for flow undisturbed by other triangles;
    the quadratic drag is as on a plate.

    `function` is a wp.func (x, t) -> air velocity [m/s]; None if velocities are tabulated. `mixed`: vertices
    are weighted means of particles (see `face`). `any_closed`: some triangle is part of a closed surface.
    """
    V, Vectors, Compensation = state_types(dim, scalar, compensated)
    Faces, corners = face(dim, scalar, compensated, mixed)
    Winds, air = _blows(dim, scalar, function)
    push = _force_on_face(dim, scalar)

    @wp.struct
    class WindOnFaces:
        winds: Winds
        faces: Faces
        wind: wp.array(dtype=int)  # index of the wind on each triangle, shape [triangle_count]
        if any_closed:
            closed: wp.array(dtype=bool)  # whether the triangle's surface is closed, shape [triangle_count]

    def force(SceneData: Any):
        @wp.func
        def blow(scene: SceneData, compensation: Compensation, x: Vectors, v: Vectors, i: int) -> V:
            total = V()
            for e in range(scene.wind.faces.first[i], scene.wind.faces.first[i + 1]):
                t = scene.wind.faces.number[e]
                w = scene.wind.wind[t]
                if wp.static(mixed):
                    centre, velocity, a = corners(scene.wind.faces, compensation, scene.skin.x, scene.skin.v, t)
                else:
                    centre, velocity, a = corners(scene.wind.faces, compensation, x, v, t)
                u = velocity - air(scene.wind.winds, centre, scene.time[scene.stage], scene.stage, w)
                if wp.static(any_closed):
                    if scene.wind.closed[t] and wp.dot(u, a) < scalar(0.0):
                        continue
                if wp.static(mixed):
                    f = push(scene.wind.winds.drag[w], scene.wind.winds.lift[w], u, a)
                    total += scene.wind.faces.share[e] * f
                else:
                    total += push(scene.wind.winds.drag[w], scene.wind.winds.lift[w], u, a) / scalar(3.0)
            return total

        return blow

    return ForceTerm("wind", WindOnFaces, force=force, selective=True, timed=True, works=True)


def _numbers_of_air(dim: int, scalar: type, Data: Any, function: Any, on_faces: bool):
    """Compose (Numbers, numbers, air): drag, lift and velocity of an element's wind; the air velocity at x."""
    V, Numbers = vector(dim, scalar), vector(2 + dim, scalar)

    @wp.func
    def numbers(data: Data, e: int, i: int, stage: int) -> Numbers:
        member = i
        if wp.static(on_faces):
            member = e
        w = data.wind[member]
        own = Numbers()
        own[0] = data.winds.drag[w]
        own[1] = data.winds.lift[w]
        for k in range(wp.static(dim)):
            own[2 + k] = data.winds.velocity[stage, w][k]
        return own

    @wp.func
    def air(own: Numbers, x: V, time: scalar) -> V:
        if wp.static(function is not None):
            return function(x, time)
        velocity = V()
        for k in range(wp.static(dim)):
            velocity[k] = own[2 + k]
        return velocity

    return Numbers, numbers, air


@functools.cache
def projection_on_faces(dim: int, scalar: type, WindOnFaces: Any, function: Any, any_closed: bool):
    """Compose (projected, numbers): φ·F of a triangle, and the numbers of its wind, for `adjoint.elements`."""
    Rows: Any = wp.types.matrix((3, dim), scalar)
    push = _force_on_face(dim, scalar)
    Numbers, numbers, air = _numbers_of_air(dim, scalar, WindOnFaces, function, True)

    @wp.func
    def projected(
        data: WindOnFaces, t: int, i: int, time: scalar, stage: int, x: Rows, v: Rows, phi: Rows, own: Numbers
    ) -> scalar:
        third = scalar(1.0) / scalar(3.0)
        a = scalar(0.5) * wp.cross(x[1] - x[0], x[2] - x[0])
        u = third * (v[0] + v[1] + v[2]) - air(own, third * (x[0] + x[1] + x[2]), time)
        along = third * wp.dot(push(own[0], own[1], u, a), phi[0] + phi[1] + phi[2])
        if wp.static(any_closed):
            if data.closed[t] and wp.dot(u, a) < scalar(0.0):
                along = scalar(0.0)
        return along

    return projected, numbers


@functools.cache
def wind_on_particles(dim: int, scalar: type, compensated: bool, function: Any) -> ForceTerm:
    """Return the term of wind on particles: −½ ρ C_d A |u| u on a particle of area A."""
    V, Vectors, Compensation = state_types(dim, scalar, compensated)
    load = records(dim, scalar).load
    Winds, air = _blows(dim, scalar, function)

    @wp.struct
    class WindOnParticles:
        winds: Winds
        wind: wp.array(dtype=int)  # index of the wind on each particle, shape [particle_count]
        area: wp.array(dtype=scalar)  # [m²], shape [particle_count]

    def force(SceneData: Any):
        @wp.func
        def blow(scene: SceneData, compensation: Compensation, x: Vectors, v: Vectors, i: int) -> V:
            w = scene.drag.wind[i]
            u = load(v, i) - air(scene.drag.winds, load(x, i), scene.time[scene.stage], scene.stage, w)
            return -scene.drag.winds.drag[w] * scene.drag.area[i] * wp.length(u) * u

        return blow

    return ForceTerm("drag", WindOnParticles, force=force, selective=True, timed=True, works=True)


@functools.cache
def projection_on_particles(dim: int, scalar: type, WindOnParticles: Any, function: Any):
    """Compose (projected, numbers): φ·F of a particle, and the numbers of its wind, for `adjoint.elements`."""
    Rows: Any = wp.types.matrix((1, dim), scalar)
    Numbers, numbers, air = _numbers_of_air(dim, scalar, WindOnParticles, function, False)

    @wp.func
    def projected(
        data: WindOnParticles, e: int, i: int, time: scalar, stage: int, x: Rows, v: Rows, phi: Rows, own: Numbers
    ) -> scalar:
        u = v[0] - air(own, x[0], time)
        return -own[0] * data.area[i] * wp.length(u) * wp.dot(u, phi[0])

    return projected, numbers
