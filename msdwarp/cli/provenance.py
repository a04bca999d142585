"""Provenance of a run as JSON data, and the scene and options that can be restored from it."""

import hashlib
import inspect
import json
import subprocess
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import fields
from enum import Enum, EnumType
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from types import UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

import numpy as np
from numpy.typing import NDArray

from .. import checks
from ..bodies import (
    CONNECTION_FIELDS,
    LINEAR_SPRING,
    PARTICLE_FIELDS,
    TEARING_FIELDS,
    LawKinds,
    OwnDamper,
    OwnSpring,
    System,
    stored,
)
from ..world import (
    Actuator,
    Collider,
    Contact,
    Load,
    PrescribedMotion,
    Scene,
    gravity_at,
    gravity_in_words,
    is_device_function,
    sampled,
    with_potential,
)
from .options import Options
from .picture_options import Pictures
from .scene_files import Origin
from .script_signatures import UNTRUSTED, Script, script_as_stored


def source_of(origin: Origin, scene: Scene) -> dict[str, Any]:
    """Return a run's origin as JSON data: the scene, how to build it again, and the version of the program."""
    return {
        "scene": origin.place,
        "parameters": parameters_of(origin),
        "gravity": np.asarray(with_potential(scene.gravity)).tolist(),
        **({"gravity_of_time": gravity_in_words(scene.gravity)} if callable(scene.gravity) else {}),
        **({"loads": [repr(one) for one in scene.loads]} if scene.loads else {}),
        "schedule": len(scene.schedule),
        "digest": digest(scene),
        "command": list(sys.argv),
        "versions": {package: _version(package) for package in ("msdwarp", "warp-lang", "numpy", "h5py")},
        "commit": commit(),
    } | script_as_stored(origin.place, origin.script)


def parameters_of(origin: Origin) -> dict[str, Any]:
    """Return all parameters of a scene, defaults included, as JSON data."""
    defaults = inspect.signature(origin.build).parameters.items()
    parameters = {name: one.default for name, one in defaults if one.default is not one.empty}
    return as_json({**parameters, **origin.parameters})


def rebuild_scene(attributes: Mapping[str, Any], script: Script = UNTRUSTED) -> tuple[Origin, Scene]:
    """Build again the scene that a file's attributes name; raise ValueError if its script may not run."""
    place = script.scene or str(checks.member("the file", attributes, "scene"))
    stored = checks.mapping("parameters of the file", checks.member("the file", attributes, "parameters"))
    found = script.found(place, attributes)
    known = inspect.signature(found.build, eval_str=True).parameters
    unknown = stored.keys() - known.keys()
    if unknown:
        raise ValueError(f"build of scene {place!r} no longer has the parameters {sorted(unknown)}")
    parameters = {name: _as_declared(value, known[name].annotation) for name, value in stored.items()}
    found = found._replace(parameters=parameters)
    return found, found.scene()


def _as_declared(value: Any, annotation: Any) -> Any:
    """Convert a value from JSON to the type in its annotation: paths, tuples and Enum members."""
    if get_origin(annotation) is Annotated:
        return _as_declared(value, get_args(annotation)[0])
    for kind in get_args(annotation) if get_origin(annotation) in (Union, UnionType) else (annotation,):
        if isinstance(value, str):
            if kind is Path:
                return Path(value)
            if isinstance(kind, EnumType) and value in kind.__members__:
                return kind[value]
        whole = get_origin(kind) or kind
        if isinstance(value, list) and whole in (list, tuple, set):
            inner = [one for one in get_args(kind) if one is not ...] or [Any]
            inner += inner[-1:] * (len(value) - len(inner))
            return whole(_as_declared(*both) for both in zip(value, inner, strict=False))
    return value


def as_json(value: Any) -> Any:
    """Return a value as JSON data: sets as sorted lists, Enum members by name, other objects as text."""

    def default(one: Any) -> Any:
        if isinstance(one, set | frozenset):
            return sorted(one)
        return one.name if isinstance(one, Enum) else str(one)

    return json.loads(json.dumps(value, default=default))


