"""Scenes as JSON data and arrays for files, so that drawing a stored run needs no script."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import checks
from ..bodies import System
from .colliders import Box, Capsule, Collider, Cone, Plane, Sphere
from .contact import Contact, radii
from .gravity import Gravity, with_potential
from .look import OF_BODIES, Look, Viewpoint
from .motion import displacement_and_turn
from .scene import Scene
from .schedule import OF_PARTICLES, Change

Stored = tuple[dict[str, Any], dict[str, NDArray]]
"""JSON data, and arrays by name."""
_COLLIDERS = {kind.__name__: kind for kind in (Plane, Sphere, Box, Capsule, Cone)}
_TEXTURES = ("texture", "obstacle_texture")
_COLOR = "colour"
"""The name in files of a look's `color`, which it had before 0.3."""
_LATER = ("azimuth", "elevation", "target", "distance", "follow", "field_of_view", "path", "finish", "cut")


@dataclass(frozen=True, eq=False)
class Recorded:
    """The motion of a collider, sampled at some times [s] and linearly interpolated."""

    times: NDArray[np.float64]
    displacement: NDArray[np.float64]
    """Displacements [m], shape [any, d]."""
    turn: NDArray[np.float64] | None
    """Rotation vectors or angles [rad], shape [any, 3 or 1]; None if the collider does not rotate."""

    def __call__(self, time: float) -> Any:
        """Return the displacement, or a pair of displacement and rotation, like `Collider.motion`."""
        shift, turn = (
            None if values is None else np.array([np.interp(time, self.times, column) for column in values.T])
            for values in (self.displacement, self.turn)
        )
        return shift if turn is None else (shift, turn if len(turn) > 1 else turn[0])


def scene_as_stored(scene: Scene, times: Sequence[float] | NDArray) -> Stored:
    """Return a scene's data without its system; motions of its colliders are sampled at these times [s].

    Changes of parameters are stored as the values that they would give the initial system.
    """
    arrays: dict[str, NDArray] = {}
    times = np.unique(np.asarray(times, dtype=float))
    described = {
        "duration": scene.duration,
        "gravity": _gravity(scene.gravity),
        "look": _look_as_stored(scene.look, "look", arrays),
        "looks": [
            {"group": group, "look": _look_as_stored(look, f"looks/{k}", arrays)}
            for k, (group, look) in enumerate(scene.looks.items())
        ],
        "colliders": [
            _collider_as_stored(one, f"colliders/{k}", times, arrays)
            for k, one in enumerate(scene.colliders)
            if type(one).__name__ in _COLLIDERS
        ],
        "schedule": _schedule_as_stored(scene, arrays),
    }
    if radii(scene.contact_rules, scene.system).any():  # which pictures show
        given = [one for one in scene.contact_rules if one.thickness is not None]
        described["thickness"] = [{"thickness": one.thickness, "groups": one.groups} for one in given]
    return described, arrays


def scene_from_stored(system: System, described: Mapping[str, Any], arrays: Mapping[str, NDArray]) -> Scene:
    """Return a system's scene from the data of `scene_as_stored`; raise ValueError if they are invalid."""
    try:
        looks = described.get("looks", [])  # older files have none, or with fields of the picture
        own = {
            one["group"]: {name: one["look"][name] for name in (_COLOR, *OF_BODIES) if name in one["look"]}
            for one in looks
        }
        return Scene(
            system=system,
            colliders=[_collider(one, arrays) for one in described["colliders"]],
            gravity=checks.gravity_of_file(described["gravity"], system.dim),
            duration=described["duration"],
            look=_look(described["look"], "look", arrays),
            looks={group: _look(look, f"looks/{k}", arrays) for k, (group, look) in enumerate(own.items())},
            schedule=[_change(one, arrays, system.dim) for one in described["schedule"]],
            contact=[Contact(**one) for one in described.get("thickness", [])],
        )
    except (AttributeError, IndexError, KeyError, TypeError, ValueError) as error:
        raise ValueError(f"the stored scene is damaged: {error}") from error


def known_until(scene: Scene) -> float:
    """Return the end of the time in which all colliders' motions are known [s]; inf for functions."""
    recorded = [one.motion for one in scene.colliders if isinstance(one.motion, Recorded)]
    return min((float(motion.times[-1]) for motion in recorded), default=np.inf)


