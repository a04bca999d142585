"""Solids that stand on a plane, continued below it: so that the way out is never down into the plane."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...world import Box, Collider, Cone, Plane

LEVEL = 1e-9
"""How far the cosine of a face's direction may be from that of the plane that it stands on."""
ON = 1e-6
"""The height above a plane that still counts as on it, by the size of the solid: more than float32 rounds."""


def geometries(colliders: Sequence[Collider], dim: int) -> list[dict[str, Any]]:
    """Return the geometry of colliders for kernels; boxes and cones that stand on a plane are continued below it.

    A particle at the foot of a box, on the plane, is nearer to the box's underside than to its side, and would be
    let in between the two. What is added lies below the plane, where all is inside anyway: together both keep the
    same places free, and the nearest way out of the box leads to where none of them is. No place in a box or a
    cone is further than twice its `inradius` from all faces but the one it stands on: so deep that one is put.

    Only solids and planes that stand still: a moving one may leave the plane later.
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
    """Return the geometry of a box or a cone, with the face that stands on a plane moved below it."""
    deep = 2.0 * collider.inradius()
    a, b = np.asarray(geometry["a"], dtype=np.float64), np.asarray(geometry["b"], dtype=np.float64)
    if isinstance(collider, Cone):
        height = float(np.linalg.norm(b - a))
        more = _missing(float(b @ up) - offset, float((a - b) @ up) / height, height, deep)
        if more == 0.0:
            return geometry
        share = 1.0 + more / height  # about the apex, which leaves the sides where they are
        return geometry | {"b": a + share * (b - a), "radius": share * geometry["radius"]}
    for k, axis in enumerate(np.asarray(geometry["axes"]).T):
        for out in (-axis, axis):
            more = _missing(float((a + b[k] * out) @ up) - offset, float(-out @ up), float(b[k]), deep)
            if more:
                longer = b.copy()
                longer[k] += more / 2.0
                return geometry | {"a": a + more / 2.0 * out, "b": longer}
    return geometry


def _missing(height: float, level: float, size: float, deep: float) -> float:
    """Return by how much to move a face down to have it `deep` below a plane [m]; 0 where it is not on that.

    The face is so high above the plane, on a solid of a size [m]; `level` is the cosine of the angle between its
    normal and that down into the plane.
    """
    if level < 1.0 - LEVEL or height > ON * size:
        return 0.0
    return max(0.0, deep + height)
