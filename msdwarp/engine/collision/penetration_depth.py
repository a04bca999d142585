"""Depths of particles in obstacles at the start, and the kernels' struct of obstacles."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from ...bodies import System, stored
from ...kernels.basis import vector
from ...kernels.colliders.signed_distance import KINDS
from ...world import Box, Capsule, Collider, Plane, Sphere
from .extended_solids import geometries

TOUCHING = 0.01
"""Depth that counts as touching, over the shortest rest length: the strain from moving a particle out."""
TOUCHING_ALONE = 1e-3
"""TOUCHING without connections [m]: about the fall of a particle from rest in a frame."""


def describe(data: Any, colliders: Sequence[Collider], dim: int, scalar: Any, device: Any) -> None:
    """Fill the struct of solids that `msdwarp.kernels.colliders.signed_distance` reads."""
    nothing = {"a": np.zeros(dim), "b": np.zeros(dim), "radius": 0.0, "axes": np.eye(dim)}
    geometry = [nothing | one for one in geometries(colliders, dim)]
    place, turn = vector(dim, scalar), wp.types.matrix((dim, dim), scalar)
    types = {"a": place, "b": place, "radius": scalar, "axes": turn}
    for name, dtype in types.items():
        values = np.array([one[name] for one in geometry], dtype=np.float64)
        setattr(data, name, wp.array(values, dtype=dtype, device=device))
    data.kind = wp.array([KINDS.index(type(one).__name__) for one in colliders], dtype=int, device=device)


def start_depths(
    position: NDArray[np.float64], colliders: Sequence[Collider], radius: Any = 0.0
) -> NDArray[np.float64]:
    """Return the depths of balls around points, shape [count, dim], in each obstacle at the start [m].

    Shape [collider_count, count]; negative outside, and −inf for soft obstacles, which particles may enter. The
    balls have a `radius` [m], or one each.
    """
    dim = position.shape[1]
    depths = np.full((len(colliders), len(position)), -np.inf)
    for k, (collider, geometry) in enumerate(zip(colliders, geometries(colliders, dim), strict=True)):
        if collider.stiffness is None:
            turn, shift = collider.pose(0.0, dim)
            depths[k] = radius - _distances(collider, geometry, (position - shift) @ turn)
    return depths


def _distances(collider: Collider, geometry: Mapping[str, Any], x: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the signed distances of points x from a solid, as `msdwarp.kernels.colliders.signed_distance` does.

    It is computed on the host, since most scenes need it only once, and would compile the kernel for it.
    """
    radius = geometry.get("radius", 0.0)
    if isinstance(collider, Plane):
        return x @ geometry["a"] - radius
    x = x - geometry["a"]
    if isinstance(collider, Box):
        past = np.abs(x @ geometry["axes"]) - geometry["b"]
        return np.minimum(past.max(axis=1), 0.0) + np.linalg.norm(np.maximum(past, 0.0), axis=1)
    if isinstance(collider, Sphere):
        return np.linalg.norm(x, axis=1) - radius
    line = np.subtract(geometry["b"], geometry["a"])
    length = float(np.linalg.norm(line))
    along = x @ (line / length)
    if isinstance(collider, Capsule):
        nearest = np.clip(along / length, 0.0, 1.0)[:, None] * line
        return np.linalg.norm(x - nearest, axis=1) - radius
    # In the half-plane (off, along) a cone is a triangle: (0, 0), (radius, length), (0, length).
    off = np.linalg.norm(x - along[:, None] * line / length, axis=1)
    slope = np.hypot(radius, length)
    side, end = (off * length - along * radius) / slope, along - length
    t = np.clip((off * radius + along * length) / slope**2, 0.0, 1.0)
    outside = np.minimum(
        np.hypot(off - t * radius, along - t * length), np.hypot(off - np.minimum(off, radius), end)
    )
    return np.where((side <= 0.0) & (end <= 0.0), np.maximum(side, end), outside)


def ways_out(position: NDArray[np.float64], collider: Collider, radius: Any = 0.0) -> NDArray[np.float64]:
    """Return the shortest displacement from each ball inside an obstacle to outside [m]; 0 if ambiguous."""
    return start_depths(position, [collider], radius)[0][:, None] * outward_normals(position, collider)


def outward_normals(position: NDArray[np.float64], collider: Collider) -> NDArray[np.float64]:
    """Return the unit vector of the shortest way out of an obstacle at each point; 0 if ambiguous."""
    step = 1e-6 * max(1.0, float(np.abs(position).max()))
    steps = step * np.eye(position.shape[1])
    rise = [start_depths(position + e, [collider])[0] - start_depths(position - e, [collider])[0] for e in steps]
    return -np.stack(rise, axis=1) / (2 * step)


def touching(system: System) -> float:
    """Return the depth up to which a particle counts as touching an obstacle and not inside [m]."""
    lengths = stored(system.rest_length)
    depth = TOUCHING * float(lengths.min()) if len(lengths) else TOUCHING_ALONE
    # Positions far from the origin are rounded to this.
    return depth + 4 * float(np.finfo(np.float32).eps) * float(np.abs(system.position).max())
