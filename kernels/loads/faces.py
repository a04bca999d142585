"""The triangles of a surface, as loads on it see them."""

import functools

import warp as wp

from ..basis import vector
from ..compensation import compensation
from ..records import records


@functools.cache
def face(dim: int, scalar: type, compensated: bool):
    """Compose (Faces, corners): triangles with the particles at their corners, and what a load needs of one.

    corners(faces, lost, x, v, t) -> (centre, velocity, area vector) of triangle t: means of its corners, and half
    the product of two edges, out of the surface by the right-hand rule. Only three coordinates have area vectors.
    """
    V = vector(dim, scalar)
    Lost, _ = compensation(dim, scalar, compensated)
    load = records(dim, scalar).load

    @wp.struct
    class Faces:
        corner: wp.array(dtype=wp.vec3i)  # the particles of each triangle, shape [triangle_count]
        first: wp.array(dtype=int)  # where the triangles around each particle begin, shape [particle_count + 1]
        number: wp.array(dtype=int)  # which triangle it is, shape [3 triangle_count]

    @wp.func
    def place(lost: Lost, x: wp.array(dtype=V), i: int) -> V:
        x_i = load(x, i)
        if wp.static(compensated):
            x_i = x_i - load(lost.x, i)
        return x_i

    @wp.func
    def corners(faces: Faces, lost: Lost, x: wp.array(dtype=V), v: wp.array(dtype=V), t: int):
        i = faces.corner[t][0]
        j = faces.corner[t][1]
        k = faces.corner[t][2]
        x_i = place(lost, x, i)
        x_j = place(lost, x, j)
        x_k = place(lost, x, k)
        third = scalar(1.0) / scalar(3.0)
        area = V()
        if wp.static(dim == 3):
            area = scalar(0.5) * wp.cross(x_j - x_i, x_k - x_i)
        velocity = third * (load(v, i) + load(v, j) + load(v, k))
        return third * (x_i + x_j + x_k), velocity, area

    return Faces, corners
