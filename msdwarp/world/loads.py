"""Loads: external actions on a system, besides gravity and obstacles.

A `Force` with a `wp.func` needs no new class, an `ElementLoad` no effect. Any other new load needs an effect in
`engine/loads`, and a line in `EFFECTS` of `engine/stepping/assemble.py`; without them it has no force, and nobody
is told.
"""

from collections.abc import Sequence
from dataclasses import MISSING, dataclass, fields
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import checks
from ..bodies import Facets, System, counted, facets_of, particles_meant
from .described import Described
from .time_functions import sampled


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Load(metaclass=Described):
    """The base class of all loads.

    Parameters
    ----------
    on
        The particles acted on: a group's name (see `System.named`), indices, or a mask; by default all.
    """

    on: Any = None
    argument: ClassVar[str] = "loads"
    """Argument of a scene under which the load is given."""
    constant: ClassVar[tuple[str, ...]] = ()
    """Fields in which a load must equal one that replaces it between frames; if empty, none can replace it."""
    of_start: ClassVar[bool] = False
    """Whether `bound` takes values from the positions of the start, which worlds must then share."""
    given: ClassVar["Load | None"] = None
    """The load of which this is the `bound` one, as the user gave it; None if it is not bound."""

    def __repr__(self) -> str:
        required, others = [], []
        for one in fields(self):
            value = getattr(self, one.name)
            text = particles_in_words(value) if one.name == "on" and value is not None else in_words(value)
            if one.default is MISSING and not one.kw_only:
                required.append(text)
            elif text != in_words(one.default):
                others.append(f"{one.name}={text}")
        return f"{type(self).__name__}({', '.join(required + others)})"

    def particles(self, system: System) -> NDArray[np.bool_]:
        """Return a mask of the particles acted on, shape [particle_count]; raise ValueError if it is empty."""
        return particles_meant("on", self.on, system)

    def facets(self, system: System) -> Facets:
        """Return the surface triangles acted on: triangles whose corners are all among the load's particles."""
        return facets_of(system).of(self.particles(system))

    def check(self, system: System) -> None:
        """Raise ValueError if the load cannot act on this system."""
        self.particles(system)

    def bound(self, system: System) -> "Load":
        """Return the load with values computed that depend on the initial state, such as points or a volume."""
        return self


class ElementLoad(Load):
    """A load whose force is a sum over elements of a few particles, such as pairs.

    The file in `kernels/loads` that is named as that of the class has `evaluate`, see `kernels/loads/elements.py`.
    """

    law: ClassVar[str] = "evaluate"
    """Name of that function; a file with several loads has several."""
    stores: ClassVar[bool] = True
    """Whether the force is that of the energy that `evaluate` returns; else its work is external."""

    def elements(self, system: System) -> tuple[NDArray[np.integer], NDArray[np.float64]]:
        """Return the particles of each element, shape [element_count, k], and its numbers, [element_count, n]."""
        raise NotImplementedError


@dataclass(frozen=True, eq=False, repr=False)
class VectorLoad(Load):
    """A load given by a vector, a function of time that returns a vector, or a `wp.func` of position and time."""

    vector: ClassVar[str]
    """Name of the field that has the vector."""

    def __post_init__(self) -> None:
        """Check the vector."""
        if not callable(self._vector):
            object.__setattr__(self, self.vector, checks.point(self.vector, self._vector))

    @property
    def _vector(self) -> Any:
        return getattr(self, self.vector)

    @property
    def of_place(self) -> bool:
        """Whether the vector is given by a `wp.func`, to be compiled into kernels."""
        return is_device_function(self._vector)

    @property
    def varies(self) -> bool:
        """Whether the vector is a function of time."""
        return callable(self._vector) and not self.of_place

    def check(self, system: System) -> None:
        """Raise ValueError if the load cannot act on this system."""
        super().check(system)
        if not self.of_place:
            self.at(np.zeros(1), system.dim, self.vector)

    def at(self, times: NDArray[np.float64], dim: int, name: str) -> NDArray[np.float64]:
        """Return the vector at these times, shape [time_count, d]."""
        return values_at(name, self._vector, times, dim)


