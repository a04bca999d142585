"""The fields of a system: names, limits, defaults and checks."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import checks
from .angles import Angles
from .cells import Cells
from .dampers import Damper
from .regions import LawKinds, each_law
from .selection import check_no_mask
from .springs import LINEAR_SPRING, Spring
from .surface import Surface
from .uniform import is_uniform, stored, uniform


def _from_0(meaning: str = "") -> checks.Limit:
    return lambda values: values >= 0, f"at least 0{meaning}"


_OF_CONNECTIONS: dict[str, tuple[float | None, tuple[checks.Limit, ...]]] = {
    "rest_length": (None, (checks.FINITE, checks.NOT_TINY)),
    "stiffness": (1000.0, (checks.FINITE, _from_0())),
    "damping": (0.0, (checks.FINITE, _from_0())),
    "yield_strain": (np.inf, (_from_0(" (inf never yields)"), checks.FINITE_OR_INF)),
    "relaxation_time": (0.1, (checks.FINITE, _from_0())),
    "largest_plastic_strain": (0.5, ((lambda strain: (strain >= 0) & (strain < 1), "at least 0 and below 1"),)),
    "original_length": (None, (checks.FINITE, checks.NOT_TINY)),
    "break_strain": (np.inf, (_from_0(" (inf never breaks)"), checks.FINITE_OR_INF)),
    "break_force": (np.inf, (_from_0(" (inf never breaks)"), checks.FINITE_OR_INF)),
    "broken_at": (np.inf, (_from_0(" (inf is whole)"), checks.FINITE_OR_INF)),
}
"""Arrays of a system with an entry for each connection: their defaults, if any, and limits."""
CONNECTION_FIELDS = tuple(_OF_CONNECTIONS)
DEFAULTS = {name: default for name, (default, _) in _OF_CONNECTIONS.items() if default is not None}
TEARING_FIELDS = ("break_strain", "break_force", "broken_at")
"""Fields for tearing, which early files do not have; defaults then apply."""
PARTICLE_FIELDS = ("position", "velocity", "mass")
"""Arrays of a system with an entry for each particle."""
_MASS: checks.Limit = (lambda mass: mass > 0, "above 0 (inf pins the particle)")
LIMITS = {
    "position": (checks.FINITE,),
    "velocity": (checks.FINITE,),
    "mass": (_MASS, checks.NOT_TINY, checks.FINITE_OR_INF),
} | {name: limits for name, (_, limits) in _OF_CONNECTIONS.items()}
_BLOCK = 1 << 15  # connections per block of computed lengths: their coordinates fit into the cache


def checked(given: Mapping[str, Any], known: Mapping[str, Any] | None = None) -> dict[str, Any]:
    """Return all fields of a system: given ones, checked and copied, and the remaining known ones.

    Known fields are those of a valid system; they are shared, not copied. They are checked again only if they must
    match a given field; a uniform array matches any number of particles or connections.
    """
    known = known or {}
    fields = {**known, **given}
    new = {name for name, value in given.items() if name not in known or value is not known[name]}
    if "position" in new:
        fields["position"] = positions(fields["position"])
    particle_count = len(fields["position"])
    if known and particle_count != len(known["position"]):
        new |= {"connections", "surface", "cells", "angles", "groups"}  # these have indices of particles

    for name in PARTICLE_FIELDS[1:]:
        shape = fields["position"].shape if name == "velocity" else (particle_count,)
        fields[name] = numbers(name, fields[name], shape, valid=name not in new)
    if new & {"velocity", "mass"} and np.isinf(stored(fields["mass"])).any():
        still = np.isfinite(fields["mass"]) | (fields["velocity"] == 0).all(axis=1)
        moves = np.broadcast_to(still[:, None], fields["velocity"].shape)
        checks.every("velocity", fields["velocity"], moves, "0: it is pinned")

    if "connections" in new:
        fields["connections"] = pairs(fields["connections"], particle_count)
    fields |= _of_connections(fields, new)
    if new & {"break_strain", "break_force"}:
        check_bears_start(fields)

    count = len(fields["connections"])
    checks.instance("damper", fields["damper"], Damper, "CoulombDamper()")
    checks.instance("spring", fields["spring"], Spring, "TensionOnlySpring()")
    for name in ("damper", "spring"):
        if isinstance(law := fields[name], LawKinds) and law.kind.shape != fields["stiffness"].shape:
            raise ValueError(f"{name} has {len(law.kind)} kinds; it must have one for each of {count} connections")
    springs, kind = each_law(fields["spring"], count)
    linear = np.array([law == LINEAR_SPRING for law in springs])
    if not linear.all() and np.isfinite(fields["break_force"][~linear[kind]]).any():
        law = f"spring is {fields['spring']!r}"
        raise ValueError(
            f"break_force is given, and {law}; only linear springs have it, others may have a break_strain"
        )
    if "surface" in new and fields["surface"] is not None:
        checks.instance("surface", fields["surface"], Surface, "Surface(particle=..., uv=..., triangles=...)")
        checks.within("surface.particle", fields["surface"].particle, checks.index_below(particle_count))
    if "cells" in new and fields["cells"] is not None:
        check_cells(fields["cells"], *fields["position"].shape)
    if "angles" in new and fields["angles"] is not None:
        checks.instance("angles", fields["angles"], Angles, "Angles(particles=..., stiffness=...)")
        checks.within("angles.particles", fields["angles"].particles, checks.index_below(particle_count))
        checks.one_of("the number of coordinates, with angles,", fields["position"].shape[1], (2, 3))
    if "directions" in new:
        fields["directions"] = checks.sequence("directions", fields["directions"], Mapping, "{'x': slice(0, 4)}")
        for k, body in enumerate(fields["directions"]):
            for name, part in body.items():
                checks.instance(f"a name in directions[{k}]", name, str, "'x'")
                named = f"directions[{k}][{name!r}]"
                checks.instance(named, part, slice, "slice(0, 4)")
                if not all(isinstance(end, int | np.integer) and end >= 0 for end in (part.start, part.stop)):
                    raise ValueError(f"{named} is {part}; its start and stop must be whole numbers of at least 0")
    if "groups" in new:
        groups = {} if fields["groups"] is None else fields["groups"]
        checks.instance("groups", groups, Mapping, "{'scoop': [0, 1]}")
        fields["groups"] = {name: group_of(name, group, particle_count) for name, group in groups.items()}
    return fields


def check_cells(cells: Cells, particle_count: int, dim: int) -> None:
    """Check that cells fit this number of particles and of coordinates."""
    checks.instance("cells", cells, Cells, "Cells(corners=..., rest_volume=..., modulus=...)")
    checks.within("cells.corners", cells.corners, (lambda index: index < particle_count, "an index of a particle"))
    if dim == 1 or (dim == 2 and not cells.flat.all()):
        raise ValueError(f"cells are given; in {dim} dimensions they must be {'flat' if dim == 2 else 'None'}")


def scaled_parts(fields: Mapping[str, Any], stiffness: float, damping: float) -> dict[str, Any]:
    """Return the cells and angles of a system's fields, with stiffness and damping multiplied by factors."""
    return {name: fields[name] and fields[name].scaled(stiffness, damping) for name in ("cells", "angles")}


