"""What a sweep is asked for, checked, and as JSON has it."""

import hashlib
import importlib
import inspect
import json
import math
import pickle
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from .. import checks
from ..world import Scene
from .grid import plain

OPTIONS = (
    "duration", "fps", "integrator", "substeps", "safety", "allow_unstable", "energy_limit", "device", "precision",
    "force_algorithm", "collider_rule",
)  # fmt: skip
"""What may be swept or set beside the parameters of a scene."""


def found(scene: str | Callable[..., Scene]) -> tuple[Callable[..., Scene], str]:
    """Return what builds a scene, and its name."""
    if isinstance(scene, str):
        try:
            if not scene.isidentifier():
                raise ModuleNotFoundError
            return importlib.import_module(f"msdwarp.scenes.{scene}").build, scene
        except (ModuleNotFoundError, AttributeError):
            raise ValueError(
                f"scene is {scene!r}; it must be a name that `msdwarp list` shows, or a function"
            ) from None
    if not callable(scene) or not hasattr(scene, "__qualname__"):
        raise ValueError(f"scene is {checks.repr_short(scene)}; it must be the name of a scene, or a function")
    return scene, scene.__qualname__


def check_names(
    build: Callable[..., Scene], grid: Mapping[str, Any], fixed: Mapping[str, Any], options: Mapping[str, Any]
) -> None:
    """Raise ValueError that names what neither the scene nor `Simulation` takes, or what is given twice."""
    known = inspect.signature(build).parameters
    anything = any(one.kind is one.VAR_KEYWORD for one in known.values())
    own = [] if anything else list(known)
    for given, label, allowed in ((grid, "grid", [*own, *OPTIONS]), (fixed, "parameters", own)):
        for name in given:
            if not anything:
                checks.one_of(f"a name in {label}", name, allowed)
    for name in options:
        checks.one_of("an option", name, OPTIONS)
    for name in grid:
        if name in fixed or name in options:
            raise ValueError(f"{name} is in grid, and given for all points too; it must be one of both")


def check_travels(functions: Mapping[str, Callable[..., Any]]) -> None:
    """Raise ValueError if worker processes could not be given functions, by what they are called."""
    where = "it must be at the top of a module that they can import, or jobs be 1"
    main = importlib.import_module("__main__")
    for label, function in functions.items():
        try:
            pickle.dumps(function)
        except Exception as error:
            raise ValueError(f"{label} cannot be given to worker processes ({error}); {where}") from error
        if function.__module__ == "__main__" and not hasattr(main, "__file__"):
            raise ValueError(f"{label} was typed in interactively, so worker processes cannot import it; {where}")


def source(function: Callable[..., Any]) -> str | None:
    """Return a digest of the source of a function, None where there is none; of what it calls it knows nothing."""
    try:
        return hashlib.sha256(inspect.getsource(function).encode()).hexdigest()[:16]
    except (OSError, TypeError):
        return None


def as_stored(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return values as JSON has them: what it cannot hold by its text."""
    return {name: _as_json(value) for name, value in values.items()}


def _as_json(value: Any) -> Any:
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)
    try:
        return plain("it", value)
    except ValueError:
        pass
    if isinstance(value, np.ndarray):
        value = value.tolist()
    if isinstance(value, list | tuple):
        return [_as_json(one) for one in value]
    try:
        return json.loads(json.dumps(value, sort_keys=True))
    except TypeError:
        return repr(value)
