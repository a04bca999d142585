"""A rasteriser: finds the nearest triangle at four points of each pixel, then shades, mostly 2 x 2 pixels at once.

Whether a triangle covers a point follows from triple products, after M. Olano and T. Greer, "Triangle scan
conversion using 2D homogeneous coordinates", Graphics Hardware 1997: triangles that reach behind the camera need
no clipping.
"""

import warp as wp

from ..basis import kernel
from .shading import (
    Body,
    Surroundings,
    color_of,
    height,
    in_bytes,
    light_on,
    meets_ground,
    mix,
    nearest_texel,
    texel,
    within_one,
)
from .shadow import DepthMap, inverse, lit_fraction, narrow

ASIDE = wp.constant(wp.vec4(0.375, 0.875, 0.125, 0.625))
"""Offsets of a pixel's four points: one in each quarter of its height and of its width (a rotated grid)."""
ALL = wp.constant(0xFFFF)
"""Bit mask of all points of 2 x 2 pixels: bits 4 n to 4 n + 3 are those of pixel n, counted along rows."""
Faces = wp.types.vector(16, int)
Colors = wp.types.matrix((4, 3), wp.float32)
Keys, Pixels = wp.array2d(dtype=wp.uint64), wp.array2d(dtype=wp.vec3ub)
SQUARE_MARGIN = wp.constant(1.0)
"""For 2 x 2 pixels the shadow map is sampled over this many more texels, so that no pixel's shadow is missed."""
MOST_GLINT = wp.constant(0.01)
"""Brighter highlights are shaded pixel by pixel: they change quickly."""
MOST_TURN = wp.constant(0.05)
"""Surfaces whose normals turn more per pixel [rad] are shaded pixel by pixel: steps would be visible."""


@wp.func
def row_of(row: int) -> float:
    """Return the distance of a row of points from the upper edge, in pixels."""
    return 0.25 * (float(row) + 0.5)


@wp.func
def weights_of(view: Surroundings, a: wp.vec3, b: wp.vec3, c: wp.vec3):
    """Return (start, across, down): weights of corners at (x, y) are proportional to start + x across + y down.

    Corners are given relative to the camera.
    """
    weights = wp.matrix_from_rows(wp.cross(b, c), wp.cross(c, a), wp.cross(a, b))
    return weights @ view.corner, weights @ view.across, weights @ view.down


@kernel
def draw_triangles(
    body: Body,
    view: Surroundings,
    hidden_by: wp.array2d(dtype=wp.uint64),  # nearest of other triangles, which hide these; or of shape [0, 0]
    # In and out:
    nearest: wp.array2d(dtype=wp.uint64),  # of each point, shape [4 · height, width]
):
    """Keep the nearest triangle at each sample; backs of closed bodies are skipped.

    The upper half of an entry has the bits of 1 / depth; the lower half has the triangle's index plus 1.
    """
    t = wp.tid()
    a = body.points[body.triangles[t][0]] - view.eye
    b = body.points[body.triangles[t][1]] - view.eye
    c = body.points[body.triangles[t][2]] - view.eye
    normal = wp.cross(b - a, c - a)
    volume = wp.dot(a, normal)
    if volume == 0.0 or (body.closed[t] and volume > 0.0):
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
        downs = wp.cw_div(wp.vec3(wp.dot(a, view.down), wp.dot(b, view.down), wp.dot(c, view.down)), depths)
        high = wp.min(downs)
        low = wp.max(downs)
        # Clamped before they become whole numbers, which could overflow.
        last = float(rows)
        lowest = wp.max(int(wp.ceil(wp.clamp(4.0 * (high + middle) / pixel - 0.5, -1.0, last))), 0)
        highest = wp.min(int(wp.floor(wp.clamp(4.0 * (low + middle) / pixel - 0.5, -1.0, last))), rows - 1)
    elif wp.max(depths) <= 0.0:
        return
    if lowest > highest:
        return
    # Inside, no corner's weight is below 0. The weights and 1 / depth are linear in x and y.
    start, across, down = weights_of(view, a, b, c)
    sign = wp.sign(volume)
    slopes = sign * across
    downwards = sign * down
    corners = sign * start
    near_slope = wp.dot(normal, view.across) / volume
    near_down = wp.dot(normal, view.down) / volume
    near_corner = wp.dot(normal, view.corner) / volume
    runs = wp.vec3(inverse(slopes[0]), inverse(slopes[1]), inverse(slopes[2]))
    number = wp.uint64(t + 1)
    for row in range(lowest, highest + 1):
        y = row_of(row)
        aside = ASIDE[row % 4]
        here = corners + y * downwards + aside * slopes
        reach = narrow(here[0], runs[0], wp.vec2(0.0, float(columns - 1)))
        reach = narrow(here[1], runs[1], reach)
        reach = narrow(here[2], runs[2], reach)
        near = near_corner + y * near_down + aside * near_slope
        first = int(wp.ceil(wp.min(reach[0], float(columns))))
        for column in range(first, int(wp.floor(wp.max(reach[1], -1.0))) + 1):
            inverse_depth = near + float(column) * near_slope
            key = (wp.uint64(wp.cast(inverse_depth, wp.uint32)) << wp.uint64(32)) | number
            if hidden_by.shape[0] == 0 or key > hidden_by[row, column]:
                wp.atomic_max(nearest, row, column, key)