def _of_connections(fields: Mapping[str, Any], new: set[str]) -> dict[str, NDArray[np.float64]]:
    """Return the arrays with an entry for each connection, after checking the `new` ones."""
    values = {name: fields[name] for name in CONNECTION_FIELDS}
    if values["rest_length"] is None:
        values["rest_length"] = lengths(fields["position"], fields["connections"])
    never_yielded = values["original_length"] is None or values["original_length"] is values["rest_length"]
    if never_yielded:
        del values["original_length"]
    shape = fields["connections"].shape[:1]
    result = {name: numbers(name, value, shape, valid=name not in new) for name, value in values.items()}
    return {"original_length": result["rest_length"]} | result  # a single array if both are equal


def numbers(name: str, value: ArrayLike, shape: tuple[int, ...], *, valid: bool = False) -> NDArray[np.float64]:
    """Return `value` as a read-only array of this shape, with entries within the field's limits.

    A `valid` array of this shape is returned as it is.
    """
    if valid:
        assert isinstance(value, np.ndarray)
        if value.shape == shape:
            return value
        value = value[0] if is_uniform(value) else value
    values = checks.broadcast(name, value, shape)
    checks.within(name, values, *LIMITS[name])
    return values


def check_bears_start(fields: Mapping[str, Any]) -> None:
    """Check that no unbroken connection exceeds its breaking length at the start."""
    strain, force = fields["break_strain"], fields["break_force"]
    if np.isinf(stored(strain)).all() and np.isinf(stored(force)).all():
        return
    length, rest = lengths(fields["position"], fields["connections"]), fields["rest_length"]
    stiffness = fields["stiffness"]
    longest = np.minimum(rest * (1 + strain), rest + break_stretch(force, stiffness))
    # Unstrained connections are as long as their rest length, up to rounding.
    bears = np.isfinite(fields["broken_at"]) | (length <= longest * (1 + 8 * np.finfo(np.float64).eps))
    if not bears.all():
        c = int(np.argmin(bears))
        if longest[c] == rest[c] * (1 + strain[c]):
            name, least = "break_strain", length[c] / rest[c] - 1
        else:
            name, least = "break_force", stiffness[c] * (length[c] - rest[c])
        raise ValueError(
            f"{name}[{c}] is {fields[name][c]:.6g}; it must be at least {least:.6g}, with which the connection "
            "starts (or broken_at says that it is broken)"
        )


