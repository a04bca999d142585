"""Arrows: a thin cylinder with a cone in front, each (float32, three coordinates)."""

import warp as wp

from ..basis import kernel

SIDES = 8
"""Corners of each ring around an arrow."""
RINGS = 5
"""Start and end of its shaft, base and tip of its head, and the base once more, which closes that."""
THICK, WIDE, HEAD = 0.025, 0.07, 0.25
"""Radii of shaft and head, and the length of the head, by that of the longest arrow; of a short one it is
HEAD / SHORTEST of itself at most."""
SHORTEST = 0.5


@kernel
def place_arrows(
    start: wp.array(dtype=wp.vec3),  # where each begins [m], shape [arrow_count]
    way: wp.array(dtype=wp.vec3),  # from there to its tip [m]
    longest: float,  # [m]
    # Out, of shape [arrow_count · RINGS · SIDES]:
    points: wp.array(dtype=wp.vec3),  # [m]
    normals: wp.array(dtype=wp.vec3),  # of unit length
):
    """Lay out every arrow; one of no length is a point, of which nothing is seen."""
    a = wp.tid()
    length = wp.length(way[a])
    axis = wp.normalize(way[a])
    aside = wp.vec3(0.0, 0.0, 1.0)
    if wp.abs(axis[2]) > 0.9:
        aside = wp.vec3(1.0, 0.0, 0.0)
    e1 = wp.normalize(wp.cross(axis, aside))
    e2 = wp.cross(axis, e1)
    # Short arrows are smaller as a whole.
    unit = wp.min(longest, length * wp.static(SHORTEST / HEAD))
    neck = start[a] + (length - wp.static(HEAD) * unit) * axis
    slant = wp.normalize(wp.vec2(wp.static(HEAD), wp.static(WIDE)))  # the cone's normal: outwards, and ahead
    for k in range(wp.static(SIDES)):
        angle = 6.2831853 * float(k) / float(wp.static(SIDES))
        outwards = wp.cos(angle) * e1 + wp.sin(angle) * e2
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
