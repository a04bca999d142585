"""Checks of the arguments of simulations and ensembles."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import checks
from ..bodies import LIMITS, NONE, System
from ..integrators import MOST_SUBSTEPS
from ..world import Actuator, Change, Load, Problem, StrainRows

GRAVITY = 9.82
"""The default of `gravity`, that object itself: beside a scene none may be given."""
MOST_FRAMES = 10**9
"""Maximal number of frames of a run."""

NOT_NEGATIVE: checks.Limit = (lambda v: v >= 0, "at least 0")
MORE_LIMITS = {"friction": (checks.FINITE, NOT_NEGATIVE)} | dict.fromkeys(("gravity", "delay"), (checks.FINITE,))
"""Checks of parameters that are not fields of `System`."""


def frame_count(duration: float, fps: float) -> int:
    """Return the number of frames of 1/fps s in a duration [s], rounded; raise ValueError if it is 0."""
    frames = checks.positive("duration", duration) * checks.positive("fps", fps)
    count = round(min(frames, 2.0 * MOST_FRAMES))
    if count > MOST_FRAMES:
        raise ValueError(
            f"duration is {duration:g}; it must be at most {MOST_FRAMES} frames, {MOST_FRAMES / fps:g} s"
        )
    if count == 0:
        raise ValueError(f"duration is {duration:g}; it must be at least one frame, {1 / fps:g} s")
    return count


def given_substeps(substeps: int | str) -> int | None:
    """Return the requested number of substeps, None for "auto"; raise ValueError for any other value."""
    if isinstance(substeps, str):
        if substeps != "auto":
            raise ValueError(f"substeps is {substeps!r}; it must be a whole number or 'auto'")
        return None
    if checks.count("substeps", substeps, 1) > MOST_SUBSTEPS:
        raise ValueError(f"substeps is {substeps}; it must be at most {MOST_SUBSTEPS}")
    return int(substeps)


def problem_of(name: str, scene: Problem | System, also: str = "", **around: Any) -> Problem:
    """Return a scene itself, or the problem of a system with what is given of the other fields of `Problem`.

    Raises ValueError if it is neither, or a field is given beside a scene; `also` ends that message.
    """
    defaults = {"gravity": GRAVITY, "colliders": (), "loads": (), "contact": None, "schedule": (), "probes": None}
    nothing = {"colliders", "loads", "schedule", "probes"}  # what says as little as the default if it is empty
    given: dict[str, Any] = {
        name: value
        for name, value in around.items()
        if value is not defaults[name]
        and not (name in nothing and isinstance(value, list | tuple | dict) and not value)
    }
    if not isinstance(scene, Problem):
        checks.instance(name, scene, System, "chain(5), or a Scene")
        return Problem(system=scene, **given)
    for field in given:
        verb = "are" if field in ("colliders", "loads", "probes") else "is"
        raise ValueError(
            f"{field} {verb} given beside a Scene, which has its own; that must be in the scene{also}"
        )
    return scene


def in_order(schedule: Sequence[Change], system: System, loads: Sequence[Load]) -> list[Change]:
    """Return changes sorted by time; raise ValueError if one cannot be applied to this system and these loads."""
    changes = checks.sequence("schedule", schedule, Change, "at(1.0, mass=2.0)")
    for k, change in enumerate(changes):
        try:
            change.foreseen.applied_to(system)  # raise before anything runs
        except ValueError as error:
            raise ValueError(f"schedule[{k}].{error}") from error
    changes = sorted(changes, key=lambda change: change.time)
    for change in changes:
        loads = change.released_from(loads, system)
    return changes


def parameter_rows(problem: Problem, system: System, worlds: int, given: Mapping[str, Any]) -> dict[str, Any]:
    """Return the rows of each parameter for `Model`; raise ValueError for a wrong shape, length or value."""
    n, d, collider_count = system.particle_count, system.dim, len(problem.colliders)
    actuators = sum(isinstance(one, Actuator) for one in problem.loads)
    shapes: dict[str, tuple[int, ...]] = {"mass": (n,), "position": (n, d), "velocity": (n, d)}
    shapes |= {"friction": (collider_count,), "gravity": (d,), "delay": (actuators, n)}
    shapes |= dict.fromkeys(("rest_length", "stiffness", "damping"), (system.connection_count,))
    rows: dict[str, Any] = {}
    for name, value in given.items():
        if value is None:
            continue
        if name in ("strain", "delay") and not actuators:
            raise ValueError(f"{name} is given; there must be an Actuator among the loads then")
        if name == "friction" and not collider_count:
            raise ValueError("friction is given; there must be colliders then")
        if name == "strain":
            values: Any = StrainRows(value, actuators)
        else:
            values = _in_rows(name, checks.array(name, value), shapes[name])
            checks.within(name, values, *(LIMITS | MORE_LIMITS)[name])
        if worlds % len(values):
            raise ValueError(f"{name} has {len(values)} rows; that must divide the number of worlds, {worlds}")
        rows[name] = values
    if "delay" in rows and "strain" in rows:
        raise ValueError(
            "delay is given beside strain; only one of them may be: a strain that is a function of time has the "
            "delays of worlds in itself"
        )
    _warn_of_cells(problem.system, system, rows)
    if "velocity" in rows:
        mass = rows.get("mass", system.mass[None])
        rows["velocity"] = _without_pinned(rows["velocity"], mass, np.ndim(given["velocity"]) == 2)
    return rows


def _warn_of_cells(system: System, base: System, rows: Mapping[str, Any]) -> None:
    """Warn if worlds, of a `base` and rows, change springs of a body with cells, whose cells stay as they are."""
    cells = system.cells
    if cells is None:
        return
    has_cells = np.zeros(system.particle_count, dtype=bool)
    has_cells[cells.corners[cells.corners != NONE]] = True
    inside = has_cells[system.connections].all(axis=1)
    for name, of_cells in (("stiffness", "modulus"), ("damping", "damping")):
        own, worlds = getattr(system, name)[inside], rows.get(name, [getattr(base, name)])
        if getattr(cells, of_cells).any() and any((row[inside] != own).any() for row in worlds):
            checks.warn(
                f"{name} is that of springs; the {of_cells} of cells, which a material with poissons_ratio adds, "
                "stays the scene's in all worlds. For another modulus or damping make a scene of its own, with "
                "Material(youngs_modulus=..., damping_ratio=...)",
                checks.StartWarning,
            )


def _in_rows(name: str, values: NDArray[np.float64], shape: tuple[int, ...]) -> NDArray[np.float64]:
    """Return rows of a given shape; a shorter form is broadcast without copies."""
    full, allowed = f"[rows, {', '.join(map(str, shape))}]", ""
    given, short = values, values.ndim == len(shape)
    if name == "gravity":
        allowed = "[rows] (downwards) or "
        if short:
            checks.within(name, values, NOT_NEGATIVE)
            given = np.concatenate([np.zeros((len(values), shape[0] - 1)), -values[:, None]], axis=1)
    elif name == "velocity":
        allowed = f"[rows, {shape[-1]}] or "
        given = values[:, None, :] if short else values
    elif name == "delay":
        allowed = f"[rows], [rows, {shape[0]}] or "
        given = values if values.ndim == 3 else values.reshape(*values.shape, *(1,) * (3 - values.ndim))
    elif name != "position":
        allowed = "[rows] or "
        given = values[:, None] if short else values
    # A short form has length 1 along axes that are left out.
    fits = given.ndim == 1 + len(shape) and all(
        own == each or (own == 1 and given is not values) for own, each in zip(given.shape[1:], shape, strict=True)
    )
    if not fits or len(given) == 0:
        raise ValueError(
            f"{name} has shape {values.shape}; it must be of shape {allowed}{full}, a row for each world"
        )
    return np.broadcast_to(given, (len(given), *shape))


def _without_pinned(
    velocity: NDArray[np.float64], mass: NDArray[np.float64], all_alike: bool
) -> NDArray[np.float64]:
    """Return velocities, 0 for pinned particles; raise ValueError if one of these was given another velocity."""
    if not np.isinf(mass).any():
        return velocity
    each = np.arange(np.lcm(len(velocity), len(mass)))
    velocity = np.array(velocity[each % len(velocity)])
    pinned = np.isinf(mass[each % len(mass)])
    moves = pinned & (velocity != 0).any(axis=2)
    if moves.any() and not all_alike:
        world, particle = np.argwhere(moves)[0]
        raise ValueError(f"velocity[{world}, {particle}] is of a pinned particle; it must be 0")
    velocity[pinned] = 0.0
    return velocity
