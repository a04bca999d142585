"""Shading along a ray: bodies and obstacles, lit and in shadow, the ground, and the background."""

import functools
from typing import Any

import warp as wp


@wp.struct
class Finish:
    """What a surface is made of; see `msdwarp/pictures/light.py`."""

    shininess: float  # Phong's exponent of highlights
    gleam: float  # cosine of the angle beyond which highlights are too weak to see: powers are expensive
    metallic: float
    sheen: float
    opacity: float


@wp.struct
class Body:
    """The triangles that are drawn."""

    mesh: wp.uint64  # search tree for rays
    other_mesh: wp.uint64  # that of other triangles that cast shadows on these; 0: none
    # Of vertices, each of shape [vertex_count]:
    points: wp.array(dtype=wp.vec3)  # [m]
    normals: wp.array(dtype=wp.vec3)  # of unit length
    colors: wp.array(dtype=wp.vec3)  # red, green and blue in 0 … 1
    uv: wp.array(dtype=wp.vec2)  # places in the texture, 0 … 1
    # Of triangles, each of shape [triangle_count]:
    triangles: wp.array(dtype=wp.vec3i)  # three vertices each
    closed: wp.array(dtype=wp.bool)  # whether the back is never visible
    gloss: wp.array(dtype=float)  # strength of highlights
    finish: wp.array(dtype=int)  # number of its finish
    finishes: wp.array(dtype=Finish)  # shape [finish_count]
    glass: int  # 1 if what is behind is seen through all triangles, 0 if through none
    first_shaded: int  # triangles before this one take no shadows
    texture: wp.array2d(dtype=wp.vec3ub)  # shape [height, width]
    textured: int  # 1 if the texture is drawn, 0 if the colors are


@wp.struct
class Surroundings:
    """Camera, light and ground."""

    eye: wp.vec3  # position of the camera [m]
    corner: wp.vec3  # direction through the upper left corner of the picture
    across: wp.vec3  # from the direction of one pixel to that of its right neighbour
    down: wp.vec3  # the same downwards
    far: float  # the longest ray [m]
    light: wp.vec3  # unit vector towards the middle of the key light
    light_u: wp.vec3  # point (a, b) of the light, a disc of radius 1, is towards light + a light_u + b light_v
    light_v: wp.vec3
    spots: wp.array(dtype=wp.vec2)  # sampling points of the key light: five to detect penumbras, then the others
    towards_viewer: wp.vec3  # unit vector against the direction of view: towards the headlight
    fill_from: wp.vec3  # unit vector towards the fill light
    background: wp.vec3  # color in 0 … 1
    # Strengths of light from the sky and from the ground, and of the three lights.
    sky: float
    bounce: float
    key: float
    head: float
    fill: float
    tone: float  # how much brighter surfaces are than in proportion to the light
    shadows: int  # 1 if there are shadows, else 0
    shaded: float  # fraction of the key light on bodies in full shadow, 0 … 1
    shadow: float  # fraction of the ground's color in full shadow, 0 … 1
    has_ground: int
    contact: float  # height above the ground where half of the light from there arrives [m]
    below: float  # points deeper below the ground are not drawn [m]
    ground: wp.array2d(dtype=wp.vec3ub)  # its texture, shape [height, width]
    ground_centre: wp.vec3  # its middle [m]
    ground_normal: wp.vec3  # unit vector upwards
    ground_u: wp.vec3  # u = (p − centre)·ground_u + 1/2 is the texture coordinate of a point p of the ground [1/m]
    ground_v: wp.vec3  # the same for v [1/m]


