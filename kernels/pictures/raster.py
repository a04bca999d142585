"""A rasteriser: triangles are drawn into four points of each pixel, and what is nearest there is shaded once.

Points are found by products of three vectors, after M. Olano and T. Greer, "Triangle scan conversion using 2D
homogeneous coordinates", Graphics Hardware 1997: what reaches behind the camera needs no cutting.
"""

import warp as wp

from ..basis import kernel
from .raycast import in_bytes, within_one
from .shading import Body, Surroundings, colour_of, height, lit, meets_ground, nearest_texel, texel
from .shadow import Seen, inside, over, share_of_light

ASIDE = wp.constant(wp.vec4(0.375, 0.875, 0.125, 0.625))
"""The four points of a pixel: one in each quarter of its height, and of its width (a rotated grid)."""


@wp.func
def column_of(point: int, column: int) -> float:
    """Return how far from the left edge of the picture a point of a pixel is, in pixels."""
    return float(column) + ASIDE[point]


@wp.func
def row_of(row: int) -> float:
    """Return how far from the upper edge a row of points is, in pixels."""
    return 0.25 * (float(row) + 0.5)


@wp.func
def shares_of(view: Surroundings, a: wp.vec3, b: wp.vec3, c: wp.vec3):
    """Return (start, across, down): corners' shares, but for a factor, at (x, y) are start + x across + y down.

    The corners are given from the camera on.
    """
    bc = wp.cross(b, c)
    ca = wp.cross(c, a)
    ab = wp.cross(a, b)
    start = wp.vec3(wp.dot(bc, view.corner), wp.dot(ca, view.corner), wp.dot(ab, view.corner))
    across = wp.vec3(wp.dot(bc, view.across), wp.dot(ca, view.across), wp.dot(ab, view.across))
    down = wp.vec3(wp.dot(bc, view.down), wp.dot(ca, view.down), wp.dot(ab, view.down))
    return start, across, down


@kernel
def draw_triangles(
    points: wp.array(dtype=wp.vec3),  # [m], shape [vertex_count]
    triangles: wp.array(dtype=wp.vec3i),  # three vertices each, shape [triangle_count]
    closed: wp.array(dtype=wp.bool),  # whether a triangle's back is never seen, shape [triangle_count]
    view: Surroundings,
    # In and out:
    nearest: wp.array2d(dtype=wp.uint64),  # of each point, shape [4 · height, width]
):
    """Draw every triangle where points lie in it; the nearest counts.

    What is kept of it is 1 / distance along the view, as bits, and in the lower half its number, counted from 1.
    """
    t = wp.tid()
    a = points[triangles[t][0]] - view.eye
    b = points[triangles[t][1]] - view.eye
    c = points[triangles[t][2]] - view.eye
    normal = wp.cross(b - a, c - a)
    volume = wp.dot(a, normal)
    if volume == 0.0 or (closed[t] and volume > 0.0):
        return
    rows = nearest.shape[0]
    columns = nearest.shape[1]
    # The direction through a point at (x, y) is corner + x across + y down, along which depth is 1.
    pixel = wp.dot(view.down, view.down)
    ahead = -view.towards_viewer
    depths = wp.vec3(wp.dot(a, ahead), wp.dot(b, ahead), wp.dot(c, ahead))
    lowest = int(0)
    highest = rows - 1
    if wp.min(depths) > 0.0:
        middle = -wp.dot(view.corner, view.down)
        high = wp.dot(a, view.down) / depths[0]
        low = high
        at = wp.dot(b, view.down) / depths[1]
        high = wp.min(high, at)
        low = wp.max(low, at)
        at = wp.dot(c, view.down) / depths[2]
        high = wp.min(high, at)
        low = wp.max(low, at)
        # What is far outside is brought near first: as whole numbers it would be anything.
        last = float(rows)
        lowest = wp.max(int(wp.ceil(wp.clamp(4.0 * (high + middle) / pixel - 0.5, -1.0, last))), 0)
        highest = wp.min(int(wp.floor(wp.clamp(4.0 * (low + middle) / pixel - 0.5, -1.0, last))), rows - 1)
    elif wp.max(depths) <= 0.0:
        return
    if lowest > highest:
        return
    # Inside, no corner's share is below 0; the shares are linear in x and y, and so is 1 / depth.
    start, across, down = shares_of(view, a, b, c)
    sign = wp.sign(volume)
    slopes = sign * across
    downwards = sign * down
    corners = sign * start
    near_slope = wp.dot(normal, view.across) / volume
    near_down = wp.dot(normal, view.down) / volume
    near_corner = wp.dot(normal, view.corner) / volume
    runs = wp.vec3(over(slopes[0]), over(slopes[1]), over(slopes[2]))
    number = wp.uint64(t + 1)
    for row in range(lowest, highest + 1):
        y = row_of(row)
        aside = ASIDE[row % 4]
        here = corners + y * downwards + aside * slopes
        reach = inside(here[0], runs[0], wp.vec2(0.0, float(columns - 1)))
        reach = inside(here[1], runs[1], reach)
        reach = inside(here[2], runs[2], reach)
        near = near_corner + y * near_down + aside * near_slope
        first = int(wp.ceil(wp.min(reach[0], float(columns))))
        for column in range(first, int(wp.floor(wp.max(reach[1], -1.0))) + 1):
            share = near + float(column) * near_slope
            key = (wp.uint64(wp.cast(share, wp.uint32)) << wp.uint64(32)) | number
            wp.atomic_max(nearest, row, column, key)