@kernel
def draw_backdrop(
    view: Surroundings,
    first_row: int,
    # Out:
    pixels: wp.array2d(dtype=wp.vec3ub),  # shape [height, width]
):
    """Draw the lit ground, and the background; threads cover some rows from the first one on."""
    i, column = wp.tid()
    row = first_row + i
    mean = wp.vec3()
    for p in range(4):
        way = view.corner + (float(column) + ASIDE[p]) * view.across + row_of(4 * row + p) * view.down
        t, uv = meets_ground(view, way)
        if t > 0.0:
            mean += 0.25 * texel(view.ground, uv[0], uv[1])
        else:
            mean += 0.25 * view.background
    pixels[row, column] = in_bytes(mean)


@wp.func
def light_on_ground(view: Surroundings, shadows: DepthMap, x: float, y: float, around: float) -> float:
    """Return the fraction of the key light on the ground at (x, y) in the picture; 1 outside the ground."""
    way = view.corner + x * view.across + y * view.down
    t, _uv = meets_ground(view, way)
    if t > 0.0 and view.shadows == 1:
        return lit_fraction(shadows, view.eye + t * way, view.ground_normal, x, y, around)
    return 1.0


@wp.func
def faces_at(nearest: Keys, row: int, column: int, points: int) -> Faces:
    """Return the triangles visible at the points of one pixel (4), or of 2 x 2 pixels (16); -1 for none."""
    faces = Faces(-2)
    for q in range(16):
        if q < points:
            key = nearest[4 * (row + q / 8) + q % 4, column + q / 4 % 2]
            faces[q] = int(key & wp.static(wp.uint64(0xFFFFFFFF))) - 1
    return faces


@wp.func
def points_of(faces: Faces, face: int):
    """Return the points that show a triangle, as bits, their number, and their mean position in pixels."""
    found = int(0)
    for q in range(16):
        if faces[q] == face:
            found += 1 << q
    if found == ALL:
        return found, 16.0, 1.0, 1.0
    count = float(0.0)
    x = float(0.0)
    y = float(0.0)
    for q in range(16):
        one = float((found >> q) & 1)
        count += one
        x += one * (float(q / 4 % 2) + ASIDE[q % 4])
        y += one * (float(q / 8) + row_of(q % 4))
    return found, count, x / count, y / count


@wp.func
def number_of(points: int) -> float:
    """Return how many of a pixel's four points are set in these bits."""
    return float((points & 1) + ((points >> 1) & 1) + ((points >> 2) & 1) + ((points >> 3) & 1))


