"""Changing: what can be changed of a simulation between two frames."""

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import checks
from ..bodies import System
from ..engine import resists
from ..integrators import Integrator, UnstableStep
from ..runtime import in_turn
from ..world import (
    Change,
    Collider,
    Contact,
    Gravity,
    Load,
    MouseSpring,
    bound,
    check_loads,
    differ_in_values,
    with_contact,
)
from .properties import PresentWorld
from .step_controller import StepController


class Changing(PresentWorld):
    """The properties of a simulation that can change between two frames."""

    _surroundings: dict[str, Any]
    """What the system is in: arguments of `Model`."""
    _acting: tuple[Load, ...]
    """The loads that act, as they were given."""
    _pace: StepController | None
    _due: list[Change]
    """The changes of the schedule that are still to come."""

    @property
    def loads(self) -> tuple[Load, ...]:
        """The loads on the system, as given."""
        return self._acting

    @property
    def colliders(self) -> tuple[Collider, ...]:
        """The obstacles."""
        return tuple(self._surroundings["colliders"])

    @property
    def gravity(self) -> Gravity:
        """Acceleration of free fall [m/s²], as given."""
        return self._surroundings["gravity"]

    def _change_as_due(self) -> None:
        """Apply the next change of the schedule."""
        try:
            self._apply(self._due[0])
        except UnstableStep as error:
            raise UnstableStep(f"after the change at {self._due[0].time:g} s {error}") from error
        del self._due[0]  # now that it has been possible

    def _stick(self, arrays: Mapping[str, NDArray]) -> None:
        """Begin with bodies that stick to each other as `BodyContact.checkpoint` says, where they may touch."""
        if self.assembly.body_contact is not None:
            self.assembly.body_contact.restore(arrays)
        self.stepping.begin_anew()
        if self._pace is not None:
            self._pace.begin(self.stepping)

    @abstractmethod
    def _load(self, system: System) -> None:
        """Upload a system and prepare to advance it, with substeps chosen anew."""

    @abstractmethod
    def _choose_anew(self) -> None:
        """Change the number of substeps if the system as it is now asks for another one."""

    @in_turn
    def change(
        self,
        *,
        group: Any = None,
        set_rest_shape: bool = False,
        unpin: Any = None,
        gravity: Gravity | None = None,
        loads: Sequence[Load] | None = None,
        contact: Contact | Sequence[Contact] | None = None,
        colliders: Sequence[Collider] | None = None,
        **parameters: Any,
    ) -> None:
        """Change gravity, loads, touch, colliders, velocities, mass, stiffness, damping or rest_length.

        A mass of inf pins a particle. A new velocity may add energy, which does not count as divergence. Automatic
        substeps and the automatic algorithm are chosen again.

        *Cost.* A new constant gravity takes about a millisecond, and so do loads if only their numbers change (the
        vector of a `Force`, the velocity and coefficients of `Wind`). New velocities are copied; with `Wind` the
        stability limit is also recomputed. A new kernel is needed, and compiled the first time, for the first
        damper, the first pinned particle, or many more kinds of connections.

        Parameters
        ----------
        loads
            All loads from now on. Previous loads that are among them continue unchanged. For new ones the current
            state is the start. Contact between bodies stays the same, unless a `Contact` is among them.
            Checkpoints do not include them.
        contact
            Contact between bodies from now on; () turns it off. Checkpoints do not include it.
        colliders
            All obstacles from now on, such as the same ones with another friction. Checkpoints do not include
            them.
        group, freeze, release, gravity, parameters
            See `msdwarp.at`.

        Raises
        ------
        ValueError
            If a name is unknown, or a value is out of range. Nothing changes then.
        """
        change = Change(self.time, group, set_rest_shape, parameters, unpin, gravity)
        if colliders is not None:
            others = (group, unpin, gravity, loads, contact)
            if set_rest_shape or parameters or any(one is not None for one in others):
                raise ValueError(
                    "colliders takes the place of all obstacles; nothing else may change in that call"
                )
            given = checks.sequence("colliders", colliders, Collider, "Plane()")
            self._go_on_with(self.snapshot(), {"colliders": given})
            return
        if loads is None and contact is None:
            self._apply(change)
            return
        if set_rest_shape or parameters or unpin is not None or gravity is not None:
            name, whose = ("loads", "loads") if loads is not None else ("contact", "rules of contact")
            raise ValueError(
                f"{name} takes the place of all {whose}; nothing but loads and contact may change in that call"
            )
        given = self._acting if loads is None else checks.sequence("loads", loads, Load, "Force((0, 0, 1))")
        if contact is None and not any(isinstance(one, Contact) for one in given):
            contact = tuple(one for one in self._acting if isinstance(one, Contact))
        self._replace_loads(given if contact is None else with_contact(given, contact))

    def _apply(self, change: Change) -> None:
        """Go on with the system, its gravity and its loads, as a change makes them."""
        if change.of_gravity_alone and not callable(change.gravity) and self.model.falling is None:
            self._fall(change.gravity)
            return
        if change.of_velocity_alone:
            self._throw(change)
            return
        system = self.snapshot()
        other: dict[str, Any] = {"loads": change.released_from(self._surroundings["loads"], system)}
        if change.gravity is not None:
            other["gravity"] = change.gravity
        self._go_on_with(change.applied_to(system), other)

    def _go_on_with(self, system: System, other: dict[str, Any]) -> None:
        """Go on with a system in other surroundings."""
        around = self._surroundings
        self._surroundings = around | other
        try:
            self._load(system)
        except Exception:
            self._surroundings = around
            raise

    def _fall(self, gravity: Any) -> None:
        """Go on under another constant gravity."""
        self.model.check_range(checks.gravity("gravity", gravity, self.model.dim), "gravity")
        before = self._energy()
        self.stepping.fall(gravity)
        self._surroundings = self._surroundings | {"gravity": gravity}
        if self._pace is not None:
            self._pace.fall(self.stepping, self._energy() - before)

    def _throw(self, change: Change) -> None:
        """Go on with other velocities."""
        held = ~np.isfinite(self.model.mass)
        before = self.frame().velocity
        velocity = change.velocities(self.system, before, held)
        self.model.check_range(velocity, "velocity")
        chosen = change.particles(self.system) & ~held
        energy = self._energy()
        self.stepping.throw(velocity, chosen)
        added = self._energy() - energy
        if resists(self.assembly):  # forces that depend on speed may be steeper now
            try:
                self._choose_anew()
            except UnstableStep:
                self.stepping.throw(before.astype(np.float64), chosen)
                raise
        if self._pace is not None:
            self._pace.bring_in(self.stepping, added)

    def _energy(self) -> float:
        """Return the energy that the method conserves [J], where it is watched.

        Where velocities lag, other velocities or forces change it by more than what physics has: by a share of
        the step.
        """
        return 0.0 if self._pace is None else self.stepping.balance().energy

    def _replace_loads(self, given: tuple[Load, ...]) -> None:
        """Go on with other loads: in place where they differ in values alone."""
        check_bears_touch(self.integrator, given)
        before = self._surroundings["loads"]
        # Those that were there have taken what they take from a start.
        known = {id(one): acting for one, acting in zip(self._acting, before, strict=True)}
        after = [known.get(id(one), one) for one in given]
        others = differ_in_values(before, after)
        if others is None:
            system = self.snapshot()
            self._go_on_with(system, {"loads": bound(after, system)})
        else:
            check_loads(after, self.system)
            pulled = self._pace if any(isinstance(one, MouseSpring) for one in others) else None
            above, energy = 0.0 if pulled is None else pulled.above(self.stepping), self._energy()
            try:
                self.stepping.exchange(others)
                added = self._energy() - energy
                self._choose_anew()
            except (UnstableStep, ValueError):  # what some effects have taken, all give back
                self.stepping.exchange({new: old for old, new in others.items()})
                raise
            if pulled is not None:  # what the springs of a hand store jumps as it moves
                pulled.begin(self.stepping, above)
            elif self._pace is not None:
                self._pace.bring_in(self.stepping, added)
            self._surroundings = self._surroundings | {"loads": tuple(after)}
        self._acting = given


def check_bears_touch(method: Integrator, loads: Sequence[Load]) -> None:
    """Raise ValueError where bodies are to touch, and the method's steps are too long for that."""
    if not method.supports_contact and any(isinstance(one, Contact) for one in loads):
        raise ValueError(f"integrator is {method}; where bodies touch it must be another, such as Leapfrog()")
