"""Numbering: which numbers particles have, and so how near neighbours lie in memory."""

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import checks
from .fields import CONNECTION_FIELDS, PARTICLE_FIELDS
from .surface import Surface
from .uniform import is_uniform

if TYPE_CHECKING:
    from .system import System

SECOND = "second neighbours"
"""The direction that connections to second neighbours are in where particles have been numbered anew."""
BITS = 62
"""Bits of a place along the curve, shared by the coordinates."""


def space_filling_order(position: ArrayLike) -> NDArray[np.int64]:
    """Return the order of points along a space-filling curve: near points are usually near in this order.

    It is the Z-order: points are sorted by the interleaved bits of their coordinates.

    Parameters
    ----------
    position
        Points [m], shape [count, d] with d = 1, 2 or 3.

    Returns
    -------
    order
        The number of the kth point, shape [count].

    Raises
    ------
    ValueError
        If `position` has the wrong shape or is not finite.
    """
    x = np.asarray(position, dtype=np.float64)
    if x.ndim != 2 or x.shape[1] not in (1, 2, 3) or not np.isfinite(x).all():
        raise ValueError(
            f"position has shape {x.shape}; it must be finite, in the shape (count, d) with d = 1, 2, 3"
        )
    if len(x) == 0:
        return np.zeros(0, dtype=np.int64)
    return np.argsort(places_along_curve(x, min(BITS // x.shape[1], 31)), kind="stable")


def places_along_curve(points: NDArray[np.floating], bits: int) -> NDArray[np.int64]:
    """Return where points of shape [count, d] come along the curve, 2^bits cells to each axis, shape [count].

    Reference: Morton, A computer oriented geodetic data base (1966).
    """
    dim, lowest, extent = points.shape[1], points.min(axis=0), np.ptp(points, axis=0).max()
    cells = ((points - lowest) * ((2**bits - 1) / max(extent, 1e-30))).astype(np.int64)
    place = np.zeros(len(points), dtype=np.int64)
    for bit in range(bits):
        for axis in range(dim):
            place |= (cells[:, axis] >> bit & 1) << (dim * bit + axis)
    return place


def renumbered(system: "System", order: ArrayLike | None) -> dict[str, Any]:
    """Return the fields of a system whose particle k was number order[k]; see `System.renumbered`."""
    n = system.particle_count
    chosen = space_filling_order(system.position) if order is None else np.asarray(order)
    if chosen.shape != (n,) or chosen.dtype.kind not in "iu" or not np.array_equal(np.sort(chosen), np.arange(n)):
        raise ValueError(f"order is {checks.repr_short(order)}; it must have each number from 0 to {n - 1} once")
    number = np.empty(n, dtype=np.int32)
    number[chosen] = np.arange(n, dtype=np.int32)
    connections = number[system.connections]
    ends = np.sort(connections, axis=1)
    near = system.between_neighbours
    second = np.zeros(len(ends), dtype=bool) if near is None else ~near
    of_connections = np.lexsort((ends[:, 1], ends[:, 0], second))
    fields: dict[str, Any] = {"connections": connections[of_connections], "damper": system.damper}
    if near is not None:  # they are of other lengths, and far softer
        fields["directions"] = ({SECOND: slice(int(near.sum()), len(ends))},)
    for names, where in ((PARTICLE_FIELDS, chosen), (CONNECTION_FIELDS, of_connections)):
        for name in names:
            values = getattr(system, name)
            fields[name] = values if is_uniform(values) else values[where]
    if system.original_length is system.rest_length:
        fields["original_length"] = fields["rest_length"]
    surface = system.surface
    if surface is not None:
        kept = {name: getattr(surface, name) for name in ("weights", "uv", "triangles", "normal_of")}
        fields["surface"] = Surface(particle=number[surface.particle], **kept)
    fields["groups"] = {name: np.sort(number[group]) for name, group in system.groups.items()}
    return fields
