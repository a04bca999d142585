"""Checkpoints: arrays and values from which a simulation continues bit for bit.

`saved_run` returns the state, the effects, the system, the substeps, the baseline, the frame index, changes,
gravity, the method, the history of substeps and the step controller; `restore_run` reads them.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from .. import checks
from ..bodies import CONNECTION_FIELDS, DEFAULTS, PARTICLE_FIELDS, TEARING_FIELDS, System, stored
from ..engine import Baseline, Effect, Model, Rates
from ..integrators import MOST_SUBSTEPS, StepChoice
from ..world import Change, Driven, Load, driven_particles, gravity_at
from .pinned_staging import to_host
from .readings import Readings
from .run import Run
from .stepping import Stepping
from .substep_controller import StepController

Arrays = Mapping[str, NDArray]
Numbers = Mapping[str, Any]

GIVEN = "velocity.given"
"""Velocities that are read until the state moves, see `Velocities`."""
NEW = ("touch.fastest",)
"""Arrays that checkpoints of earlier versions lack: these start from 0."""
_REST_VOLUME = "system.cells.rest_volume"


def saved_run(run: Run) -> tuple[dict[str, NDArray], dict[str, Any]]:
    """Return arrays, and values, from which `restore_run` continues this frame bit for bit."""
    stepping, now = run.stepping, run.stepping.model
    arrays = {name: to_host(array) for name, array in _all_arrays(stepping).items()}
    for effect in stepping.assembly.all:
        arrays |= effect.checkpoint()
    arrays |= saved_system(now.system) | saved_drives(run.start.loads, now)
    numbers = _saved_choice(stepping.choice, stepping.watch.baseline)
    own = {"frame_index": run.frame_index, "changes": len(run.schedule) - len(run.due), "fps": run.chooser.fps}
    gravity, at_start = run.problem.gravity, run.start.gravity
    if not callable(gravity) and (callable(at_start) or not np.array_equal(gravity, at_start)):
        own["gravity"] = np.asarray(gravity, dtype=float).tolist()
    own |= {"integrator": repr(run.chooser.method), "chosen": [list(one) for one in run.substep_history]}
    return arrays, own | numbers | (run.controller.saved() if run.controller is not None else {})


def restore_run(run: Run, arrays: Arrays, numbers: Numbers) -> None:
    """Go to a checkpoint of a run that began alike; see `Simulation.restore`."""
    check_same(numbers, fps=run.chooser.fps, integrator=repr(run.chooser.method))
    start, gravity_now = run.start, run.problem.gravity
    frame_index, changes, chosen = restored_progress(numbers)
    system = restored_system(start.system, arrays)
    choice = restored_choice(numbers, run.chooser.fps)
    controller = run.controller and StepController.restored(numbers)
    baseline = restored_baseline(numbers)
    gravity = restored_gravity(numbers, start.gravity, run.schedule[:changes], system.dim)
    gravity_at(gravity, np.zeros(1), system.dim, "gravity of the checkpoint")
    loads = restored_loads(start.loads, system, arrays)
    reusable = run.controller is None and run.frame_index == 0
    reusable = reusable and system is run.problem.system and choice == run.stepping.choice
    reusable = reusable and loads is run.problem.loads and gravity is gravity_now
    with run.undoing():
        run.controller = run.controller and StepController()
        run.frame_index, run.readings = frame_index, Readings(run.problem.probes, system.dim)
        if not reusable:  # in a sweep, an upload for each world would take as long as a new simulation
            problem = run.problem.replace(system=system, loads=loads, contact=start.contact, gravity=gravity)
            run.load(problem.begun(), choice, arrays)
        check_arrays(run.stepping, arrays)
        run.stepping.begin_at(run.time)
        run.due = run.schedule[changes:]
        restore_arrays(run.stepping, arrays)
        for effect in run.stepping.assembly.all:
            effect.make_room(run.stepping.state.x, run.stepping.state.v)
        run.substep_history = chosen or [(0.0, run.stepping.choice.substeps)]
        if baseline is not None:
            run.stepping.watch.compare_with(baseline)
        if controller is not None:  # older checkpoints have no controller: it starts here
            run.controller = controller


def saved_worlds(stepping: Stepping) -> list[tuple[dict[str, NDArray], dict[str, Any]]]:
    """Return arrays and values of each world of an ensemble, as `saved_run` does, without its system's fields."""
    moving = {name: stepping.model.by_world(to_host(array)) for name, array in _all_arrays(stepping).items()}
    baselines = np.stack(np.broadcast_arrays(*stepping.watch.baseline), axis=-1)
    found = []
    for world, changed in enumerate(stepping.assembly.checkpoints()):
        own = replace(stepping.choices[world % len(stepping.choices)], substeps=stepping.choice.substeps)
        arrays = {name: array[world] for name, array in moving.items()}
        found.append((arrays | changed, _saved_choice(own, baselines[world])))
    return found


