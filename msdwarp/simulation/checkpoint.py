"""Checkpoints: what a simulation needs to go on from a frame, to the last bit."""

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
from ..world import Change, Driven, Load, driven_particles
from .pinned_staging import to_host
from .stepping import Stepping

Arrays = Mapping[str, NDArray]
Numbers = Mapping[str, Any]


def saved(stepping: Stepping) -> tuple[dict[str, NDArray], dict[str, Any]]:
    """Return the arrays of a system that moves, and the numbers of its substeps."""
    arrays = {name: to_host(array) for name, array in _moving(stepping).items()}
    for effect in stepping.assembly.all:
        arrays |= effect.checkpoint()
    return arrays | saved_system(stepping.model.system), _saved_choice(stepping.choice, stepping.watch.baseline)


def saved_worlds(stepping: Stepping) -> list[tuple[dict[str, NDArray], dict[str, Any]]]:
    """Return the same of each world of an ensemble, but for the fields of its system."""
    moving = {name: stepping.model.by_world(to_host(array)) for name, array in _moving(stepping).items()}
    baselines = np.stack(np.broadcast_arrays(*stepping.watch.baseline), axis=-1)
    found = []
    for world, changed in enumerate(stepping.assembly.checkpoints()):
        own = replace(stepping.choices[world % len(stepping.choices)], substeps=stepping.choice.substeps)
        arrays = {name: array[world] for name, array in moving.items()}
        found.append((arrays | changed, _saved_choice(own, baselines[world])))
    return found


def saved_system(system: System) -> dict[str, NDArray]:
    """Return the fields of a system that can change."""
    absent = () if system.tears else TEARING_FIELDS
    names = (*PARTICLE_FIELDS, *(name for name in CONNECTION_FIELDS if name not in absent))
    return {f"system.{name}": np.array(stored(getattr(system, name))) for name in names}


def _saved_choice(choice: StepChoice, baseline: Iterable[float]) -> dict[str, Any]:
    """Return the numbers of the substeps, and what energies are compared with."""
    numbers: dict[str, Any] = {f"rates.{name}": value for name, value in choice.rates._asdict().items()}
    numbers |= {name: getattr(choice, name) for name in ("limit", "least", "substeps", "refinement")}
    return numbers | {"baseline": [float(one) for one in baseline]}


def check_same(numbers: Numbers, **own: Any) -> None:
    """Raise ValueError unless a checkpoint holds these by name."""
    for name, value in own.items():
        if checks.member("checkpoint", numbers, name) != value:
            raise ValueError(f"checkpoint is of another {name}: {numbers[name]}; here it is {value}")


def restored_system(start: System, arrays: Arrays) -> System:
    """Return the system whose fields a checkpoint holds; its connections and surface are those of `start`.

    Raises
    ------
    ValueError
        If the checkpoint is of another system.
    """
    fields = {}
    for names, count in ((PARTICLE_FIELDS, start.particle_count), (CONNECTION_FIELDS, start.connection_count)):
        for name in names:
            if (
                name in TEARING_FIELDS and f"system.{name}" not in arrays
            ):  # in one of before, or where nothing tears
                fields[name] = DEFAULTS[name]
                continue
            values = checks.member("checkpoint", arrays, f"system.{name}")
            if np.ndim(values) == 0 or len(values) not in (1, count):
                raise ValueError(f"checkpoint is of another system: its {name} has shape {np.shape(values)}")
            fields[name] = values[0] if len(values) < count else values
    # Whether a connection bears its length is a question to the start, not to a state on the way.
    breaking = {name: fields.pop(name) for name in TEARING_FIELDS}
    known = all((getattr(start, name) == value).all() for name, value in breaking.items())
    if known and all((getattr(start, name) == value).all() for name, value in fields.items()):
        return start
    return (start if known else start.replace(**breaking)).replace(**fields)


def restored_choice(numbers: Numbers, fps: float) -> StepChoice:
    """Return the substeps that a checkpoint holds; raise ValueError if it lacks a number."""
    known = {f"rates.{name}": value for name, value in Rates._field_defaults.items()} | dict(numbers)
    rates = Rates(*(_size(known, f"rates.{name}") for name in Rates._fields))
    limit = _size(numbers, "limit")
    least, substeps = (checks.member("checkpoint", numbers, name) for name in ("least", "substeps"))
    if checks.count("substeps", substeps, 1) > MOST_SUBSTEPS:
        raise ValueError(f"substeps of the checkpoint is {substeps}; it must be at most {MOST_SUBSTEPS}")
    refinement = checks.positive("refinement", numbers.get("refinement", 1.0))
    return StepChoice(rates, limit, checks.count("least", least, 0), int(substeps), fps, refinement)