@dataclass(frozen=True, eq=False, repr=False)
class Force(VectorLoad):
    """A force on particles.

    Parameters
    ----------
    force
        The force on each particle [N]: a vector of shape [d]; a function of time [s] that returns one; or, for
        a force that depends on position or velocity, a `wp.func` (x, v, t, i) -> force on particle i at position x
        [m] with velocity v [m/s] at time t. A `wp.func` is compiled into the scene's kernels: it must take vectors
        of the scene's precision, or `Any`. Automatic substeps follow its slopes and changes.
    on
        The particles acted on; see `Load`.
    total
        Whether `force` is the sum over these particles, divided equally; not for a `wp.func`.
    """

    vector = "force"
    constant = ("on", "total")
    force: Any
    total: bool = False

    def __post_init__(self) -> None:
        checks.one_of("total", self.total, (False, True))
        if self.of_place and self.total:
            raise ValueError("total is True; a force that is a function of place acts on each particle by itself")
        super().__post_init__()


def in_words(value: Any) -> str:
    """Return a number, a vector or a function as text: for a function its name, never a whole array."""
    if callable(value):
        return named(value)
    given = np.asarray(value)
    if given.dtype.kind not in "if":
        return repr(value)
    if given.ndim == 0:
        return f"{given:g}"
    several = given.shape not in ((1,), (2,), (3,))
    return f"{given.size} numbers" if several else f"({', '.join(f'{one:g}' for one in given)})"


def particles_in_words(on: Any) -> str:
    """Return a group's name, or the number of particles, as text."""
    if isinstance(on, str):
        return repr(on)
    given = np.asarray(on)
    return counted(int(given.sum()) if given.dtype == bool else given.size, "particle")


def named(function: Any) -> str:
    """Return the name of a function; if it has none, of its type."""
    return getattr(function, "__name__", None) or getattr(function, "key", None) or type(function).__name__


def is_device_function(given: Any) -> bool:
    """Return whether the argument is a `wp.func`, to be compiled into kernels."""
    return type(given).__module__.partition(".")[0] == "warp"


def values_at(name: str, given: ArrayLike | Any, times: NDArray[np.float64], width: int) -> NDArray[np.float64]:
    """Return constant values, or values of a function of time, at these times, shape [time_count, width].

    Raises ValueError if there are not `width` values, or one is not finite.
    """
    if not callable(given):
        values = np.atleast_2d(np.asarray(given, dtype=np.float64))
    else:
        try:
            values = sampled(given, times)
        except Exception as error:
            span = f"from {times[0]:g} s to {times[-1]:g} s"
            raise ValueError(f"{name} has no value {span}: {checks.message(error)}") from error
    if values.shape[1] != width:
        raise ValueError(f"{name} has {values.shape[1]} numbers; it must have {counted(width, 'number')}")
    wrong = ~checks.FINITE[0](values).all(axis=1)
    if wrong.any():
        k = int(np.argmax(wrong))
        raise ValueError(
            f"{name} is {checks.repr_short(values[k])} at {times[k]:g} s; it must be {checks.FINITE[1]}"
        )
    return np.broadcast_to(values, (len(times), width))


def check_loads(loads: Sequence[Load], system: System) -> None:
    """Raise ValueError, which names the load, if a load cannot act on this system."""
    for k, one in enumerate(loads):
        try:
            one.check(system)
        except ValueError as error:
            raise ValueError(f"loads[{k}].{error}" if one.argument == "loads" else str(error)) from error


def differ_in_values(before: Sequence[Load], after: Sequence[Load]) -> dict[Load, Load] | None:
    """Return {old load: new load} of replaced loads; None if loads differ in more than values.

    The fields in `constant` must be equal. A vector must stay a vector, a function of time a function of time.
    """
    if len(before) != len(after):
        return None
    others = {old: new for old, new in zip(before, after, strict=True) if old is not new}
    return others if all(_alike(old, new) for old, new in others.items()) else None


def _alike(old: Load, new: Any) -> bool:
    if type(old) is not type(new) or not old.constant:
        return False
    if isinstance(old, VectorLoad) and (old.of_place or new.of_place or old.varies != new.varies):
        return False
    return all(_same(getattr(old, name), getattr(new, name)) for name in old.constant)


def _same(one: Any, other: Any) -> bool:
    plain = (str, bool, int, float)
    return one is other or (isinstance(one, plain) and isinstance(other, plain) and one == other)
