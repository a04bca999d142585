"""On which side of a sheet a point is, which it remembers: what has come through a sheet is pushed back.

As long as a point touches a sheet, it is known which facet it touches (`contact_side`), and whether it came from
the side of its normal or from behind. Where it slides on, the facet has a corner in common with the one before:
what is further off is another layer of the sheet. A point that is suddenly on the other side has come through. The
sign of its distance then stays, so that the law pushes it back, until it is deeper than half of the sheet's
spacing. It is forgotten where the point lets go of the sheet, and where it may go around its border: there the
sheet is seen from its edge.
Reference: Baraff, Witkin, Kass, Untangling cloth, SIGGRAPH 2003, on what such a memory can do and what not.
"""

import functools

import warp as wp

from ..basis import vector
from .contact_data import HISTORY

STEEP = 0.25
"""The square of the cosine of the angle to the normal within which a place is above a facet, not beside it."""


@functools.cache
def meets():
    """Compose (corner, one, other) -> whether two facets have a corner in common."""

    @wp.func
    def have_common(corner: wp.array(dtype=wp.vec3i), one: int, other: int) -> bool:
        a = corner[one]
        b = corner[other]
        found = bool(False)
        for k in range(3):
            found = found or a[k] == b[0] or a[k] == b[1] or a[k] == b[2]
        return found

    return have_common


@functools.cache
def remembered(scalar: type):
    """Compose (partner, seen, slip, p, other, held) -> the slip of a point p on a body, by the facet that is held.

    It is 0 where it did not touch before.
    """
    V = vector(3, scalar)

    @wp.func
    def slip_on(
        contact_body: wp.array2d(dtype=int),
        seen: wp.array2d(dtype=int),
        tangential_displacement: wp.array2d(dtype=V),
        p: int,
        other: int,
        held: int,
    ) -> V:
        kept = V()
        for k in range(wp.static(HISTORY)):
            if contact_body[k, p] == other and seen[k, p] == held:
                kept = tangential_displacement[k, p]
        return kept

    return slip_on
