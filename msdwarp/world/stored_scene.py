"""A scene by value: as numbers, texts and arrays that a file can hold, so that pictures of it need no script."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..bodies import System
from .colliders import Box, Capsule, Collider, Cone, Plane, Sphere
from .gravity import with_potential
from .look import Look
from .motion import displacement_and_turn
from .scene import Scene
from .schedule import OF_PARTICLES, Change

Stored = tuple[dict[str, Any], dict[str, NDArray]]
"""What JSON can hold, and arrays by name."""
_COLLIDERS = {kind.__name__: kind for kind in (Plane, Sphere, Box, Capsule, Cone)}
_TEXTURES = ("texture", "obstacle_texture")


@dataclass(frozen=True, eq=False)
class Recorded:
    """The motion of a collider as it was at some times, and straight between them."""

    times: NDArray[np.float64]
    """When [s], rising, shape [any]."""
    displacement: NDArray[np.float64]
    """By how much it was displaced [m], shape [any, d]."""
    turn: NDArray[np.float64] | None
    """By how much it was turned [rad], shape [any, 3 or 1]; None where it never was."""

    def __call__(self, time: float) -> Any:
        """Return the displacement, or a pair of it and the turn, as `Collider.motion` does."""
        shift = self._at(time, self.displacement)
        if self.turn is None:
            return shift
        turn = self._at(time, self.turn)
        return shift, turn if len(turn) > 1 else turn[0]

    def _at(self, time: float, values: NDArray) -> NDArray[np.float64]:
        return np.array([np.interp(time, self.times, column) for column in values.T])


def scene_as_stored(scene: Scene, times: Sequence[float] | NDArray) -> Stored:
    """Return what a scene is beside its system; what moves in it, as it is at these times [s].

    Changes of parameters are kept as the values that they make of the system as it is at the start.
    """
    arrays: dict[str, NDArray] = {}
    looks = [
        {"group": group, "look": _look_as_stored(look, f"looks/{k}", arrays)}
        for k, (group, look) in enumerate(scene.looks.items())
    ]
    colliders = [
        _collider_as_stored(one, f"colliders/{k}", np.unique(np.asarray(times, dtype=float)), arrays)
        for k, one in enumerate(scene.colliders)
        if type(one).__name__ in _COLLIDERS
    ]
    described = {
        "duration": scene.duration,
        "gravity": np.asarray(with_potential(scene.gravity), dtype=float).tolist(),
        "look": _look_as_stored(scene.look, "look", arrays),
        "looks": looks,
        "colliders": colliders,
        "schedule": _schedule_as_stored(scene, arrays),
    }
    return described, arrays


def scene_from_stored(system: System, described: Mapping[str, Any], arrays: Mapping[str, NDArray]) -> Scene:
    """Return the scene of a system that `scene_as_stored` described; raise ValueError if it is none."""
    try:
        looks = described.get("looks", [])  # which older files have not
        colliders = [_collider(one, arrays) for one in described["colliders"]]
        for one in colliders:
            if wrong := one.fits(system.dim):
                raise ValueError(wrong)
        return Scene(
            system=system,
            colliders=colliders,
            gravity=described["gravity"],
            duration=described["duration"],
            look=_look(described["look"], "look", arrays),
            looks={one["group"]: _look(one["look"], f"looks/{k}", arrays) for k, one in enumerate(looks)},
            schedule=[_change(one, arrays) for one in described["schedule"]],
        )
    except (AttributeError, IndexError, KeyError, TypeError, ValueError) as error:
        raise ValueError(f"the stored scene is damaged: {error}") from error


def known_until(scene: Scene) -> float:
    """Return until when it is known where all colliders are [s]: inf where their motions are functions."""
    recorded = [one.motion for one in scene.colliders if isinstance(one.motion, Recorded)]
    return min((float(motion.times[-1]) for motion in recorded), default=np.inf)


def _look_as_stored(look: Look, place: str, arrays: dict[str, NDArray]) -> dict[str, Any]:
    values = {one.name: getattr(look, one.name) for one in fields(Look)}
    for name in _TEXTURES:
        image = values.pop(name)
        if image is not None:
            arrays[f"{place}/{name}"] = np.asarray(image)
    return {name: _plain(value) for name, value in values.items()}


def _look(described: Mapping[str, Any], place: str, arrays: Mapping[str, NDArray]) -> Look:
    textures = {name: arrays[f"{place}/{name}"] for name in _TEXTURES if f"{place}/{name}" in arrays}
    return Look(**{**described, **textures})


def _collider_as_stored(
    collider: Collider, place: str, times: NDArray, arrays: dict[str, NDArray]
) -> dict[str, Any]:
    values = {one.name: _plain(getattr(collider, one.name)) for one in fields(collider) if one.name != "motion"}
    if collider.motion is None:
        return {"kind": type(collider).__name__, **values}
    both = [displacement_and_turn(collider.motion(float(time))) for time in times]
    arrays[f"{place}/times"] = times
    arrays[f"{place}/displacement"] = np.array([np.atleast_1d(shift) for shift, _ in both], dtype=float)
    turns = [np.atleast_1d(turn) for _, turn in both if turn is not None]
    if turns:
        none = np.zeros_like(turns[0], dtype=float)
        arrays[f"{place}/turn"] = np.array([none if turn is None else np.atleast_1d(turn) for _, turn in both])
    return {"kind": type(collider).__name__, **values, "motion": place}


def _collider(described: Mapping[str, Any], arrays: Mapping[str, NDArray]) -> Collider:
    values = dict(described)
    kind, place = _COLLIDERS[values.pop("kind")], values.pop("motion", None)
    motion = None
    if place is not None:
        times, displacement, turn = (arrays.get(f"{place}/{name}") for name in ("times", "displacement", "turn"))
        if times is None or displacement is None or not len(times) == len(displacement) > 0:
            raise ValueError(f"the motion {place!r} is not there, or not whole")
        motion = Recorded(times, displacement, turn)
    return kind(**{name: _tuples(value) for name, value in values.items()}, motion=motion)


def _schedule_as_stored(scene: Scene, arrays: dict[str, NDArray]) -> list[dict[str, Any]]:
    system, found = scene.system, []
    for k, change in enumerate(sorted(scene.schedule, key=lambda change: change.time)):
        particles, connections = change.chosen(system)
        system = change.applied_to(system)
        one = {"time": change.time, "freeze": change.set_rest_shape, "parameters": sorted(change.parameters)}
        if change.gravity is not None:
            one["gravity"] = np.asarray(with_potential(change.gravity), dtype=float).tolist()
        if isinstance(change.group, str) or change.group is None:
            one["group"] = change.group
        else:
            arrays[f"schedule/{k}/group"] = np.flatnonzero(particles)
        for name in change.parameters:
            values = getattr(system, name)[particles if name in OF_PARTICLES else connections]
            same = len(values) > 0 and np.all(values == values[0])
            arrays[f"schedule/{k}/{name}"] = values[:1] if same else values
        found.append({**one, "place": f"schedule/{k}"})
    return found


def _change(described: Mapping[str, Any], arrays: Mapping[str, NDArray]) -> Change:
    place = described["place"]
    group = described["group"] if "group" in described else arrays[f"{place}/group"]
    values = {name: arrays[f"{place}/{name}"] for name in described["parameters"]}
    values = {name: value[0] if len(value) == 1 else value for name, value in values.items()}
    return Change(described["time"], group, described["freeze"], values, gravity=described.get("gravity"))


def _plain(value: Any) -> Any:
    """Return a number, text, or numbers as JSON has them."""
    return value if value is None or isinstance(value, str) else np.asarray(value).tolist()


def _tuples(value: Any) -> Any:
    return tuple(value) if isinstance(value, list) else value
