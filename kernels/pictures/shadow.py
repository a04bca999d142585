"""A shadow map: how far towards the key light the nearest surface is, along parallel rays (float32)."""

import warp as wp

from ..basis import kernel

BLOCK, REACH = 8, 2
"""Texels of a shadow map along an edge of a block, and how many blocks around one are looked at with it."""


@wp.struct
class Lamp:
    """The square across the light that a map covers."""

    u: wp.vec3
    v: wp.vec3
    towards: wp.vec3
    """Unit vectors across and towards the light."""
    corner: wp.vec3
    """The square's first corner along u and v [m], and what distances towards the light are counted from [m]."""
    scale: float
    """Texels per metre."""


@wp.func
def in_lamp(lamp: Lamp, point: wp.vec3) -> wp.vec3:
    """Return a point as (column, row, distance towards the light [m]); a texel's middle is at whole numbers."""
    away = wp.vec3(wp.dot(point, lamp.u), wp.dot(point, lamp.v), wp.dot(point, lamp.towards)) - lamp.corner
    return wp.vec3(lamp.scale * away[0] - 0.5, lamp.scale * away[1] - 0.5, away[2])


@wp.func
def inside(share: float, slope: float, reach: wp.vec2) -> wp.vec2:
    """Return where share + x slope >= 0 holds of x from reach[0] to reach[1]: (first, last)."""
    if slope > 0.0:
        return wp.vec2(wp.max(reach[0], -share / slope), reach[1])
    if slope < 0.0:
        return wp.vec2(reach[0], wp.min(reach[1], -share / slope))
    if share < 0.0:
        return wp.vec2(1.0, 0.0)
    return reach


@kernel
def draw_depth(
    points: wp.array(dtype=wp.vec3),  # [m], shape [vertex_count]
    triangles: wp.array(dtype=wp.vec3i),  # three vertices each, shape [triangle_count]
    lamp: Lamp,
    # In and out:
    depth: wp.array2d(dtype=float),  # [m], shape [size, size]
):
    """Draw every triangle where a texel's middle lies in it; what is nearest to the light counts."""
    t = wp.tid()
    size = depth.shape[0]
    a = in_lamp(lamp, points[triangles[t][0]])
    ab = in_lamp(lamp, points[triangles[t][1]]) - a
    ac = in_lamp(lamp, points[triangles[t][2]]) - a
    area = ab[0] * ac[1] - ab[1] * ac[0]
    if area == 0.0:
        return
    lowest = int(wp.ceil(wp.max(a[1] + wp.min(wp.min(ab[1], ac[1]), 0.0), 0.0)))
    highest = int(wp.floor(wp.min(a[1] + wp.max(wp.max(ab[1], ac[1]), 0.0), float(size - 1))))
    # The shares of b and c at a texel are linear in its column. Inside, neither they nor the rest are below 0.
    b_slope = ac[1] / area
    c_slope = -ab[1] / area
    for row in range(lowest, highest + 1):
        y = float(row) - a[1]
        b = -(y * ac[0] + a[0] * ac[1]) / area
        c = (y * ab[0] + a[0] * ab[1]) / area
        reach = inside(b, b_slope, wp.vec2(0.0, float(size - 1)))
        reach = inside(c, c_slope, reach)
        reach = inside(1.0 - b - c, -b_slope - c_slope, reach)
        near = a[2] + b * ab[2] + c * ac[2]
        slope = b_slope * ab[2] + c_slope * ac[2]
        # A little more than the triangle, so that rounding leaves no gap between neighbours.
        first = int(wp.ceil(reach[0] - 1.0e-3))
        last = int(wp.floor(reach[1] + 1.0e-3))
        for column in range(wp.max(first, 0), wp.min(last, size - 1) + 1):
            wp.atomic_max(depth, row, column, near + float(column) * slope)


@kernel
def nearest_in_blocks(
    depth: wp.array2d(dtype=float),  # as `draw_depth` leaves it [m], shape [BLOCK · n, BLOCK · n]
    # Out:
    nearest: wp.array2d(dtype=float),  # [m], shape [n, n]
):
    """Find what is nearest to the light in each block of texels."""
    row, column = wp.tid()
    largest = depth[wp.static(BLOCK) * row, wp.static(BLOCK) * column]
    for i in range(wp.static(BLOCK)):
        for j in range(wp.static(BLOCK)):
            largest = wp.max(largest, depth[wp.static(BLOCK) * row + i, wp.static(BLOCK) * column + j])
    nearest[row, column] = largest


@kernel
def nearest_around(
    nearest: wp.array2d(dtype=float),  # of blocks [m], shape [n, n]
    # Out:
    around: wp.array2d(dtype=wp.vec4),  # [m], four times the same, shape [n, n]
):
    """Find what is nearest to the light in each block and those up to REACH blocks away."""
    row, column = wp.tid()
    largest = nearest[row, column]
    for i in range(wp.max(row - wp.static(REACH), 0), wp.min(row + wp.static(REACH + 1), nearest.shape[0])):
        for j in range(
            wp.max(column - wp.static(REACH), 0), wp.min(column + wp.static(REACH + 1), nearest.shape[1])
        ):
            largest = wp.max(largest, nearest[i, j])
    around[row, column] = wp.vec4(largest, largest, largest, largest)
