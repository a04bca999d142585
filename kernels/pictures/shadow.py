"""A shadow map: distances of the nearest surfaces towards the key light, along parallel rays (float32)."""

import warp as wp

from ..basis import kernel

BLOCK = 8
"""Edge of a block of the shadow map, in texels."""

LEAST, MOST = 1.25, 24.0
"""Least and largest sampling radius around a point, in texels: half the width of a shadow's edge at a contact, and
far from one. The largest stays within the blocks that are checked around a point."""
STEEPEST = 6.0
"""Limit of the slopes of surfaces along the light, so that rounding casts no shadows."""
SAMPLES, FIRST = 16, 8
"""Points of the light that a pixel samples, and how many of these first; the others follow only if some, but not
all, of the first are hidden. Each of 2 x 2 pixels samples others, so that soft edges have no visible steps."""


@wp.struct
class DepthMap:
    """A shadow map: the surfaces that the key light reaches first, in a square across it, and sampling points."""

    u: wp.vec3  # unit vectors across and towards the light
    v: wp.vec3
    towards: wp.vec3
    corner: wp.vec3  # its first corner along u and v, and the origin of distances towards the light [m]
    scale: float  # texels per metre
    depth: wp.array2d(dtype=float)  # distance towards the light of the first surface [m], shape [size, size]
    around: wp.array2d(dtype=wp.vec4)  # maximum over a block and the blocks around it, shape [size / BLOCK] * 2
    softness: float  # radius of the light over its distance
    spots: wp.array(dtype=wp.vec2)  # points of the light, a disc of radius 1, shape [4 · SAMPLES]: `light.spread`


@wp.func
def in_map(shadows: DepthMap, point: wp.vec3) -> wp.vec3:
    """Return (column, row, distance towards the light [m]) of a point; texel centres are at whole numbers."""
    place = wp.vec3(wp.dot(point, shadows.u), wp.dot(point, shadows.v), wp.dot(point, shadows.towards))
    away = place - shadows.corner
    return wp.vec3(shadows.scale * away[0] - 0.5, shadows.scale * away[1] - 0.5, away[2])


@wp.func
def inverse(slope: float) -> float:
    """Return 1 / slope, or 0 for a negligible slope."""
    if wp.abs(slope) < 1.0e-30:
        return 0.0
    return 1.0 / slope


@wp.func
def narrow(start: float, run: float, reach: wp.vec2) -> wp.vec2:
    """Return the part of the interval `reach` where start + x / run >= 0; if run is 0, where start >= 0."""
    if run > 0.0:
        return wp.vec2(wp.max(reach[0], -start * run), reach[1])
    if run < 0.0:
        return wp.vec2(reach[0], wp.min(reach[1], -start * run))
    if start < 0.0:
        return wp.vec2(1.0, 0.0)
    return reach


@kernel
def draw_depth(
    points: wp.array(dtype=wp.vec3),  # [m], shape [vertex_count]
    triangles: wp.array(dtype=wp.vec3i),  # three vertices each, shape [triangle_count]
    closed: wp.array(dtype=wp.bool),  # whether a triangle's back is never visible, shape [triangle_count]
    # In and out:
    shadows: DepthMap,  # its depth
):
    """Draw every triangle into the texels whose centres it covers, and keep the nearest to the light."""
    t = wp.tid()
    size = shadows.depth.shape[0]
    a = in_map(shadows, points[triangles[t][0]])
    ab = in_map(shadows, points[triangles[t][1]]) - a
    ac = in_map(shadows, points[triangles[t][2]]) - a
    area = ab[0] * ac[1] - ab[1] * ac[0]
    if area == 0.0 or (closed[t] and area < 0.0):
        return
    lowest = int(wp.ceil(wp.max(a[1] + wp.min(wp.min(ab[1], ac[1]), 0.0), 0.0)))
    highest = int(wp.floor(wp.min(a[1] + wp.max(wp.max(ab[1], ac[1]), 0.0), float(size - 1))))
    # The weights of b and c are linear in a texel's column. Inside, all three weights are at least 0.
    b_slope = ac[1] / area
    c_slope = -ab[1] / area
    b_run = inverse(b_slope)
    c_run = inverse(c_slope)
    a_run = inverse(-b_slope - c_slope)
    slope = b_slope * ab[2] + c_slope * ac[2]
    for row in range(lowest, highest + 1):
        y = float(row) - a[1]
        b = -(y * ac[0] + a[0] * ac[1]) / area
        c = (y * ab[0] + a[0] * ab[1]) / area
        reach = narrow(b, b_run, wp.vec2(0.0, float(size - 1)))
        reach = narrow(c, c_run, reach)
        reach = narrow(1.0 - b - c, a_run, reach)
        near = a[2] + b * ab[2] + c * ac[2]
        # Slightly more than the triangle, so that rounding leaves no gaps between adjacent ones.
        first = int(wp.ceil(wp.min(reach[0], float(size)) - 1.0e-3))
        last = int(wp.floor(wp.max(reach[1], -1.0) + 1.0e-3))
        for column in range(wp.max(first, 0), wp.min(last, size - 1) + 1):
            wp.atomic_max(shadows.depth, row, column, near + float(column) * slope)