def break_stretch(force: NDArray[np.float64], stiffness: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the elongation at which springs reach their break force [m], shape [connection_count]."""
    if np.isinf(stored(force)).all():
        return uniform(np.inf, len(force))
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        return np.where(stiffness > 0, force / stiffness, np.inf)


def positions(value: ArrayLike) -> NDArray[np.float64]:
    """Return `value` as a new read-only array of positions [m], shape [particle_count, d]."""
    position = checks.array("position", value)
    if position.ndim != 2 or position.shape[1] not in (1, 2, 3) or len(position) == 0:
        raise ValueError(
            f"position has shape {position.shape}; it must be (particle_count, d) with at least "
            "one particle and d = 1, 2 or 3"
        )
    checks.within("position", position, *LIMITS["position"])
    position.flags.writeable = False
    return position


def pairs(value: ArrayLike, particle_count: int) -> NDArray[np.int32]:
    """Return `value` as a new read-only array of particle pairs, shape [connection_count, 2]."""
    connections = checks.indices("connections", value, 2, particle_count)
    itself = connections[:, 0] == connections[:, 1]
    if itself.any():
        c = int(np.argmax(itself))
        raise ValueError(f"connections[{c}] joins particle {connections[c, 0]} with itself")
    return connections


def lengths(position: NDArray, connections: NDArray[np.int32]) -> NDArray:
    """Return the distance of the two particles of each connection, in the precision of `position`."""
    axes = np.ascontiguousarray(position.T)
    result = np.empty(len(connections), dtype=axes.dtype)
    for start in range(0, len(connections), _BLOCK):
        i, j = connections[start : start + _BLOCK].T.astype(np.intp)
        squared = np.zeros(len(i), dtype=axes.dtype)
        for x in axes:
            apart = x.take(i, mode="clip") - x.take(j, mode="clip")  # indices are valid; "clip" is faster
            squared += apart * apart
        result[start : start + _BLOCK] = np.sqrt(squared)
    return result


def group_of(name: str, particles: ArrayLike, particle_count: int) -> NDArray[np.int32]:
    """Return a group's particles as a new read-only array of indices, shape [any]."""
    checks.instance("a group's name", name, str, "'scoop'")
    label = f"groups[{name!r}]"
    where = checks.whole_numbers(label, particles, "(any,)", lambda shape: True).reshape(-1)
    check_no_mask(label, where, particle_count)
    return checks.indices(label, where[:, None], 1, particle_count)[:, 0]
