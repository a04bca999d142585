"""Several built-in laws in one system: each connection follows one of them."""

from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import checks
from .dampers import Damper, OwnDamper, UnknownDamper
from .springs import OwnSpring, Spring, UnknownSpring

MOST_LAWS = 16
"""Maximal number of laws of springs, and of dampers, so that a byte can number the pairs of them."""


class LawKinds:
    """Several laws, and which of them each connection follows.

    Parameters
    ----------
    laws
        One to 16 different built-in laws.
    kind
        Index in `laws` of each connection's law, shape [connection_count]; of two laws a mask chooses the second.

    Raises
    ------
    ValueError
        If a law is given twice or is not built-in, or an index is out of range.
    """

    laws: tuple[Any, ...]
    kind: NDArray[np.uint8]

    def __init__(self, laws: Any, kind: ArrayLike) -> None:
        laws = checks.sequence("laws", laws, Spring if isinstance(self, Spring) else Damper, "QuadraticDamper()")
        others = LawKinds | OwnSpring | OwnDamper | UnknownSpring | UnknownDamper
        if any(isinstance(law, others) for law in laws) or not 1 <= len(set(laws)) == len(laws) <= MOST_LAWS:
            raise ValueError(f"laws is {laws}; it must be one to {MOST_LAWS} different built-in laws")
        given = np.asarray(kind)
        if given.ndim != 1 or given.dtype.kind not in "iub":
            raise ValueError(f"kind is {checks.repr_short(kind)}; it must be a whole number for each connection")
        checks.within("kind", given, checks.index_below(len(laws)))
        self.__dict__.update(laws=laws, kind=given.astype(np.uint8))
        self.kind.flags.writeable = False

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, LawKinds) or type(other) is not type(self):
            return False
        return other.laws == self.laws and np.array_equal(self.kind, other.kind)

    def __repr__(self) -> str:
        counts = np.bincount(self.kind, minlength=len(self.laws))
        each = (f"{law!r} of {count}" for law, count in zip(self.laws, counts, strict=True))
        return f"{type(self).__name__}({', '.join(each)})"

    def ordered(self, order: Any) -> Self:
        """Return the laws of connections in another order: connection k is the former order[k]."""
        return type(self)(self.laws, self.kind[order])


class SpringKinds(LawKinds, Spring):
    """Several laws of springs, such as `Spring()` for struts and `TensionOnlySpring()` for cables."""


class DamperKinds(LawKinds, Damper):
    """Several laws of dampers: see `LawKinds`."""

    @property
    def steepest(self) -> Any:
        """Largest slope of each connection's law, shape [connection_count]."""
        return np.array([law.steepest for law in self.laws])[self.kind]


def each_law(law: Any, count: int) -> tuple[tuple[Any, ...], NDArray[np.uint8]]:
    """Return the laws of so many connections, and which of them each follows."""
    return (law.laws, law.kind) if isinstance(law, LawKinds) else ((law,), np.zeros(count, dtype=np.uint8))


def joined_laws(one: Any, count: int, other: Any, more: int, used: Any = (True, True)) -> Any:
    """Return the law, or the laws, of `count` connections followed by `more`; a law that is not `used` gives way.

    Raises ValueError if the laws differ, and one of them is not built-in.
    """
    parts = each_law(one, count), each_law(other, more)
    laws = list(dict.fromkeys(law for (of, _), use in zip(parts, used, strict=True) if use for law in of)) or [one]
    if len(laws) == 1:
        return laws[0]
    places = [np.array([laws.index(law) if law in laws else 0 for law in of])[kind] for of, kind in parts]
    return (SpringKinds if isinstance(one, Spring) else DamperKinds)(laws, np.concatenate(places))
