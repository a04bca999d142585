"""Nearest points of a triangle and a point, of two segments, and of the two sides of a near pair."""

import functools

import warp as wp

from ..basis import vector

FLAT = 1e-10
"""Squared sine of an angle below which corners count as collinear: float32 resolves no smaller area."""


@functools.cache
def fraction_of_length(scalar: type):
    """Compose (numerator, denominator) -> their quotient, clamped to 0 … 1; 0 if the denominator is 0."""
    zero, one = scalar(0.0), scalar(1.0)

    @wp.func
    def fraction(numerator: scalar, denominator: scalar) -> scalar:
        if denominator <= zero:
            return zero
        return wp.clamp(numerator / denominator, zero, one)

    return fraction


@functools.cache
def nearest_on_triangle(scalar: type):
    """Compose (p, a, b, c) -> barycentric weights of the point of a triangle that is nearest to p.

    Triangles may be segments (b = c) or points (a = b = c), as for ropes and grains.
    Reference: Ericson, Real-Time Collision Detection (2005), 5.1.5.
    """
    V, fraction = vector(3, scalar), fraction_of_length(scalar)
    zero, one, flat = scalar(0.0), scalar(1.0), scalar(FLAT)

    @wp.func
    def on_longest_edge(ap: V, ab: V, ac: V) -> V:
        """Return the weights for collinear corners: the nearest point is on the longest edge."""
        bc = ac - ab
        if wp.length_sq(bc) > wp.max(wp.length_sq(ab), wp.length_sq(ac)):
            t = fraction(wp.dot(bc, ap - ab), wp.length_sq(bc))
            return V(zero, one - t, t)
        if wp.length_sq(ac) > wp.length_sq(ab):
            t = fraction(wp.dot(ac, ap), wp.length_sq(ac))
            return V(one - t, zero, t)
        t = fraction(wp.dot(ab, ap), wp.length_sq(ab))
        return V(one - t, t, zero)

    @wp.func
    def nearest(p: V, a: V, b: V, c: V) -> V:
        ab = b - a
        ac = c - a
        ap = p - a
        if wp.length_sq(wp.cross(ab, ac)) <= flat * wp.length_sq(ab) * wp.length_sq(ac):
            return on_longest_edge(ap, ab, ac)
        bp = p - b
        cp = p - c
        d1 = wp.dot(ab, ap)
        d2 = wp.dot(ac, ap)
        d3 = wp.dot(ab, bp)
        d4 = wp.dot(ac, bp)
        d5 = wp.dot(ab, cp)
        d6 = wp.dot(ac, cp)
        # Weights up to a factor. If p is in several regions around the triangle, the last one below counts.
        u = d3 * d6 - d5 * d4
        v = d5 * d2 - d1 * d6
        w = d1 * d4 - d3 * d2
        beside_ab = w <= zero and d1 >= zero and d3 <= zero
        beside_ac = v <= zero and d2 >= zero and d6 <= zero
        beside_bc = u <= zero and d4 >= d3 and d5 >= d6
        if beside_bc:
            u, v, w = zero, d5 - d6, d4 - d3
        if beside_ac:
            u, v, w = -d6, zero, d2
        if d6 >= zero and d5 <= d6:
            u, v, w = zero, zero, one
        if beside_ab:
            u, v, w = -d3, d1, zero
        if d3 >= zero and d4 <= d3:
            u, v, w = zero, one, zero
        if (d1 <= zero and d2 <= zero) or u + v + w <= zero:
            u, v, w = one, zero, zero
        by = one / (u + v + w)
        return V(by * u, by * v, by * w)

    return nearest


@functools.cache
def nearest_on_segments(scalar: type):
    """Compose (a, b, c, d) -> the weights of b and d in the nearest points of segments a b and c d.

    Segments may be points.
    Reference: Ericson, Real-Time Collision Detection (2005), 5.1.9.
    """
    V, Weights, fraction = vector(3, scalar), wp.types.vector(2, scalar), fraction_of_length(scalar)
    zero, one, flat = scalar(0.0), scalar(1.0), scalar(FLAT)

    @wp.func
    def nearest(a: V, b: V, c: V, d: V) -> Weights:
        ab = b - a
        cd = d - c
        ca = a - c
        length = wp.length_sq(ab)
        other_length = wp.length_sq(cd)
        along = wp.dot(ab, cd)
        p = wp.dot(ab, ca)
        q = wp.dot(cd, ca)
        area = length * other_length - along * along
        s = zero
        if area > flat * length * other_length:
            s = fraction(along * q - p * other_length, area)
        t = zero
        if other_length > zero:
            t = (along * s + q) / other_length
        if t <= zero:
            t = zero
            s = fraction(-p, length)
        elif t >= one:
            t = one
            s = fraction(along - p, length)
        return Weights(s, t)

    return nearest


@functools.cache
def shortest_line(scalar: type):
    """Compose (b, c, d, edges) -> (weights, away), for a near pair: a vertex a and a triangle bcd, or two edges.

    With `edges` the sides of the pair are ab and cd. Positions are relative to a. `away` [m] is the shortest line
    from the second side to the first, and `weights` are those of the four vertices in it.
    """
    V, W, one = vector(3, scalar), wp.types.vector(4, scalar), scalar(1.0)
    on_triangle, on_segments = nearest_on_triangle(scalar), nearest_on_segments(scalar)

    @wp.func
    def shortest(b: V, c: V, d: V, edges: bool):
        weights = W()
        away = V()
        if edges:
            found = on_segments(V(), b, c, d)
            s = found[0]
            t = found[1]
            weights = W(one - s, s, t - one, -t)
            away = s * b - (one - t) * c - t * d
        else:
            on = on_triangle(V(), b, c, d)
            weights = W(one, -on[0], -on[1], -on[2])
            away = -(on[0] * b + on[1] * c + on[2] * d)
        return weights, away

    return shortest
