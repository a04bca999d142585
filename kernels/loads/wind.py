"""Wind: drag and lift on the triangles of a surface, or drag on particles."""

import functools
from typing import Any

import warp as wp

from ..basis import vector
from ..compensation import compensation
from ..effect import Piece
from ..records import records
from .faces import face


@functools.cache
def wind(dim: int, scalar: type, compensated: bool, faces: bool, lifts: bool, function: Any) -> Piece:
    """Return what wind adds to kernels: the force of the air on the faces around a particle, or on itself.

    With u the velocity of a triangle against the air, a its area vector and n = a/|a|,

        F = −½ ρ (C_d |u·a| u + C_l (u·a) (|u| n − (u·n) u/|u|))

    of which each corner takes a third: drag against u as on a plate of the area seen along u, lift across u
    towards the lee side; both sides of the surface count. A particle of area A feels −½ ρ C_d A |u| u. Without a
    relative speed there is no force, exactly.
    Reference: Wejchert & Haumann, Computer Graphics 25 (4) (1991) 19-22; drag as on a flat plate.

    Parameters
    ----------
    dim, scalar, compensated
        Coordinates, numbers, and whether sums keep what rounding takes away.
    faces
        Whether it acts on triangles; else on particles.
    lifts
        Whether there is lift.
    function
        A wp.func (x, t) -> velocity of the air [m/s]; None where it is given by numbers.
    """
    V = vector(dim, scalar)
    Lost, _ = compensation(dim, scalar, compensated)
    load = records(dim, scalar).load
    Faces, corners = face(dim, scalar, compensated)

    @wp.struct
    class Wind:
        velocity: wp.array(dtype=V)  # of the air in each stage of a frame, and at its end [m/s]
        drag: scalar  # ½ ρ C_d [kg/m³]
        lift: scalar  # ½ ρ C_l [kg/m³]
        faces: Faces  # the triangles around each particle
        area: wp.array(dtype=scalar)  # of each particle [m²], where it acts on particles

    @wp.func
    def air(w: Wind, x: V, time: scalar, stage: int) -> V:
        if wp.static(function is not None):
            return function(x, time)
        return w.velocity[stage]

    @wp.func
    def push(w: Wind, u: V, a: V) -> V:
        through = wp.dot(u, a)
        force = -w.drag * wp.abs(through) * u
        if wp.static(lifts):
            speed = wp.length(u)
            area = wp.length(a)
            if speed * area > scalar(0.0):
                force -= w.lift * through / area * (speed * a - through / speed * u)
        return force

    def force(World: Any):
        @wp.func
        def blow(world: World, lost: Lost, x: wp.array(dtype=V), v: wp.array(dtype=V), i: int) -> V:
            time = world.time[world.stage]
            if wp.static(not faces):
                u = load(v, i) - air(world.wind, load(x, i), time, world.stage)
                return -world.wind.drag * world.wind.area[i] * wp.length(u) * u
            total = V()
            for e in range(world.wind.faces.first[i], world.wind.faces.first[i + 1]):
                centre, velocity, a = corners(world.wind.faces, lost, x, v, world.wind.faces.number[e])
                u = velocity - air(world.wind, centre, time, world.stage)
                total += push(world.wind, u, a) / scalar(3.0)
            return total

        return blow

    return Piece("wind", Wind, force=force, selective=True, timed=True, works=True)
