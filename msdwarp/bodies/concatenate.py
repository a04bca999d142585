"""Both: two systems as one."""

from typing import TYPE_CHECKING, Any

import numpy as np

from .fields import CONNECTION_FIELDS, PARTICLE_FIELDS
from .uniform import joined

if TYPE_CHECKING:
    from .system import System


def both(one: "System", other: "System") -> dict[str, Any]:
    """Return the fields of a system that holds both, with the particles and connections of `other` behind.

    Raises
    ------
    ValueError
        If they have another number of coordinates, or other laws of damping.
    """
    if other.dim != one.dim:
        raise ValueError(f"cannot add a system of {other.dim} coordinates to one of {one.dim}")
    if one.damper != other.damper and one.damping.any() and other.damping.any():
        raise ValueError(f"cannot add a system damped by {other.damper} to one damped by {one.damper}")
    n, c = one.particle_count, one.connection_count
    surface = one.surface
    if other.surface is not None:
        surface = other.surface.behind(surface, n)
    shifted = tuple(
        {name: slice(part.start + c, part.stop + c) for name, part in body.items()} for body in other.directions
    )
    connections = np.concatenate([one.connections, other.connections])
    connections[c:] += n
    groups = dict(one.groups)
    for name, particles in other.groups.items():
        groups[name] = np.concatenate([groups.get(name, particles[:0]), particles + np.int32(n)])
    fields = {
        name: joined(getattr(one, name), getattr(other, name)) for name in (*PARTICLE_FIELDS, *CONNECTION_FIELDS)
    }
    if one.original_length is one.rest_length and other.original_length is other.rest_length:
        fields["original_length"] = fields["rest_length"]
    return fields | {
        "connections": connections,
        "damper": one.damper if one.damping.any() else other.damper,
        "surface": surface,
        "directions": one.directions + shifted,
        "groups": groups,
    }
