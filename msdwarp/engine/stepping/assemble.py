"""Assembly: a model and the effects of a scene; `assemble` makes it."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import warp as wp
from numpy.typing import NDArray

from ... import checks
from ...bodies import behind_surfaces
from ...kernels.effect import ForceTerm
from ...runtime import in_turn
from ...world import (
    BODY_CONTACT_FORCE,
    CONTACT_FORCE,
    WRENCH,
    Collider,
    Load,
    Problem,
    driven_particles,
    radii,
)
from ..collision.body_contact import BodyContact
from ..collision.colliders import Colliders
from ..collision.penetration_depth import start_depths, touching
from ..collision.soft_colliders import SoftColliders
from ..collision.surface_contact import SurfaceContact, surface_contact_of
from ..loads.actuators import actuators_of
from ..loads.attachments import attachments_of
from ..loads.drives import Drives, drives_of
from ..loads.elements import element_loads_of
from ..loads.external_work import Work
from ..loads.forces import Steady, forces_of_loads
from ..loads.pressure import pressures_of
from ..loads.surface_triangles import embedded_vertices_of
from ..loads.wind import winds_of
from ..model.effect import Effect
from ..model.model import CONSTANTS, Model, Rows
from ..springs.angles import AngleSprings
from ..springs.cell_volumes import CellVolumes
from ..springs.extra_springs import ExtraSprings
from ..springs.force_algorithms import note_tables
from ..springs.fracture import Fracture
from ..springs.inverted_cells import InvertedCells, note_inverted_cells
from ..springs.linearised import note_rates
from ..springs.plasticity import Plasticity
from .fire import Fire

COLLIDER_RULES = ("coulomb", "report")


class Asked(NamedTuple):
    """What a simulation asks for beside the problem."""

    collider_rule: str
    """The contact rule, "coulomb" or "report"; see `msdwarp.kernels.colliders`."""
    contact_forces: bool
    """Whether the contact force on each particle is requested."""
    settles: bool
    """Whether the system is moved to equilibrium (`Fire`)."""


def _colliders(model: Model, problem: Problem, asked: Asked) -> Colliders | None:
    if not problem.rigid_colliders:
        return None
    summed = asked.contact_forces or problem.measures(CONTACT_FORCE, WRENCH)
    spared = behind_surfaces(model.system) if any(one.surface_colliders for one in problem.contact_rules) else None
    radius = radii(problem.contact_rules, model.system)
    return Colliders(model, problem.colliders, asked.collider_rule, summed, spared, radius)


def _soft_colliders(model: Model, problem: Problem, asked: Asked) -> SoftColliders | None:
    if len(problem.rigid_colliders) == len(problem.colliders):
        return None
    if asked.contact_forces or problem.measures(CONTACT_FORCE, WRENCH):
        raise ValueError("contact forces are asked for, and colliders has soft ones, which do not have them yet")
    return SoftColliders(model, problem.colliders, radii(problem.contact_rules, model.system))


def _body_contact(model: Model, problem: Problem, asked: Asked) -> BodyContact | None:
    rules = problem.contact_rules
    if all(one.exclude for one in rules):
        return None
    summed = asked.contact_forces or problem.measures(CONTACT_FORCE, BODY_CONTACT_FORCE)
    shape: Any = problem.shape
    return BodyContact(model, rules, summed and not model.in_worlds, shape)


def _on_surfaces(model: Model, loads: Sequence[Load]) -> list[Effect]:
    """Return the effects of wind and pressure, and before them the embedded vertices on which they act."""
    vertices = embedded_vertices_of(model, loads)
    effects: list[Effect] = [] if vertices is None else [vertices]
    return effects + winds_of(model, loads, vertices) + pressures_of(model, loads, vertices)


EFFECTS: list[Callable[[Model, Problem, Asked], Effect | Sequence[Effect] | None]] = [
    _colliders,
    _soft_colliders,
    lambda model, *_: Plasticity(model) if model.system.yields else None,
    lambda model, *_: Fracture(model) if model.system.tears else None,
    lambda model, problem, _: drives_of(model, problem.loads),
    lambda model, *_: ExtraSprings(model) if model.lattice is not None and len(model.lattice.ties) else None,
    lambda model, *_: None if model.system.cells is None else CellVolumes(model),
    lambda model, *_: None if model.system.angles is None else AngleSprings(model),
    lambda model, problem, _: forces_of_loads(model, problem.loads),
    lambda model, problem, _: _on_surfaces(model, problem.loads),
    lambda model, problem, _: attachments_of(model, problem.loads),
    lambda model, problem, _: actuators_of(model, problem.loads),
    lambda model, problem, _: element_loads_of(model, problem.loads),
    _body_contact,
]
"""A function for each kind of effect; it returns one effect, several, or None if the scene has none."""


class Assembly:
    """A model, and the effects that act on it.

    Attributes
    ----------
    all
        Every effect, in the order in which they act.
    colliders, fracture, plasticity, drives, body_contact, surface_contact, external_work, fire
        The effect of that kind; None if the scene has none.
    sums_contact_forces
        Whether effects sum the contact forces on particles.
    """

    def __init__(self, model: Model, problem: Problem, asked: Asked) -> None:
        self.model, self.probes, self._start = model, problem.probes, model.system.position
        measured = CONTACT_FORCE, BODY_CONTACT_FORCE, WRENCH
        self.sums_contact_forces = asked.contact_forces or problem.measures(*measured)
        self.all: list[Effect] = []
        note_rates(model)
        note_inverted_cells(model)
        note_tables(model)
        for make in EFFECTS:
            effects = make(model, problem, asked)
            self.all += [effects] if isinstance(effects, Effect) else effects or []
        self.colliders = self._one_of(Colliders)
        self.fracture = self._one_of(Fracture)
        self.plasticity = self._one_of(Plasticity)
        self.drives = self._one_of(Drives)
        self.body_contact: Any = self._one_of(BodyContact)
        if self.body_contact is not None and self.fracture is not None:
            self.body_contact.tear(self.fracture.broken_at)
        self.surface_contact: SurfaceContact | None = None
        if self.colliders is not None and self.body_contact is not None:
            obstacles = problem.rigid_colliders
            if asked.settles:  # the dampers of contact would make FIRE stop again and again
                obstacles = [replace(one, restitution=1.0) for one in obstacles]
            self.surface_contact = surface_contact_of(
                model, self.colliders, self.body_contact, obstacles, problem.loads
            )
        self.all += [self.surface_contact] if self.surface_contact is not None else []
        self.all += [self.body_contact.planes] if self.body_contact is not None else []
        self.external_work = self._work()
        self.all += [self.external_work] if self.external_work is not None else []
        self.fire = Fire(model) if asked.settles else None
        self.all += [self.fire] if self.fire is not None else []  # after everything else that changes velocities
        model.kernels.compile()

    def release_overlaps_within(self, seconds: float) -> bool:
        """Move apart what overlaps at the start within a time [s]; return whether anything does."""
        effects = (self.colliders, self.surface_contact, self.body_contact)
        overlapping = [one for one in effects if one is not None and one.overlapping_at_start]
        for effect in overlapping:
            effect.release_overlap_within(seconds)
        return bool(overlapping)

    def contacts(self) -> dict[str, NDArray]:
        """Return which surfaces touch, and how far they have slipped; not how fast they came, to be at rest."""
        effects = [one for one in (self.surface_contact, self.body_contact) if one is not None]
        each = {name: values for one in effects for name, values in one.checkpoint().items()}
        return {name: values for name, values in each.items() if not name.endswith(".fastest")}

    def press(self, contacts: Mapping[str, NDArray]) -> None:
        """Take over `contacts` of the same system at rest: what overlaps is pressed together, with friction."""
        for effect in (self.surface_contact, self.body_contact):
            if effect is not None:
                effect.take_history(contacts)
                effect.allow_none()

    def _one_of(self, kind: type) -> Any:
        """Return the effect of a kind, or None."""
        return next((effect for effect in self.all if isinstance(effect, kind)), None)

    def _work(self) -> Work | None:
        """Return the effect that sums the work of others; None if none does work."""
        summed = any(isinstance(effect.term, ForceTerm) and effect.term.works for effect in self.all)
        steady = self._one_of(Steady)
        others = [effect for effect in self.all if effect.done is not None]
        if not summed and steady is None and not others:
            return None
        return Work(self.model, summed=summed, steady=steady, others=others)

    def keep_work(self, before: NDArray) -> Work:
        """Keep earlier work [J], shape [worlds], where nothing does work any more; return what keeps it."""
        if self.external_work is None:
            self.external_work = Work(self.model, summed=False, steady=None)
            self.external_work.before[:] = before
            self.all.append(self.external_work)
        return self.external_work

    @cached_property
    def inverted_cells(self) -> InvertedCells:
        """Finds the cells that are turned inside out; made when first asked for."""
        return InvertedCells(self.model, self.fracture, self._start)

    @property
    def begins_substeps(self) -> bool:
        """Whether springs change when a substep begins, by an effect or because they break."""
        terms = [one.term for one in self.all if isinstance(one.term, ForceTerm)]
        return self.fracture is not None or any(term.begin is not None for term in terms)

    def checkpoints(self) -> list[dict[str, NDArray]]:
        """Return for each world the effects' arrays, from which a single run can continue."""
        found: list[dict[str, NDArray]] = [{} for _ in range(self.model.worlds)]
        for effect in self.all:
            if effect is self.body_contact:
                parts = self.body_contact.checkpoints()
            else:
                arrays = {name: np.split(one, self.model.worlds) for name, one in effect.checkpoint().items()}
                parts = [{name: one[w] for name, one in arrays.items()} for w in range(self.model.worlds)]
            found = [others | part for others, part in zip(found, parts, strict=True)]
        return found

    @in_turn
    def changed_fields(self) -> dict[str, NDArray]:
        """Return the fields of the system that substeps have changed, except positions and velocities."""
        return {name: array for effect in self.all for name, array in effect.changed_fields().items()}

    def take_over(
        self, other: "Assembly", x: wp.array, v: wp.array, restored: Mapping[str, NDArray] | None = None
    ) -> None:
        """Copy the work and the state of each effect from `other`, the assembly before a change of the scene.

        x [m] and v [m/s] are the current positions and velocities in `other`. If a checkpoint is `restored`, its
        work counts, also that of loads which are gone.
        """
        if restored is None and other.external_work is not None:
            self.keep_work(np.zeros(self.model.worlds)).before += other.external_work.totals(x, v)
        elif restored is not None and "work.before" in restored:
            self.keep_work(restored["work.before"])
        for effect in self.all:
            same = next((one for one in other.all if type(one) is type(effect)), None)
            if same is not None:
                effect.go_on_from(same)
        self._start = other._start