@wp.func
def sharing(faces: wp.vec4i, p: int) -> wp.vec4:
    """Return 1 for the points of a pixel that show the same as point p, else 0; all 0 if p is not their first."""
    found = wp.vec4()
    for q in range(4):
        if faces[q] == faces[p]:
            if q < p:
                return wp.vec4()
            found[q] = 1.0
    return found


@wp.func
def seen_triangle(
    body: Body,
    view: Surroundings,
    shadows: Seen,
    points: wp.array(dtype=wp.vec3),
    triangles: wp.array(dtype=wp.vec3i),
    face: int,
    row: int,
    column: int,
    covered: wp.vec4,
):
    """Return the colour of a triangle at the points of a pixel that it covers, and its height above the ground.

    It is lit once, at the middle of these points.
    """
    i = triangles[face][0]
    j = triangles[face][1]
    k = triangles[face][2]
    a = points[i] - view.eye
    b = points[j] - view.eye
    c = points[k] - view.eye
    normal = wp.cross(b - a, c - a)
    start, across, down = shares_of(view, a, b, c)
    count = float(0.0)
    x = float(0.0)
    y = float(0.0)
    colour = wp.vec3()
    for p in range(4):
        if covered[p] > 0.0:
            px = column_of(p, column)
            py = row_of(4 * row + p)
            count += 1.0
            x += px
            y += py
            if body.textured == 1:
                shares = start + px * across + py * down
                at = shares[0] * body.uv[i] + shares[1] * body.uv[j] + shares[2] * body.uv[k]
                colour += nearest_texel(body.texture, at / (shares[0] + shares[1] + shares[2]))
    way = view.corner + (x / count) * view.across + (y / count) * view.down
    shares = start + (x / count) * across + (y / count) * down
    # Where a triangle is seen edge on, rounding must not lead out of it.
    shares = wp.max(shares / (shares[0] + shares[1] + shares[2]), wp.vec3())
    shares = shares / (shares[0] + shares[1] + shares[2])
    if body.textured == 1:
        colour = colour / count
    else:
        colour = shares[0] * body.colours[i] + shares[1] * body.colours[j] + shares[2] * body.colours[k]
    ray = wp.normalize(way)
    upright = wp.normalize(shares[0] * body.normals[i] + shares[1] * body.normals[j] + shares[2] * body.normals[k])
    if wp.dot(a, normal) > 0.0:  # seen from its back
        upright = -upright
    share = float(1.0)
    spot = view.eye + shares[0] * a + shares[1] * b + shares[2] * c
    above = float(0.0)
    if view.has_ground == 1:
        above = height(view, spot)
    if view.shadows == 1 and face >= body.first_shaded and wp.dot(upright, view.light) > 0.0:
        share = share_of_light(shadows, spot, normal)
    return lit(view, colour, body.gloss[face], upright, ray, share), above