def _look_as_stored(look: Look, place: str, arrays: dict[str, NDArray]) -> dict[str, Any]:
    values = {one.name: getattr(look, one.name) for one in fields(Look)}
    for name in _TEXTURES:
        image = values.pop(name)
        if image is not None:
            arrays[f"{place}/{name}"] = np.asarray(image)
    values[_COLOR] = values.pop("color")
    if look.cut is not None:
        values["cut"] = _collider_as_stored(look.cut, f"{place}/cut", np.zeros(0), arrays)
    # Earlier versions open files of scenes that use nothing later.
    values["path"] = [asdict(one) for one in look.path] or look.path
    return {
        name: _plain(value) for name, value in values.items() if name not in _LATER or value != getattr(Look, name)
    }


def _look(described: Mapping[str, Any], place: str, arrays: Mapping[str, NDArray]) -> Look:
    textures = {name: arrays[f"{place}/{name}"] for name in _TEXTURES if f"{place}/{name}" in arrays}
    path = [Viewpoint(**one) for one in described.get("path", [])]
    values = {"color" if name == _COLOR else name: value for name, value in described.items()}
    cut = described.get("cut")
    return Look(**{**values, **textures, "path": path, "cut": cut and _collider(cut, arrays)})


def _collider_as_stored(
    collider: Collider, place: str, times: NDArray, arrays: dict[str, NDArray]
) -> dict[str, Any]:
    values = {one.name: _plain(getattr(collider, one.name)) for one in fields(collider) if one.name != "motion"}
    values = {"kind": type(collider).__name__, **values}
    if collider.motion is None:
        return values
    shifts, turns = zip(*(displacement_and_turn(collider.motion(float(time))) for time in times), strict=True)
    arrays[f"{place}/times"] = times
    arrays[f"{place}/displacement"] = np.array([np.atleast_1d(shift) for shift in shifts], dtype=float)
    known = [turn for turn in turns if turn is not None]
    if known:
        turns = [np.zeros(np.shape(known[0])) if turn is None else turn for turn in turns]
        arrays[f"{place}/turn"] = np.array([np.atleast_1d(turn) for turn in turns])
    return {**values, "motion": place}


def _collider(described: Mapping[str, Any], arrays: Mapping[str, NDArray]) -> Collider:
    values = dict(described)
    kind, place = _COLLIDERS[values.pop("kind")], values.pop("motion", None)
    motion = None
    if place is not None:
        times, displacement, turn = (arrays.get(f"{place}/{name}") for name in ("times", "displacement", "turn"))
        if times is None or displacement is None or not len(times) == len(displacement) > 0:
            raise ValueError(f"the motion {place!r} is missing or incomplete")
        motion = Recorded(times, displacement, turn)
    return kind(**{name: _tuples(value) for name, value in values.items()}, motion=motion)


def _schedule_as_stored(scene: Scene, arrays: dict[str, NDArray]) -> list[dict[str, Any]]:
    system, found = scene.system, []
    changes = sorted((change.foreseen for change in scene.schedule), key=lambda change: change.time)
    for k, change in enumerate(changes):
        particles, connections = change.chosen(system)
        system = change.applied_to(system)
        one = {"time": change.time, "freeze": change.set_rest_shape, "parameters": sorted(change.parameters)}
        if change.gravity is not None:
            one["gravity"] = _gravity(change.gravity)
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


def _change(described: Mapping[str, Any], arrays: Mapping[str, NDArray], dim: int) -> Change:
    place = described["place"]
    group = described["group"] if "group" in described else arrays[f"{place}/group"]
    values = {name: arrays[f"{place}/{name}"] for name in described["parameters"]}
    values = {name: value[0] if len(value) == 1 else value for name, value in values.items()}
    gravity = checks.gravity_of_file(described.get("gravity"), dim)
    return Change(described["time"], group, described["freeze"], values, gravity=gravity)


def _gravity(gravity: Gravity) -> Any:
    return np.asarray(with_potential(gravity), dtype=float).tolist()


def _plain(value: Any) -> Any:
    """Return a number, text, or array of numbers as JSON data."""
    return value if value is None or isinstance(value, str) else np.asarray(value).tolist()


def _tuples(value: Any) -> Any:
    return tuple(value) if isinstance(value, list) else value
