"""What is drawn: points, normals and colours that follow the particles (float32, three coordinates)."""

import functools

import warp as wp

from ..basis import kernel

STRAIN_STOPS = (
    (0.05, 0.22, 0.62),
    (0.22, 0.50, 0.85),
    (0.74, 0.75, 0.75),
    (0.90, 0.42, 0.27),
    (0.70, 0.06, 0.10),
)
"""Colours, evenly spaced, of strain from full compression (blue) over none (grey) to full tension (red)."""
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
"""Colours, evenly spaced, of any other value from 0 to full: from blue through red to yellow.

Each is as far from the next in OKLab as the others are, to 5 %, and lighter: equal differences of values look
alike. The darkest is light enough for shading to show the shape of a body at rest.
"""


@functools.cache
def lift(vectors: type):
    """Return a kernel that copies vectors of one to three coordinates into space: the second of two is z."""
    dim = wp.types.type_size(vectors)

    @kernel
    def lift_all(
        x: wp.array(dtype=vectors),  # [m], shape [particle_count]
        # Out:
        in_space: wp.array(dtype=wp.vec3),  # [m], shape [particle_count]
    ):
        i = wp.tid()
        here = x[i]
        if wp.static(dim == 1):
            in_space[i] = wp.vec3(float(here[0]), 0.0, 0.0)
        if wp.static(dim == 2):
            in_space[i] = wp.vec3(float(here[0]), 0.0, float(here[1]))
        if wp.static(dim == 3):
            in_space[i] = wp.vec3(float(here[0]), float(here[1]), float(here[2]))

    return lift_all


@kernel
def place_vertices(
    x: wp.array(dtype=wp.vec3),  # positions [m], shape [particle_count]
    particle: wp.array(dtype=int),  # of each vertex, shape [vertex_count]
    # Out:
    points: wp.array(dtype=wp.vec3),  # [m], shape [vertex_count]
):
    """Put every surface vertex where its particle is."""
    i = wp.tid()
    points[i] = x[particle[i]]


@kernel
def place_mixtures(
    x: wp.array(dtype=wp.vec3),  # positions [m], shape [particle_count]
    particle: wp.array2d(dtype=int),  # of each vertex, shape [vertex_count, k]
    weights: wp.array2d(dtype=float),  # shape [vertex_count, k]
    # Out:
    points: wp.array(dtype=wp.vec3),  # [m], shape [vertex_count]
):
    """Put every surface vertex at the weighted sum of its particles."""
    i = wp.tid()
    point = wp.vec3()
    for k in range(particle.shape[1]):
        point += weights[i, k] * x[particle[i, k]]
    points[i] = point


@kernel
def add_face_normals(
    points: wp.array(dtype=wp.vec3),  # [m], shape [vertex_count]
    triangles: wp.array(dtype=wp.vec3i),  # three vertices each, shape [triangle_count]
    normal_of: wp.array(dtype=int),  # the vertex whose normal each takes, shape [vertex_count]
    # Out:
    sums: wp.array(dtype=wp.vec3),  # 0 before; twice an area [m²], shape [vertex_count]
):
    """Add each triangle's normal, weighted by its area, at the vertices whose normals its corners take."""
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
    sums: wp.array(dtype=wp.vec3),  # of the normals of triangles, shape [vertex_count]
    normal_of: wp.array(dtype=int),  # the vertex whose normal each takes, shape [vertex_count]
    # Out:
    normals: wp.array(dtype=wp.vec3),  # of unit length, shape [vertex_count]
):
    """Give every vertex the unit normal of the vertex that it shares it with."""
    i = wp.tid()
    normals[i] = wp.normalize(sums[normal_of[i]])


@kernel
def place_balls(
    x: wp.array(dtype=wp.vec3),  # positions [m], shape [particle_count]
    particle: wp.array(dtype=int),  # in the middle of each ball, shape [ball_count]
    directions: wp.array(dtype=wp.vec3),  # of unit length, shape [corner_count]
    radius: float,  # [m]
    # Out:
    points: wp.array(dtype=wp.vec3),  # [m], shape [ball_count · corner_count]
):
    """Put balls, given by the directions from their middles to their vertices, at some particles."""
    p, k = wp.tid()
    points[p * directions.shape[0] + k] = x[particle[p]] + radius * directions[k]


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
    """Turn and shift a mesh as one."""
    i = wp.tid()
    points[i] = turn * given_points[i] + shift
    normals[i] = turn * given_normals[i]


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
    """Lay a tube of some sides along every connection, with vertices at its start and its end in turn."""
    c = wp.tid()
    start = x[connections[c][0]]
    end = x[connections[c][1]]
    axis = wp.normalize(end - start)
    aside = wp.vec3(0.0, 0.0, 1.0)
    if wp.abs(axis[2]) > 0.9:
        aside = wp.vec3(1.0, 0.0, 0.0)
    e1 = wp.normalize(wp.cross(axis, aside))
    e2 = wp.cross(axis, e1)
    for k in range(sides):
        angle = 6.2831853 * float(k) / float(sides)
        outwards = wp.cos(angle) * e1 + wp.sin(angle) * e2
        near = 2 * (sides * c + k)
        points[near] = start + radius * outwards
        points[near + 1] = end + radius * outwards
        normals[near] = outwards
        normals[near + 1] = outwards


