"""Selection of particles by indices, a slice or a mask."""

from collections.abc import Mapping
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from .. import checks


class Grouped(Protocol):
    """What has particles, some of them in groups with names: a `System`."""

    @property
    def particle_count(self) -> int:
        """Number of particles."""
        ...

    def group(self, name: str, argument: str = "group") -> NDArray[np.bool_]:
        """Return the mask of the particles in a group, shape [particle_count]."""
        ...


def selected(name: str, selection: Any, count: int) -> NDArray[np.bool_]:
    """Return a mask of shape [count] that selects particles by indices, a slice or a mask.

    Raises ValueError that names the argument if it is none of these, an index is out of range, or whole
    numbers look like a mask.
    """
    chosen = np.zeros(count, dtype=bool)
    wrong = f"{name} does not index {count} particles: "
    allowed = "it must be indices, a slice or a mask of booleans"
    # None, True and False would select all: NumPy inserts a new axis for them.
    if selection is None or isinstance(selection, bool | np.bool_ | str):
        raise ValueError(wrong + f"it is {selection!r}; {allowed}")
    try:
        where = selection if isinstance(selection, slice) else np.asarray(selection)
        if isinstance(where, slice) or where.size:  # an empty list selects nothing
            chosen[where] = True
    except (IndexError, TypeError, ValueError) as error:
        raise ValueError(wrong + f"{error}; {allowed}") from error
    if isinstance(where, np.ndarray):
        check_no_mask(name, where, count)
    return chosen


def particles_meant(name: str, which: Any, system: Grouped, *, some: bool = True) -> NDArray[np.bool_]:
    """Return a mask of particles, shape [particle_count], for a group's name, indices, a mask, or None for all.

    Raises ValueError naming the argument if there is no such group or index or, with `some`, it names no particle.
    """
    return np.ones(system.particle_count, dtype=bool) if which is None else chosen(name, which, system, some)


def chosen(name: str, which: Any, system: Grouped, some: bool = True) -> NDArray[np.bool_]:
    """Return a mask of particles as `particles_meant` does, but raise ValueError for None."""
    mask = system.group(which, name) if isinstance(which, str) else selected(name, which, system.particle_count)
    if some and not mask.any():
        raise ValueError(f"{name} is {checks.repr_short(which)}; it must name one particle at least")
    return mask


def mask_of(where: Any, count: int) -> NDArray[np.bool_]:
    """Return a mask of shape [count] that is True at these indices."""
    mask = np.zeros(count, dtype=bool)
    mask[where] = True
    return mask


def check_no_mask(name: str, where: NDArray, count: int) -> None:
    """Raise ValueError for a mask of integers, which as indices would mean the first two particles.

    Such a mask has an entry for each particle and only values 0 and 1, at least one of them twice.
    """
    zeros_and_ones = where.dtype.kind in "iu" and where.shape == (count,) and np.isin(where, (0, 1)).all()
    if zeros_and_ones and len(np.unique(where)) < count:
        raise ValueError(
            f"{name} holds 0 and 1 for each of {count} particles, which as indices are the first two: "
            "a mask must be of booleans, such as mask == 1"
        )


def body_name(groups: Mapping[str, NDArray], particles: NDArray) -> str:
    """Return what a message calls the body of these particles, in order: by its group's name if it has one."""
    names = (name for name, of in groups.items() if np.array_equal(np.sort(of), particles))
    return next(map(repr, names), f"the body of particle {particles[0]}")
