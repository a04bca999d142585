"""Run: a problem on a device, advanced frame by frame and changed between two frames."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from .. import checks
from ..bodies import LINEAR_SPRING, System
from ..engine import (
    Assembly,
    Blocks,
    Dynamics,
    State,
    check_blocks,
    starting_state,
    threads_of_world,
)
from ..integrators import Integrator, StepChoice, UnstableStep
from ..runtime import completing
from ..world import Problem
from .arguments import in_order
from .divergence_error import divergence_of
from .pinned_staging import to_host
from .readings import Readings
from .stepping import Stepping
from .substep_chooser import SubstepChooser, running
from .substep_controller import StepControlFailed, StepController


class Run:
    """What a simulation owns of its problem on a device; an ensemble, of its worlds.

    A change that fails leaves all as it was. `assemble` uploads a problem, with the options of the simulation;
    `blocks` is the number of threads per world in an ensemble. For the others see `Simulation`.

    Attributes
    ----------
    start, contacts, schedule
        The problem at time 0, its loads bound to that state; the contacts of its bodies, if it starts at rest (see
        `Assembly.press`); its changes in the order of their times.
    problem, due
        The problem as last uploaded, at the start or at a change; the changes that have not been made yet.
    controller
        Takes more substeps where energy rises; None if their number is given, or nothing limits the energy.
    inside
        Message about an overlap at the start, or None.
    """

    problem: Problem
    stepping: Stepping
    controller: StepController | None = None
    contacts: Mapping[str, NDArray] | None = None
    inside: str | None = None
    frame_index = 0

    def __init__(
        self,
        start: Problem,
        chooser: SubstepChooser,
        assemble: Callable[..., Assembly],
        *,
        energy_limit: float,
        blocks: Blocks | int | str,
        threads: int | str = 1,
        watches_energy: bool = True,
    ) -> None:
        self.start, self.chooser, self.assemble = start, chooser, assemble
        self.schedule = in_order(start.schedule, start.system, start.loads)
        self.energy_limit = checks.non_negative("energy_limit", energy_limit, infinite=True)
        self._blocks: Any = blocks
        self.threads, self._watches_energy = threads, watches_energy

    @property
    def time(self) -> float:
        """Simulated time since the start [s]."""
        return self.frame_index / self.chooser.fps

    def begin(self) -> None:
        """Begin at time 0, from the problem at the start."""
        watched = self.chooser.forced is None and math.isfinite(self.energy_limit) and self._watches_energy
        with self.undoing():
            self.frame_index, self.chooser.warned, self.due = 0, False, list(self.schedule)
            self.readings, self.warned = Readings(self.start.probes, self.start.system.dim), set[type[Warning]]()
            self.controller = StepController() if watched else None
            self.load(self.start)
            self.press(self.contacts)
            self.substep_history = [(0.0, self.stepping.choice.substeps)]

    @contextmanager
    def undoing(self) -> Iterator[None]:
        """Restore what the run owns, and its controller, if a block fails.

        That is enough where the block makes new arrays instead of writing to those that are there.
        """
        before = [(one, vars(one).copy()) for one in (self, self.controller) if one is not None]
        try:
            yield
        except BaseException:  # of a function of time, or of a signal's handler
            for one, kept in before:
                vars(one).update(kept)
                for name in vars(one).keys() - kept.keys():
                    del vars(one)[name]
            raise

    def load(self, problem: Problem, choice: StepChoice | None = None, arrays: Any = None) -> None:
        """Upload a problem, with a checkpoint's `arrays`, if any; advance by given or newly chosen substeps."""
        assembly, controller, method = self.assemble(problem), self.controller, self.chooser.method
        if self.time > 0.0:
            assembly.take_over(self.stepping.assembly, self.stepping.state.x, self.stepping.state.v, arrays)
        if assembly.model.in_worlds:
            threads_of_world(assembly, self._blocks)  # raise before kernels are compiled
        else:
            check_blocks(self._blocks, on_gpu=assembly.model.device.is_cuda)
        state = starting_state(problem.system, assembly, method.method_state, self.time, self.chooser.fps)
        refinement, above = 1.0, 0.0
        if controller is not None and controller.scale > 0:
            refinement, above = controller.refinement, controller.above_floor(self.stepping)
        self.stepping = Stepping(
            Dynamics(assembly, self.threads),
            state,
            method,
            [choice] if choice else [one.refined(refinement) for one in self.choices(assembly, state)],
            energy_limit=self.energy_limit,
            blocks=self._blocks,
            watch_energy=controller is not None,
            time=self.time,
        )
        self.problem = problem
        if controller is not None:
            controller.begin(self.stepping, above)

    def begins_again(self) -> tuple[Assembly, State]:
        """Return another assembly of the problem, and its current state."""
        if not self.stepping.model.in_worlds:
            assembly = self.assemble(self.problem.with_checked(system=self.snapshot()))
            return assembly, State.from_system(assembly.model.system, assembly.model)
        assembly = self.assemble(self.problem)
        state, frame = State(assembly.model), self.stepping.frame(self.time)
        state.write("x", frame.position)
        state.write("v", frame.velocity)
        return assembly, state

    def snapshot(self) -> System:
        """Return the system of a single world with its current positions, velocities and parameters."""
        _, position, velocity = self.stepping.frame(self.time)
        changed = self.stepping.assembly.changed_fields()
        return self.problem.system.replace(position=position, velocity=velocity, **changed)

    def held_back(self) -> NDArray[np.float64]:
        """Return the largest distance by which contact held a particle back, by world, in the last frame [m]."""
        contact = self.stepping.assembly.body_contact
        return np.zeros(self.stepping.model.worlds) if contact is None else contact.held_back

    def contact_force(self) -> NDArray:
        """Return the mean contact force on each particle in the last frame; see `Simulation.contact_force`."""
        summed, model = self.stepping.contact_forces, self.stepping.model
        if summed is None:
            raise ValueError("contact_forces is False; it must be True for these forces to be summed")
        force = wp.zeros(model.particle_count, dtype=model.vector, device=model.device)
        summed.write_force(force)
        return to_host(force)

    def inverted(self) -> NDArray[np.integer]:
        """Return the number of cells that are turned inside out, by world."""
        return self.stepping.assembly.inverted_cells.find(self.stepping.state.x).sum(axis=1)

    def change_to(self, problem: Problem) -> None:
        """Upload a problem in which something has changed, in its current state."""
        with completing(), self.undoing():
            self.load(problem.begun())

    def advance(self, next_time: float | None) -> None:
        """Advance by a frame; `next_time` [s] is as for `Stepping.advance`. Raises SimulationDiverged."""
        if self.controller is None:
            if not self.stepping.advance(self.time, next_time):
                raise divergence_of(self)
            return
        try:
            self.stepping = self.controller.advance(self.stepping, self.time, self.stable_choice, next_time)
        except StepControlFailed as failure:
            raise divergence_of(self, failure) from None

    def choices(self, assembly: Assembly, state: State, old: Sequence[StepChoice] = ()) -> list[StepChoice]:
        """Return the substeps that different worlds need; a world that none can follow keeps its `old` ones.

        Raises UnstableStep where there are no old ones, and in a single world.
        """
        choices = list[StepChoice]()
        for k, rates in enumerate(self.chooser.rates(assembly, state, self.time)):
            try:
                choices.append(self.chooser.choose(rates, assembly, state, self.time, k))
            except UnstableStep as error:
                if not assembly.model.in_worlds:
                    raise
                if not old:
                    raise UnstableStep(f"in world {k} {error}") from error
                choices.append(old[k])
        for k in np.flatnonzero(~running(self.stepping)).tolist() if old else ():
            choices[k] = replace(old[k], substeps=1, rates=old[k].rates._replace(own=0.0))
        return choices

    def stable_choice(self) -> StepChoice:
        """Return the substeps that stability requires in the current state; or raise UnstableStep."""
        return self.choices(self.stepping.assembly, self.stepping.state)[0]

    def update_choice(self) -> None:
        """Choose the substeps for the current state."""
        if self.stepping.model.in_worlds:
            choices = self.choices(self.stepping.assembly, self.stepping.state, self.stepping.choices)
            self.stepping = self.stepping.with_choice(*choices)
            return
        choice = self.stable_choice()
        if self.controller is not None:
            self.stepping = self.controller.follow(self.stepping, choice)
        elif choice.substeps != self.stepping.choice.substeps:
            self.stepping = self.stepping.with_choice(choice)

    def press(self, contacts: Mapping[str, NDArray] | None) -> None:
        """Take over the contacts of the system at rest, if given; energies are compared from here on."""
        if contacts is not None:
            self.stepping.assembly.press(contacts)
            self._reset_baseline()

    def restore_contact(self, arrays: Mapping[str, NDArray]) -> None:
        """Restore the contacts between bodies, if they touch, from a checkpoint (`BodyContact.checkpoint`)."""
        if self.stepping.assembly.body_contact is not None:
            self.stepping.assembly.body_contact.restore(arrays)
        self._reset_baseline()

    def _reset_baseline(self) -> None:
        """From now on compare energies with those of the current state."""
        self.stepping.reset_baseline()
        if self.controller is not None:
            self.controller.begin(self.stepping)

    def start_here(self) -> None:
        """Let the run start from its present state at rest."""
        self.start = self.start.with_checked(system=self.problem.system)
        self.contacts = self.stepping.assembly.contacts()
        self.begin()

    def is_due(self, frame: int) -> bool:
        """Return whether a change of the schedule is due before frame number `frame`."""
        return bool(self.due) and self.due[0].is_due(frame, self.chooser.fps)


def check_supports(method: Integrator, problem: Problem) -> None:
    """Raise ValueError if the method's steps are too long for contact, or it needs linear springs."""
    if not method.supports_contact and problem.contact_rules:
        raise ValueError(f"integrator is {method}; where bodies touch it must be another, such as Leapfrog()")
    if method.solves and problem.system.spring != LINEAR_SPRING:
        raise ValueError(
            f"integrator is {method}, and spring is {problem.system.spring!r}; with such springs it must be an "
            "explicit method, such as Leapfrog()"
        )