def restored_progress(numbers: Numbers) -> tuple[int, int, list[tuple[float, int]]]:
    """Return the frame, the changes made, and from when on [s] frames took how many substeps.

    The last is empty where an older checkpoint did not keep it. Raises ValueError for what is none of these.
    """
    frame_index, changes = (
        checks.count(name, checks.member("checkpoint", numbers, name), 0) for name in ("frame_index", "changes")
    )
    chosen = numbers.get("chosen", [])
    if not isinstance(chosen, list) or not all(isinstance(one, list) and len(one) == 2 for one in chosen):
        raise ValueError(f"chosen of the checkpoint is {checks.repr_short(chosen)}; it must be a list of pairs")
    counts = [(checks.non_negative("chosen", time), checks.count("chosen", count, 1)) for time, count in chosen]
    return frame_index, changes, counts


def restored_gravity(numbers: Numbers, start: Any, made: Sequence[Change]) -> Any:
    """Return gravity as a checkpoint has it: as it was changed to by hand, or by what was made of a schedule."""
    if "gravity" in numbers:
        return numbers["gravity"]
    return next((one.gravity for one in reversed(made) if one.gravity is not None), start)


def saved_drives(loads: Sequence[Load], model: Model) -> dict[str, NDArray]:
    """Return which particles are driven still, where any were at the start."""
    return {"driven": np.flatnonzero(model.driven)} if any(isinstance(one, Driven) for one in loads) else {}


def restored_loads(loads: Sequence[Load], system: System, arrays: Arrays) -> tuple[Load, ...]:
    """Return loads as they were at the start, with drives that hold what they held still.

    Raises
    ------
    ValueError
        If the checkpoint is of other drives.
    """
    if not any(isinstance(one, Driven) for one in loads):
        return tuple(loads)
    kept = np.zeros(system.particle_count, dtype=bool)
    held = np.asarray(checks.member("checkpoint", arrays, "driven"))
    kept[checks.indices("driven of the checkpoint", held[:, None], 1, len(kept))[:, 0]] = True
    if (kept & ~driven_particles(loads, system)).any():
        raise ValueError("checkpoint is of other drives: it holds particles that none moves here")
    return tuple(one.keeping(kept) if isinstance(one, Driven) else one for one in loads)


def restored_baseline(numbers: Numbers) -> Baseline | None:
    """Return what energies are compared with; None if the checkpoint, of before, does not hold it."""
    if "baseline" not in numbers:
        return None
    found = numbers["baseline"]
    if not isinstance(found, list) or len(found) != 2 or not all(isinstance(one, int | float) for one in found):
        raise ValueError(f"baseline of the checkpoint is {checks.repr_short(found)}; it must be two numbers")
    return Baseline(*map(float, found))


def _size(numbers: Numbers, name: str) -> float:
    return checks.non_negative(
        f"{name} of the checkpoint", checks.member("checkpoint", numbers, name), infinite=True
    )


def check_arrays(stepping: Stepping, arrays: Arrays) -> None:
    """Raise ValueError unless `take_back` can take the arrays of a checkpoint back."""
    own = {name: array.numpy() for name, array in _moving(stepping).items()}
    for effect in _kept_effects(stepping, arrays):
        own |= effect.checkpoint()
    for name, values in own.items():
        found = checks.member("checkpoint", arrays, name)
        if (found.shape, found.dtype) != (values.shape, values.dtype):
            raise ValueError(f"checkpoint holds {name} of shape {found.shape} and type {found.dtype}")


def take_back(stepping: Stepping, arrays: Arrays) -> None:
    """Let a system move on from the arrays of a checkpoint."""
    for name, array in _moving(stepping).items():
        array.assign(arrays[name])
    kept = _kept_effects(stepping, arrays)
    for effect in kept:
        effect.restore(arrays)
    if len(kept) < len(stepping.assembly.all):
        stepping.begin_anew()


def _kept_effects(stepping: Stepping, arrays: Arrays) -> list[Effect]:
    """Return the effects that a checkpoint has kept.

    Older ones did not sum the work of obstacles that move, and knew none between the particles of a body.
    """
    work, between = stepping.assembly.external_work, "straddle.partner"
    known = [one for one in stepping.assembly.all if one is not work or "work.before" in arrays]
    return known if between in arrays else [one for one in known if between not in one.checkpoint()]


def _moving(stepping: Stepping) -> dict[str, wp.array]:
    """Return what a substep leaves to the next, by name."""
    now = stepping.state.state_in
    arrays = {"x": now.x, "v": now.v} | {f"carried.{k}": array for k, array in enumerate(now.method_state)}
    if stepping.model.compensated:
        arrays |= {"lost.x": now.compensation.x, "lost.v": now.compensation.v}
    return arrays
