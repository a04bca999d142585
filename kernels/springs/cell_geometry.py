"""The volume of a cell, and its derivatives by the positions of the corners."""

import functools

import warp as wp

from ..basis import vector

AROUND = (
    (1, 3, 4, 2, 7, 5),
    (2, 0, 5, 3, 4, 6),
    (3, 1, 6, 0, 5, 7),
    (0, 2, 7, 1, 6, 4),
    (7, 5, 0, 6, 1, 3),
    (4, 6, 1, 7, 2, 0),
    (5, 7, 2, 4, 3, 1),
    (6, 4, 3, 5, 0, 2),
)
"""Corners around each corner of a solid cell: a, b, c along its edges, right-handed; across ab, bc, ca."""


@functools.cache
def cell_geometry(dim: int, scalar: type, solid: bool, flat: bool):
    """Compose (Rows, geometry, turning): a matrix with a corner in each row, and functions of it.

    geometry(points, is_flat) -> (volume, ∂V/∂x_c in row c). turning(points, is_flat) -> Σ_j |∂²V/∂x_c ∂x_j| of
    each corner c. There are 8 rows if any cell is solid, else 4.
    """
    V, corners = vector(dim, scalar), 8 if solid else 4
    Rows, Numbers = wp.types.matrix((corners, dim), scalar), wp.types.vector(corners, scalar)

    @wp.func
    def gradient_at(o: V, a: V, b: V, c: V, ab: V, bc: V, ca: V) -> V:
        total = wp.cross(ab - o, a - b) + wp.cross(bc - o, b - c) + wp.cross(ca - o, c - a)
        return (total - wp.cross(b - a, c - a)) / scalar(12.0)

    @wp.func
    def turning_at(a: V, b: V, c: V, ab: V, bc: V, ca: V) -> scalar:
        near = wp.length(ab - ca + b - c) + wp.length(bc - ab + c - a) + wp.length(ca - bc + a - b)
        return (near + wp.length(a - b) + wp.length(b - c) + wp.length(c - a)) / scalar(12.0)

    @wp.func
    def geometry(points: Rows, is_flat: bool):
        gradient = Rows()
        volume = scalar(0.0)
        if wp.static(solid):
            if not is_flat:
                for k in range(8):
                    gradient[k] = gradient_at(
                        points[k],
                        points[wp.static(AROUND[k][0])],
                        points[wp.static(AROUND[k][1])],
                        points[wp.static(AROUND[k][2])],
                        points[wp.static(AROUND[k][3])],
                        points[wp.static(AROUND[k][4])],
                        points[wp.static(AROUND[k][5])],
                    )
                    volume += wp.dot(points[k] - points[0], gradient[k]) / scalar(3.0)
        if wp.static(flat):
            if is_flat:
                p = scalar(0.5) * (points[2] - points[0])
                q = scalar(0.5) * (points[3] - points[1])
                along_p = V()
                along_q = V()
                if wp.static(dim == 3):
                    normal = scalar(2.0) * wp.cross(p, q)
                    volume = wp.length(normal)
                    if volume > scalar(0.0):
                        along_p = wp.cross(q, normal / volume)
                        along_q = wp.cross(normal / volume, p)
                else:
                    volume = scalar(2.0) * (p[0] * q[1] - p[1] * q[0])
                    along_p = V(q[1], -q[0])
                    along_q = V(-p[1], p[0])
                gradient[0] = -along_p
                gradient[1] = -along_q
                gradient[2] = along_p
                gradient[3] = along_q
        return volume, gradient

    @wp.func
    def flat_turning(p: V, q: V) -> scalar:
        """Return the sum at an end of the diagonal p of a flat cell, whose other one is q."""
        result = scalar(1.0)
        if wp.static(dim == 3):
            area = wp.length(wp.cross(p, q))  # twice that of the cell
            if area > scalar(0.0):
                result += (wp.abs(wp.dot(p, q)) + wp.dot(q, q)) / area
        return result

    @wp.func
    def turning(points: Rows, is_flat: bool):
        result = Numbers()
        if wp.static(solid):
            if not is_flat:
                for k in range(8):
                    result[k] = turning_at(
                        points[wp.static(AROUND[k][0])],
                        points[wp.static(AROUND[k][1])],
                        points[wp.static(AROUND[k][2])],
                        points[wp.static(AROUND[k][3])],
                        points[wp.static(AROUND[k][4])],
                        points[wp.static(AROUND[k][5])],
                    )
        if wp.static(flat):
            if is_flat:
                p = points[2] - points[0]
                q = points[3] - points[1]
                result[0] = flat_turning(p, q)
                result[1] = flat_turning(q, p)
                result[2] = result[0]
                result[3] = result[1]
        return result

    return Rows, geometry, turning
