"""Extend solids that stand on a plane to below it, so that the nearest way out never leads into the plane."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...world import Box, Collider, Cone, Plane

LEVEL = 1e-9
"""Tolerance of the cosine between a face's normal and the plane's."""
ON = 1e-6
"""Height above a plane that still counts as on it, over the solid's size: above float32 rounding."""


def geometries(colliders: Sequence[Collider], dim: int) -> list[dict[str, Any]]:
    """Return the geometry of colliders for kernels; boxes and cones that stand on a plane are extended below it.

    A particle at the foot of a box, on the plane, is nearer to the box's underside than to its side, and would be
    pushed between box and plane. The base is moved below the plane, where no particle can be, so the free space
    stays the same, and the base is no longer the nearest face. No point of a box or cone is further than twice its
    `inradius` from all faces other than its base, so the base is moved down by that much.

    Only fixed solids and planes are treated: a moving solid may leave the plane later.
    """
    planes = [one for one in colliders if isinstance(one, Plane) and one.motion is None and not one.fits(dim)]
    found = []
    for collider in colliders:
        geometry = collider.geometry(dim)
        if collider.motion is None and isinstance(collider, Box | Cone):
            for plane in planes:
                up = plane.unit_normal(dim)
                geometry = _continued(collider, geometry, up, plane.offset)
        found.append(geometry)
    return found


def _continued(collider: Collider, geometry: dict[str, Any], up: NDArray, offset: float) -> dict[str, Any]:
    """Return the geometry of a box or a cone, with the face on a plane moved below the plane."""
    deep = 2.0 * collider.inradius()
    a, b = np.asarray(geometry["a"], dtype=np.float64), np.asarray(geometry["b"], dtype=np.float64)
    if isinstance(collider, Cone):
        height = float(np.linalg.norm(b - a))
        more = _missing(float(b @ up) - offset, float((a - b) @ up) / height, height, deep)
        if more == 0.0:
            return geometry
        scale = 1.0 + more / height  # scaled about the apex, so that the sides stay
        return geometry | {"b": a + scale * (b - a), "radius": scale * geometry["radius"]}
    for k, axis in enumerate(np.asarray(geometry["axes"]).T):
        for out in (-axis, axis):
            more = _missing(float((a + b[k] * out) @ up) - offset, float(-out @ up), float(b[k]), deep)
            if more:
                longer = b.copy()
                longer[k] += more / 2.0
                return geometry | {"a": a + more / 2.0 * out, "b": longer}
    return geometry


def _missing(height: float, level: float, size: float, deep: float) -> float:
    """Return the distance to move a face down until it is `deep` below a plane [m]; 0 if it is not on the plane.

    `height` is the face's height above the plane [m], `size` the solid's size [m], and `level` the cosine of the
    angle between the face's normal and the downward normal of the plane.
    """
    if level < 1.0 - LEVEL or height > ON * size:
        return 0.0
    return max(0.0, deep + height)