@wp.func
def nearest_around_spot(shadows: DepthMap, at: wp.vec3) -> float:
    """Return the distance towards the light of the first surface around a point [m], linear between blocks."""
    last = shadows.around.shape[0] - 1
    column = wp.clamp(at[0] * wp.static(1.0 / BLOCK) - 0.5, 0.0, float(last))
    row = wp.clamp(at[1] * wp.static(1.0 / BLOCK) - 0.5, 0.0, float(last))
    c = wp.min(int(column), last - 1)
    r = wp.min(int(row), last - 1)
    s = column - float(c)
    t = row - float(r)
    upper = (1.0 - s) * shadows.around[r, c][0] + s * shadows.around[r, c + 1][0]
    lower = (1.0 - s) * shadows.around[r + 1, c][0] + s * shadows.around[r + 1, c + 1][0]
    return (1.0 - t) * upper + t * lower


@wp.func
def hidden(shadows: DepthMap, at: wp.vec3, slope: wp.vec2, aside: wp.vec2) -> int:
    """Return 1 if the texel at an offset `aside` from a point is above a plane through the point, else 0."""
    if shadows.depth[int(at[1] + aside[1]), int(at[0] + aside[0])] > at[2] + wp.dot(slope, aside):
        return 1
    return 0


@wp.func
def lit_fraction(shadows: DepthMap, spot: wp.vec3, normal: wp.vec3, x: float, y: float, around: float) -> float:
    """Return the fraction of the key light that reaches a point [m] of a plane with a normal of any length.

    It is seen at (x, y) in the picture. The sampling radius grows with the height of possible occluders above the
    point, plus `around` texels; with these only 0 and 1 are meant exactly.
    """
    at = in_map(shadows, spot) + wp.vec3(0.5, 0.5, 0.0)
    size = float(shadows.depth.shape[0])
    to_edge = wp.min(wp.min(at[0], at[1]), size - wp.max(at[0], at[1]))
    if to_edge < 1.0:
        return 1.0
    block = shadows.around[int(at[1]) / wp.static(BLOCK), int(at[0]) / wp.static(BLOCK)]
    texel = 1.0 / shadows.scale
    if block[0] - at[2] <= 0.3 * texel:
        return 1.0
    above = nearest_around_spot(shadows, at) - at[2]
    facing = wp.dot(normal, shadows.towards)
    if facing == 0.0:
        return 1.0
    # Rise of the plane towards the light per texel [m].
    slope = -texel / facing * wp.vec2(wp.dot(normal, shadows.u), wp.dot(normal, shadows.v))
    slope = slope * wp.min(1.0, wp.static(STEEPEST) * texel / wp.max(wp.length(slope), 1.0e-6 * texel))
    # A texel stores the distance at its centre, up to half a texel away.
    margin = 0.3 * texel + 0.6 * (wp.abs(slope[0]) + wp.abs(slope[1]))
    if above <= margin:
        return 1.0
    radius = wp.clamp(shadows.softness * above / texel, wp.static(LEAST), wp.static(MOST)) + around
    # The map is empty near its edge, so little is missed there.
    radius = wp.min(radius, to_edge - 0.5)
    at[2] = at[2] + margin
    start = wp.static(SAMPLES) * (2 * (int(y) % 2) + int(x) % 2)
    count = int(0)
    for k in range(wp.static(FIRST)):
        count += hidden(shadows, at, slope, radius * shadows.spots[start + k])
    if count > 0 and count < wp.static(FIRST):
        if around > 0.0:
            return 0.5
        for k in range(wp.static(FIRST), wp.static(SAMPLES)):
            count += hidden(shadows, at, slope, radius * shadows.spots[start + k])
        return 1.0 - float(count) / wp.static(float(SAMPLES))
    return 1.0 - float(count) / wp.static(float(FIRST))
