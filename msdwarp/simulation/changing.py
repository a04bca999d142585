"""Changing: what can be changed in a simulation between frames."""

import warnings
from abc import abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import checks
from ..bodies import LINEAR_SPRING, System
from ..engine import Assembly, State, assemble, caught, resists
from ..integrators import Integrator, UnstableStep
from ..runtime import completing, exclusive
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
from .settling import Settled, settled
from .substep_controller import StepController
from .undoing import undoing, undoing_in_place


class Changing(PresentWorld):
    """The properties of a simulation that can change between two frames."""

    _surroundings: dict[str, Any]
    """Arguments of `assemble` that describe the surroundings: gravity, colliders, loads, probes, device."""
    _active_loads: tuple[Load, ...]
    """The current loads, as given."""
    _step_controller: StepController | None
    _threads: int | str
    _refresh: bool
    _pressed: Mapping[str, NDArray] | None = None
    """The contacts at the start of a settled scene, see `Assembly.press`; None if it is not settled."""

    @property
    def loads(self) -> tuple[Load, ...]:
        """The loads on the system, as given."""
        return self._active_loads

    @property
    def colliders(self) -> tuple[Collider, ...]:
        """The obstacles."""
        return tuple(self._surroundings["colliders"])

    @property
    def gravity(self) -> Gravity:
        """Acceleration of free fall [m/s²], as given."""
        return self._surroundings["gravity"]

    def _assembled(self) -> tuple[Assembly, State]:
        """Return a new assembly of the scene, and its current state."""
        system = self.snapshot()
        assembly = assemble(system, **self._surroundings)
        return assembly, State.from_system(system, assembly.model)

    def _apply_scheduled_change(self) -> None:
        """Apply the next change of the schedule."""
        try:
            self._apply(self._due[0])
        except UnstableStep as error:
            raise UnstableStep(f"after the change at {self._due[0].time:g} s {error}") from error
        except ValueError as error:
            raise ValueError(f"the change at {self._due[0].time:g} s cannot be made: {error}") from error
        self._due = self._due[1:]  # only after the change has succeeded

    def _touch_by(self, shape: NDArray) -> None:
        """Make surfaces for contact by positions `shape` [m], as in a motion that began there."""
        if self.assembly.body_contact is not None and (shape != self.system.position).any():
            self._surroundings = self._surroundings | {"shape": shape}
            self._load(self.system)

    def _restore_contact(self, arrays: Mapping[str, NDArray]) -> None:
        """Restore the contacts between bodies from a checkpoint (`BodyContact.checkpoint`)."""
        if self.assembly.body_contact is not None:
            self.assembly.body_contact.restore(arrays)
        self._reset_baseline()

    def _reset_baseline(self) -> None:
        """From now on compare energies with those of the current state."""
        self.stepping.reset_baseline()
        if self._step_controller is not None:
            self._step_controller.begin(self.stepping)

    @abstractmethod
    def _load(self, system: System) -> None:
        """Upload a system, choose substeps and prepare to advance it."""

    @abstractmethod
    def _update_choice(self) -> None:
        """Choose the substeps for the current state."""

    @exclusive
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
        """Change gravity, loads, contact, colliders, velocities, mass, stiffness, damping or rest_length.

        A mass of inf pins a particle. A new velocity may add energy, which does not count as divergence. Automatic
        substeps and the automatic algorithm are chosen again.

        *Cost.* A new constant gravity takes about a millisecond, and so do loads if only their values change (the
        vector of a `Force`, the velocity and coefficients of `Wind`). New velocities are copied; with `Wind` the
        stability limit is also recomputed. The first damper, the first pinned particle and many more kinds of
        connections each need a new kernel, which is compiled when first used.

        Parameters
        ----------
        loads
            All loads from now on. Previous loads among them continue unchanged. New loads start from the
            current state. Contact between bodies stays the same, unless `loads` has a `Contact`. Checkpoints do
            not include loads.
        contact
            Contact between bodies from now on; () turns it off. Checkpoints do not include it.
        colliders
            All obstacles from now on, such as the same obstacles with another friction. Checkpoints do not include
            them.
        group, set_rest_shape, unpin, gravity, parameters
            See `msdwarp.at`.

        Raises
        ------
        ValueError
            If a name is unknown, or a value is out of range. Nothing changes then.

        Warns
        -----
        StartWarning
            If one of `colliders` is in the middle of a body, which would leave it on opposite sides.
        """
        change = Change(self.time, group, set_rest_shape, parameters, unpin, gravity)
        if colliders is not None:
            others = (group, unpin, gravity, loads, contact)
            if set_rest_shape or parameters or any(one is not None for one in others):
                raise ValueError(
                    "colliders takes the place of all obstacles; nothing else may change in that call"
                )
            given = checks.sequence("colliders", colliders, Collider, "Plane()")
            system = self.snapshot()
            self._reload(system, {"colliders": given})
            if message := caught(system, given):
                warnings.warn(message, checks.StartWarning, stacklevel=5)
            return
        if loads is None and contact is None:
            self._apply(change)
            return
        if set_rest_shape or parameters or unpin is not None or gravity is not None:
            name, replaced = ("loads", "loads") if loads is not None else ("contact", "rules of contact")
            raise ValueError(
                f"{name} takes the place of all {replaced}; nothing but loads and contact may change in that call"
            )
        given = self._active_loads if loads is None else checks.sequence("loads", loads, Load, "Force((0, 0, 1))")
        if contact is None and not any(isinstance(one, Contact) for one in given):
            contact = tuple(one for one in self._active_loads if isinstance(one, Contact))
        self._replace_loads(given if contact is None else with_contact(given, contact))

    @exclusive
    def settle(self, tolerance: float | None = None, *, substeps: int = 200_000) -> Settled:
        """Move the system to static equilibrium, where it stays at rest; the time does not change.

        Fast inertial relaxation (FIRE; see `msdwarp.kernels.integrators.fire`) finds a minimum of the energy under
        the current loads, contact and obstacles, many times faster than damping stops motion. Functions of time
        keep their current values. What overlaps is moved apart first. Velocities are 0 afterwards. If friction or
        several minima allow several equilibria, the result is the first that is reached. Automatic substeps are
        chosen again.

        Parameters
        ----------
        tolerance
            Largest force that may remain on a free particle [N]. By default a thousandth of the mean weight of a
            particle, or without gravity 1e-4 of the largest force at the start.
        substeps
            Maximal number of substeps. What overlaps is moved apart in any case.

        Returns
        -------
        found
            The remaining force, the tolerance, the number of substeps, and whether the result has `converged`.

        Warns
        -----
        SettleWarning
            If the remaining force is above the tolerance.

        Raises
        ------
        ValueError
            If an argument is out of range, the system has no springs, or a part of it falls freely.
        SimulationDiverged
            If a number is no longer finite. Nothing changes then, as for a ValueError.
        """
        system, found, contacts = settled(
            self.snapshot(),
            self._surroundings,
            tolerance=tolerance,
            most=substeps,
            threads=self._threads,
            time=self.time,
        )
        if not found.converged:
            warnings.warn(str(found), checks.SettleWarning, stacklevel=5)
        self._reload(system, {})
        self._press(contacts)
        return found

    def _press(self, contacts: Mapping[str, NDArray] | None) -> None:
        """Take over the contacts of the system at rest, if given; energies are compared from here on."""
        if contacts is not None:
            self.assembly.press(contacts)
            self._reset_baseline()

    def _apply(self, change: Change) -> None:
        """Make a change of the system, gravity or loads."""
        if change.of_gravity_alone and not callable(change.gravity) and self.model.falling is None:
            self._set_gravity(change.gravity)
            return
        if change.of_velocity_alone:
            self._set_velocity(change)
            return
        system = self.snapshot()
        other: dict[str, Any] = {"loads": change.released_from(self._surroundings["loads"], system)}
        if change.gravity is not None:
            other["gravity"] = change.gravity
        self._reload(change.applied_to(system), other)

    def _reload(self, system: System, other: dict[str, Any]) -> None:
        """Upload a system again, with changed surroundings."""
        with completing(), undoing(self):
            self._surroundings = self._surroundings | other
            self._load(system)

    def _set_gravity(self, gravity: Any) -> None:
        """Change constant gravity in place."""
        self.model.check_range(checks.gravity("gravity", gravity, self.model.dim), "gravity")
        before = self._energy()
        self.stepping.set_gravity(gravity)
        self._surroundings = self._surroundings | {"gravity": gravity}
        if self._step_controller is not None:
            self._step_controller.set_gravity(self.stepping, self._energy() - before)

    def _set_velocity(self, change: Change) -> None:
        """Change velocities in place."""
        held = ~np.isfinite(self.model.mass)
        before = self.frame().velocity
        velocity = change.velocities(self.system, before, held)
        self.model.check_range(velocity, "velocity")
        chosen = change.particles(self.system) & ~held
        energy = self._energy()
        with completing(), undoing(self), undoing_in_place(self.stepping):
            self.stepping.set_velocity(velocity, chosen)
            added = self._energy() - energy
            if resists(self.assembly):  # forces that depend on speed may now have a larger derivative
                self._update_choice()
            if self._step_controller is not None:
                self._step_controller.add_energy(self.stepping, added)

    def _energy(self) -> float:
        """Return the energy that the method conserves [J]; 0 without a step controller, which alone needs it.

        If velocities lag, a change of velocities or forces adds a term proportional to the step.
        """
        return 0.0 if self._step_controller is None else self.stepping.balance().energy

    def _replace_loads(self, given: tuple[Load, ...]) -> None:
        """Replace the loads, in place if they differ only in values."""
        check_supports_contact(self.integrator, given)
        before = self._surroundings["loads"]
        # Loads that are kept stay bound to the state in which they began.
        bound_loads = {id(one): load for one, load in zip(self._active_loads, before, strict=True)}
        after = [bound_loads.get(id(one), one) for one in given]
        replacements = differ_in_values(before, after)
        if replacements is None:
            system = self.snapshot()
            self._reload(system, {"loads": bound(after, system)})
        else:
            check_loads(after, self.system)
            controller, pulled = self._step_controller, any(isinstance(one, MouseSpring) for one in replacements)
            above = controller.above_floor(self.stepping) if controller is not None and pulled else 0.0
            energy = self._energy()
            try:
                self.stepping.exchange(replacements)
                added = self._energy() - energy
                self._update_choice()
            except (UnstableStep, ValueError):  # some effects may already have taken new values
                self.stepping.exchange({new: old for old, new in replacements.items()})
                raise
            if controller is not None and pulled:  # the energy of a mouse spring jumps when the mouse moves
                controller.begin(self.stepping, above)
            elif controller is not None:
                controller.add_energy(self.stepping, added)
            self._surroundings = self._surroundings | {"loads": tuple(after)}
        self._active_loads = given


def check_supports(method: Integrator, system: System) -> None:
    """Raise ValueError if the method needs linear springs, but the system's springs have another law."""
    if method.solves and system.spring != LINEAR_SPRING:
        raise ValueError(
            f"integrator is {method}, and spring is {system.spring!r}; with such springs it must be an explicit "
            "method, such as Leapfrog()"
        )


def check_supports_contact(method: Integrator, loads: Sequence[Load]) -> None:
    """Raise ValueError if bodies may touch, but the method's steps are too long for contact."""
    if not method.supports_contact and any(isinstance(one, Contact) for one in loads):
        raise ValueError(f"integrator is {method}; where bodies touch it must be another, such as Leapfrog()")
