"""The effects there are, and which of them a scene has."""

from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType
from typing import TYPE_CHECKING, NamedTuple

from ...kernels.effect import ForceTerm
from ...world import BODY_CONTACT_FORCE, CONTACT_FORCE, Collider, Contact, Load, Probe
from ..collision.body_contact import BodyContact
from ..collision.body_contact_worlds import BodyContactWorlds
from ..collision.colliders import Colliders
from ..collision.surface_contact import straddling
from ..loads.actuators import actuating
from ..loads.attachments import attaching
from ..loads.drives import driving
from ..loads.embedded_vertices import mixing
from ..loads.external_work import Work
from ..loads.forces import Steady, forcing
from ..loads.pressure import pressing
from ..loads.wind import blowing
from ..model.effect import Effect
from ..springs.extra_springs import ExtraSprings
from ..springs.fracture import Fracture
from ..springs.plasticity import Plasticity

if TYPE_CHECKING:
    from ..model.model import Model


class Surroundings(NamedTuple):
    """What a system is in, as a scene says it."""

    colliders: Sequence[Collider] = ()
    """Obstacles, in the order in which a particle meets them."""
    collider_rule: str = "coulomb"
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


def collider_rule(model: "Model", around: Surroundings) -> Colliders:
    """Return the effect of the obstacles that there are."""
    return Colliders(model, around.colliders, around.collider_rule, around.asks_for(CONTACT_FORCE))


def touching(model: "Model", around: Surroundings) -> BodyContact | None:
    """Return the effect of contact between bodies, if they touch."""
    rules = [one for one in around.loads if isinstance(one, Contact)]
    if all(one.exclude for one in rules):
        return None
    if model.in_worlds:
        return BodyContactWorlds(model, rules)
    return BodyContact(model, rules, around.asks_for(CONTACT_FORCE, BODY_CONTACT_FORCE))


EFFECTS: list[Callable[["Model", Surroundings], Effect | Sequence[Effect] | None]] = [
    lambda model, around: collider_rule(model, around) if around.colliders else None,
    lambda model, around: Plasticity(model) if model.system.yields else None,
    lambda model, around: Fracture(model) if model.system.tears else None,
    lambda model, around: driving(model, around.loads),
    lambda model, around: ExtraSprings(model) if model.lattice is not None and len(model.lattice.ties) else None,
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
    summed = any(isinstance(effect.piece, ForceTerm) and effect.piece.works for effect in found)
    steady = next((effect for effect in found if isinstance(effect, Steady)), None)
    others = [effect for effect in found if effect.done is not None]
    if summed or steady is not None or others:
        found.append(Work(model, summed=summed, steady=steady, others=others))
    return found