def restored_options(values: Mapping[str, Any], **changes: Any) -> Options:
    """Return options from the data of `Options.as_stored`, with changes; missing options have their defaults.

    Raise ValueError for data of a later version, or data that no run could have stored.
    """
    values = _renamed(checks.mapping("the run's options", values)) | changes
    pictures = _renamed(checks.mapping("the run's pictures", values.pop("pictures", {})))
    own, drawn = get_type_hints(Options), get_type_hints(Pictures)
    if unknown := (values.keys() - own.keys()) | (pictures.keys() - drawn.keys()):
        raise ValueError(f"the run's options are those of a later version of msdwarp: {sorted(unknown)}")
    for hints, given in ((own, values), (drawn, pictures)):
        for name, value in given.items():
            if not fits(value, hints[name]):
                raise ValueError(f"the run's {name} is {checks.repr_short(value)}, which no run stores")
    out = values.pop("out", None)
    drawing: Any = {name: tuple(value) if isinstance(value, list) else value for name, value in pictures.items()}
    return Options(**values, out=out and Path(out), pictures=Pictures(**drawing))


def _renamed(options: Mapping[str, Any]) -> dict[str, Any]:
    """Return options by their present names: of version 0.1 `route` has another, of 0.2 `colour`."""
    return {{"route": "force_algorithm", "colour": "color"}.get(name, name): one for name, one in options.items()}


def fits(value: Any, kind: Any) -> bool:
    """Return whether a value, of JSON or Python, fits the type of an option."""
    if get_origin(kind) in (Union, UnionType):
        return any(fits(value, one) for one in get_args(kind))
    if get_origin(kind) is Literal:
        return any(type(value) is type(one) and value == one for one in get_args(kind))
    if get_origin(kind) is tuple:
        return isinstance(value, list | tuple) and all(fits(one, get_args(kind)[0]) for one in value)
    kinds = {float: (int, float), Path: str}.get(kind, kind)
    return isinstance(value, kinds) and (kind is bool or not isinstance(value, bool))


def digest(scene: Scene) -> str:
    """Return a short text that is equal for scenes with the same bodies and surroundings.

    Functions are compared by values: a collider's poses at some times, a change applied to the start.
    """
    found = hashlib.sha256()
    for part in _parts(scene):
        found.update(part)
    return found.hexdigest()[:16]


def _parts(scene: Scene) -> Iterator[bytes]:
    # Without breakable springs, fields of fracture are left out, so digests of earlier versions stay valid.
    absent = () if scene.system.tears else TEARING_FIELDS
    times, dim = np.linspace(0.0, scene.duration, 9), scene.system.dim
    for field in (field for field in fields(System) if field.name not in absent):
        values = getattr(scene.system, field.name)
        if isinstance(values, np.ndarray):
            yield f"{field.name} {values.shape}".encode()
            yield np.ascontiguousarray(stored(values) if values.ndim == 1 else values).tobytes()
    if scene.settled:
        yield b"settled"
    if scene.shape is not None:
        yield b"shape" + np.ascontiguousarray(scene.shape).tobytes()
    for part in (scene.system.cells, scene.system.angles):
        if part is not None:
            yield from (np.ascontiguousarray(getattr(part, field.name)).tobytes() for field in fields(part))
    constant = np.asarray(with_potential(scene.gravity), dtype=float).tolist()
    yield repr((scene.system.damper, constant)).encode()
    if isinstance(damper := scene.system.damper, OwnDamper):
        yield str(damper.function.adj.source).encode()
    if isinstance(spring := scene.system.spring, OwnSpring):
        yield str(spring.function.adj.source).encode()
    elif spring != LINEAR_SPRING:
        yield repr(spring).encode()
    yield from (law.kind.tobytes() for law in (damper, spring) if isinstance(law, LawKinds))
    if callable(scene.gravity):
        yield _of_times(lambda at: gravity_at(scene.gravity, at, dim), times)
    for collider in scene.colliders:
        left_out = {"motion"} if collider.stiffness is not None else {"motion", "stiffness", "ramp", "dissipation"}
        held = {one.name: getattr(collider, one.name) for one in fields(collider) if one.name not in left_out}
        yield repr((type(collider).__name__, held)).encode()
        if collider.motion is not None:
            yield from _poses(lambda time, of=collider: of.pose(time, dim), times)
    for one in scene.loads:
        if isinstance(one, PrescribedMotion):
            drive = one.bound(scene.system)
            yield np.concatenate([drive.held, drive.centre]).tobytes()
            yield from _poses(drive.pose, times)
        elif isinstance(one, Actuator):
            chosen = one.connections(scene.system)
            yield chosen.tobytes() + one.delays(scene.system, chosen).tobytes()
            yield _of_times(one.at, times)
        else:
            yield from _of_load(one, scene, times)
    for change in scene.schedule:
        yield repr((change.time, change.set_rest_shape, sorted(change.parameters))).encode()
        if change.unpin is not None:
            yield repr(("release", np.asarray(change.unpin).tolist())).encode()
        if change.gravity is not None:
            late = np.linspace(change.time, scene.duration, 9)
            yield _of_times(lambda at, given=change.gravity: gravity_at(given, at, dim), late)
        changed = change.foreseen.applied_to(scene.system)
        for name in (*PARTICLE_FIELDS, *(name for name in CONNECTION_FIELDS if name not in absent)):
            yield np.ascontiguousarray(getattr(changed, name)).tobytes()


