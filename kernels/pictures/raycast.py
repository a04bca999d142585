"""A small ray caster: body, ground and shadow by ray queries, for machines without OpenGL."""

import warp as wp

from ..basis import kernel


@wp.struct
class Body:
    """The triangles that are drawn."""

    mesh: wp.uint64
    # Of vertices, each of shape [vertex_count]:
    normals: wp.array(dtype=wp.vec3)  # of unit length
    colours: wp.array(dtype=wp.vec3)  # red, green and blue in 0 … 1
    uv: wp.array(dtype=wp.vec2)  # places in the texture, 0 … 1
    texture: wp.array2d(dtype=wp.vec3)  # in 0 … 1, shape [height, width]
    textured: int  # 1 if the texture is what is seen, 0 if the colours are
    gloss: wp.array(dtype=float)  # strength of highlights of each triangle, shape [triangle_count]


@wp.struct
class Surroundings:
    """Camera, light and ground."""

    eye: wp.vec3
    """Where the camera is [m]."""
    corner: wp.vec3
    """Direction through the upper left corner of the picture."""
    across: wp.vec3
    """From the direction of one pixel to that of its right neighbour."""
    down: wp.vec3
    far: float
    """Beyond this distance nothing is met [m]."""
    light: wp.vec3
    """Unit vector towards the key light."""
    towards_viewer: wp.vec3
    """Unit vector against the direction of view: towards the second light."""
    background: wp.vec3
    """Colour where nothing is met, in 0 … 1."""
    # Strengths of what lights the body: from everywhere, from the key light and from the viewer.
    ambient: float
    key: float
    head: float
    shadow: float
    """What is left of the ground's colour in the shadow, 0 … 1."""
    has_ground: int
    below: float
    """What is further below the ground is not seen [m]."""
    ground: wp.array2d(dtype=wp.vec3)
    """Its texture in 0 … 1, shape [height, width]."""
    ground_centre: wp.vec3
    """Its middle [m]."""
    ground_normal: wp.vec3
    """Unit vector upwards."""
    ground_u: wp.vec3
    """u = (p − centre)·ground_u + 1/2 is the texture coordinate of a point p of the ground [1/m]."""
    ground_v: wp.vec3
    """The same for v [1/m]."""


@wp.func
def texel(image: wp.array2d(dtype=wp.vec3), u: float, v: float) -> wp.vec3:
    """Return the image at (u, v), linear between pixels; row 0 is at v = 1, and edges extend."""
    column = wp.clamp(u, 0.0, 1.0) * float(image.shape[1]) - 0.5
    row = (1.0 - wp.clamp(v, 0.0, 1.0)) * float(image.shape[0]) - 0.5
    c0 = int(wp.floor(column))
    r0 = int(wp.floor(row))
    s = column - float(c0)
    t = row - float(r0)
    c1 = wp.min(c0 + 1, image.shape[1] - 1)
    r1 = wp.min(r0 + 1, image.shape[0] - 1)
    c0 = wp.max(c0, 0)
    r0 = wp.max(r0, 0)
    upper = (1.0 - s) * image[r0, c0] + s * image[r0, c1]
    lower = (1.0 - s) * image[r1, c0] + s * image[r1, c1]
    return (1.0 - t) * upper + t * lower


@wp.func
def seen_body(body: Body, view: Surroundings, hit: wp.MeshQueryRay, ray: wp.vec3) -> wp.vec3:
    """Return the colour of the body where the ray hit it: Phong, both sides alike."""
    i = wp.mesh_get_index(body.mesh, 3 * hit.face)
    j = wp.mesh_get_index(body.mesh, 3 * hit.face + 1)
    k = wp.mesh_get_index(body.mesh, 3 * hit.face + 2)
    w = 1.0 - hit.u - hit.v
    normal = wp.normalize(hit.u * body.normals[i] + hit.v * body.normals[j] + w * body.normals[k])
    if wp.dot(normal, ray) > 0.0:
        normal = -normal
    colour = hit.u * body.colours[i] + hit.v * body.colours[j] + w * body.colours[k]
    if body.textured == 1:
        at = hit.u * body.uv[i] + hit.v * body.uv[j] + w * body.uv[k]
        colour = texel(body.texture, at[0], at[1])
    gloss = body.gloss[hit.face]
    diffuse = view.ambient
    glint = float(0.0)
    for k in range(2):
        light = view.light
        strength = view.key
        if k == 1:
            light = view.towards_viewer
            strength = view.head
        facing = wp.dot(normal, light)
        if facing > 0.0:
            mirrored = 2.0 * facing * normal - light
            diffuse += strength * facing
            glint += strength * gloss * wp.pow(wp.max(-wp.dot(mirrored, ray), 0.0), 30.0)
    return diffuse * colour + wp.vec3(glint, glint, glint)


