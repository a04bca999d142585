"""Arguments of a sweep, checked and converted to JSON data: values of parameters, points, functions."""

import hashlib
import importlib
import inspect
import itertools
import json
import math
import pickle
import re
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from typing import Any

import numpy as np

from .. import checks
from ..world import Scene

MOST_POINTS = 1_000_000
"""Maximal number of points of a grid."""
OPTIONS = (
    "duration", "fps", "integrator", "substeps", "safety", "allow_unstable", "energy_limit", "device", "precision",
    "force_algorithm", "collider_rule",
)  # fmt: skip
"""Options that may be swept or set in addition to the parameters of a scene."""
_NUMBER = r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?"
_FORMS = (
    "a value, a list such as 1,2,5, whole numbers such as 0:100 (without 100), five evenly spaced values "
    "such as 1:3:5, or twenty values in equal ratios such as 1e3:1e5:log:20"
)


def values_of(name: str, text: str) -> list[str] | None:
    """Return the values of a list or a range, as texts; None if the text is a single value.

    Numbers are rounded to twelve digits, so that equal values of different ranges are equal to the last bit.
    Raises ValueError if the text begins like a list or a range but is neither.
    """
    if "," not in text and not re.match(f"{_NUMBER}:", text):
        return None
    values = [value for piece in text.split(",") for value in _piece(name, text, piece)]
    _check_distinct(name, values)
    return values


def _piece(name: str, text: str, piece: str) -> list[str]:
    given = f"{name} is {checks.repr_short(text)}"
    if piece and not re.match(f"{_NUMBER}:", piece):
        return [piece]
    if match := re.fullmatch(r"([+-]?\d+):([+-]?\d+)", piece):
        first, end = int(match[1]), int(match[2])
        if end <= first:
            raise ValueError(f"{given}; {piece} holds no number: its end must be the larger")
        _check_count(name, end - first)
        return [str(k) for k in range(first, end)]
    match = re.fullmatch(rf"({_NUMBER}):({_NUMBER}):(log:)?(\d+)", piece)
    if match is None:
        raise ValueError(f"{given}; it must be {_FORMS}")
    a, b, log, n = float(match[1]), float(match[2]), match[3], int(match[4])
    if n < 2 or a == b or not (math.isfinite(a) and math.isfinite(b)):
        raise ValueError(f"{given}; {piece} must be at least 2 values between two numbers")
    _check_count(name, n)
    if log and not (a > 0 and b > 0):
        raise ValueError(f"{given}; both ends of {piece} must be above 0, since it is log")
    return [f"{value:.12g}" for value in (np.geomspace(a, b, n) if log else np.linspace(a, b, n))]


def _check_count(name: str, count: int) -> None:
    if count > MOST_POINTS:
        raise ValueError(f"{name} has {count} values; a sweep has at most {MOST_POINTS} points")


def _check_distinct(name: str, values: list[Any]) -> None:
    value, times = Counter(values).most_common(1)[0]
    if times > 1:
        raise ValueError(f"{name} has the value {value} twice; its values must differ")


def checked_grid(grid: object) -> dict[str, list[Any]]:
    """Return the values of each parameter of a grid as lists of JSON values; raise ValueError if it is invalid.

    An entry is a sequence of distinct numbers, texts, booleans or None, or a text that `values_of` reads.
    """
    checked = {}
    for name, given in checks.mapping("grid", grid).items():
        checks.instance("a name in grid", name, str, "'stiffness'")
        label = f"grid[{name!r}]"
        if isinstance(given, str):
            texts = values_of(label, given)
            values: list[Any] = [given] if texts is None else list(texts)
            for k, text in enumerate(texts or ()):
                if re.fullmatch(_NUMBER, text):
                    values[k] = as_scalar(label, float(text))
        elif isinstance(given, Iterable):
            values = [as_scalar(f"{label}[{k}]", value) for k, value in enumerate(given)]
        else:
            raise ValueError(
                f"{label} is {checks.repr_short(given)}; it must be a sequence of values, or {_FORMS}"
            )
        if not values:
            raise ValueError(f"{label} is empty; it must have a value")
        _check_distinct(label, values)
        checked[name] = values
    check_size(checked)
    return checked


def check_size(grid: Mapping[str, list[Any]]) -> None:
    """Raise ValueError if a grid has no parameter, or too many points."""
    if not grid:
        raise ValueError(f"nothing is swept; at least one parameter must be a list or a range: {_FORMS}")
    count = math.prod(map(len, grid.values()))
    if count > MOST_POINTS:
        raise ValueError(f"grid has {count} points; it must have at most {MOST_POINTS}")


def points(grid: Mapping[str, list[Any]]) -> Iterator[dict[str, Any]]:
    """Return an iterator over the points of a grid; the last parameter changes fastest."""
    for values in itertools.product(*grid.values()):
        yield dict(zip(grid, values, strict=True))


def as_scalar(name: str, value: Any) -> Any:
    """Return a JSON scalar, 2.0 as 2; raise ValueError if `value` is not a number, text, boolean or None."""
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float) and math.isfinite(value):
        return int(value) if value.is_integer() else value
    if value is None or isinstance(value, str | bool | int):
        return value
    must = "it must be a finite number, a text, True, False or None"
    raise ValueError(f"{name} is {checks.repr_short(value)}; {must}")


def find_build(scene: str | Callable[..., Scene]) -> tuple[Callable[..., Scene], str]:
    """Return (function that builds a scene, name of the scene)."""
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
    """Raise ValueError for a name that is given twice, or is an argument of neither scene nor `Simulation`."""
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
    """Raise ValueError if one of the functions, given by label, cannot be pickled for worker processes."""
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
    """Return a digest of a function's source, excluding functions that it calls; None if there is no source."""
    try:
        return hashlib.sha256(inspect.getsource(function).encode()).hexdigest()[:16]
    except (OSError, TypeError):
        return None


def as_json(value: Any) -> Any:
    """Return a value as JSON data; other values become text."""
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)
    with suppress(ValueError):
        return as_scalar("it", value)
    if isinstance(value, np.ndarray):
        value = value.tolist()
    if isinstance(value, list | tuple):
        return [as_json(one) for one in value]
    try:
        return json.loads(json.dumps(value, sort_keys=True))
    except TypeError:
        return repr(value)
