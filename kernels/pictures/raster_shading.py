"""What a rasteriser has drawn is lit: what four points of each pixel show, and mostly 2 x 2 pixels at once."""

import warp as wp

from ..basis import kernel
from .raster import ASIDE, row_of, shares_of
from .shading import (
    Body,
    Surroundings,
    colour_of,
    height,
    in_bytes,
    light_on,
    meets_ground,
    mix,
    nearest_texel,
    within_one,
)
from .shadow import Seen, share_of_light

ALL = wp.constant(0xFFFF)
"""All points of 2 x 2 pixels, as bits: 4 n to 4 n + 3 are those of pixel n, counted along rows."""
Faces = wp.types.vector(16, int)
Colours = wp.types.matrix((4, 3), wp.float32)
Keys, Pixels = wp.array2d(dtype=wp.uint64), wp.array2d(dtype=wp.vec3ub)
BESIDE = wp.constant(1.0)
"""So many texels of the shadow map further aside is looked at for 2 x 2 pixels, so that none of them is missed."""
GLEAMS = wp.constant(0.01)
"""Highlights that are brighter are drawn pixel by pixel: they change quickly."""
TURN = wp.constant(0.05)
"""So are surfaces whose normals turn further from pixel to pixel [rad]: light would change in visible steps."""


@wp.func
def faces_at(nearest: Keys, row: int, column: int, points: int) -> Faces:
    """Return the triangles that the points of one pixel show (4), or of 2 x 2 pixels (16); -1 for none."""
    faces = Faces(-2)
    for q in range(16):
        if q < points:
            key = nearest[4 * (row + q / 8) + q % 4, column + q / 4 % 2]
            faces[q] = int(key & wp.static(wp.uint64(0xFFFFFFFF))) - 1
    return faces


@wp.func
def alike(faces: Faces, face: int):
    """Return which points show a triangle, as bits, how many they are, and their middle in pixels."""
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
    """Return how many points of a pixel are among some that are given as bits."""
    return float((points & 1) + ((points >> 1) & 1) + ((points >> 2) & 1) + ((points >> 3) & 1))


@wp.func
def seen_triangle(body: Body, view: Surroundings, shadows: Seen, face: int, x: float, y: float, around: float):
    """Return what is seen of a triangle where it is at (x, y) in the picture.

    (brightness of its colour, highlights, share of the key light, its colour if it has no texture, place in its
    texture, how that changes per pixel across and down, height above the ground, and the least a pixel around, and
    how far its normal turns from a pixel to the next)
    """
    corners = body.triangles[face]
    a = body.points[corners[0]] - view.eye
    b = body.points[corners[1]] - view.eye
    c = body.points[corners[2]] - view.eye
    normal = wp.cross(b - a, c - a)
    start, to_right, downwards = shares_of(view, a, b, c)
    shares = start + x * to_right + y * downwards
    whole = shares[0] + shares[1] + shares[2]
    # Where a triangle is seen edge on, rounding must not lead out of it.
    shares = wp.max(shares / whole, wp.vec3())
    shares = shares / (shares[0] + shares[1] + shares[2])
    # How the shares change per pixel.
    to_right = to_right / whole
    to_right -= (to_right[0] + to_right[1] + to_right[2]) * shares
    downwards = downwards / whole
    downwards -= (downwards[0] + downwards[1] + downwards[2]) * shares
    colour = wp.vec3()
    at = wp.vec2()
    across = wp.vec2()
    down = wp.vec2()
    if body.textured == 1:
        at = mix(shares, body.uv, corners)
        across = mix(to_right, body.uv, corners)
        down = mix(downwards, body.uv, corners)
    else:
        colour = mix(shares, body.colours, corners)
    ray = wp.normalize(view.corner + x * view.across + y * view.down)
    upright = wp.normalize(mix(shares, body.normals, corners))
    turn = wp.length(mix(to_right, body.normals, corners))
    turn += wp.length(mix(downwards, body.normals, corners))
    if wp.dot(a, normal) > 0.0:  # seen from its back
        upright = -upright
    above = float(0.0)
    least = float(0.0)
    if view.has_ground == 1:
        heights = wp.vec3()
        for k in range(3):
            heights[k] = height(view, body.points[corners[k]])
        above = wp.dot(shares, heights)
        least = above - wp.abs(wp.dot(to_right, heights)) - wp.abs(wp.dot(downwards, heights))
    share = float(1.0)
    if view.shadows == 1 and face >= body.first_shaded and wp.dot(upright, view.light) > 0.0:
        share = share_of_light(shadows, view.eye + shares[0] * a + shares[1] * b + shares[2] * c, normal, around)
    bright, glint = light_on(view, body.gloss[face], upright, ray, share)
    return bright, glint, share, colour, at, across, down, above, least, turn