def saved_system(system: System) -> dict[str, NDArray]:
    """Return the fields of a system that can change during a run."""
    absent = () if system.tears else TEARING_FIELDS
    names = (*PARTICLE_FIELDS, *(name for name in CONNECTION_FIELDS if name not in absent))
    arrays = {f"system.{name}": np.array(stored(getattr(system, name))) for name in names}
    return arrays | ({} if system.cells is None else {_REST_VOLUME: np.array(system.cells.rest_volume)})


def _saved_choice(choice: StepChoice, baseline: Iterable[float]) -> dict[str, Any]:
    """Return the values of the substeps and the energy baseline."""
    numbers: dict[str, Any] = {f"rates.{name}": value for name, value in choice.rates._asdict().items()}
    numbers |= {name: getattr(choice, name) for name in ("limit", "least", "substeps", "refinement")}
    return numbers | {"baseline": [float(one) for one in baseline]}


def check_same(numbers: Numbers, **own: Any) -> None:
    """Raise ValueError unless the values `own` of a simulation equal those in a checkpoint."""
    for name, value in own.items():
        if checks.member("checkpoint", numbers, name) != value:
            raise ValueError(f"checkpoint is of another {name}: {numbers[name]}; here it is {value}")


def restored_system(start: System, arrays: Arrays) -> System:
    """Return `start` with the fields in a checkpoint; raise ValueError for a checkpoint of another system."""
    fields = {}
    for names, count in ((PARTICLE_FIELDS, start.particle_count), (CONNECTION_FIELDS, start.connection_count)):
        for name in names:
            if name in TEARING_FIELDS and f"system.{name}" not in arrays:  # older version, or nothing tears
                fields[name] = DEFAULTS[name]
                continue
            values = checks.member("checkpoint", arrays, f"system.{name}")
            if np.ndim(values) == 0 or len(values) not in (1, count):
                raise ValueError(f"checkpoint is of another system: its {name} has shape {np.shape(values)}")
            fields[name] = values[0] if len(values) < count else values
    # System checks that no spring breaks at its initial length, so limits are set before the later state.
    breaking = {name: fields.pop(name) for name in TEARING_FIELDS}
    for changed in (breaking, fields):
        if any((getattr(start, name) != value).any() for name, value in changed.items()):
            start = start.replace(**changed)
    if start.cells is not None:
        volume = checks.member("checkpoint", arrays, _REST_VOLUME)
        if np.shape(volume) != (len(start.cells),):
            raise ValueError(f"checkpoint is of another system: its cells are {np.shape(volume)}")
        if (volume != start.cells.rest_volume).any():
            start = start.replace(cells=replace(start.cells, rest_volume=volume))
    return start


def restored_choice(numbers: Numbers, fps: float) -> StepChoice:
    """Return the substeps stored in a checkpoint; raise ValueError if a value is missing or invalid."""
    known = {f"rates.{name}": value for name, value in Rates._field_defaults.items()} | dict(numbers)
    rates = Rates(*(_non_negative(known, f"rates.{name}") for name in Rates._fields))
    limit = _non_negative(numbers, "limit")
    least, substeps = (checks.member("checkpoint", numbers, name) for name in ("least", "substeps"))
    if checks.count("substeps", substeps, 1) > MOST_SUBSTEPS:
        raise ValueError(f"substeps of the checkpoint is {substeps}; it must be at most {MOST_SUBSTEPS}")
    refinement = checks.positive("refinement", numbers.get("refinement", 1.0))
    return StepChoice(rates, limit, checks.count("least", least, 0), int(substeps), fps, refinement)


def restored_progress(numbers: Numbers) -> tuple[int, int, list[tuple[float, int]]]:
    """Return (frame index, number of scheduled changes made, substep history).

    Older checkpoints have no history: it is then empty. Raises ValueError if a value is missing or invalid.
    """
    frame_index, changes = (
        checks.count(name, checks.member("checkpoint", numbers, name), 0) for name in ("frame_index", "changes")
    )
    chosen = numbers.get("chosen", [])
    if not isinstance(chosen, list) or not all(isinstance(one, list) and len(one) == 2 for one in chosen):
        raise ValueError(f"chosen of the checkpoint is {checks.repr_short(chosen)}; it must be a list of pairs")
    counts = [(checks.non_negative("chosen", time), checks.count("chosen", count, 1)) for time, count in chosen]
    return frame_index, changes, counts


