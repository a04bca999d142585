"""Points, normals and colors of meshes that follow the particles, and arrows (float32, in 3D)."""

import warp as wp

from ..basis import kernel

STRAIN_STOPS = (
    (0.05, 0.22, 0.62),
    (0.22, 0.50, 0.85),
    (0.74, 0.75, 0.75),
    (0.90, 0.42, 0.27),
    (0.70, 0.06, 0.10),
)
"""Evenly spaced colors of strain from full compression (blue) through 0 (grey) to full tension (red)."""
VALUE_STOPS = (
    (0.08, 0.29, 0.58),
    (0.32, 0.31, 0.74),
    (0.54, 0.32, 0.80),
    (0.73, 0.32, 0.75),
    (0.89, 0.36, 0.64),
    (0.99, 0.44, 0.49),
    (1.00, 0.56, 0.34),
    (1.00, 0.71, 0.26),
    (0.98, 0.87, 0.31),
)
"""Evenly spaced colors of other values from 0 to full: from blue through red to yellow.

Distances of adjacent colors in OKLab agree to 5 %, and lightness increases: equal differences of values look
equal. The darkest color is light enough for shading to show the shape of a body at rest.
"""
SIDES = 8
"""Corners of each ring around an arrow: a thin cylinder with a cone in front."""
RINGS = 5
"""Start and end of an arrow's shaft, base and tip of its head, and the base again, which closes the cone."""
THICK, WIDE, HEAD = 0.025, 0.07, 0.25
"""Radii of shaft and head, and length of the head, as fractions of the longest arrow; on short arrows all are
smaller."""
SHORTEST = 0.5


@kernel
def place_vertices(
    x: wp.array(dtype=wp.vec3),  # positions [m], shape [particle_count]
    particle: wp.array2d(dtype=int),  # of each vertex, shape [vertex_count, k]
    weights: wp.array2d(dtype=float),  # shape [vertex_count, k]
    radius: float,  # [m]
    normals: wp.array(dtype=wp.vec3),  # shape [vertex_count]
    # Out:
    points: wp.array(dtype=wp.vec3),  # [m], shape [vertex_count]
):
    """Place every vertex at the weighted sum of its particles, plus `radius` along its normal."""
    i = wp.tid()
    point = wp.vec3()
    for k in range(particle.shape[1]):
        point += weights[i, k] * x[particle[i, k]]
    if radius > 0.0:
        point += radius * normals[i]
    points[i] = point


@kernel
def add_face_normals(
    points: wp.array(dtype=wp.vec3),  # [m], shape [vertex_count]
    triangles: wp.array(dtype=wp.vec3i),  # three vertices each, shape [triangle_count]
    normal_of: wp.array(dtype=int),  # vertex whose normal each vertex has, shape [vertex_count]
    # Out:
    sums: wp.array(dtype=wp.vec3),  # initially 0; twice the area [m²], shape [vertex_count]
):
    """Add each triangle's normal, weighted by its area, to those of its corners."""
    t = wp.tid()
    a = triangles[t][0]
    b = triangles[t][1]
    c = triangles[t][2]
    normal = wp.cross(points[b] - points[a], points[c] - points[a])
    wp.atomic_add(sums, normal_of[a], normal)
    wp.atomic_add(sums, normal_of[b], normal)
    wp.atomic_add(sums, normal_of[c], normal)


@kernel
def take_normals(
    sums: wp.array(dtype=wp.vec3),  # sums of triangle normals, shape [vertex_count]
    normal_of: wp.array(dtype=int),  # vertex whose normal each vertex has, shape [vertex_count]
    # Out:
    normals: wp.array(dtype=wp.vec3),  # of unit length, shape [vertex_count]
):
    """Normalize the sums, and copy them to the vertices that have them."""
    i = wp.tid()
    normals[i] = wp.normalize(sums[normal_of[i]])


