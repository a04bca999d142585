"""Parameters of a scene that a fit may change, each a positive number, and scenes with other values."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import checks
from ..world import Scene

UNITS = {
    "stiffness": "N/m",
    "damping": "N s/m",
    "rest_length": "m",
    "mass": "kg",
    "friction": "",
    "gravity": "m/s²",
}
"""Units of the parameters that may be fitted."""
FACTOR = "times the scene's own"
OF_CELLS = ("stiffness", "damping")
"""Parameters that scale the cells of a material with a Poisson's ratio together with its springs."""
REACH = 10.0
"""Default bounds are the starting value divided and multiplied by this factor."""


@dataclass(frozen=True, eq=False)
class Parameter:
    """A number that a fit changes, and the pattern of values that it multiplies."""

    name: str
    pattern: NDArray[np.float64]
    """The values of springs, particles or obstacles for a parameter of 1; for gravity its direction."""
    own: float
    """The parameter's value in the scene; 1 for a factor."""
    start: float
    low: float
    high: float
    unit: str

    @property
    def is_one_number(self) -> bool:
        """Whether the parameter itself is the value of each spring, particle or obstacle."""
        return bool((self.pattern == 1.0).all())

    def rows(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the argument of `Ensemble` for parameter values of shape [worlds]."""
        if self.is_one_number and self.name != "gravity":
            return values
        return values[:, None] * self.pattern


def parameters_of(scene: Scene, requested: Any, bounds: Any) -> list[Parameter]:
    """Return the requested parameters; raise ValueError if one is invalid."""
    if isinstance(requested, str):
        requested = [requested]
    if not isinstance(requested, Sequence | Mapping) or not len(requested):
        raise ValueError(
            f"parameters is {checks.repr_short(requested)}; it must be names from {', '.join(UNITS)}, "
            "or where each starts"
        )
    starts = dict(requested) if isinstance(requested, Mapping) else dict.fromkeys(requested)
    limits = dict(checks.mapping("bounds", bounds or {}))
    for name in starts:
        if name == "youngs_modulus":
            raise ValueError(
                "a name in parameters is 'youngs_modulus'; 'stiffness' is its factor, of springs and cells"
            )
        checks.one_of("a name in parameters", name, UNITS)
    if len(starts) < len(requested):
        raise ValueError(f"parameters is {checks.repr_short(requested)}; each must be named once")
    for name in limits:
        checks.one_of("a name in bounds", name, starts)
    return [_parameter(scene, name, start, limits.get(name)) for name, start in starts.items()]


def _parameter(scene: Scene, name: str, start: Any, limits: Any) -> Parameter:
    pattern, own, unit = _pattern(scene, name)
    if start is None and not own > 0:
        raise ValueError(
            f"{name} is {own:g} in the scene; it must be above 0 to be fitted, or be told where to start: "
            f"parameters={{'{name}': 1.0}}"
        )
    first = checks.positive(f"parameters[{name!r}]", own if start is None else start)
    if limits is None:
        low, high = first / REACH, first * REACH
    else:
        low, high = checks.vector(f"bounds[{name!r}]", limits, 2)
    if not 0 < low < first < high:
        raise ValueError(
            f"bounds[{name!r}] is ({low:g}, {high:g}); both must be above 0, the start, {first:g}, between"
        )
    return Parameter(name, pattern, own, first, float(low), float(high), unit)


def _pattern(scene: Scene, name: str) -> tuple[NDArray[np.float64], float, str]:
    """Return (pattern of a parameter, its value in the scene or 1 if values vary, its unit)."""
    if name == "gravity":
        if callable(scene.gravity):
            raise ValueError("gravity is a function of time; it must be constant to be fitted")
        vector = checks.gravity("gravity", scene.gravity, scene.system.dim)
        size = float(np.linalg.norm(vector))
        return vector / size if size else -np.eye(scene.system.dim)[-1], size, UNITS[name]
    if name == "friction":
        obstacles: Sequence[Any] = scene.colliders
        if not len(obstacles):
            raise ValueError("parameters has 'friction'; the scene must have colliders then")
        own = np.array([one.friction for one in obstacles])
        checks.every("friction of colliders", own, np.isfinite(own), "finite to be fitted")
    else:
        own = np.array(getattr(scene.system, name))
        if not own.size:
            raise ValueError(f"parameters has {name!r}; the scene must have connections then")
    finite = np.isfinite(own)  # pinned particles stay pinned
    if not finite.any():
        raise ValueError(f"parameters has {name!r}; this needs a free particle")
    alike = own[finite] == own[finite][0]
    if alike.all():
        return np.where(finite, 1.0, own), float(own[finite][0]), UNITS[name]
    return own, 1.0, FACTOR


def scene_with(scene: Scene, parameters: Sequence[Parameter], values: NDArray[np.float64]) -> Scene:
    """Return the scene with these values of the parameters."""
    changes: dict[str, Any] = {}
    fields: dict[str, Any] = {}
    times: dict[str, float] = {}
    for one, value in zip(parameters, values, strict=True):
        each = float(value) * one.pattern
        if one.name == "gravity":
            changes["gravity"] = each
        elif one.name == "friction":
            obstacles: Sequence[Any] = scene.colliders
            changes["colliders"] = [replace(c, friction=float(f)) for c, f in zip(obstacles, each, strict=True)]
        else:
            fields[one.name] = float(value) if one.is_one_number else each
            if one.name in OF_CELLS and one.own > 0:
                times[one.name] = float(value) / one.own
    cells = scene.system.cells
    if times and cells is not None:
        fields["cells"] = cells.scaled(*(times.get(name, 1.0) for name in OF_CELLS))
    return replace(scene, system=scene.system.replace(**fields), **changes)
