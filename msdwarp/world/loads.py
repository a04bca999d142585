"""Loads: what acts on a system from outside, beside gravity and obstacles."""

from collections.abc import Sequence
from dataclasses import MISSING, dataclass, fields
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import checks
from ..bodies import System, selected
from .time_functions import sampled


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Load:
    """The base class of all loads.

    Parameters
    ----------
    on
        The particles that it acts on: a group's name (see `System.named`), indices, or a mask; by default all.
    """

    on: Any = None
    argument: ClassVar[str] = "loads"
    """The argument of a scene that it is given by."""

    def __repr__(self) -> str:
        own = [one for one in fields(self) if one.name != "on"]
        required = [one.name for one in own if one.default is MISSING]
        said = [in_words(getattr(self, name)) for name in required]
        said += [] if self.on is None else [f"on={particles_in_words(self.on)}"]
        for one in own:
            value = getattr(self, one.name)
            if one.name not in required and value is not one.default and not _equal(value, one.default):
                said.append(f"{one.name}={in_words(value)}")
        return f"{type(self).__name__}({', '.join(said)})"

    def particles(self, system: System) -> NDArray[np.bool_]:
        """Return the particles that it acts on, shape [particle_count].

        Raises
        ------
        ValueError
            If there is no such group, an index is out of range, or there are no particles.
        """
        return particles_meant(self.on, system)

    def check(self, system: System) -> None:
        """Raise ValueError if it cannot act on this system."""
        self.particles(system)

    def bound(self, system: System) -> "Load":
        """Return the load with the values that it takes from the starting state."""
        return self


@dataclass(frozen=True, eq=False, repr=False)
class Force(Load):
    """A force on particles.

    Parameters
    ----------
    force
        The force on each particle [N]: a vector of shape [d]; a function of time [s] that returns one; or, for a
        force that depends on position or velocity, a `wp.func` (x, v, t, i) -> force on particle i at position x
        [m] with velocity v [m/s] at time t. The latter is compiled into the scene's kernels: it must take vectors
        of the scene's precision, or `Any`.
    on
        The particles that it acts on; see `Load`.
    total
        Whether `force` is the sum over these particles, shared equally.

    Raises
    ------
    ValueError
        If a vector is not finite, or `total` is used with a function of position.
    """

    force: Any
    total: bool = False

    def __post_init__(self) -> None:
        """Check the arguments."""
        checks.one_of("total", self.total, (False, True))
        if self.of_place and self.total:
            raise ValueError("total is True; a force that is a function of place acts on each particle by itself")
        if not self.of_place and not self.varies:
            object.__setattr__(self, "force", checks.point("force", self.force))

    @property
    def of_place(self) -> bool:
        """Whether it is a `wp.func`, a function of position, velocity and time."""
        return is_device_function(self.force)

    @property
    def varies(self) -> bool:
        """Whether it is a function of time."""
        return callable(self.force)

    def check(self, system: System) -> None:
        """Raise ValueError if it cannot act on this system."""
        super().check(system)
        if not self.of_place:
            self.at(np.zeros(1), system.dim, "force")

    def at(self, times: NDArray[np.float64], dim: int, name: str = "force") -> NDArray[np.float64]:
        """Return the force at these times [N], shape [time_count, d]."""
        return values_at(name, self.force, times, dim)


def particles_meant(on: Any, system: System) -> NDArray[np.bool_]:
    """Return the particles that a group's name, indices, a mask, or None for all mean, shape [particle_count].

    Raises
    ------
    ValueError
        If there is no such group, an index is out of range, or there are no particles.
    """
    if on is None:
        return np.ones(system.particle_count, dtype=bool)
    chosen = system.group(on, "on") if isinstance(on, str) else selected("on", on, system.particle_count)
    if not chosen.any():
        raise ValueError(f"on is {checks.repr_short(on)}; it must name one particle at least")
    return chosen


def in_words(value: Any) -> str:
    """Return a number, a vector or a function as text: a function by its name, never an array."""
    if callable(value):
        return named(value)
    given = np.asarray(value)
    if given.dtype.kind not in "if":
        return repr(value)
    if given.ndim == 0:
        return f"{given:g}"
    return (
        f"({', '.join(f'{one:g}' for one in given)})"
        if given.shape in ((1,), (2,), (3,))
        else f"{given.size} numbers"
    )


def particles_in_words(on: Any) -> str:
    """Return a group's name, or how many particles are meant."""
    if isinstance(on, str):
        return repr(on)
    given = np.asarray(on)
    count = int(given.sum()) if given.dtype == bool else given.size
    return f"{count} particle{'' if count == 1 else 's'}"


def named(function: Any) -> str:
    """Return what a function is called, else its type."""
    return getattr(function, "__name__", None) or getattr(function, "key", None) or type(function).__name__


def _equal(one: Any, other: Any) -> bool:
    plain = (bool, int, float, str)
    return isinstance(one, plain) and isinstance(other, plain) and one == other


def is_device_function(given: Any) -> bool:
    """Tell whether something is a `wp.func`, to be compiled into kernels."""
    return type(given).__module__.partition(".")[0] == "warp"


def values_at(name: str, given: ArrayLike | Any, times: NDArray[np.float64], width: int) -> NDArray[np.float64]:
    """Return numbers, or what a function of time gives, at these times, shape [time_count, width].

    Raises
    ------
    ValueError
        If they are not as many, or one is not finite.
    """
    if not callable(given):
        values = np.atleast_2d(np.asarray(given, dtype=np.float64))
    else:
        try:
            values = sampled(given, times)
        except Exception as error:
            raise ValueError(f"{name} has no value from {times[0]:g} s to {times[-1]:g} s: {error}") from error
    if values.shape[1] != width:
        numbers = "number" if width == 1 else "numbers"
        raise ValueError(f"{name} has {values.shape[1]} numbers; it must have {width} {numbers}")
    wrong = ~checks.FINITE[0](values).all(axis=1)
    if wrong.any():
        k = int(np.argmax(wrong))
        raise ValueError(
            f"{name} is {checks.repr_short(values[k])} at {times[k]:g} s; it must be {checks.FINITE[1]}"
        )
    return np.broadcast_to(values, (len(times), width))


def check_loads(loads: Sequence[Load], system: System) -> None:
    """Raise ValueError that names a load which cannot act on this system."""
    for k, one in enumerate(loads):
        try:
            one.check(system)
        except ValueError as error:
            raise ValueError(f"loads[{k}].{error}" if one.argument == "loads" else str(error)) from error
