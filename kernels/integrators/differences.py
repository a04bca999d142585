"""Differences between the worlds of an ensemble, and the struct that has them in kernels."""

import functools
from typing import Any, NamedTuple

import warp as wp

from ..basis import vector

SHARED, UNIFORM, EACH = "shared", "uniform", "each"
"""How a constant of connections differs between worlds: not at all; one value per world; several per world."""


class Differences(NamedTuple):
    """The parameters that differ between worlds; other ones need no code. Hashable: ensembles share kernels."""

    gravity: bool = False
    mass: bool = False
    friction: bool = False
    """Whether friction of obstacles differs."""
    storage: str = ""
    """Where the algorithm stores constants: "one", "table", "own", "lattice", "lattices"; see `enter_world`."""
    rest_length: str = SHARED
    stiffness: str = SHARED
    damping: str = SHARED
    arrays: tuple[str, ...] = ()
    """Arrays of the scene, named "field.name", that have a part for each world."""


@functools.cache
def world_data(dim: int, scalar: type, Forces: Any, differs: Differences, body_contact: bool) -> Any:
    """Compose the struct of all differences. World w uses row w mod (number of rows).

    stride: bytes between the vectors of successive worlds. frozen: status of each world; only worlds with status 0
    are advanced; shape [world_count]. unit: unit of contact forces [N], shape [world_count].
    """
    V = vector(dim, scalar)
    fields: dict[str, Any] = {"stride": wp.int64, "frozen": wp.array(dtype=wp.int32)}
    if differs.gravity:
        fields["gravity"] = wp.array(dtype=V)  # [m/s²]
    if differs.mass:
        fields["inverse_mass"] = wp.array2d(dtype=scalar)  # [1/kg], shape [rows, particle_count]
    if differs.friction:
        fields["friction"] = wp.array2d(dtype=scalar)  # shape [rows, obstacle_count]
    if differs.storage == "one":
        fields["constants"] = wp.array(dtype=Forces.vars["constants"].type.vars["all"].type)
    elif differs.storage == "table":
        kind = Forces.vars["constants"].type.vars["table"].type.dtype
        fields["constants"] = wp.array2d(dtype=kind)  # shape [rows, kind_count]
    elif differs.storage:
        for name in ("rest_length", "stiffness", "damping"):
            how = getattr(differs, name)
            if how == UNIFORM:
                fields[name] = wp.array(dtype=scalar)  # shape [rows]
            elif how == EACH and differs.storage == "own":
                fields[name] = wp.array2d(dtype=scalar)  # shape [rows, connection_count or slot_count]
            elif how == EACH and differs.storage == "lattice":
                fields[name] = wp.array(dtype=Forces.vars[name].type)  # by direction, shape [rows]
            elif how == EACH:
                fields[name] = wp.array3d(dtype=scalar)  # shape [rows, kind_count, direction_count]
    if body_contact:
        fields["unit"] = wp.array(dtype=wp.float64)
    names = {"__module__": __name__, "__qualname__": "world_data.<locals>.WorldData"}
    return wp.struct(type("WorldData", (), {"__annotations__": fields} | names))