@wp.func
def is_broken(broken_at: float, time: float) -> bool:
    """Return whether what broke at that time is broken in a frame: before it, or from the start."""
    return broken_at < time or broken_at <= 0.0


@kernel
def collapse(
    broken_at: wp.array(dtype=float),  # of each piece [s], inf where it is whole, shape [piece_count]
    time: float,  # [s]
    corners: int,
    # In and out:
    points: wp.array(dtype=wp.vec3),  # [m], so many corners for each piece, shape [piece_count · corners]
):
    """Put all corners of broken pieces where their first ones are: nothing is seen of them then."""
    piece = wp.tid()
    if is_broken(broken_at[piece], time):
        for k in range(1, corners):
            points[piece * corners + k] = points[piece * corners]


@kernel
def collapse_until(
    since: wp.array(dtype=float),  # when each piece is seen first [s], shape [piece_count]
    time: float,  # [s]
    corners: int,
    # In and out:
    points: wp.array(dtype=wp.vec3),  # [m], so many corners for each piece, shape [piece_count · corners]
):
    """Put all corners of pieces that nothing has laid bare yet where their first ones are."""
    piece = wp.tid()
    if not is_broken(since[piece], time):
        for k in range(1, corners):
            points[piece * corners + k] = points[piece * corners]


@wp.func
def colour_at(stops: wp.array(dtype=wp.vec3), share: float) -> wp.vec3:
    """Return the colour at a share of a scale: linear between its stops, and its ends below 0 and above 1."""
    last = stops.shape[0] - 1
    at = wp.clamp(share, 0.0, 1.0) * float(last)
    k = wp.min(int(at), last - 1)
    return stops[k] + (at - float(k)) * (stops[k + 1] - stops[k])


@kernel
def colour_by_strain(
    x: wp.array(dtype=wp.vec3),  # positions [m], shape [particle_count]
    connections: wp.array(dtype=wp.vec2i),  # two particles each, shape [connection_count]
    rest_length: wp.array(dtype=float),  # [m], shape [connection_count]
    full_strain: float,
    corners: int,
    stops: wp.array(dtype=wp.vec3),  # colours of the scale, shape [stop_count]
    # Out:
    colours: wp.array(dtype=wp.vec3),  # shape [corners · connection_count]
):
    """Colour the vertices of every connection's tube by its strain / full_strain, from -1 to 1."""
    c = wp.tid()
    strain = wp.length(x[connections[c][1]] - x[connections[c][0]]) / rest_length[c] - 1.0
    colour = colour_at(stops, 0.5 + 0.5 * strain / full_strain)
    for k in range(corners):
        colours[corners * c + k] = colour


@kernel
def colour_by_value(
    shares: wp.array(dtype=float),  # shape [particle_count]
    particle: wp.array2d(dtype=int),  # of each vertex, shape [vertex_count, k]
    weights: wp.array2d(dtype=float),  # shape [vertex_count, k]
    stops: wp.array(dtype=wp.vec3),  # colours of the scale, shape [stop_count]
    # Out:
    colours: wp.array(dtype=wp.vec3),  # shape [vertex_count]
):
    """Colour every vertex by the mixture of its particles' values, given as shares of the full one."""
    i = wp.tid()
    share = float(0.0)
    for k in range(particle.shape[1]):
        share += weights[i, k] * shares[particle[i, k]]
    colours[i] = colour_at(stops, share)


@wp.func
def byte(pixel: wp.uint32, k: int) -> int:
    """Return byte k of a pixel: red, green, blue, coverage."""
    return int((pixel >> wp.uint32(8 * k)) & wp.uint32(255))


@kernel
def halve_over(
    fine: wp.array2d(dtype=wp.uint32),  # shape [2 · height, 2 · width]
    first_row: int,
    first_column: int,
    # In and out:
    pixels: wp.array2d(dtype=wp.uint32),  # shape [height, width]
):
    """Average a picture of twice the size, last row first, 2 × 2 to a pixel, and lay it over what is there.

    Threads cover a rectangle from the first row and column on. A pixel is four bytes. Where nothing was drawn
    `fine` is 0, so an average is weighted by coverage already.
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
    if (a | b | c | d) == wp.uint32(0):
        return
    if a == b and a == c and a == d:
        pixels[row, column] = a
    else:
        below = pixels[row, column]
        bare = 4 * 255 - byte(a, 3) - byte(b, 3) - byte(c, 3) - byte(d, 3)
        pixel = wp.uint32(255) << wp.uint32(24)
        for k in range(3):
            total = byte(a, k) + byte(b, k) + byte(c, k) + byte(d, k)
            mean = (255 * total + bare * byte(below, k) + 510) / 1020
            pixel = pixel | (wp.uint32(mean) << wp.uint32(8 * k))
        pixels[row, column] = pixel
