"""Signed distances of points from solids, negative inside, and outward directions.

`collide.py` and `contact_rule.py` have the response of particles.
"""

import functools

import warp as wp

from ..basis import vector

KINDS = ("Plane", "Sphere", "Box", "Capsule", "Cone")
"""The kinds of solids: names of classes in `msdwarp.world.colliders`."""
PLANE, SPHERE, BOX, CAPSULE, CONE = range(len(KINDS))
"""Indices of the kinds in KINDS, as in `Solids.kind`."""


@functools.cache
def solids(dim: int, scalar: type):
    """Compose the struct that has the shapes of solids.

    Plane: normal a, offset `radius`. Sphere: centre a, `radius`. Box: centre a, half edge lengths b along the
    columns of `axes`. Capsule: from a to b, `radius`. Cone: apex a, centre b and `radius` of the base.
    With particles that have a radius, all solids are larger by `margin`.
    """
    V, Axes = vector(dim, scalar), wp.types.matrix((dim, dim), scalar)

    @wp.struct
    class Solids:
        # Each of shape [solid_count]:
        kind: wp.array(dtype=int)  # index in KINDS
        a: wp.array(dtype=V)  # [m]; for a plane the unit normal
        b: wp.array(dtype=V)  # [m]
        radius: wp.array(dtype=scalar)  # [m]
        axes: wp.array(dtype=Axes)  # orthonormal
        margin: scalar  # radius of the current particle [m]

    return Solids


@functools.cache
def signed_distance(dim: int, scalar: type, kinds: tuple[str, ...], round_particles: bool = False):
    """Compose `distance(solids, p, x)` for solids of these kinds: (n, signed distance of x from solid p [m]).

    The result vector has the outward unit normal n = grad of the distance, then the distance. Distances are
    exact inside and outside. Derivations: Quilez, Distance functions, iquilezles.org/articles/distfunctions.
    For `round_particles` it is that from all points within `margin` of the solid, also a convex body, and exact.
    """
    V, Solids = vector(dim, scalar), solids(dim, scalar)
    Result = wp.types.vector(dim + 1, scalar)
    zero, one = wp.constant(scalar(0.0)), wp.constant(scalar(1.0))
    several = len(kinds) > 1

    @wp.func
    def result(normal: V, distance: scalar) -> Result:
        r = Result()
        for k in range(wp.static(dim)):
            r[k] = normal[k]
        r[wp.static(dim)] = distance
        return r

    @wp.func
    def from_point(x: V, nearest: V, radius: scalar) -> Result:
        """Return the outward normal of a ball around `nearest` (up at its centre), and x's signed distance."""
        away = x - nearest
        length = wp.length(away)
        normal = V()
        normal[wp.static(dim - 1)] = one
        if length > zero:
            normal = away / length
        return result(normal, length - radius)

    @wp.func
    def plane(s: Solids, p: int, x: V) -> Result:
        normal = s.a[p]
        return result(normal, wp.dot(x, normal) - s.radius[p])

    @wp.func
    def sphere(s: Solids, p: int, x: V) -> Result:
        return from_point(x, s.a[p], s.radius[p])

    @wp.func
    def capsule(s: Solids, p: int, x: V) -> Result:
        line = s.b[p] - s.a[p]
        t = wp.clamp(wp.dot(x - s.a[p], line) / wp.dot(line, line), zero, one)
        return from_point(x, s.a[p] + t * line, s.radius[p])

    @wp.func
    def box(s: Solids, p: int, x: V) -> Result:
        axes = s.axes[p]
        q = wp.transpose(axes) * (x - s.a[p])
        # Inside, the nearest face decides; outside, the nearest point is on a face, an edge or a corner.
        depth = scalar(-1.0e30)
        normal = V()
        beyond = V()
        for k in range(wp.static(dim)):
            side = wp.where(q[k] < zero, -one, one)
            past = wp.abs(q[k]) - s.b[p][k]
            if past > depth:
                depth = past
                normal = V()
                normal[k] = side
            beyond[k] = side * wp.max(past, zero)
        if depth > zero:
            depth = wp.length(beyond)
            normal = beyond / depth
        return result(axes * normal, depth)

    @wp.func
    def cone(s: Solids, p: int, x: V) -> Result:
        axis = s.b[p] - s.a[p]
        height = wp.length(axis)
        axis = axis / height
        along = wp.dot(x - s.a[p], axis)
        outward = x - s.a[p] - along * axis
        off = wp.length(outward)
        if off > zero:
            outward = outward / off
        else:  # on the axis any perpendicular direction will do
            least = int(0)
            for k in range(wp.static(dim)):
                if wp.abs(axis[k]) < wp.abs(axis[least]):
                    least = k
            outward[least] = one
            outward = wp.normalize(outward - axis[least] * axis)
        # In the half-plane (off, along) the cone is a triangle: (0, 0), (radius, height), (0, height).
        r = s.radius[p]
        slope = wp.sqrt(r * r + height * height)
        side = (off * height - along * r) / slope
        end = along - height
        if side <= zero and end <= zero:
            if side > end:
                return result((height * outward - r * axis) / slope, side)
            return result(axis, end)
        t = wp.clamp((off * r + along * height) / (slope * slope), zero, one)
        to_side = (off - t * r) * outward + (along - t * height) * axis
        if t > zero and t < one:  # the same vector, with less rounding error in direction
            to_side = side / slope * (height * outward - r * axis)
        to_end = (off - wp.min(off, r)) * outward + end * axis
        if wp.length_sq(to_end) < wp.length_sq(to_side):
            to_side = to_end
        return result(wp.normalize(to_side), wp.length(to_side))

    shapes = {"Plane": plane, "Sphere": sphere, "Box": box, "Capsule": capsule, "Cone": cone}
    if round_particles:
        distance_from = signed_distance(dim, scalar, kinds)

        @wp.func
        def round_distance(s: Solids, p: int, x: V) -> Result:
            found = distance_from(s, p, x)
            found[wp.static(dim)] = found[wp.static(dim)] - s.margin
            return found

        return round_distance
    if not several:
        return shapes[kinds[0]]

    @wp.func
    def distance(s: Solids, p: int, x: V) -> Result:
        kind = s.kind[p]
        if wp.static("Sphere" in kinds):
            if kind == wp.static(SPHERE):
                return sphere(s, p, x)
        if wp.static("Box" in kinds):
            if kind == wp.static(BOX):
                return box(s, p, x)
        if wp.static("Capsule" in kinds):
            if kind == wp.static(CAPSULE):
                return capsule(s, p, x)
        if wp.static("Cone" in kinds):
            if kind == wp.static(CONE):
                return cone(s, p, x)
        return plane(s, p, x)

    return distance
