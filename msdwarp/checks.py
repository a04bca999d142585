"""Checks of users' arguments: each error names the argument, its value and the allowed values."""

import importlib
import math
import re
import sys
import warnings
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

_MOST_SHOWN = 200
"""Maximal number of characters of a value that a message shows in full."""
LARGEST, SMALLEST = 1e18, 1e-18
"""Bounds of physical quantities, and of those above 0: products of two such numbers are finite in float32 too."""
Limit = tuple[Callable[[NDArray], NDArray], str]
"""A condition that holds for an interval of numbers, perhaps with inf, and its description in messages."""
_MOST = f"at most {LARGEST:.0e}"
FINITE: Limit = (lambda values: np.abs(values) <= LARGEST, f"finite, and {_MOST} in size")
FINITE_OR_INF: Limit = (lambda values: (values <= LARGEST) | (values == np.inf), f"{_MOST}, or inf")
NOT_TINY: Limit = (lambda values: values >= SMALLEST, f"above 0, and at least {SMALLEST:.0e}")


class GradientWarning(UserWarning):
    """A gradient grows so much from the end to the start that it says little about finite changes."""


class EnergyDriftWarning(UserWarning):
    """The energy of a run has risen by rounding errors."""


class FitWarning(UserWarning):
    """The measurements do not determine the fitted values well."""


class InvertedWarning(UserWarning):
    """Cells of a body stay turned inside out: it has been crushed, and its springs do not resist that."""


class SettleWarning(UserWarning):
    """A system has not settled within its tolerance."""


class StartWarning(UserWarning):
    """The scene can be simulated, but its starting state probably contains a mistake."""


class StepWarning(UserWarning):
    """Substeps are too long for what happens in one, or very many: the frame takes long, or is not resolved."""


class StrainWarning(UserWarning):
    """A body is strained so much that its model may not hold."""


class UnitWarning(UserWarning):
    """A length or a density is so large or small that it is probably in other units than metres and kg/m³."""


def warn(message: str, kind: type[Warning] = UserWarning) -> None:
    """Warn at the user's line: the first outside of msdwarp that led here."""
    level, frame = 2, sys._getframe(1)
    while frame.f_back is not None and frame.f_globals.get("__name__", "").partition(".")[0] == "msdwarp":
        level, frame = level + 1, frame.f_back
    warnings.warn(message, kind, stacklevel=level)


def array(name: str, value: ArrayLike) -> NDArray[np.float64]:
    """Return `value` as a new float64 array; raise ValueError unless its entries are numbers.

    Text and booleans are refused, although NumPy would read numbers from them. So are None, which NumPy reads as
    NaN, and masked entries, whose mask NumPy would drop.
    """
    allowed = "an array of numbers"
    if np.ma.is_masked(value):
        raise ValueError(f"{name} has masked entries; it must be {allowed}, none of them masked")
    try:
        given: NDArray = np.asarray(value)
        # Integers too large for NumPy's types become an array of Python objects.
        if given.dtype.kind in "iuf" or (given.dtype.kind == "O" and all(map(_is_real, given.flat))):
            result: NDArray[np.float64] = np.array(given, dtype=np.float64)
            return result
    except (TypeError, ValueError, OverflowError) as error:
        allowed += f" up to {sys.float_info.max:.2g}" if isinstance(error, OverflowError) else ""
        raise ValueError(f"{name} must be {allowed}, not {repr_short(value)}") from error
    raise ValueError(f"{name} must be {allowed}, not {repr_short(value)}")


def as_now(value: Any) -> Any:
    """Return a value that its giver cannot change later: a read-only copy of an array, a copy of a list."""
    if isinstance(value, np.ndarray):
        value = value.copy()
        value.flags.writeable = False
    return list(value) if isinstance(value, list) else value


def _is_real(value: object) -> bool:
    """Return whether a value is a number, or converts to one (`__float__`); text and booleans do not count."""
    if isinstance(value, np.ndarray | np.generic):
        return value.ndim == 0 and value.dtype.kind in "iuf"
    return hasattr(value, "__float__") and not isinstance(value, bool)


def repr_short(value: object) -> str:
    """Return a value as text for a message; a long one is shortened in the middle."""
    try:
        return _short(repr(value))
    except ValueError:  # Python prints no integer of more than a few thousand digits
        return "a whole number of very many digits"