def restored_gravity(numbers: Numbers, start: Any, made: Sequence[Change], dim: int) -> Any:
    """Return a checkpoint's gravity: the one set by the user, else by the last change in `made`, else `start`."""
    if "gravity" in numbers:
        return checks.gravity_of_file(numbers["gravity"], dim)
    return next((one.gravity for one in reversed(made) if one.gravity is not None), start)


def saved_drives(loads: Sequence[Load], model: Model) -> dict[str, NDArray]:
    """Return the indices of the particles that are still driven, under "driven"; nothing without drives."""
    return {"driven": np.flatnonzero(model.driven)} if any(isinstance(one, Driven) for one in loads) else {}


def restored_loads(loads: Sequence[Load], system: System, arrays: Arrays) -> Sequence[Load]:
    """Return the loads; drives hold only the particles in the checkpoint. Raise ValueError for other drives."""
    if not any(isinstance(one, Driven) for one in loads):
        return loads
    kept = np.zeros(system.particle_count, dtype=bool)
    indices = np.asarray(checks.member("checkpoint", arrays, "driven"))
    kept[checks.indices("driven of the checkpoint", indices[:, None], 1, len(kept))[:, 0]] = True
    if (kept & ~driven_particles(loads, system)).any():
        raise ValueError("checkpoint is of other drives: it holds particles that none moves here")
    return tuple(one.keeping(kept) if isinstance(one, Driven) else one for one in loads)


def restored_baseline(numbers: Numbers) -> Baseline | None:
    """Return the energy baseline; None if an older checkpoint has none."""
    if "baseline" not in numbers:
        return None
    found = numbers["baseline"]
    if not isinstance(found, list) or len(found) != 2 or not all(isinstance(one, int | float) for one in found):
        raise ValueError(f"baseline of the checkpoint is {checks.repr_short(found)}; it must be two numbers")
    return Baseline(*map(float, found))


def _non_negative(numbers: Numbers, name: str) -> float:
    return checks.non_negative(
        f"{name} of the checkpoint", checks.member("checkpoint", numbers, name), infinite=True
    )


def check_arrays(stepping: Stepping, arrays: Arrays) -> None:
    """Raise ValueError unless `restore_arrays` can restore the arrays of a checkpoint."""
    own = {name: array.numpy() for name, array in _state_arrays(stepping).items()}
    for effect in _kept_effects(stepping, arrays):
        own |= effect.checkpoint()
    for name, values in own.items():
        if name in NEW and name not in arrays:
            continue
        found = np.asarray(checks.member("checkpoint", arrays, name))
        if (found.shape, found.dtype) != (values.shape, values.dtype):
            raise ValueError(f"checkpoint holds {name} of shape {found.shape} and type {found.dtype}")
        if name in ("x", "v"):
            checks.finite(f"{name} of the checkpoint", found)
    if np.shape(arrays.get(GIVEN, own["v"])) != own["v"].shape:
        raise ValueError(f"checkpoint holds {GIVEN} of shape {np.shape(arrays[GIVEN])}")


def restore_arrays(stepping: Stepping, arrays: Arrays) -> None:
    """Restore the state and the effects from the arrays of a checkpoint."""
    for name, array in _state_arrays(stepping).items():
        array.assign(arrays[name])
    stepping.velocities.give(arrays.get(GIVEN))
    kept = _kept_effects(stepping, arrays)
    for effect in kept:
        effect.restore(arrays)
    if len(kept) < len(stepping.assembly.all):
        stepping.reset_baseline()


def _kept_effects(stepping: Stepping, arrays: Arrays) -> list[Effect]:
    """Return the effects whose state is in a checkpoint, which may lack some.

    Older versions did not sum the work of moving obstacles, and had no contact of surfaces with obstacles.
    """
    work, between = stepping.assembly.external_work, "straddle.partner"
    known = [one for one in stepping.assembly.all if one is not work or "work.before" in arrays]
    return known if between in arrays else [one for one in known if between not in one.checkpoint()]


def _all_arrays(stepping: Stepping) -> dict[str, wp.array]:
    """Return the state's arrays, and the velocities that are read instead of its own, if any."""
    given = stepping.velocities.kept()
    return _state_arrays(stepping) | ({} if given is None else {GIVEN: given})


def _state_arrays(stepping: Stepping) -> dict[str, wp.array]:
    """Return the arrays that a substep passes to the next, by name."""
    state = stepping.state.state_in
    arrays = {"x": state.x, "v": state.v} | {f"carried.{k}": array for k, array in enumerate(state.method_state)}
    if stepping.model.compensated:
        arrays |= {"lost.x": state.compensation.x, "lost.v": state.compensation.v}
    return arrays