@wp.func
def painted(body: Body, at: wp.vec2, across: wp.vec2, down: wp.vec2, x: float, y: float, covered: int) -> wp.vec3:
    """Return the mean colour of the texture at some points of a pixel, given as bits.

    At (x, y) of the pixel the place in the texture is `at`, and it changes evenly from there.
    """
    colour = wp.vec3()
    for p in range(4):
        if (covered >> p) & 1 == 1:
            colour += nearest_texel(body.texture, at + (ASIDE[p] - x) * across + (row_of(p) - y) * down)
    return colour / (255.0 * number_of(covered))


@wp.func
def shade_pixel(
    body: Body, view: Surroundings, shadows: Seen, row: int, column: int, nearest: Keys, pixels: Pixels
):
    """Lay what was drawn, and its shadow on the ground, over one pixel.

    A triangle is lit once, at the middle of the points that show it.
    """
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
            covered, count, x, y = alike(faces, faces[p])
            left = left - covered
            if faces[p] < 0:
                bare += count
            else:
                bright, glint, _share, colour, at, across, down, above, _least, _turn = seen_triangle(
                    body, view, shadows, faces[p], float(column) + x, float(row) + y, 0.0
                )
                if body.textured == 1:
                    colour = painted(body, at, across, down, x, y, covered)
                if above >= -view.below:
                    mean += 0.25 * count * within_one(bright * colour + wp.vec3(glint, glint, glint))
                else:
                    bare += count
        p += 1
    if bare > 0.0:
        way = view.corner + (float(column) + 0.5) * view.across + (float(row) + 0.5) * view.down
        share = float(1.0)
        t, _uv = meets_ground(view, way)
        if t > 0.0 and view.shadows == 1:
            share = share_of_light(shadows, view.eye + t * way, view.ground_normal, 0.0)
        if share == 1.0 and bare == 4.0:
            return
        mean += 0.25 * bare * (view.shadow + (1.0 - view.shadow) * share) * colour_of(pixels[row, column])
    pixels[row, column] = in_bytes(mean)


@wp.func
def shade_square(
    body: Body, view: Surroundings, shadows: Seen, row: int, column: int, nearest: Keys, pixels: Pixels
) -> int:
    """Shade 2 x 2 pixels, each triangle lit once, and return 0; or return 4 where each pixel must be looked at.

    That is where shadows begin, in highlights, where normals turn, and where something may go below the ground.
    Elsewhere light hardly changes from one pixel to the next; textures are looked at as closely as ever.
    """
    if 4 * row + 8 > nearest.shape[0] or column + 2 > nearest.shape[1]:
        return 4
    faces = faces_at(nearest, row, column, 16)
    means = Colours()
    bare = int(0)
    left = int(wp.static(ALL))
    point = int(0)
    while left > 0:
        if (left >> point) & 1 == 1:
            covered, _count, x, y = alike(faces, faces[point])
            left = left - covered
            # Thin tubes turn from pixel to pixel, and so may colours that show values.
            if covered != ALL and body.textured == 0:
                return 4
            if faces[point] < 0:
                bare = covered
                bright = float(1.0)
                if view.shadows == 1:
                    way = view.corner + (float(column) + x) * view.across + (float(row) + y) * view.down
                    t, _uv = meets_ground(view, way)
                    if t > 0.0:
                        share = share_of_light(shadows, view.eye + t * way, view.ground_normal, BESIDE)
                        if share > 0.0 and share < 1.0:
                            return 4
                        bright = view.shadow + (1.0 - view.shadow) * share
                if covered == ALL and bright == 1.0:
                    return 0
                for n in range(4):
                    weight = 0.25 * bright * number_of(covered >> (4 * n))
                    means[n] += weight * colour_of(pixels[row + n / 2, column + n % 2])
            else:
                bright, glint, share, colour, at, across, down, _above, least, turn = seen_triangle(
                    body, view, shadows, faces[point], float(column) + x, float(row) + y, BESIDE
                )
                if least < -view.below or (share > 0.0 and share < 1.0) or glint > GLEAMS or turn > TURN:
                    return 4
                for n in range(4):
                    here = (covered >> (4 * n)) & 15
                    if here > 0:
                        if body.textured == 1:
                            colour = painted(body, at, across, down, x - float(n % 2), y - float(n / 2), here)
                        lit = within_one(bright * colour + wp.vec3(glint, glint, glint))
                        means[n] += 0.25 * number_of(here) * lit
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
    shadows: Seen,
    first_row: int,
    first_column: int,
    columns: int,
    # In and out:
    nearest: Keys,  # as `draw_triangles` leaves it, and 0 then; shape [4 · height, width]
    pixels: Pixels,  # shape [height, width]
):
    """Lay what was drawn, and its shadow on the ground, over a picture of the ground in light.

    Each thread takes two rows, from the first column on: a thread's start costs as much as a pixel of the ground.
    """
    row = first_row + 2 * wp.tid()
    for pair in range((columns + 1) / 2):
        column = first_column + 2 * pair
        left = shade_square(body, view, shadows, row, column, nearest, pixels)
        for q in range(left):
            if row + q / 2 < pixels.shape[0] and column + q % 2 < pixels.shape[1]:
                shade_pixel(body, view, shadows, row + q / 2, column + q % 2, nearest, pixels)
