"""A rasteriser: triangles are drawn into four points of each pixel; `raster_shading` lights what is nearest.

Points are found by products of three vectors, after M. Olano and T. Greer, "Triangle scan conversion using 2D
homogeneous coordinates", Graphics Hardware 1997: what reaches behind the camera needs no cutting.
"""

import warp as wp

from ..basis import kernel
from .shading import Body, Surroundings, in_bytes, meets_ground, texel
from .shadow import inside, over

ASIDE = wp.constant(wp.vec4(0.375, 0.875, 0.125, 0.625))
"""The four points of a pixel: one in each quarter of its height, and of its width (a rotated grid)."""


@wp.func
def row_of(row: int) -> float:
    """Return how far from the upper edge a row of points is, in pixels."""
    return 0.25 * (float(row) + 0.5)


@wp.func
def shares_of(view: Surroundings, a: wp.vec3, b: wp.vec3, c: wp.vec3):
    """Return (start, across, down): corners' shares, but for a factor, at (x, y) are start + x across + y down.

    The corners are given from the camera on.
    """
    shares = wp.matrix_from_rows(wp.cross(b, c), wp.cross(c, a), wp.cross(a, b))
    return shares @ view.corner, shares @ view.across, shares @ view.down


@kernel
def draw_triangles(
    body: Body,
    view: Surroundings,
    # In and out:
    nearest: wp.array2d(dtype=wp.uint64),  # of each point, shape [4 · height, width]
):
    """Draw every triangle where points lie in it; the nearest counts.

    What is kept of it is 1 / distance along the view, as bits, and in the lower half its number, counted from 1.
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
        way = view.corner + (float(column) + ASIDE[p]) * view.across + row_of(4 * row + p) * view.down
        t, uv = meets_ground(view, way)
        if t > 0.0:
            mean += 0.25 * texel(view.ground, uv[0], uv[1])
        else:
            mean += 0.25 * view.background
    pixels[row, column] = in_bytes(mean)