MIRRORED_SKY, MIRRORED_GROUND = 1.25, 0.4
"""Brightness of what metal and glass mirror: the sky above the horizon, and the ground."""
DARK_BELOW, BRIGHT_ABOVE = -0.15, 0.3
"""Vertical components of directions between which the mirrored brightness changes from ground to sky."""
ZENITH = 0.45
"""By how much the sky is less bright towards the zenith."""
MIRRORS = 0.05
"""Share of light that glass mirrors where it is seen face-on; towards its edges it grows by C. Schlick's formula
("An inexpensive BRDF model for physically-based rendering", Computer Graphics Forum 13, 1994)."""
GAP = wp.constant(1.0e-4)
"""Offset of a shadow ray's start from the surface, over the distance of the camera: well above the rounding of
float32, and less than a tenth of a pixel."""
FIRST_SAMPLES = wp.constant(5)
"""Points of the light that adjacent pixels sample, one each, to detect penumbras."""
FACING_AWAY = wp.constant(0.5)
"""Value for the visible fraction of the key light on surfaces that face away from it."""


@wp.func
def color_of(pixel: wp.vec3ub) -> wp.vec3:
    """Return the color of a pixel, converted from bytes to 0 … 1."""
    return wp.vec3(float(pixel[0]), float(pixel[1]), float(pixel[2])) / 255.0


@wp.func
def within_one(color: wp.vec3) -> wp.vec3:
    """Return a color with each of its channels limited to 1."""
    return wp.min(color, wp.vec3(1.0, 1.0, 1.0))


@wp.func
def in_bytes(color: wp.vec3) -> wp.vec3ub:
    """Return a color in 0 … 1, converted to bytes."""
    scaled = 255.0 * wp.max(color, wp.vec3()) + wp.vec3(0.5, 0.5, 0.5)
    return wp.vec3ub(wp.uint8(scaled[0]), wp.uint8(scaled[1]), wp.uint8(scaled[2]))


@wp.func
def mix(weights: wp.vec3, values: wp.array(dtype=Any), corners: wp.vec3i):
    """Return the weighted sum of the values at the corners of a triangle."""
    return weights[0] * values[corners[0]] + weights[1] * values[corners[1]] + weights[2] * values[corners[2]]


@wp.func
def texel(image: wp.array2d(dtype=wp.vec3ub), u: float, v: float) -> wp.vec3:
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
    upper = (1.0 - s) * color_of(image[r0, c0]) + s * color_of(image[r0, c1])
    lower = (1.0 - s) * color_of(image[r1, c0]) + s * color_of(image[r1, c1])
    return (1.0 - t) * upper + t * lower


@wp.func
def nearest_texel(image: wp.array2d(dtype=wp.vec3ub), uv: wp.vec2) -> wp.vec3:
    """Return the pixel of the image at (u, v), in 0 … 255; row 0 is at v = 1, and edges extend."""
    column = int(wp.clamp(uv[0], 0.0, 1.0) * float(image.shape[1]))
    row = int((1.0 - wp.clamp(uv[1], 0.0, 1.0)) * float(image.shape[0]))
    pixel = image[wp.min(row, image.shape[0] - 1), wp.min(column, image.shape[1] - 1)]
    return wp.vec3(float(pixel[0]), float(pixel[1]), float(pixel[2]))


@wp.func
def height(view: Surroundings, spot: wp.vec3) -> float:
    """Return the height of a point above the ground [m]; 0 without a ground."""
    return wp.dot(spot - view.ground_centre, view.ground_normal)


@wp.func
def surroundings_at(upwards: float) -> float:
    """Return the brightness of the surroundings that is mirrored, for a direction's vertical component -1 … 1."""
    up = wp.clamp((upwards - wp.static(DARK_BELOW)) / wp.static(BRIGHT_ABOVE - DARK_BELOW), 0.0, 1.0)
    sky = wp.static(MIRRORED_SKY) - wp.static(ZENITH) * wp.max(upwards, 0.0)
    return wp.static(MIRRORED_GROUND) + (sky - wp.static(MIRRORED_GROUND)) * up * up * (3.0 - 2.0 * up)