def message(error: BaseException, *clear: type) -> str:
    """Return an error's message, preceded by its class unless that is ValueError, OSError or one of `clear`."""
    if str(error) and isinstance(error, (ValueError, OSError, *clear)):
        return str(error)
    return ": ".join(filter(None, (type(error).__name__, str(error))))


def _short(text: str) -> str:
    return text if len(text) <= _MOST_SHOWN else f"{text[: _MOST_SHOWN // 2]} ... {text[-_MOST_SHOWN // 4 :]}"


def broadcast(name: str, value: ArrayLike, shape: tuple[int, ...]) -> NDArray[np.float64]:
    """Return `value` as a read-only float64 array of `shape`; a uniform value is stored once."""
    if isinstance(value, np.ndarray) and value.size and value.shape == shape and value.strides[:1] == (0,):
        value = value[0]  # already one constant or row, repeated
    given = array(name, value)
    try:
        result = np.broadcast_to(given, shape)
    except ValueError as error:
        several = f"{shape[0]} numbers" if len(shape) == 1 else f"have shape {shape[1:]} or {shape}"
        raise ValueError(f"{name} has shape {given.shape}; it must be one number or {several}") from error
    result.flags.writeable = False
    return result


def every(name: str, values: NDArray, holds: NDArray, allowed: str) -> None:
    """Raise ValueError that names the first entry of `values` for which `holds` is False.

    For a broadcast number the message shows only the number.
    """
    if np.all(holds):
        return
    index = tuple(int(k) for k in np.argwhere(~holds)[0])
    entry = []
    for axis, k in enumerate(index):
        along = (*index[:axis], slice(None), *index[axis + 1 :])
        if values.strides[axis] or np.any(holds[along]):  # entries differ along it, or only this one is wrong
            entry.append(str(k))
    where = f"{name}[{', '.join(entry)}]" if entry else name
    shown = str(values[index]) if entry or values.dtype.kind != "f" else f"{values[index]}".removesuffix(".0")
    raise ValueError(f"{where} is {shown}; it must be {allowed}")


def finite(name: str, value: ArrayLike) -> NDArray[np.float64]:
    """Return numbers as an array; raise ValueError if one is not finite, or larger than LARGEST."""
    given = array(name, value)
    every(name, given, FINITE[0](given), FINITE[1])
    return given


def within(name: str, values: NDArray, *limits: Limit) -> None:
    """Raise ValueError that names the first entry of `values` that is not within all `limits`."""
    if values.size == 0:
        return
    once = values[tuple(slice(1) if stride == 0 else slice(None) for stride in values.strides)]
    # Limits are intervals: testing minimum and maximum suffices; these are NaN if any number is.
    extremes = np.array([once.min(), once.max()])
    if extremes[1] == np.inf:
        extremes = np.append(extremes, once.max(where=once < np.inf, initial=extremes[0]))
    for holds, allowed in limits:
        if not holds(extremes).all():
            every(name, values, holds(values), allowed)


def indices(name: str, value: ArrayLike, width: int, below: int) -> NDArray[np.int32]:
    """Return `value` as a new read-only int32 array of shape (any, width) with 0 <= entries < below."""
    given = whole_numbers(name, value, f"(any, {width})", lambda shape: 0 in shape or shape[1:] == (width,))
    within(name, given, index_below(below))
    return as_int32(given.reshape(-1, width))


def whole_numbers(name: str, value: ArrayLike, allowed: str, fits: Callable[[tuple[int, ...]], bool]) -> NDArray:
    """Return `value` as an array; raise ValueError unless it has whole numbers, in a shape that `fits`."""
    must = f"it must hold whole numbers in the shape {allowed}"
    try:
        given = np.asarray(value)
    except ValueError as error:  # rows of different lengths
        raise ValueError(f"{name} is {repr_short(value)}; {must}") from error
    if not fits(given.shape) or (given.size and given.dtype.kind not in "iu"):
        raise ValueError(f"{name} has shape {given.shape} and type {given.dtype}; {must}")
    return given


def as_int32(values: NDArray) -> NDArray[np.int32]:
    """Return whole numbers as a new read-only array."""
    result = values.astype(np.int32)
    result.flags.writeable = False
    return result


def index_below(count: int) -> Limit:
    """Return the limit of an index into `count` things."""
    return lambda index: (index >= 0) & (index < count), f"an index from 0 to {count - 1}"


ONE_SIZE = "; from_mesh makes an ellipsoid, of pyvista.ParametricEllipsoid(a, b, c)"
"""A hint where three sizes may be given for one."""


