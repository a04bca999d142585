"""A ray caster: one ray per pixel, then four per pixel where one is not enough."""

import functools

import warp as wp

from ..basis import kernel
from ..springs.lanes import sum_over_lanes
from .shading import FIRST_SAMPLES, Body, Surroundings, color_of, in_bytes, ray_shader, shade_hit, within_one

CONTRAST = wp.constant(0.08)
"""Pixels whose neighbours differ by more are refined."""
TILE = wp.constant(8)
"""Edge in pixels of the squares that consecutive threads draw, so that their rays are coherent."""
Five = wp.types.vector(5, wp.float32)


@wp.func
def place(i: int, width: int):
    """Return the row and column of thread i, square by square; some are beyond the edges of the picture."""
    square = i / (TILE * TILE)
    inside = i % (TILE * TILE)
    squares = (width + TILE - 1) / TILE
    return TILE * (square / squares) + inside / TILE, TILE * (square % squares) + inside % TILE


@functools.cache
def cast(through_glass: bool):
    """Compose the kernel that draws a picture with or without glass."""
    shade_ray = ray_shader(through_glass)

    @kernel
    def cast_rays(
        body: Body,
        glass: Body,
        view: Surroundings,
        # Out:
        image: wp.array2d(dtype=wp.vec4),  # red, green, blue, fraction of the light, shape [height, width]
    ):
        """Draw the picture with one ray through each pixel's centre, and one from the hit towards the light.

        A pixel and the four that share an edge with it sample five points of the light.
        """
        row, column = place(wp.tid(), image.shape[1])
        if row < image.shape[0] and column < image.shape[1]:
            spot = (2 * row + column) % FIRST_SAMPLES
            color, lit = shade_ray(body, glass, view, float(column) + 0.5, float(row) + 0.5, spot, 1)
            color = within_one(color)
            image[row, column] = wp.vec4(color[0], color[1], color[2], lit)

    return cast_rays


@kernel
def choose(
    image: wp.array2d(dtype=wp.vec4),  # as `cast` draws it, shape [height, width]
    # Out:
    pixels: wp.array2d(dtype=wp.vec3ub),  # those that need no refinement, shape [height, width]
    chosen: wp.array2d(dtype=int),  # pixels in penumbras, and others; shape [2, height · width]
    count: wp.array(dtype=int),  # number of each; initially 0
):
    """Convert pixels to bytes, and list those whose neighbours differ in color or light, for refinement."""
    row, column = place(wp.tid(), image.shape[1])
    if row >= image.shape[0] or column >= image.shape[1]:
        return
    here = image[row, column]
    left = image[row, wp.max(column - 1, 0)]
    right = image[row, wp.min(column + 1, image.shape[1] - 1)]
    above = image[wp.max(row - 1, 0), column]
    below = image[wp.min(row + 1, image.shape[0] - 1), column]
    pixel = image.shape[1] * row + column
    # These pixels have sampled all first points of the light.
    lit = Five(here[3], left[3], right[3], above[3], below[3])
    if wp.max(lit) > 0.5 and wp.min(lit) < 0.5:
        chosen[0, wp.atomic_add(count, 0, 1)] = pixel
    elif wp.length(right[:3] - left[:3]) + wp.length(below[:3] - above[:3]) > CONTRAST:
        chosen[1, wp.atomic_add(count, 1, 1)] = pixel
    else:
        pixels[row, column] = in_bytes(here[:3])


@functools.cache
def refine(lanes: int, through_glass: bool):
    """Compose the kernel that draws chosen pixels with four rays each.

    Pixels in penumbras come first, since they take longest. `lanes` (1, 4 or 16) adjacent threads draw a pixel.
    Of 4 threads each casts one ray. Of 16, four take a penumbra's ray and divide the samples of its light.
    """
    together, parts = sum_over_lanes(3, wp.float32, lanes), max(lanes // 4, 1)
    shade_ray = ray_shader(through_glass)

    @kernel
    def refine_pixels(
        body: Body,
        glass: Body,
        view: Surroundings,
        spots: int,  # points of the light per ray in a penumbra
        threads: int,
        chosen: wp.array2d(dtype=int),  # shape [2, height · width]
        count: wp.array(dtype=int),  # shape [2]
        # Out:
        pixels: wp.array2d(dtype=wp.vec3ub),  # shape [height, width]
    ):
        i = wp.tid() / wp.static(lanes)
        lane = wp.tid() % wp.static(lanes)
        while i < count[0] + count[1]:
            pixel = int(0)
            looks = int(1)
            shared = int(1)  # number of threads of one ray
            if i < count[0]:
                pixel = chosen[0, i]
                looks = spots / wp.static(parts)
                shared = wp.static(parts)
            else:
                pixel = chosen[1, i - count[0]]
            row = pixel / pixels.shape[1]
            column = pixel % pixels.shape[1]
            mean = wp.vec3()
            if lane / 4 < shared:
                for k in range(lane % 4, 4, wp.static(min(lanes, 4))):
                    x = float(column) + 0.25 + 0.5 * float(k % 2)
                    y = float(row) + 0.25 + 0.5 * float(k / 2)
                    first = k
                    if i < count[0]:  # adjacent pixels sample other points, to avoid visible steps
                        first = FIRST_SAMPLES + spots * (8 * (row % 2) + 4 * (column % 2) + k) + looks * (lane / 4)
                    color, _lit = shade_ray(body, glass, view, x, y, first, looks)
                    mean += (0.25 / float(shared)) * within_one(color)
            mean = together(mean)
            if lane == 0:
                pixels[row, column] = in_bytes(mean)
            i += threads / wp.static(lanes)

    return refine_pixels


@kernel
def lay_over(
    body: Body,
    view: Surroundings,
    # In and out:
    pixels: wp.array2d(dtype=wp.vec3ub),  # shape [height, width]
):
    """Draw triangles over the picture, with four rays per pixel."""
    row, column = wp.tid()
    met = int(0)
    mean = wp.vec3()
    for k in range(4):
        x = float(column) + 0.25 + 0.5 * float(k % 2)
        y = float(row) + 0.25 + 0.5 * float(k / 2)
        ray = wp.normalize(view.corner + x * view.across + y * view.down)
        hit = wp.mesh_query_ray(body.mesh, view.eye, ray, view.far)
        if hit.result:
            met += 1
            color, _lit, _opacity = shade_hit(body, view, hit, ray, 0, 0)
            mean += 0.25 * within_one(color)
    if met > 0:
        pixels[row, column] = in_bytes(mean + (1.0 - 0.25 * float(met)) * color_of(pixels[row, column]))