@wp.func
def visible_light(body: Body, view: Surroundings, start: wp.vec3, first: int, count: int) -> float:
    """Return the visible fraction of `count` points of the key light, starting at `first`."""
    if view.shadows == 0:
        return 1.0
    hidden = int(0)
    for k in range(first, first + count):
        way = view.light + view.spots[k][0] * view.light_u + view.spots[k][1] * view.light_v
        way = wp.normalize(way)
        if wp.mesh_query_ray_anyhit(body.mesh, start, way, view.far):
            hidden += 1
        elif body.other_mesh != wp.uint64(0):
            if wp.mesh_query_ray_anyhit(body.other_mesh, start, way, view.far):
                hidden += 1
    return 1.0 - float(hidden) / float(count)


@wp.func
def highlight(finish: Finish, mirrored: wp.vec3, ray: wp.vec3) -> float:
    """Return the strength of a highlight along a ray, given the mirrored direction of the light; 0 below 1e-4."""
    along = -wp.dot(mirrored, ray)
    if along < finish.gleam:
        return 0.0
    return wp.pow(along, finish.shininess)


@wp.func
def light_on(
    view: Surroundings, finish: Finish, gloss: float, normal: wp.vec3, ray: wp.vec3, arrives: float, above: float
):
    """Return the brightness of a surface's color, highlights, and opacity; see `msdwarp/pictures/light.py`.

    `normal` is that of the visible side; `arrives` is the fraction of the key light that reaches it, and `above`
    the height above the ground [m].
    """
    from_ground = view.bounce * (1.0 - view.contact / (wp.max(above, 0.0) + view.contact + 1.0e-30))
    diffuse = view.sky + 0.5 * (1.0 - normal[2]) * (from_ground - view.sky)
    diffuse += view.fill * wp.max(wp.dot(normal, view.fill_from), 0.0)
    glint = float(0.0)
    facing = wp.dot(normal, view.towards_viewer)
    if facing > 0.0:
        diffuse += view.head * facing
        if gloss > 0.0:
            mirrored = 2.0 * facing * normal - view.towards_viewer
            glint += view.head * gloss * highlight(finish, mirrored, ray)
    facing = wp.dot(normal, view.light)
    if facing > 0.0:
        diffuse += view.key * facing * (view.shaded + (1.0 - view.shaded) * arrives)
        if gloss > 0.0:
            mirrored = 2.0 * facing * normal - view.light
            glint += view.key * gloss * arrives * highlight(finish, mirrored, ray)
    diffuse = wp.min(diffuse, 1.0)
    diffuse += view.tone * diffuse * (1.0 - diffuse)
    opacity = float(1.0)
    if finish.sheen + finish.metallic > 0.0 or finish.opacity < 1.0:
        along = wp.min(-wp.dot(normal, ray), 1.0)
        edge = 1.0 - wp.max(along, 0.0)
        diffuse += finish.sheen * edge * edge
        if finish.metallic > 0.0:
            around = surroundings_at(ray[2] + 2.0 * along * normal[2])
            diffuse += finish.metallic * (around - diffuse) + glint
            glint = 0.0
        elif finish.opacity < 1.0:
            around = surroundings_at(ray[2] + 2.0 * along * normal[2])
            mirrors = wp.static(MIRRORS) + (1.0 - wp.static(MIRRORS)) * edge * edge * edge * edge * edge
            opacity = 1.0 - (1.0 - finish.opacity) * (1.0 - mirrors) * (1.0 - wp.min(glint, 1.0))
            diffuse = diffuse * finish.opacity / opacity
            glint = (glint + mirrors * around) / opacity
    return diffuse, glint, opacity


