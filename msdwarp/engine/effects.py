"""The effects there are, and which of them a scene has."""

from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType
from typing import TYPE_CHECKING, NamedTuple

from ..kernels.effect import Piece
from ..world import CONTACT_FORCE, TOUCH_FORCE, Collider, Load, Probe, Touch
from .actuating import actuating
from .attaching import attaching
from .blowing import blowing
from .contact import Contact
from .driving import driving
from .effect import Effect
from .forcing import Steady, forcing
from .mixing import mixing
from .pressing import pressing
from .straddling import straddling
from .tearing import Tearing
from .ties import Ties
from .touching import Touching
from .touching_worlds import TouchingWorlds
from .work import Work
from .yielding import Yielding

if TYPE_CHECKING:
    from .model import Model


class Surroundings(NamedTuple):
    """What a system is in, as a scene says it."""

    colliders: Sequence[Collider] = ()
    """Obstacles, in the order in which a particle meets them."""
    contact: str = "coulomb"
    """The contact rule, "coulomb" or "report"."""
    loads: Sequence[Load] = ()
    """What else acts on the system."""
    probes: Mapping[str, Probe] = MappingProxyType({})
    """What is measured, by name."""
    contact_forces: bool = False
    """Whether what contacts push each particle with is asked for."""

    def asks_for(self, *quantities: str) -> bool:
        """Tell whether a probe asks for one of these, or the contact forces are asked for as they are."""
        return self.contact_forces or any(one.what in quantities for one in self.probes.values())


def contact(model: "Model", around: Surroundings) -> Contact:
    """Return the effect of the obstacles that there are."""
    return Contact(model, around.colliders, around.contact, around.asks_for(CONTACT_FORCE))


def touching(model: "Model", around: Surroundings) -> Touching | None:
    """Return the effect of contact between bodies, if they touch."""
    rules = [one for one in around.loads if isinstance(one, Touch)]
    if not any(one.between != "none" for one in rules):
        return None
    if model.in_worlds:
        return TouchingWorlds(model, rules)
    return Touching(model, rules, around.asks_for(CONTACT_FORCE, TOUCH_FORCE))


EFFECTS: list[Callable[["Model", Surroundings], Effect | Sequence[Effect] | None]] = [
    lambda model, around: contact(model, around) if around.colliders else None,
    lambda model, around: Yielding(model) if model.system.yields else None,
    lambda model, around: Tearing(model) if model.system.tears else None,
    lambda model, around: driving(model, around.loads),
    lambda model, around: Ties(model) if model.lattice is not None and len(model.lattice.ties) else None,
    lambda model, around: forcing(model, around.loads),
    lambda model, around: mixing(model, around.loads),  # what it finds is read by the next two
    lambda model, around: blowing(model, around.loads),
    lambda model, around: pressing(model, around.loads),
    lambda model, around: attaching(model, around.loads),
    lambda model, around: actuating(model, around.loads),
    touching,
]
"""For each kind of effect a function that returns it, or those of its kind, or None where the scene lacks it."""


def effects_of(model: "Model", around: Surroundings) -> list[Effect]:
    """Return the effects that a scene has."""
    found: list[Effect] = []
    for make in EFFECTS:
        made = make(model, around)
        found += [made] if isinstance(made, Effect) else made or []
    between = straddling(model, around.colliders, around.loads, found)
    found += [between] if between is not None else []
    summed = any(isinstance(effect.piece, Piece) and effect.piece.works for effect in found)
    steady = next((effect for effect in found if isinstance(effect, Steady)), None)
    others = [effect for effect in found if effect.done is not None]
    if summed or steady is not None or others:
        found.append(Work(model, summed=summed, steady=steady, others=others))
    return found
