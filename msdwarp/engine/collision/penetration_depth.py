"""Depths of particles in obstacles at the start, and the kernels' struct of obstacles."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from ...bodies import System, stored
from ...kernels.basis import vector
from ...kernels.colliders.penetration_depth import distances
from ...kernels.colliders.signed_distance import KINDS, solids
from ...world import Collider, Plane
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


def start_depths(position: NDArray[np.float64], colliders: Sequence[Collider]) -> NDArray[np.float64]:
    """Return the depths of points, shape [count, dim], in each obstacle at the start [m].

    Shape [collider_count, count]; negative outside, and −inf for soft obstacles, which particles may enter.
    """
    dim = position.shape[1]
    data: Any = solids(dim, wp.float64)()
    describe(data, colliders, dim, wp.float64, "cpu")
    found: Any = wp.zeros(len(position), dtype=wp.float64, device="cpu")
    depths = np.empty((len(colliders), len(position)))
    for k, collider in enumerate(colliders):
        if collider.stiffness is not None:
            depths[k] = -np.inf
            continue
        turn, shift = collider.pose(0.0, dim)
        places: Any = (position - shift) @ turn
        if isinstance(collider, Plane):  # without a kernel, which most scenes would compile for nothing else
            depths[k] = collider.offset - places @ collider.unit_normal(dim)
            continue
        places = wp.array(places, dtype=vector(dim, wp.float64), device="cpu")
        wp.launch(distances(dim), len(position), [data, k, places], [found], device="cpu")
        depths[k] = -found.numpy()
    return depths


def ways_out(position: NDArray[np.float64], collider: Collider) -> NDArray[np.float64]:
    """Return the shortest displacement from each point inside an obstacle to outside [m]; 0 if ambiguous."""
    depth = start_depths(position, [collider])[0]
    step = 1e-6 * max(1.0, float(np.abs(position).max()))
    steps = step * np.eye(position.shape[1])
    rise = [start_depths(position + e, [collider])[0] - start_depths(position - e, [collider])[0] for e in steps]
    return -depth[:, None] * np.stack(rise, axis=1) / (2 * step)


def touching(system: System) -> float:
    """Return the depth up to which a particle counts as touching an obstacle and not inside [m]."""
    lengths = stored(system.rest_length)
    depth = TOUCHING * float(lengths.min()) if len(lengths) else TOUCHING_ALONE
    # Positions far from the origin are rounded to this.
    return depth + 4 * float(np.finfo(np.float32).eps) * float(np.abs(system.position).max())