@wp.func
def shade_pixel(
    body: Body,
    view: Surroundings,
    shadows: Seen,
    points: wp.array(dtype=wp.vec3),
    triangles: wp.array(dtype=wp.vec3i),
    row: int,
    column: int,
    nearest: wp.array2d(dtype=wp.uint64),
    pixels: wp.array2d(dtype=wp.vec3ub),
):
    """Lay what was drawn, and its shadow on the ground, over one pixel."""
    faces = wp.vec4i()
    for q in range(4):
        faces[q] = int(nearest[4 * row + q, column] & wp.static(wp.uint64(0xFFFFFFFF))) - 1
        if faces[q] >= 0:
            nearest[4 * row + q, column] = wp.static(wp.uint64(0))
    bare = int(0)
    mean = wp.vec3()
    for p in range(4):
        covered = sharing(faces, p)
        count = covered[0] + covered[1] + covered[2] + covered[3]
        if faces[p] < 0:
            bare += 1
        elif count > 0.0:
            colour, above = seen_triangle(body, view, shadows, points, triangles, faces[p], row, column, covered)
            if above >= -view.below:
                mean += 0.25 * count * within_one(colour)
            else:
                bare += int(count)
    if bare > 0:
        way = view.corner + (float(column) + 0.5) * view.across + (float(row) + 0.5) * view.down
        share = float(1.0)
        t, _uv = meets_ground(view, way)
        if t > 0.0 and view.shadows == 1:
            share = share_of_light(shadows, view.eye + t * way, view.ground_normal)
        if share == 1.0 and bare == 4:
            return
        mean += 0.25 * float(bare) * (view.shadow + (1.0 - view.shadow) * share) * colour_of(pixels[row, column])
    pixels[row, column] = in_bytes(mean)


@kernel
def shade(
    body: Body,
    view: Surroundings,
    shadows: Seen,
    points: wp.array(dtype=wp.vec3),  # [m], shape [vertex_count]
    triangles: wp.array(dtype=wp.vec3i),  # shape [triangle_count]
    first_row: int,
    first_column: int,
    columns: int,
    # In and out:
    nearest: wp.array2d(dtype=wp.uint64),  # as `draw_triangles` leaves it, and 0 then; shape [4 · height, width]
    pixels: wp.array2d(dtype=wp.vec3ub),  # shape [height, width]
):
    """Lay what was drawn, and its shadow on the ground, over a picture of the ground in light.

    Each thread takes a row, from the first column on: a thread's start costs as much as a pixel of the ground.
    """
    row = first_row + wp.tid()
    for column in range(first_column, first_column + columns):
        shade_pixel(body, view, shadows, points, triangles, row, column, nearest, pixels)


@kernel
def draw_backdrop(
    view: Surroundings,
    # Out:
    pixels: wp.array2d(dtype=wp.vec3ub),  # shape [height, width]
):
    """Draw the ground in light, and what is behind it."""
    row, column = wp.tid()
    mean = wp.vec3()
    for p in range(4):
        way = view.corner + column_of(p, column) * view.across + row_of(4 * row + p) * view.down
        t, uv = meets_ground(view, way)
        if t > 0.0:
            mean += 0.25 * texel(view.ground, uv[0], uv[1])
        else:
            mean += 0.25 * view.background
    pixels[row, column] = in_bytes(mean)
