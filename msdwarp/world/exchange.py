"""Exchange: loads that take the place of others, and differ from them in values alone."""

from collections.abc import Sequence
from typing import Any

from .loads import Force, Load
from .mouse_spring import MouseSpring
from .wind import Wind


def differ_in_values(before: Sequence[Load], after: Sequence[Load]) -> dict[Load, Load] | None:
    """Return what stands for each load that is replaced; None where more than values differs.

    A force may have another vector, or function of time where it had one; wind also other coefficients. What
    they act on is the same: the same name, or the same object. A hand may hold others, as many as it has room for.
    """
    if len(before) != len(after):
        return None
    others = {}
    for old, new in zip(before, after, strict=True):
        if old is new:
            continue
        if not _alike(old, new):
            return None
        others[old] = new
    return others


def _alike(old: Load, new: Load) -> bool:
    if isinstance(old, MouseSpring) and isinstance(new, MouseSpring):
        return old.room == new.room
    return type(old) is type(new) and isinstance(old, Force | Wind) and _on_the_same(old, new)


def _on_the_same(old: Any, new: Any) -> bool:
    """Tell whether two forces, or winds, act on the same, and are functions of the same."""
    same = ["total"] if isinstance(old, Force) else ["area"]
    alike = all(_same(getattr(old, name), getattr(new, name)) for name in ("on", *same))
    return alike and not old.of_place and not new.of_place and old.varies == new.varies


def _same(one: Any, other: Any) -> bool:
    plain = (str, bool, int, float)
    return one is other or (isinstance(one, plain) and isinstance(other, plain) and one == other)