@kernel
def place_rigid(
    given_points: wp.array(dtype=wp.vec3),  # [m], shape [vertex_count]
    given_normals: wp.array(dtype=wp.vec3),  # shape [vertex_count]
    turn: wp.mat33,
    shift: wp.vec3,  # [m]
    # Out:
    points: wp.array(dtype=wp.vec3),  # [m], shape [vertex_count]
    normals: wp.array(dtype=wp.vec3),  # shape [vertex_count]
):
    """Turn and shift a rigid mesh."""
    i = wp.tid()
    points[i] = turn * given_points[i] + shift
    normals[i] = turn * given_normals[i]


@wp.func
def spoke(axis: wp.vec3, k: int, count: int) -> wp.vec3:
    """Return the k-th of `count` unit vectors spread evenly around an axis of unit length."""
    aside = wp.vec3(0.0, 0.0, 1.0)
    if wp.abs(axis[2]) > 0.9:
        aside = wp.vec3(1.0, 0.0, 0.0)
    e1 = wp.normalize(wp.cross(axis, aside))
    angle = 6.2831853 * float(k) / float(count)
    return wp.cos(angle) * e1 + wp.sin(angle) * wp.cross(axis, e1)


@kernel
def place_tubes(
    x: wp.array(dtype=wp.vec3),  # positions [m], shape [particle_count]
    connections: wp.array(dtype=wp.vec2i),  # two particles each, shape [connection_count]
    radius: float,  # [m]
    sides: int,
    # Out:
    points: wp.array(dtype=wp.vec3),  # [m], shape [2 · sides · connection_count]
    normals: wp.array(dtype=wp.vec3),  # of unit length, shape [2 · sides · connection_count]
):
    """Lay a tube along every spring, with vertices at its start and its end in turn."""
    c = wp.tid()
    start = x[connections[c][0]]
    end = x[connections[c][1]]
    axis = wp.normalize(end - start)
    for k in range(sides):
        outwards = spoke(axis, k, sides)
        near = 2 * (sides * c + k)
        points[near] = start + radius * outwards
        points[near + 1] = end + radius * outwards
        normals[near] = outwards
        normals[near + 1] = outwards


@kernel
def place_arrows(
    start: wp.array(dtype=wp.vec3),  # start of each arrow [m], shape [arrow_count]
    way: wp.array(dtype=wp.vec3),  # from the start to the tip [m]
    longest: float,  # [m]
    # Out, of shape [arrow_count · RINGS · SIDES]:
    points: wp.array(dtype=wp.vec3),  # [m]
    normals: wp.array(dtype=wp.vec3),  # of unit length
):
    """Place the vertices of every arrow; an arrow of length 0 is an invisible point."""
    a = wp.tid()
    length = wp.length(way[a])
    axis = wp.normalize(way[a])
    # Short arrows are scaled down as a whole.
    unit = wp.min(longest, length * wp.static(SHORTEST / HEAD))
    neck = start[a] + (length - wp.static(HEAD) * unit) * axis
    slant = wp.normalize(wp.vec2(wp.static(HEAD), wp.static(WIDE)))  # the cone's normal: outward, and forward
    for k in range(wp.static(SIDES)):
        outwards = spoke(axis, k, wp.static(SIDES))
        first = wp.static(RINGS * SIDES) * a + k
        points[first] = start[a] + wp.static(THICK) * unit * outwards
        points[first + wp.static(SIDES)] = neck + wp.static(THICK) * unit * outwards
        points[first + wp.static(2 * SIDES)] = neck + wp.static(WIDE) * unit * outwards
        points[first + wp.static(3 * SIDES)] = start[a] + way[a]
        points[first + wp.static(4 * SIDES)] = neck + wp.static(WIDE) * unit * outwards
        normals[first] = outwards
        normals[first + wp.static(SIDES)] = outwards
        normals[first + wp.static(2 * SIDES)] = slant[0] * outwards + slant[1] * axis
        normals[first + wp.static(3 * SIDES)] = slant[0] * outwards + slant[1] * axis
        normals[first + wp.static(4 * SIDES)] = -axis


