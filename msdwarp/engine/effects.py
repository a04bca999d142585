"""The effects there are, and which of them a scene has."""

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, NamedTuple

from ..world import Collider
from .contact import Contact
from .effect import Effect
from .tearing import Tearing
from .yielding import Yielding

if TYPE_CHECKING:
    from .model import Model


class Surroundings(NamedTuple):
    """What a system is in, as a scene says it."""

    colliders: Sequence[Collider] = ()
    """Obstacles, in the order in which a particle meets them."""
    contact: str = "coulomb"
    """The contact rule, "coulomb" or "report"."""


EFFECTS: list[Callable[["Model", Surroundings], Effect | None]] = [
    lambda model, around: Contact(model, around.colliders, around.contact) if around.colliders else None,
    lambda model, around: Yielding(model) if model.system.yields else None,
    lambda model, around: Tearing(model) if model.system.tears else None,
]
"""For each effect a function that returns it, or None where the scene lacks it."""


def effects_of(model: "Model", around: Surroundings) -> list[Effect]:
    """Return the effects that a scene has."""
    found = (make(model, around) for make in EFFECTS)
    return [effect for effect in found if effect is not None]