@wp.func
def shade_triangle(
    body: Body, view: Surroundings, shadows: DepthMap, face: int, x: float, y: float, around: float
):
    """Return the shading of a triangle at (x, y) in the picture.

    Namely: brightness of its color, highlights, fraction of the key light, color if it has no texture, texture
    coordinates and their change per pixel across and down, height above the ground there and the lowest within a
    pixel, how far the normal turns from one pixel to the next, and opacity.
    """
    corners = body.triangles[face]
    a = body.points[corners[0]] - view.eye
    b = body.points[corners[1]] - view.eye
    c = body.points[corners[2]] - view.eye
    normal = wp.cross(b - a, c - a)
    start, to_right, downwards = weights_of(view, a, b, c)
    weights = start + x * to_right + y * downwards
    whole = weights[0] + weights[1] + weights[2]
    # For a triangle seen edge-on, rounding must not give a point outside.
    weights = wp.max(weights / whole, wp.vec3())
    weights = weights / (weights[0] + weights[1] + weights[2])
    # Change of the weights per pixel.
    to_right = to_right / whole
    to_right -= (to_right[0] + to_right[1] + to_right[2]) * weights
    downwards = downwards / whole
    downwards -= (downwards[0] + downwards[1] + downwards[2]) * weights
    color = wp.vec3()
    at = wp.vec2()
    across = wp.vec2()
    down = wp.vec2()
    if body.textured == 1:
        at = mix(weights, body.uv, corners)
        across = mix(to_right, body.uv, corners)
        down = mix(downwards, body.uv, corners)
    else:
        color = mix(weights, body.colors, corners)
    ray = wp.normalize(view.corner + x * view.across + y * view.down)
    upright = wp.normalize(mix(weights, body.normals, corners))
    turn = wp.length(mix(to_right, body.normals, corners))
    turn += wp.length(mix(downwards, body.normals, corners))
    if wp.dot(a, normal) > 0.0:  # its back is visible
        upright = -upright
    above = float(0.0)
    least = float(0.0)
    if view.has_ground == 1:
        heights = wp.vec3()
        for k in range(3):
            heights[k] = height(view, body.points[corners[k]])
        above = wp.dot(weights, heights)
        least = above - wp.abs(wp.dot(to_right, heights)) - wp.abs(wp.dot(downwards, heights))
    lit = float(1.0)
    if view.shadows == 1 and face >= body.first_shaded and wp.dot(upright, view.light) > 0.0:
        spot = view.eye + weights[0] * a + weights[1] * b + weights[2] * c
        lit = lit_fraction(shadows, spot, normal, x, y, around)
    finish = body.finishes[body.finish[face]]
    bright, glint, opacity = light_on(view, finish, body.gloss[face], upright, ray, lit, above)
    return bright, glint, lit, color, at, across, down, above, least, turn, opacity


@wp.func
def mean_texel(
    body: Body, at: wp.vec2, across: wp.vec2, down: wp.vec2, x: float, y: float, covered: int
) -> wp.vec3:
    """Return the texture's mean color at those points of a pixel that `covered` has, as bits.

    Texture coordinates are `at` where the pixel has (x, y); per pixel they change by `across` and `down`.
    """
    color = wp.vec3()
    for p in range(4):
        if (covered >> p) & 1 == 1:
            color += nearest_texel(body.texture, at + (ASIDE[p] - x) * across + (row_of(p) - y) * down)
    return color / (255.0 * number_of(covered))


@wp.func
def shade_pixel(
    body: Body, view: Surroundings, shadows: DepthMap, row: int, column: int, nearest: Keys, pixels: Pixels
):
    """Draw triangles and their shadow on the ground in one pixel; each is shaded at the mean of its points."""
    faces = faces_at(nearest, row, column, 4)
    for q in range(4):
        if faces[q] >= 0:
            nearest[4 * row + q, column] = wp.static(wp.uint64(0))
    bare = float(0.0)
    mean = wp.vec3()
    left = int(15)
    p = int(0)
    while left > 0:
        if (left >> p) & 1 == 1:
            covered, count, x, y = points_of(faces, faces[p])
            left = left - covered
            if faces[p] < 0:
                bare += count
            else:
                bright, glint, _lit, color, at, across, down, above, _least, _turn, opacity = shade_triangle(
                    body, view, shadows, faces[p], float(column) + x, float(row) + y, 0.0
                )
                if body.textured == 1:
                    color = mean_texel(body, at, across, down, x, y, covered)
                if above >= -view.below:
                    mean += 0.25 * count * opacity * within_one(bright * color + wp.vec3(glint, glint, glint))
                    bare += count * (1.0 - opacity)
                else:
                    bare += count
        p += 1
    if bare > 0.0:
        lit = float(1.0)
        if body.glass == 0:
            lit = light_on_ground(view, shadows, float(column) + 0.5, float(row) + 0.5, 0.0)
        if lit == 1.0 and bare == 4.0:
            return
        mean += 0.25 * bare * (view.shadow + (1.0 - view.shadow) * lit) * color_of(pixels[row, column])
    pixels[row, column] = in_bytes(mean)