@kernel
def collapse(
    since: wp.array(dtype=float),  # time when each piece appears [s], shape [piece_count]
    until: wp.array(dtype=float),  # time when it disappears [s], inf for never, shape [piece_count]
    time: float,  # [s]
    corners: int,  # vertices of each piece
    # In and out:
    points: wp.array(dtype=wp.vec3),  # [m], shape [piece_count · corners]
):
    """Collapse pieces that are not visible at `time` to their first vertices."""
    piece = wp.tid()
    if until[piece] < time or until[piece] <= 0.0 or (since[piece] >= time and since[piece] > 0.0):
        for k in range(1, corners):
            points[piece * corners + k] = points[piece * corners]


@wp.func
def color_at(stops: wp.array(dtype=wp.vec3), fraction: float) -> wp.vec3:
    """Return the color at a fraction 0 … 1 of a scale: linear between its stops, clamped to its ends outside."""
    last = stops.shape[0] - 1
    at = wp.clamp(fraction, 0.0, 1.0) * float(last)
    k = wp.min(int(at), last - 1)
    return stops[k] + (at - float(k)) * (stops[k + 1] - stops[k])


@kernel
def color_by_strain(
    x: wp.array(dtype=wp.vec3),  # positions [m], shape [particle_count]
    connections: wp.array(dtype=wp.vec2i),  # two particles each, shape [connection_count]
    rest_length: wp.array(dtype=float),  # [m], shape [connection_count]
    full_strain: float,
    corners: int,
    stops: wp.array(dtype=wp.vec3),  # colors of the scale, shape [stop_count]
    # Out:
    colors: wp.array(dtype=wp.vec3),  # shape [corners · connection_count]
):
    """Color the vertices of every spring's tube by its strain / full_strain, from -1 to 1."""
    c = wp.tid()
    strain = wp.length(x[connections[c][1]] - x[connections[c][0]]) / rest_length[c] - 1.0
    color = color_at(stops, 0.5 + 0.5 * strain / full_strain)
    for k in range(corners):
        colors[corners * c + k] = color


@kernel
def color_by_value(
    fractions: wp.array(dtype=float),  # shape [particle_count]
    particle: wp.array2d(dtype=int),  # of each vertex, shape [vertex_count, k]
    weights: wp.array2d(dtype=float),  # shape [vertex_count, k]
    stops: wp.array(dtype=wp.vec3),  # colors of the scale, shape [stop_count]
    # Out:
    colors: wp.array(dtype=wp.vec3),  # shape [vertex_count]
):
    """Color every vertex by the weighted mean of its particles' values, given as fractions of the full value."""
    i = wp.tid()
    fraction = float(0.0)
    for k in range(particle.shape[1]):
        fraction += weights[i, k] * fractions[particle[i, k]]
    colors[i] = color_at(stops, fraction)


@kernel
def halve_over(
    fine: wp.array2d(dtype=wp.vec4ub),  # red, green, blue, coverage, shape [2 · height, 2 · width]
    first_row: int,
    first_column: int,
    # In and out:
    pixels: wp.array2d(dtype=wp.vec4ub),  # shape [height, width]
):
    """Average 2 × 2 pixels of a picture of twice the size, stored last row first, and blend it over `pixels`.

    Threads cover a rectangle that starts at the first row and column. Where nothing was drawn `fine` is 0,
    and adds nothing to an average.
    """
    i, j = wp.tid()
    row = first_row + i
    column = first_column + j
    y = fine.shape[0] - 1 - 2 * row
    x = 2 * column
    a = fine[y, x]
    b = fine[y, x + 1]
    c = fine[y - 1, x]
    d = fine[y - 1, x + 1]
    bare = 4 * 255 - int(a[3]) - int(b[3]) - int(c[3]) - int(d[3])
    if bare == 4 * 255:
        return
    if bare == 0 and a == b and a == c and a == d:
        pixels[row, column] = a
        return
    pixel = pixels[row, column]
    for k in range(3):
        total = int(a[k]) + int(b[k]) + int(c[k]) + int(d[k])
        pixel[k] = wp.uint8((255 * total + bare * int(pixel[k]) + 510) / 1020)
    pixels[row, column] = pixel