@wp.func
def shade_hit(body: Body, view: Surroundings, hit: wp.MeshQueryRay, ray: wp.vec3, first: int, count: int):
    """Return the color of the body where the ray hit it, the fraction of the key light there, and opacity.

    Phong's shading, for both sides. If triangles approximate a smooth surface, a ray towards the light starts on
    that surface, since the triangles' own shadow would be jagged at grazing light (J. Hanika, "Hacking the shadow
    terminator", Ray Tracing Gems II, 2021).
    """
    corners = body.triangles[hit.face]
    weights = wp.vec3(hit.u, hit.v, 1.0 - hit.u - hit.v)
    side = float(1.0)
    if wp.dot(hit.normal, ray) > 0.0:
        side = -1.0
    normal = side * wp.normalize(mix(weights, body.normals, corners))
    color = mix(weights, body.colors, corners)
    if body.textured == 1:
        at = mix(weights, body.uv, corners)
        color = texel(body.texture, at[0], at[1])
    lit = FACING_AWAY
    arrives = float(1.0)
    spot = view.eye + hit.t * ray
    if wp.dot(normal, view.light) > 0.0 and count > 0 and hit.face >= body.first_shaded:
        start = spot + GAP * hit.t * normal
        for k in range(3):
            # Move up to the tangent plane at each corner.
            upwards = side * body.normals[corners[k]]
            start += weights[k] * (wp.max(wp.dot(body.points[corners[k]] - spot, upwards), 0.0) * upwards)
        lit = visible_light(body, view, start, first, count)
        arrives = lit
    finish = body.finishes[body.finish[hit.face]]
    above = height(view, spot)
    bright, glint, opacity = light_on(view, finish, body.gloss[hit.face], normal, ray, arrives, above)
    return bright * color + wp.vec3(glint, glint, glint), lit, opacity


@wp.func
def meets_ground(view: Surroundings, way: wp.vec3):
    """Return t where eye + t way meets the ground, or -1, and the ground's texture coordinates there."""
    slope = wp.dot(way, view.ground_normal)
    if view.has_ground == 0 or slope >= 0.0:
        return -1.0, wp.vec2()
    t = wp.dot(view.ground_centre - view.eye, view.ground_normal) / slope
    spot = view.eye + t * way - view.ground_centre
    uv = wp.vec2(wp.dot(spot, view.ground_u) + 0.5, wp.dot(spot, view.ground_v) + 0.5)
    if t <= 0.0 or wp.min(uv) < 0.0 or wp.max(uv) > 1.0:
        return -1.0, wp.vec2()
    return t, uv


@functools.cache
def ray_shader(through_glass: bool):
    """Compose the function that shades a ray; `through_glass` tells whether there is glass."""

    @wp.func
    def shade_ray(body: Body, glass: Body, view: Surroundings, column: float, row: float, first: int, count: int):
        """Return the color at a point of the picture, in pixels from its upper left, and the light there.

        The light is the visible fraction of `count` points of the key light, from `first` on. Of several glasses
        behind each other only the nearest is drawn.
        """
        ray = wp.normalize(view.corner + column * view.across + row * view.down)
        color = view.background
        lit = FACING_AWAY
        hit = wp.mesh_query_ray(body.mesh, view.eye, ray, view.far)
        if hit.result and (view.has_ground == 0 or height(view, view.eye + hit.t * ray) >= -view.below):
            color, lit, _opacity = shade_hit(body, view, hit, ray, first, count)
        else:
            t, uv = meets_ground(view, ray)
            if t > 0.0:
                spot = view.eye + t * ray
                lit = visible_light(body, view, spot + GAP * t * view.ground_normal, first, count)
                color = (view.shadow + (1.0 - view.shadow) * lit) * texel(view.ground, uv[0], uv[1])
        if wp.static(through_glass):
            through = wp.mesh_query_ray(glass.mesh, view.eye, ray, view.far)
            if through.result and (through.t < hit.t or not hit.result):
                if view.has_ground == 0 or height(view, view.eye + through.t * ray) >= -view.below:
                    seen, own, opacity = shade_hit(glass, view, through, ray, first, count)
                    color = (1.0 - opacity) * color + opacity * within_one(seen)
                    # A value that changes at the edges of penumbras, both on the glass and behind it.
                    if lit == FACING_AWAY:
                        lit = own
                    elif own != FACING_AWAY:
                        lit = wp.abs(lit - own)
        return color, lit

    return shade_ray
