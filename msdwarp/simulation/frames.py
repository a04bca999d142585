"""Frames of a run, and changes between them."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from .. import checks
from ..engine import caught, resists
from ..integrators import UnstableStep
from ..runtime import completing
from ..world import Change, Collider, Contact, Load, MouseSpring, differ_in_values
from .run import Run, check_supports
from .settling import Settled, settled


def advance(run: Run, frames: int) -> None:
    """Advance by one or more frames; see `Simulation.step`."""
    with completing() as interrupted:
        try:
            for left in reversed(range(frames)):
                _take_frame(run, left > 0 and not run.stepping.model.in_worlds)
                if interrupted:
                    break
        finally:  # after an exception or an interrupt, the next frame may have been launched
            run.stepping.discard_ahead()
            if run.stepping.end > run.time:  # of a signal, before the frame was counted
                _count_frame(run)


def _take_frame(run: Run, continues: bool) -> None:
    """Advance by a frame; `continues`: another frame follows immediately."""
    while run.is_due(run.frame_index):
        apply_due(run)
    if run.chooser.is_outdated(run.stepping, run.frame_index):
        run.update_choice()
    following = run.frame_index + 1
    ahead = continues and not run.is_due(following) and not run.chooser.looks_at(run.stepping.assembly, following)
    run.advance(following / run.chooser.fps if ahead else None)
    _count_frame(run)


def _count_frame(run: Run) -> None:
    """Count the frame that has been taken, and keep what was measured in it."""
    substeps = run.stepping.choice.substeps
    if substeps != run.substep_history[-1][1]:
        run.substep_history.append((run.time, substeps))
    run.frame_index += 1
    if run.readings:
        run.readings.add(run.time, 1.0 / run.chooser.fps, run.stepping.readings())
    found = {} if run.controller is None else run.controller.warnings
    for kind in found.keys() - run.warned:
        run.warned.add(kind)
        checks.warn(f"up to {run.time:.4g} s {found[kind]}", kind)


def change(
    run: Run,
    change: Change,
    colliders: Sequence[Collider] | None,
    loads: Sequence[Load] | None,
    contact: Contact | Sequence[Contact] | None,
) -> None:
    """Make a change, or replace the obstacles, or loads and rules of contact; see `Simulation.change`."""
    changes = change.set_rest_shape or change.parameters or change.unpin is not None or change.gravity is not None
    if colliders is not None:
        if changes or any(one is not None for one in (change.group, loads, contact)):
            raise ValueError("colliders takes the place of all obstacles; nothing else may change in that call")
        run.change_to(run.problem.replace(system=run.snapshot(), colliders=colliders))
        if message := caught(run.problem.system, run.problem.colliders):
            checks.warn(message, checks.StartWarning)
    elif loads is None and contact is None:
        apply(run, change)
    elif changes:
        name, replaced = ("loads", "loads") if loads is not None else ("contact", "rules of contact")
        raise ValueError(
            f"{name} takes the place of all {replaced}; nothing but loads and contact may change in that call"
        )
    else:
        replace_loads(run, loads, contact)


def settle(run: Run, tolerance: float | None, substeps: int) -> Settled:
    """Move the system to static equilibrium; see `Simulation.settle`."""
    problem, found, contacts = settled(
        run.problem.with_checked(system=run.snapshot()),
        run.assemble,
        tolerance=tolerance,
        most=substeps,
        threads=run.threads,
        time=run.time,
    )
    if not found.converged:
        checks.warn(str(found), checks.SettleWarning)
    run.change_to(problem)
    run.press(contacts)
    return found


def apply(run: Run, change: Change) -> None:
    """Make a change of the system or of gravity."""
    if change.of_gravity_alone and not callable(change.gravity) and run.stepping.model.falling is None:
        _set_gravity(run, change.gravity)
        return
    if change.of_velocity_alone:
        _set_velocity(run, change)
        return
    system = run.snapshot()
    run.change_to(
        run.problem.replace(
            system=change.applied_to(system),
            loads=change.released_from(run.problem.loads, system),
            gravity=run.problem.gravity if change.gravity is None else change.gravity,
        )
    )


def apply_due(run: Run) -> None:
    """Make the next change of the schedule."""
    change = run.due[0]
    try:
        apply(run, change)
    except UnstableStep as error:
        raise UnstableStep(f"after the change at {change.time:g} s {error}") from error
    except ValueError as error:
        raise ValueError(f"the change at {change.time:g} s cannot be made: {error}") from error
    run.due = run.due[1:]  # only after the change has succeeded


def _set_gravity(run: Run, gravity: Any) -> None:
    """Change constant gravity in place."""
    model = run.stepping.model
    model.check_range(checks.gravity("gravity", gravity, model.dim), "gravity")
    before = _energy(run)
    run.stepping.set_gravity(gravity)
    run.problem = run.problem.with_checked(gravity=gravity)
    if run.controller is not None:
        run.controller.set_gravity(run.stepping, _energy(run) - before)


def _set_velocity(run: Run, change: Change) -> None:
    """Change velocities in place."""
    model, system = run.stepping.model, run.problem.system
    held = ~np.isfinite(model.mass)
    velocity = change.velocities(system, run.stepping.frame(run.time).velocity, held)
    model.check_range(velocity, "velocity")
    chosen = change.particles(system) & ~held
    energy = _energy(run)
    with completing(), run.undoing(), run.stepping.undoing():
        run.stepping.set_velocity(velocity, chosen)
        added = _energy(run) - energy
        if resists(run.stepping.assembly):  # forces that depend on speed may now have a larger derivative
            run.update_choice()
        if run.controller is not None:
            run.controller.add_energy(run.stepping, added)


def _energy(run: Run) -> float:
    """Return the energy that the method conserves [J]; 0 without a step controller, which alone needs it.

    If velocities lag, a change of velocities or forces adds a term proportional to the step.
    """
    return 0.0 if run.controller is None else run.stepping.balance().energy


def replace_loads(run: Run, loads: Sequence[Load] | None, contact: Contact | Sequence[Contact] | None) -> None:
    """Replace loads, rules of contact or both, in place if they differ only in values."""
    given = (
        run.problem.loads_as_given if loads is None else checks.sequence("loads", loads, Load, "Force((0, 0, 1))")
    )
    rules = [one for one in given if isinstance(one, Contact)] or run.problem.contact_rules
    rules = tuple(rules) if contact is None else contact
    # Loads that are kept stay bound to the state in which they began.
    kept = {id(one.given or one): one for one in run.problem.loads}
    after = [kept.get(id(one), one) for one in given if not isinstance(one, Contact)]
    several = rules if isinstance(rules, Sequence) else (rules,)
    replacements = differ_in_values(run.problem.loads, [*after, *several])
    system = run.problem.system if replacements is not None else run.snapshot()
    problem = run.problem.replace(system=system, loads=after, contact=rules)
    check_supports(run.chooser.method, problem)
    if replacements is None:
        run.change_to(problem)
        return
    controller, pulled = run.controller, any(isinstance(one, MouseSpring) for one in replacements.values())
    above = controller.above_floor(run.stepping) if controller is not None and pulled else 0.0
    energy = _energy(run)
    try:
        run.stepping.exchange(replacements)
        added = _energy(run) - energy
        run.update_choice()
    except (UnstableStep, ValueError):  # some effects may already have taken new values
        run.stepping.exchange({new: old for old, new in replacements.items()})
        raise
    if controller is not None and pulled:  # the energy of a mouse spring jumps when the mouse moves
        controller.begin(run.stepping, above)
    elif controller is not None:
        controller.add_energy(run.stepping, added)
    run.problem = problem
