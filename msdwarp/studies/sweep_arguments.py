"""Arguments of a sweep, checked, and as JSON has them."""

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
            must = "it must be a name that `msdwarp list` shows, or a function"
            raise ValueError(f"scene is {scene!r}; {must}") from None
    if not callable(scene) or not hasattr(scene, "__qualname__"):
        raise ValueError(f"scene is {checks.repr_short(scene)}; it must be the name of a scene, or a function")
    return scene, scene.__qualname__


def check_names(
    build: Callable[..., Scene], grid: Mapping[str, Any], fixed: Mapping[str, Any], options: Mapping[str, Any]
) -> None:
    """Raise ValueError that names what neither the scene nor `Simulation` takes, or what is given twice."""
    known = inspect.signature(build).parameters
    if not any(one.kind is one.VAR_KEYWORD for one in known.values()):
        for given, label, allowed in ((grid, "grid", [*known, *OPTIONS]), (fixed, "parameters", known)):
            for name in given:
                checks.one_of(f"a name in {label}", name, allowed)
    for name in options:
        checks.one_of("an option", name, OPTIONS)
    for name in grid:
        if name in fixed or name in options:
            raise ValueError(f"{name} is in grid, and given for all points too; it must be one of both")


def check_travels(functions: Mapping[str, Callable[..., Any]]) -> None:
    """Raise ValueError if functions, by label, could not be given to worker processes."""
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
    """Return a digest of a function's own source, without what it calls; None where there is none."""
    try:
        return hashlib.sha256(inspect.getsource(function).encode()).hexdigest()[:16]
    except (OSError, TypeError):
        return None


def as_json(value: Any) -> Any:
    """Return a value as JSON has it; what JSON cannot hold as its text."""
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)
    try:
        return plain("it", value)
    except ValueError:
        pass
    if isinstance(value, np.ndarray):
        value = value.tolist()
    if isinstance(value, list | tuple):
        return [as_json(one) for one in value]
    try:
        return json.loads(json.dumps(value, sort_keys=True))
    except TypeError:
        return repr(value)