@in_turn
def assemble(
    problem: Problem,
    *,
    collider_rule: str = "coulomb",
    contact_forces: bool = False,
    settles: bool = False,
    device: str | None = None,
    precision: str = "float32",
    force_algorithm: str = "auto",
    worlds: int = 1,
    rows: Rows | None = None,
) -> Assembly:
    """Return a problem on a device, with its effects: `Problem` has checked it, the effects convert and upload it.

    See `Simulation` for the options, `Asked` for `settles`, and `Model` for `worlds` and `rows`. Raises ValueError
    if an option is out of range.
    """
    checks.one_of("collider_rule", collider_rule, COLLIDER_RULES)
    begun, system = problem.begun(), problem.system
    model = Model(
        system,
        gravity=problem.gravity,
        driven=driven_particles(begun.loads, system),
        device=device,
        precision=precision,
        force_algorithm=force_algorithm,
        worlds=worlds,
        rows=rows,
    )
    return Assembly(model, begun, Asked(collider_rule, contact_forces, settles))


def assemble_worlds(problem: Problem, worlds: int, rows: Rows, **options: Any) -> Assembly:
    """Return many worlds of a problem on a device, as `assemble` does with these options.

    Raises ValueError if the problem has a feature that ensembles lack, or a number exceeds the precision's range.
    """
    for k, one in enumerate(problem.colliders):
        if one.stiffness is not None and "friction" in rows:
            raise ValueError(
                f"friction differs between worlds, and colliders[{k}] has a stiffness; the friction of a soft "
                "obstacle must be the same in all worlds"
            )
    if any(one.surface_colliders for one in problem.contact_rules):
        raise ValueError("contact has surface_colliders=True, which worlds of an ensemble cannot have yet")
    for k, one in enumerate(problem.loads):
        if "position" in rows and one.of_start:
            raise ValueError(
                f"position differs between worlds, and loads[{k}], {one.given or one!r}, starts from the "
                "positions of the scene; in an ensemble with such a load all worlds must start alike"
            )
    assembly = assemble(problem, worlds=worlds, rows=rows, **options)
    model = assembly.model
    if model.system.tears and model.force_algorithm == "stencil" and model.rows.keys() & set(CONSTANTS):
        raise ValueError(
            "force_algorithm is 'stencil', and the system can tear; where the constants of connections differ "
            "between worlds, it must be another"
        )
    if assembly.colliders is not None:
        _check_starts(model, problem.rigid_colliders, assembly.colliders.radius)
    return assembly


def _check_starts(model: Model, colliders: Sequence[Collider], radius: NDArray) -> None:
    """Raise ValueError if worlds that differ start inside obstacles, since all worlds share one depenetration."""
    if not {"position", "rest_length", "mass"} & model.rows.keys():
        return
    depths = np.array([start_depths(x, colliders, radius).max(axis=0) for x in model.row_of("position")])
    depths = np.where(np.isfinite(model.row_of("mass")).any(axis=0), depths, 0.0)
    if depths.max() > touching(model.system):
        row, particle = np.unravel_index(np.argmax(depths), depths.shape)
        raise ValueError(
            f"particle {particle} of world {row} starts {depths.max():.3g} m inside an obstacle; where "
            "positions, rest lengths or masses differ between worlds, all particles must start outside"
        )