@wp.func
def height(view: Surroundings, spot: wp.vec3) -> float:
    """Return how far a point is above the ground [m]."""
    return wp.dot(spot - view.ground_centre, view.ground_normal)


@wp.func
def seen(body: Body, view: Surroundings, column: float, row: float) -> wp.vec3:
    """Return the colour at a point of the picture, given in pixels from its upper left corner."""
    ray = wp.normalize(view.corner + column * view.across + row * view.down)
    hit = wp.mesh_query_ray(body.mesh, view.eye, ray, view.far)
    if hit.result and (view.has_ground == 0 or height(view, view.eye + hit.t * ray) >= -view.below):
        return seen_body(body, view, hit, ray)
    slope = wp.dot(ray, view.ground_normal)
    if view.has_ground == 1 and slope < 0.0:
        t = wp.dot(view.ground_centre - view.eye, view.ground_normal) / slope
        spot = view.eye + t * ray
        u = wp.dot(spot - view.ground_centre, view.ground_u) + 0.5
        v = wp.dot(spot - view.ground_centre, view.ground_v) + 0.5
        if t > 0.0 and u >= 0.0 and u <= 1.0 and v >= 0.0 and v <= 1.0:
            colour = texel(view.ground, u, v)
            start = spot + 1.0e-5 * view.far * view.ground_normal
            if wp.mesh_query_ray_anyhit(body.mesh, start, view.light, view.far):
                colour = view.shadow * colour
            return colour
    return view.background


@kernel
def cast(
    body: Body,
    view: Surroundings,
    # Out:
    image: wp.array2d(dtype=wp.vec3),  # red, green and blue, 1 being full, shape [height, width]
):
    """Draw the picture with one ray through the middle of each pixel."""
    row, column = wp.tid()
    image[row, column] = seen(body, view, float(column) + 0.5, float(row) + 0.5)


@kernel
def refine(
    body: Body,
    view: Surroundings,
    image: wp.array2d(dtype=wp.vec3),  # as `cast` draws it, shape [height, width]
    # Out:
    pixels: wp.array2d(dtype=wp.vec3ub),  # shape [height, width]
):
    """Smooth the outlines, with four rays where neighbouring pixels differ much; then turn to bytes."""
    row, column = wp.tid()
    left = image[row, wp.max(column - 1, 0)]
    right = image[row, wp.min(column + 1, image.shape[1] - 1)]
    above = image[wp.max(row - 1, 0), column]
    below = image[wp.min(row + 1, image.shape[0] - 1), column]
    colour = wp.min(image[row, column], wp.vec3(1.0, 1.0, 1.0))
    if wp.length(right - left) + wp.length(below - above) > 0.08:
        colour = wp.vec3()
        for k in range(4):
            x = float(column) + 0.25 + 0.5 * float(k % 2)
            y = float(row) + 0.25 + 0.5 * float(k / 2)
            colour += 0.25 * wp.min(seen(body, view, x, y), wp.vec3(1.0, 1.0, 1.0))
    pixels[row, column] = wp.vec3ub(
        wp.uint8(255.0 * wp.max(colour[0], 0.0) + 0.5),
        wp.uint8(255.0 * wp.max(colour[1], 0.0) + 0.5),
        wp.uint8(255.0 * wp.max(colour[2], 0.0) + 0.5),
    )


@kernel
def lay_over(
    body: Body,
    view: Surroundings,
    # In and out:
    pixels: wp.array2d(dtype=wp.vec3ub),  # shape [height, width]
):
    """Draw triangles over a picture, through all that is in it: four rays a pixel, where any meets one."""
    row, column = wp.tid()
    met = int(0)
    colour = wp.vec3()
    for k in range(4):
        x = float(column) + 0.25 + 0.5 * float(k % 2)
        y = float(row) + 0.25 + 0.5 * float(k / 2)
        ray = wp.normalize(view.corner + x * view.across + y * view.down)
        hit = wp.mesh_query_ray(body.mesh, view.eye, ray, view.far)
        if hit.result:
            met += 1
            colour += wp.min(seen_body(body, view, hit, ray), wp.vec3(1.0, 1.0, 1.0))
    if met > 0:
        below = pixels[row, column]
        share = 1.0 - 0.25 * float(met)
        pixels[row, column] = wp.vec3ub(
            wp.uint8(255.0 * 0.25 * colour[0] + share * float(below[0]) + 0.5),
            wp.uint8(255.0 * 0.25 * colour[1] + share * float(below[1]) + 0.5),
            wp.uint8(255.0 * 0.25 * colour[2] + share * float(below[2]) + 0.5),
        )
