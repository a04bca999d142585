"""What a contact adds to the forces on vertices: whole numbers of a unit, whose sums depend on no order."""

import functools

import warp as wp

from ..basis import vector


@functools.cache
def exert_force(scalar: type, lanes: int):
    """Compose (force, ends, s, corner, w, f, per_unit, lane): add f [N] to a point, and the opposite to a facet.

    The point lies between the vertices `ends`, with the share s of the second, and touches the facet where its
    corners have the weights w. What they get is exactly what the point gets, in units of 1 / per_unit [N].
    """
    V = vector(3, scalar)

    @wp.func
    def part(total: wp.int64, share: scalar) -> wp.int64:
        return wp.int64(wp.float64(total) * wp.float64(share))

    @wp.func
    def exert(
        force: wp.array2d(dtype=wp.int64),
        ends: wp.vec2i,
        s: scalar,
        corner: wp.vec3i,
        w: V,
        f: V,
        per_unit: wp.float64,  # [1/N]
        lane: int,
    ):
        """Add force f to a point, and the opposite to a facet; each thread of the point takes some coordinates."""
        for k in range(lane, 3, wp.static(lanes)):
            total = wp.int64(wp.float64(f[k]) * per_unit)
            if ends[0] == ends[1]:
                wp.atomic_add(force, ends[0], k, total)
            else:
                second = part(total, s)
                wp.atomic_add(force, ends[1], k, second)
                wp.atomic_add(force, ends[0], k, total - second)
            on_1 = part(total, w[1])
            on_2 = part(total, w[2])
            wp.atomic_add(force, corner[1], k, -on_1)
            wp.atomic_add(force, corner[2], k, -on_2)
            wp.atomic_add(force, corner[0], k, on_1 + on_2 - total)

    return exert