def _poses(pose: Callable[[float], Iterable[Any]], times: NDArray) -> Iterator[bytes]:
    def at(time: NDArray) -> NDArray:
        return np.concatenate([np.ravel(part) for part in pose(float(time[0]))], dtype=float)

    for time in times:
        yield _of_times(at, np.array([time]))


def _of_times(values: Callable[[NDArray], NDArray], times: NDArray) -> bytes:
    """Return the bytes of a function's values; "undefined" in place of those at times at which it fails.

    A run may have ended before such a time, though it is within the scene's duration.
    """
    try:
        return values(times).tobytes()
    except Exception:
        return b"undefined" if len(times) == 1 else b"".join(_of_times(values, one) for one in times[:, None])


_FIRST_NAMES = {"Contact": "Touch", "EnclosedGas": "Gas", "surface_colliders": "obstacles"}
"""Class names in version 0.1: digests use them, so that files of this version still match."""


def _of_load(load: Load, scene: Scene, times: NDArray) -> Iterator[bytes]:
    """Yield the contents of a load: functions of time by some values, functions of position by their source."""
    kind = type(load).__name__
    yield _FIRST_NAMES.get(kind, kind).encode()
    yield load.particles(scene.system).tobytes()
    for field in fields(load):
        value = getattr(load, field.name)
        if isinstance(load, Contact) and field.name == "exclude":
            continue
        if isinstance(load, Contact) and field.name == "self_contact":
            yield from (b"between", repr("none" if load.exclude else "all" if value else "bodies").encode())
            continue
        yield _FIRST_NAMES.get(field.name, field.name).encode()
        if field.name == "on":
            continue
        if isinstance(value, Collider):
            yield repr(value).encode()
            yield from _poses(lambda time, of=value: of.pose(time, scene.system.dim), times)
        elif is_device_function(value):
            yield str(value.adj.source).encode()
        elif callable(value):
            yield _of_times(lambda at, of=value: sampled(of, at), times)
        elif isinstance(value, np.ndarray | tuple | list):
            yield np.asarray(value, dtype=float).tobytes()
        else:
            yield repr(value).encode()


def _version(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:  # msdwarp runs from its sources
        return None


def commit() -> str | None:
    """Return the commit of this working copy, with a + if there are changes; None if this is no working copy."""
    folder = Path(__file__).parent

    def git(*words: str) -> str:
        done = subprocess.run(["git", *words], cwd=folder, capture_output=True, text=True, check=True, timeout=5)
        return done.stdout.strip()

    try:
        if not git("ls-files", "--", Path(__file__).name):  # a copy inside another project's repository
            return None
        return git("rev-parse", "HEAD") + ("+" if git("status", "--porcelain", "--untracked-files=no") else "")
    except (OSError, subprocess.SubprocessError):
        return None