def positive(name: str, value: float, hint: str = "") -> float:
    """Return `value` as a float; raise ValueError unless it is finite and above zero.

    The hint ends the message about what is no number.
    """
    allowed = "a number above 0, and finite"
    number = _real(name, value, allowed + hint)
    if not 0.0 < number < math.inf:
        raise ValueError(f"{name} is {number:g}; it must be {allowed}")
    if not SMALLEST <= number <= LARGEST:
        raise ValueError(f"{name} is {number:g}; it must be from {SMALLEST:.0e} to {LARGEST:.0e}")
    return number


def non_negative(name: str, value: float, *, infinite: bool = False) -> float:
    """Return `value` as a float; raise ValueError if it is negative, NaN or (unless allowed) infinite."""
    allowed = "a number of at least 0" + ("" if infinite else ", and finite")
    number = _real(name, value, allowed)
    if not number >= 0.0 or (math.isinf(number) and not infinite):
        raise ValueError(f"{name} is {number:g}; it must be {allowed}")
    if LARGEST < number < math.inf:
        raise ValueError(f"{name} is {number:g}; it must be from 0 to {LARGEST:.0e}")
    return number


def _real(name: str, value: float, allowed: str) -> float:
    """Return a number as a float; raise ValueError if it is no number, or larger than any float."""
    if _is_real(value):
        with suppress(TypeError, ValueError, OverflowError):
            return float(value)
    raise ValueError(f"{name} is {repr_short(value)}; it must be {allowed}")


def between(name: str, value: float, low: float, high: float) -> float:
    """Return `value` as a float; raise ValueError unless it is from `low` to `high`."""
    number = _real(name, value, f"a number from {low:g} to {high:g}")
    if not low <= number <= high:
        raise ValueError(f"{name} is {number}; it must be from {low:g} to {high:g}")
    return number


def count(name: str, value: int, least: int) -> int:
    """Return `value` as an int; raise ValueError unless it is a whole number from `least` to LARGEST."""
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < least:
        raise ValueError(f"{name} is {repr_short(value)}; it must be a whole number of at least {least}")
    if value > LARGEST:
        raise ValueError(f"{name} is {repr_short(value)}; it must be {_MOST}")
    return int(value)


def mapping(name: str, value: Any) -> Mapping[str, Any]:
    """Return a mapping; raise ValueError if the value is not one."""
    if not isinstance(value, Mapping):
        raise ValueError(f"{name} is {repr_short(value)}; it must be a mapping")
    return value


def member(name: str, of: Mapping[str, Any], key: str) -> Any:
    """Return an entry of a mapping; raise ValueError naming both if it is missing or `of` is no mapping."""
    if key not in mapping(name, of):
        raise ValueError(f"{name} lacks {key!r}; it has {_short(', '.join(map(repr, of))) or 'nothing'}")
    return of[key]


def one_of(name: str, value: object, allowed: Iterable[object]) -> None:
    """Raise ValueError unless `value` is among `allowed`."""
    allowed = list(allowed)
    inexact = isinstance(value, bool | float) and any(type(one) is int for one in allowed)  # True == 1 == 1.0
    if inexact or isinstance(value, np.ndarray) or value not in allowed:  # arrays compare entry by entry
        words = ", ".join(map(repr, allowed)) or "those that exist: there are none"
        raise ValueError(f"{name} is {repr_short(value)}; it must be one of {words}")


def instance(name: str, value: object, kind: type, example: str) -> None:
    """Raise ValueError unless `value` is an instance of `kind`; the message shows the `example`."""
    if not isinstance(value, kind):
        given = repr_short(value)
        if "\n" in given or len(given) > _MOST_SHOWN // 2:  # for a long value, such as a scene, name the class
            given = _kind(type(value))
        raise ValueError(f"{name} is {given}; it must be {_kind(kind)}, such as {example}")


def _kind(kind: type) -> str:
    """Return the name of a class with its article."""
    return f"{'an' if kind.__name__[0] in 'AEIOaeio' else 'a'} {kind.__name__}"


def sequence(name: str, value: object, kind: type, example: str) -> tuple[Any, ...]:
    """Return several instances of a class as a tuple; raise ValueError if `value` does not hold any."""
    if isinstance(value, str) or not isinstance(value, Iterable):
        raise ValueError(
            f"{name} is {repr_short(value)}; it must be a sequence of {kind.__name__} objects, such as [{example}]"
        )
    several = tuple(value)
    for k, one in enumerate(several):
        instance(f"{name}[{k}]", one, kind, example)
    return several


