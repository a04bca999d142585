"""Sheets near obstacles: flat triangles that cut their corners are bent around them (float32, in 3D)."""

import warp as wp

from ..basis import kernel
from ..colliders.signed_distance import KINDS, signed_distance, solids

Solids = solids(3, wp.float32)
distance_from = signed_distance(3, wp.float32, KINDS)
STEPS = 12
"""Steps that move a point outwards; the last three go the shortest way, if the others did not suffice."""
BULGE = wp.constant(0.5)
"""Additional distance from an obstacle, as a fraction of a point's depth in it: bends become round, so that pieces
of the sheet do not cut the edge that they bend around."""


@wp.func
def way_out(s: Solids, p: int, x: wp.vec3) -> wp.vec3:
    """Return the outward normal of a solid at x."""
    r = distance_from(s, p, x)
    return wp.vec3(r[0], r[1], r[2])


@wp.func
def outside(s: Solids, p: int, gap: float, x: wp.vec3, a: wp.vec3, b: wp.vec3, c: wp.vec3, weights: wp.vec3):
    """Return a point x of the triangle a, b, c, moved out of a solid, so that it keeps `gap` from it [m].

    Points further than 2 `gap` stay. Of two points on top of each other the upper one stays the upper one.
    """
    before = distance_from(s, p, x)[3]
    if before >= 2.0 * gap:
        return x
    wanted = gap + 0.5 * before
    if before < 0.0:
        wanted = gap - BULGE * before
    # From inside, the nearest side may be wrong. The corners are outside, and show the right side.
    ahead = weights[0] * way_out(s, p, a) + weights[1] * way_out(s, p, b) + weights[2] * way_out(s, p, c)
    steps = wp.static(STEPS)
    if wp.length(ahead) < 0.1:
        steps = 3
    ahead = wp.normalize(ahead)
    for k in range(steps):
        r = distance_from(s, p, x)
        if k >= steps - 3:
            ahead = wp.vec3(r[0], r[1], r[2])
        x += wp.max(wanted - r[3], 0.0) * ahead  # never too far: a distance grows by at most the step
    return x


@kernel
def bend(
    points: wp.array(dtype=wp.vec3),  # of the flat triangles [m], shape [vertex_count]
    normals: wp.array(dtype=wp.vec3),  # of unit length, shape [vertex_count]
    corners: wp.array(dtype=wp.vec3i),  # the triangle that each fine vertex is in, shape [fine_count]
    weights: wp.array(dtype=wp.vec3),  # its barycentric coordinates there, shape [fine_count]
    free: wp.array(dtype=float),  # 0 where particles are pinned, such as into a frame, else 1, shape [fine_count]
    s: Solids,
    turn: wp.array(dtype=wp.mat33),  # poses of the solids, shape [solid_count]
    shift: wp.array(dtype=wp.vec3),  # [m], shape [solid_count]
    gap: float,  # [m]
    # Out, of shape [fine_count]:
    fine_points: wp.array(dtype=wp.vec3),  # [m]
    fine_normals: wp.array(dtype=wp.vec3),  # of unit length
):
    """Place vertices within flat triangles, and move them out of the solids."""
    i = wp.tid()
    a = points[corners[i][0]]
    b = points[corners[i][1]]
    c = points[corners[i][2]]
    x = weights[i][0] * a + weights[i][1] * b + weights[i][2] * c
    for p in range(s.kind.shape[0]):
        back = wp.transpose(turn[p])
        o = shift[p]
        y = back * (x - o)
        moved = outside(s, p, gap, y, back * (a - o), back * (b - o), back * (c - o), weights[i])
        x += free[i] * (turn[p] * (moved - y))
    fine_points[i] = x
    normal = wp.vec3()
    for k in range(3):
        normal += weights[i][k] * normals[corners[i][k]]
    fine_normals[i] = wp.normalize(normal)
