"""The fields of a system: their names, limits and defaults, and the checks of each."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import checks

_FINITE = (np.isfinite, "finite")
LIMITS = {
    "position": (_FINITE,),
    "velocity": (_FINITE,),
    "mass": ((lambda mass: mass > 0, "above 0 (inf pins the particle)"),),
    "rest_length": (_FINITE, (lambda length: length > 0, "above 0")),
    "stiffness": (_FINITE, (lambda stiffness: stiffness >= 0, "at least 0")),
    "damping": (_FINITE, (lambda damping: damping >= 0, "at least 0")),
    "yield_strain": ((lambda strain: strain >= 0, "at least 0 (inf never yields)"),),
    "relaxation_time": (_FINITE, (lambda time: time >= 0, "at least 0")),
    "largest_plastic_strain": ((lambda strain: (strain >= 0) & (strain < 1), "at least 0 and below 1"),),
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
)
"""Arrays of a system with an entry for each connection."""
DEFAULTS = {
    "stiffness": 1000.0,
    "damping": 0.0,
    "yield_strain": np.inf,
    "relaxation_time": 0.1,
    "largest_plastic_strain": 0.5,
}
LIMITS["original_length"] = LIMITS["rest_length"]
_BLOCK = 1 << 16  # connections whose lengths are computed at a time: their coordinates fit into the cache


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
    return checks.indices(f"groups[{name!r}]", np.reshape(particles, (-1, 1)), 1, particle_count)[:, 0]
