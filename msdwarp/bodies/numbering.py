"""Numbering: reorder a system's particles, and concatenate two systems."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import checks
from .fields import CONNECTION_FIELDS, PARTICLE_FIELDS
from .regions import LawKinds, joined_laws
from .uniform import is_uniform, joined

_SECOND = "second neighbours"
"""Direction name of connections to second neighbours in a renumbered system."""
_BITS = 62
"""Bits of an index along the curve, divided equally among the coordinates."""


def space_filling_order(position: ArrayLike) -> NDArray[np.int64]:
    """Return the order of points along a space-filling curve, on which near points are usually near each other.

    The curve is the Z-order: points are sorted by the interleaved bits of their coordinates.

    Parameters
    ----------
    position
        Points [m], shape [count, d] with d = 1, 2 or 3.

    Returns
    -------
    order
        Index of the kth point along the curve, shape [count].
    """
    x = checks.array("position", position)
    if x.ndim != 2 or x.shape[1] not in (1, 2, 3) or not np.isfinite(x).all():
        raise ValueError(
            f"position has shape {x.shape}; it must be finite, in the shape (count, d) with d = 1, 2, 3"
        )
    if len(x) == 0:
        return np.zeros(0, dtype=np.int64)
    return np.argsort(places_along_curve(x, min(_BITS // x.shape[1], 31)), kind="stable")


def places_along_curve(points: NDArray[np.floating], bits: int) -> NDArray[np.int64]:
    """Return the indices of points, shape [count, d], along the curve, with 2^bits cells per axis; shape [count].

    Reference: Morton, A computer oriented geodetic data base (1966).
    """
    dim, lowest, extent = points.shape[1], points.min(axis=0), np.ptp(points, axis=0).max()
    cells = ((points - lowest) * ((2**bits - 1) / max(extent, 1e-30))).astype(np.int64)
    place = np.zeros(len(points), dtype=np.int64)
    for bit in range(bits):
        for axis in range(dim):
            place |= (cells[:, axis] >> bit & 1) << (dim * bit + axis)
    return place


def between_neighbors(directions: Sequence[Mapping[str, slice]], count: int) -> NDArray[np.bool_] | None:
    """Return a mask of `count` connections, False for those between second neighbours; None if all are True."""
    named = [(name, part) for body in directions for name, part in body.items()]
    second = [part for name, part in named if re.fullmatch(f"([+-]?2[xyz])+|{_SECOND}", name)]
    found = np.ones(count, dtype=bool)
    for part in second:
        found[part] = False
    return found if second else None


def renumbered(fields: Mapping[str, Any], order: ArrayLike | None) -> dict[str, Any]:
    """Return the fields of a system in which particle k is the former order[k]; see `System.renumbered`."""
    n = len(fields["position"])
    chosen = space_filling_order(fields["position"]) if order is None else np.asarray(order)
    if chosen.shape != (n,) or chosen.dtype.kind not in "iu" or not np.array_equal(np.sort(chosen), np.arange(n)):
        raise ValueError(f"order is {checks.repr_short(order)}; it must have each number from 0 to {n - 1} once")
    number = np.empty(n, dtype=np.int32)
    number[chosen] = np.arange(n, dtype=np.int32)
    connections = number[fields["connections"]]
    ends = np.sort(connections, axis=1)
    near = between_neighbors(fields["directions"], len(ends))
    second = np.zeros(len(ends), dtype=bool) if near is None else ~near
    of_connections = np.lexsort((ends[:, 1], ends[:, 0], second))
    result: dict[str, Any] = {"connections": connections[of_connections]}
    for name in ("damper", "spring"):
        law = fields[name]
        result[name] = law.ordered(of_connections) if isinstance(law, LawKinds) else law
    if near is not None:  # springs to second neighbours differ in length, and are far softer
        result["directions"] = ({_SECOND: slice(int(near.sum()), len(ends))},)
    for names, where in ((PARTICLE_FIELDS, chosen), (CONNECTION_FIELDS, of_connections)):
        for name in names:
            values = fields[name]
            result[name] = values if is_uniform(values) else values[where]
    if fields["original_length"] is fields["rest_length"]:
        result["original_length"] = result["rest_length"]
    if (surface := fields["surface"]) is not None:
        result["surface"] = replace(surface, particle=number[surface.particle])
    for name in ("cells", "angles"):
        if fields[name] is not None:
            result[name] = fields[name].renumbered(number)
    result["groups"] = {name: np.sort(number[group]) for name, group in fields["groups"].items()}
    return result


def concatenated(one: Mapping[str, Any], other: Mapping[str, Any]) -> dict[str, Any]:
    """Return the fields of two systems as one; the particles and connections of `other` come second.

    Raises ValueError if the systems differ in the number of coordinates, or in a law that is not built-in.
    """
    n, c = len(one["position"]), len(one["connections"])
    dims = [each["position"].shape[1] for each in (one, other)]
    if dims[0] != dims[1]:
        raise ValueError(f"cannot add a system of {dims[1]} coordinates to one of {dims[0]}")
    result = {name: joined(one[name], other[name]) for name in (*PARTICLE_FIELDS, *CONNECTION_FIELDS)}
    for name, of in (("damper", "damping"), ("spring", "stiffness")):  # what there is none of has no law
        used = tuple(each[of].any() if of == "damping" else len(each[of]) for each in (one, other))
        result[name] = joined_laws(one[name], c, other[name], len(other["connections"]), used)
    if all(each["original_length"] is each["rest_length"] for each in (one, other)):
        result["original_length"] = result["rest_length"]
    groups = dict(one["groups"])
    for name, particles in other["groups"].items():
        groups[name] = np.concatenate([groups.get(name, particles[:0]), particles + np.int32(n)])
    shifted = tuple(
        {name: slice(part.start + c, part.stop + c) for name, part in body.items()} for body in other["directions"]
    )
    for name in ("surface", "cells", "angles"):
        result[name] = one[name] if other[name] is None else other[name].behind(one[name], n)
    return result | {
        "connections": np.concatenate([one["connections"], other["connections"] + np.int32(n)]),
        "directions": one["directions"] + shifted,
        "groups": groups,
    }