@wp.func
def shade_square(
    body: Body, view: Surroundings, shadows: DepthMap, row: int, column: int, nearest: Keys, pixels: Pixels
) -> int:
    """Shade 2 x 2 pixels, each triangle once, and return 0; return 4 if each pixel needs its own shading.

    Pixels need it at edges of shadows, in highlights and glass, where normals turn, and where a triangle may reach
    below the ground. Elsewhere light hardly changes between pixels. Textures are always sampled in each pixel.
    """
    if 4 * row + 8 > nearest.shape[0] or column + 2 > nearest.shape[1]:
        return 4
    faces = faces_at(nearest, row, column, 16)
    means = Colors()
    bare = int(0)
    left = int(wp.static(ALL))
    point = int(0)
    while left > 0:
        if (left >> point) & 1 == 1:
            covered, _count, x, y = points_of(faces, faces[point])
            left = left - covered
            # On thin tubes normals change from pixel to pixel, and so may colors that show values.
            if (covered != ALL and body.textured == 0) or (faces[point] >= 0 and body.glass == 1):
                return 4
            if faces[point] < 0:
                bare = covered
                lit = float(1.0)
                if body.glass == 0:
                    lit = light_on_ground(view, shadows, float(column) + x, float(row) + y, SQUARE_MARGIN)
                if lit > 0.0 and lit < 1.0:
                    return 4
                if covered == ALL and lit == 1.0:
                    return 0
                bright = view.shadow + (1.0 - view.shadow) * lit
                for n in range(4):
                    weight = 0.25 * bright * number_of(covered >> (4 * n))
                    means[n] += weight * color_of(pixels[row + n / 2, column + n % 2])
            else:
                bright, glint, lit, color, at, across, down, _above, least, turn, _opacity = shade_triangle(
                    body, view, shadows, faces[point], float(column) + x, float(row) + y, SQUARE_MARGIN
                )
                if least < -view.below or (lit > 0.0 and lit < 1.0) or glint > MOST_GLINT or turn > MOST_TURN:
                    return 4
                for n in range(4):
                    here = (covered >> (4 * n)) & 15
                    if here > 0:
                        if body.textured == 1:
                            color = mean_texel(body, at, across, down, x - float(n % 2), y - float(n / 2), here)
                        seen = within_one(bright * color + wp.vec3(glint, glint, glint))
                        means[n] += 0.25 * number_of(here) * seen
        point += 1
    for n in range(4):
        pixels[row + n / 2, column + n % 2] = in_bytes(means[n])
    if bare != ALL:
        for q in range(8):
            nearest[4 * row + q, column] = wp.static(wp.uint64(0))
            nearest[4 * row + q, column + 1] = wp.static(wp.uint64(0))
    return 0


@kernel
def shade(
    body: Body,
    view: Surroundings,
    shadows: DepthMap,
    first_row: int,
    first_column: int,
    columns: int,
    # In and out:
    nearest: Keys,  # written by `draw_triangles`, reset to 0; shape [4 · height, width]
    pixels: Pixels,  # shape [height, width]
):
    """Draw triangles and their shadow on the ground over a picture of the lit ground.

    Each thread shades two rows of a column: starting a thread costs as much as a pixel of the ground.
    """
    row = first_row + 2 * wp.tid()
    for pair in range((columns + 1) / 2):
        column = first_column + 2 * pair
        left = shade_square(body, view, shadows, row, column, nearest, pixels)
        for q in range(left):
            if row + q / 2 < pixels.shape[0] and column + q % 2 < pixels.shape[1]:
                shade_pixel(body, view, shadows, row + q / 2, column + q % 2, nearest, pixels)
