"""The volume of a cell, and its derivatives with respect to corner positions."""

import functools

import warp as wp

from ..basis import fully_hashed, vector

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
"""Corners around each corner of a solid cell: a, b, c along its edges, right-handed; diagonal to ab, bc, ca."""


@functools.cache
def cell_geometry(dim: int, scalar: type, solid: bool, flat: bool):
    """Compose (Rows, geometry, turning): a matrix with a corner per row, and functions of this matrix.

    geometry(points, is_flat) -> (volume, ∂V/∂x_c in row c). turning(points, is_flat) -> Σ_j |∂²V/∂x_c ∂x_j| for
    each corner c. There are 8 rows if any cell is solid, otherwise 4.
    """
    V, corners = vector(dim, scalar), 8 if solid else 4
    Rows, Numbers = wp.types.matrix((corners, dim), scalar), wp.types.vector(corners, scalar)

    @wp.func
    def turning_at(a: V, b: V, c: V, ab: V, bc: V, ca: V) -> scalar:
        near = wp.length(ab - ca + b - c) + wp.length(bc - ab + c - a) + wp.length(ca - bc + a - b)
        return (near + wp.length(a - b) + wp.length(b - c) + wp.length(c - a)) / scalar(12.0)

    @wp.func
    def solid_geometry(points: Rows):
        """Return the volume of a cell, and its gradient.

        With x = m + a ξ + b η + c ζ + d ηζ + e ζξ + f ξη + g ξηζ over the cube from −1 to 1,
        V = ∫ det(∂x/∂(ξ, η, ζ)) = 8 (a·b×c + (c·e×d + b·d×f + a·f×e)/3); the other terms vanish.
        """
        # Sums and differences along ξ, at four pairs (η, ζ): −−, +−, −+, ++.
        s0, d0 = points[1] + points[0], points[1] - points[0]
        s1, d1 = points[2] + points[3], points[2] - points[3]
        s2, d2 = points[5] + points[4], points[5] - points[4]
        s3, d3 = points[6] + points[7], points[6] - points[7]
        a, e, f = (d1 + d0) + (d3 + d2), (d3 + d2) - (d1 + d0), (d1 - d0) + (d3 - d2)
        b, c, d = (s1 - s0) + (s3 - s2), (s3 + s2) - (s1 + s0), (s3 - s2) - (s1 - s0)
        # Each vector is 8 times the docstring's, so V and its gradient have a factor of 1/64.
        third, scale = scalar(1.0) / scalar(3.0), scalar(1.0) / scalar(64.0)
        of_a = scale * (wp.cross(b, c) + third * wp.cross(f, e))
        of_b = scale * (wp.cross(c, a) + third * wp.cross(d, f))
        of_c = scale * (wp.cross(a, b) + third * wp.cross(e, d))
        of_d = scale * third * (wp.cross(c, e) + wp.cross(f, b))
        of_e = scale * third * (wp.cross(d, c) + wp.cross(a, f))
        of_f = scale * third * (wp.cross(b, d) + wp.cross(e, a))
        volume = third * (wp.dot(a, of_a) + wp.dot(b, of_b) + wp.dot(c, of_c))
        volume += third * (wp.dot(d, of_d) + wp.dot(e, of_e) + wp.dot(f, of_f))
        gradient = Rows()
        odd, even = of_a - of_e - of_f, of_d - of_b - of_c
        gradient[0] = even - odd
        gradient[1] = even + odd
        odd, even = of_a - of_e + of_f, of_b - of_c - of_d
        gradient[3] = even - odd
        gradient[2] = even + odd
        odd, even = of_a + of_e - of_f, of_c - of_b - of_d
        gradient[4] = even - odd
        gradient[5] = even + odd
        odd, even = of_a + of_e + of_f, of_b + of_c + of_d
        gradient[7] = even - odd
        gradient[6] = even + odd
        return volume, gradient

    @wp.func
    def flat_geometry(points: Rows):
        """Return the area of a cell, half the cross product of its diagonals, and its gradient."""
        p = scalar(0.5) * (points[2] - points[0])
        q = scalar(0.5) * (points[3] - points[1])
        along_p = V()
        along_q = V()
        if wp.static(dim == 3):
            normal = scalar(2.0) * wp.cross(p, q)
            area = wp.length(normal)
            if area > scalar(0.0):
                along_p = wp.cross(q, normal / area)
                along_q = wp.cross(normal / area, p)
        else:
            area = scalar(2.0) * (p[0] * q[1] - p[1] * q[0])
            along_p = V(q[1], -q[0])
            along_q = V(-p[1], p[0])
        gradient = Rows()
        gradient[0] = -along_p
        gradient[1] = -along_q
        gradient[2] = along_p
        gradient[3] = along_q
        return area, gradient

    @wp.func
    def geometry(points: Rows, is_flat: bool):
        volume = scalar(0.0)
        gradient = Rows()
        if wp.static(solid):
            if not is_flat:
                volume, gradient = solid_geometry(points)
        if wp.static(flat):
            if is_flat:
                volume, gradient = flat_geometry(points)
        return volume, gradient

    @wp.func
    def flat_turning(p: V, q: V) -> scalar:
        """Return `turning` at the two corners on the diagonal p of a flat cell with the other diagonal q."""
        result = scalar(1.0)
        if wp.static(dim == 3):
            area = wp.length(wp.cross(p, q))  # twice the cell's area
            if area > scalar(0.0):
                result += (wp.abs(wp.dot(p, q)) + wp.dot(q, q)) / area
        return result

    @fully_hashed
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
