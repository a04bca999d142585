"""The point of a triangle that is nearest to another point."""

import functools

import warp as wp

from ..basis import vector

FLAT = 1e-10
"""The square of the sine of an angle below which corners are on one line: float32 knows no smaller area."""


@functools.cache
def nearest_on_triangle(scalar: type):
    """Compose (p, a, b, c) -> weights of a, b and c in the point of the triangle that is nearest to p.

    Triangles may be segments (b = c) or points (a = b = c): ropes and grains are made of such.
    Reference: Ericson, Real-Time Collision Detection (2005), 5.1.5.
    """
    V = vector(3, scalar)
    zero, one, flat = scalar(0.0), scalar(1.0), scalar(FLAT)

    @wp.func
    def share(numerator: scalar, denominator: scalar) -> scalar:
        """Return numerator / denominator, clamped to 0 … 1; 0 of an edge without length."""
        if denominator <= zero:
            return zero
        return wp.clamp(numerator / denominator, zero, one)

    @wp.func
    def on_longest_edge(ap: V, ab: V, ac: V) -> V:
        """Return the weights where all corners are on one line: that of the longest edge, which holds them all."""
        bc = ac - ab
        if wp.length_sq(bc) > wp.max(wp.length_sq(ab), wp.length_sq(ac)):
            t = share(wp.dot(bc, ap - ab), wp.length_sq(bc))
            return V(zero, one - t, t)
        if wp.length_sq(ac) > wp.length_sq(ab):
            t = share(wp.dot(ac, ap), wp.length_sq(ac))
            return V(one - t, zero, t)
        t = share(wp.dot(ab, ap), wp.length_sq(ab))
        return V(one - t, t, zero)

    @wp.func
    def nearest(p: V, a: V, b: V, c: V) -> V:
        ab = b - a
        ac = c - a
        ap = p - a
        if wp.length_sq(wp.cross(ab, ac)) <= flat * wp.length_sq(ab) * wp.length_sq(ac):
            return on_longest_edge(ap, ab, ac)
        d1 = wp.dot(ab, ap)
        d2 = wp.dot(ac, ap)
        if d1 <= zero and d2 <= zero:
            return V(one, zero, zero)
        bp = p - b
        d3 = wp.dot(ab, bp)
        d4 = wp.dot(ac, bp)
        if d3 >= zero and d4 <= d3:
            return V(zero, one, zero)
        vc = d1 * d4 - d3 * d2
        if vc <= zero and d1 >= zero and d3 <= zero:
            t = share(d1, d1 - d3)
            return V(one - t, t, zero)
        cp = p - c
        d5 = wp.dot(ab, cp)
        d6 = wp.dot(ac, cp)
        if d6 >= zero and d5 <= d6:
            return V(zero, zero, one)
        vb = d5 * d2 - d1 * d6
        if vb <= zero and d2 >= zero and d6 <= zero:
            t = share(d2, d2 - d6)
            return V(one - t, zero, t)
        va = d3 * d6 - d5 * d4
        if va <= zero and d4 - d3 >= zero and d5 - d6 >= zero:
            t = share(d4 - d3, (d4 - d3) + (d5 - d6))
            return V(zero, one - t, t)
        total = va + vb + vc
        if total <= zero:
            return V(one, zero, zero)
        return V(va / total, vb / total, vc / total)

    return nearest
