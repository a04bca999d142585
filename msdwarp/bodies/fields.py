"""The fields of a system: their names, limits and defaults, and the checks of each."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import checks
from .dampers import Damper
from .selection import check_no_mask
from .surface import Surface
from .uniform import is_uniform, stored

LIMITS = {
    "position": (checks.FINITE,),
    "velocity": (checks.FINITE,),
    "mass": (
        (lambda mass: mass > 0, "above 0 (inf pins the particle)"),
        checks.NOT_TINY,
        checks.FINITE_OR_INF,
    ),
    "rest_length": (checks.FINITE, checks.NOT_TINY),
    "stiffness": (checks.FINITE, (lambda stiffness: stiffness >= 0, "at least 0")),
    "damping": (checks.FINITE, (lambda damping: damping >= 0, "at least 0")),
    "yield_strain": ((lambda strain: strain >= 0, "at least 0 (inf never yields)"), checks.FINITE_OR_INF),
    "relaxation_time": (checks.FINITE, (lambda time: time >= 0, "at least 0")),
    "largest_plastic_strain": ((lambda strain: (strain >= 0) & (strain < 1), "at least 0 and below 1"),),
    "break_strain": ((lambda strain: strain >= 0, "at least 0 (inf never breaks)"), checks.FINITE_OR_INF),
    "break_force": ((lambda force: force >= 0, "at least 0 (inf never breaks)"), checks.FINITE_OR_INF),
    "broken_at": ((lambda time: time >= 0, "at least 0 (inf is whole)"), checks.FINITE_OR_INF),
}
PARTICLE_FIELDS = ("position", "velocity", "mass")
"""Arrays of a system with an entry for each particle."""
CONNECTION_FIELDS = (
    "rest_length",
    "stiffness",
    "damping",
    "yield_strain",
    "relaxation_time",
    "largest_plastic_strain",
    "original_length",
    "break_strain",
    "break_force",
    "broken_at",
)
"""Arrays of a system with an entry for each connection."""
TEARING_FIELDS = ("break_strain", "break_force", "broken_at")
"""Those of them that files of before tearing lack; they are then as by default."""
DEFAULTS = {
    "stiffness": 1000.0,
    "damping": 0.0,
    "yield_strain": np.inf,
    "relaxation_time": 0.1,
    "largest_plastic_strain": 0.5,
    "break_strain": np.inf,
    "break_force": np.inf,
    "broken_at": np.inf,
}
"""What connections have where nothing is said."""
LIMITS["original_length"] = LIMITS["rest_length"]
_BLOCK = 1 << 16  # connections whose lengths are computed at a time: their coordinates fit into the cache


def checked(given: Mapping[str, Any], known: Mapping[str, Any] | None = None) -> dict[str, Any]:
    """Return all fields of a system: those given, checked and copied, and the others as they are known.

    Known fields are valid together, and nobody writes to their arrays: they are shared. Only what has to fit a
    given field is checked anew; a uniform array fits any number of particles or connections.
    """
    known = known or {}
    fields = {**known, **given}
    new = {name for name, value in given.items() if name not in known or value is not known[name]}
    if "position" in new:
        fields["position"] = positions(fields["position"])
    particle_count = len(fields["position"])
    if known and particle_count != len(known["position"]):
        new |= {"connections", "surface", "groups"}  # which hold indices of particles

    for name in PARTICLE_FIELDS[1:]:
        shape = fields["position"].shape if name == "velocity" else (particle_count,)
        fields[name] = numbers(name, fields[name], shape, valid=name not in new)
    if new & {"velocity", "mass"}:
        check_pinned_still(fields["velocity"], fields["mass"])

    if "connections" in new:
        fields["connections"] = pairs(fields["connections"], particle_count)
    fields |= _of_connections(fields, new)
    if new & {"break_strain", "break_force"}:
        check_bears_start(fields)

    if not isinstance(fields["damper"], Damper):
        was = checks.repr_short(fields["damper"])
        raise ValueError(f"damper is {was}; it must be a law of damping, such as CoulombDamper()")
    if "surface" in new and fields["surface"] is not None:
        checks.instance("surface", fields["surface"], Surface, "Surface(particle=..., uv=..., triangles=...)")
        checks.within("surface.particle", fields["surface"].particle, checks.index_below(particle_count))
    if "directions" in new:
        fields["directions"] = _of_bodies(fields["directions"])
    if "groups" in new:
        groups = fields["groups"] or {}
        checks.instance("groups", groups, Mapping, "{'scoop': [0, 1]}")
        fields["groups"] = {name: group_of(name, group, particle_count) for name, group in groups.items()}
    return fields


def _of_bodies(directions: Any) -> tuple[Mapping[str, slice], ...]:
    """Return the slices of each body's connections, by name."""
    bodies = checks.sequence("directions", directions, Mapping, "{'x': slice(0, 4)}")
    for k, body in enumerate(bodies):
        for name, connections in body.items():
            checks.instance(f"a name in directions[{k}]", name, str, "'x'")
            checks.instance(f"directions[{k}][{name!r}]", connections, slice, "slice(0, 4)")
    return bodies


