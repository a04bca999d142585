"""Checks of the arguments of `Ensemble` that differ between worlds."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import checks
from ..bodies import LIMITS, System
from ..world import Collider, Gravity, Load, Scene, with_contact

NOT_NEGATIVE: checks.Limit = (lambda v: v >= 0, "at least 0")
MORE_LIMITS = {"friction": (checks.FINITE, NOT_NEGATIVE), "gravity": (checks.FINITE,)}
"""Checks of parameters that are not fields of `System`."""


def parameter_rows(
    system: System, collider_count: int, worlds: int, given: Mapping[str, Any]
) -> dict[str, NDArray[np.float64]]:
    """Return the rows of each parameter for `Model`; raise ValueError for a wrong shape, length or value."""
    n, d = system.particle_count, system.dim
    shapes: dict[str, tuple[int, ...]] = {"mass": (n,), "position": (n, d), "velocity": (n, d)}
    shapes |= {"friction": (collider_count,), "gravity": (d,)}
    shapes |= dict.fromkeys(("rest_length", "stiffness", "damping"), (system.connection_count,))
    rows = {}
    for name, value in given.items():
        if value is None:
            continue
        values = _in_rows(name, checks.array(name, value), shapes[name])
        if worlds % len(values):
            raise ValueError(f"{name} has {len(values)} rows; that must divide the number of worlds, {worlds}")
        checks.within(name, values, *(LIMITS | MORE_LIMITS)[name])
        rows[name] = values
    if "velocity" in rows:
        mass = rows.get("mass", system.mass[None])
        rows["velocity"] = _without_pinned(rows["velocity"], mass, np.ndim(given["velocity"]) == 2)
    return rows


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


def taken_from(
    scene: Any, colliders: Any, loads: Any, contact: Any
) -> tuple[System, tuple[Collider, ...], tuple[Load, ...], Gravity]:
    """Return system, colliders, loads and gravity of a scene, or of a system and these arguments."""
    colliders = checks.sequence("colliders", colliders, Collider, "Plane()")
    loads = checks.sequence("loads", loads, Load, "Force((0, 0, 1))")
    if isinstance(scene, System):
        return scene, colliders, with_contact(loads, contact), 9.82
    if not isinstance(scene, Scene):
        raise ValueError(f"scene is {checks.repr_short(scene)}; it must be a Scene or a System, such as chain(5)")
    given = {"colliders are": colliders, "loads are": loads, "contact is": () if contact is None else (contact,)}
    for named, values in given.items():
        if len(values):
            raise ValueError(f"{named} given beside a Scene, which has its own; that must be in the scene")
    if len(scene.schedule):
        raise ValueError("the scene has a schedule, which worlds of an ensemble cannot have yet")
    return scene.system, tuple(scene.colliders), tuple(scene.loads), scene.gravity