def vector(name: str, value: ArrayLike, count: int | None = None) -> NDArray[np.float64]:
    """Return this many finite numbers, by default 1 to 3, as an array; raise ValueError for anything else."""
    vector = array(name, value)
    right = vector.shape in ((1,), (2,), (3,)) if count is None else vector.shape == (count,)
    if not right or not FINITE[0](vector).all():
        numbers = "a finite number" if count == 1 else f"{count or '1 to 3'} finite numbers"
        raise ValueError(f"{name} is {repr_short(value)}; it must be {numbers}, {_MOST} in size")
    return vector


def gravity(name: str, value: ArrayLike, dim: int) -> NDArray[np.float64]:
    """Return the acceleration of free fall as a vector, from a number or a vector; the last coordinate is up."""
    given = array(name, value)
    if not FINITE[0](given).all():
        raise ValueError(f"{name} is {repr_short(value)}; it must be {FINITE[1]}")
    if given.ndim == 0:
        downwards = np.zeros(dim)
        downwards[-1] = -given
        if given < 0:
            upwards = f"upwards is the vector {tuple(downwards.tolist())}"
            raise ValueError(f"{name} is {given:g}; a number is downwards, and must be at least 0; {upwards}")
        return downwards
    if given.shape != (dim,):
        raise ValueError(f"{name} has shape {given.shape}; it must be a number or have shape ({dim},)")
    return given


def gravity_of_file(value: Any, dim: int) -> Any:
    """Return gravity as stored; a number below 0, as version 0.1 allowed, becomes the vector that it meant."""
    return (0.0,) * (dim - 1) + (-value,) if np.ndim(value) == 0 and (value or 0.0) < 0 else value


def point(name: str, value: ArrayLike) -> tuple[float, ...]:
    """Return a point of 1 to 3 coordinates as a tuple; raise ValueError if `value` is no point."""
    return tuple(map(float, vector(name, value)))


def direction(name: str, value: ArrayLike) -> tuple[float, ...]:
    """Return a direction of unit length as a tuple; raise ValueError if `value` is no direction."""
    direction = array(name, value)
    if direction.ndim != 1 or not np.isfinite(direction).all() or not direction.any():
        raise ValueError(f"{name} is {repr_short(value)}; it must be a finite direction other than zero")
    # A power of two brings the largest coordinate to 1/2 … 1 without rounding: no square is too large or small.
    direction = np.ldexp(direction, -np.frexp(np.abs(direction).max())[1])
    return tuple(map(float, direction / np.linalg.norm(direction)))


def color(name: str, color: str) -> tuple[float, float, float]:
    """Return a color "#rrggbb" as three numbers in 0 … 1; raise ValueError naming the argument for other text."""
    if not isinstance(color, str) or not re.fullmatch(r"#[0-9a-fA-F]{6}", color):
        raise ValueError(f"{name} is {color!r}; it must be a color of the form '#rrggbb'")
    red, green, blue = (int(color[k : k + 2], 16) / 255 for k in (1, 3, 5))
    return red, green, blue


def imported(name: str, missing: str) -> Any:
    """Return an optional package, imported; raise ValueError with the message `missing` if it is not installed."""
    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise ValueError(missing) from error


def free_memory() -> int | None:
    """Return the number of bytes of memory that are free for this process; None if unknown."""
    found = []
    with suppress(OSError, ValueError, StopIteration):
        lines = Path("/proc/meminfo").read_text().splitlines()
        found.append(1024 * int(next(line for line in lines if line.startswith("MemAvailable")).split()[1]))
    with suppress(OSError, ValueError):  # that of a container
        most, taken = (int((Path("/sys/fs/cgroup") / f"memory.{name}").read_text()) for name in ("max", "current"))
        stat = dict(line.split() for line in (Path("/sys/fs/cgroup") / "memory.stat").read_text().splitlines())
        found.append(most - taken + int(stat.get("inactive_file", 0)))
    return min(found, default=None)


def fits(given: str, what: str, size: float) -> None:
    """Raise ValueError if something of `size` bytes does not fit into memory.

    The message begins with the given argument, such as "size is 3"; `what` names the resulting object.
    """
    if size < 1e8:  # checking would take longer than allocating
        return
    free = free_memory()
    if free is not None and size > free:
        raise ValueError(f"{given}; {what} take {size / 1e9:.3g} GB of memory, and {free / 1e9:.3g} GB are free")