def _of_connections(fields: Mapping[str, Any], new: set[str]) -> dict[str, NDArray[np.float64]]:
    """Return the arrays with an entry for each connection, those that are `new` checked."""
    values = {name: fields[name] for name in CONNECTION_FIELDS}
    if values["rest_length"] is None:
        values["rest_length"] = lengths(fields["position"], fields["connections"])
    never_yielded = values["original_length"] is None or values["original_length"] is values["rest_length"]
    if never_yielded:
        del values["original_length"]
    shape = fields["connections"].shape[:1]
    result = {name: numbers(name, value, shape, valid=name not in new) for name, value in values.items()}
    return {"original_length": result["rest_length"]} | result  # one array, if the two are alike


def numbers(name: str, value: ArrayLike, shape: tuple[int, ...], *, valid: bool = False) -> NDArray[np.float64]:
    """Return `value` as a read-only array of this shape, its entries within the limits of the field.

    A `valid` array is returned as it is if it has that shape.
    """
    if valid:
        assert isinstance(value, np.ndarray)
        if value.shape == shape:
            return value
        value = value[0] if is_uniform(value) else value
    values = checks.broadcast(name, value, shape)
    checks.within(name, values, *LIMITS[name])
    return values


def longest(fields: Mapping[str, Any]) -> NDArray[np.float64]:
    """Return the length beyond which each connection of a system breaks [m]: it exerts break_force there at most.

    Parameters
    ----------
    fields
        Those of the system by name, of which rest_length, stiffness, break_strain and break_force are read.
    """
    rest, stiffness = fields["rest_length"], fields["stiffness"]
    with np.errstate(divide="ignore", invalid="ignore"):
        stretch = np.where(stiffness > 0, fields["break_force"] / stiffness, np.inf)
    return np.minimum(rest * (1 + fields["break_strain"]), rest + stretch)


def check_bears_start(fields: Mapping[str, Any]) -> None:
    """Check that no connection that is whole is longer at the start than what it bears."""
    if np.isinf(stored(fields["break_strain"])).all() and np.isinf(stored(fields["break_force"])).all():
        return
    length, most, rest = lengths(fields["position"], fields["connections"]), longest(fields), fields["rest_length"]
    # Lengths of what was placed unstrained are those of the rest but for rounding.
    bears = np.isfinite(fields["broken_at"]) | (length <= most * (1 + 8 * np.finfo(np.float64).eps))
    if not bears.all():
        c = int(np.argmin(bears))
        name = "break_strain" if most[c] == rest[c] * (1 + fields["break_strain"][c]) else "break_force"
        least = (
            length[c] / rest[c] - 1 if name == "break_strain" else fields["stiffness"][c] * (length[c] - rest[c])
        )
        raise ValueError(
            f"{name}[{c}] is {fields[name][c]:.6g}; it must be at least {least:.6g}, with which the connection "
            "starts (or broken_at says that it is broken)"
        )


def check_pinned_still(velocity: NDArray[np.float64], mass: NDArray[np.float64]) -> None:
    """Check that pinned particles do not move."""
    pinned = np.isinf(mass)
    if pinned.any():
        still = ~pinned | (velocity == 0).all(axis=1)
        checks.every("velocity", velocity, np.broadcast_to(still[:, None], velocity.shape), "0: it is pinned")


def positions(value: ArrayLike) -> NDArray[np.float64]:
    """Return `value` as a new read-only array of particle positions."""
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
    """Return `value` as a new read-only array of the two particles of each connection."""
    connections = checks.indices("connections", value, 2, particle_count)
    itself = connections[:, 0] == connections[:, 1]
    if itself.any():
        c = int(np.argmax(itself))
        raise ValueError(f"connections[{c}] joins particle {connections[c, 0]} with itself")
    return connections


def lengths(position: NDArray[np.float64], connections: NDArray[np.int32]) -> NDArray[np.float64]:
    """Return the distance of the two particles of each connection."""
    result = np.empty(len(connections))
    for start in range(0, len(connections), _BLOCK):
        i, j = connections[start : start + _BLOCK].T
        apart = position.take(i, axis=0) - position.take(j, axis=0)
        result[start : start + _BLOCK] = np.linalg.norm(apart, axis=1)
    return result


def group_of(name: str, particles: ArrayLike, particle_count: int) -> NDArray[np.int32]:
    """Return a group's particles as a new read-only array of indices."""
    checks.instance("a group's name", name, str, "'scoop'")
    where = np.reshape(particles, -1)
    check_no_mask(f"groups[{name!r}]", where, particle_count)
    return checks.indices(f"groups[{name!r}]", where[:, None], 1, particle_count)[:, 0]
