"""What made a run, as text that a file can hold, and the scene built again from that text."""

import hashlib
import inspect
import json
import subprocess
import sys
from collections.abc import Iterator, Mapping
from dataclasses import fields
from enum import Enum, EnumType
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from types import UnionType
from typing import Annotated, Any, Union, get_args, get_origin

import numpy as np

from .. import checks
from ..bodies import CONNECTION_FIELDS, PARTICLE_FIELDS, TEARING_FIELDS, System, stored
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
from .scene_files import Origin
from .script_signatures import UNTOLD, Script, script_as_stored


def about(origin: Origin, scene: Scene) -> dict[str, Any]:
    """Return what made a run, as JSON has it: the scene, how it is built again, and by what program."""
    defaults = inspect.signature(origin.build).parameters.items()
    parameters = {name: one.default for name, one in defaults if one.default is not one.empty}
    return {
        "scene": origin.place,
        "parameters": json.loads(json.dumps({**parameters, **origin.parameters}, default=as_json)),
        "gravity": np.asarray(with_potential(scene.gravity)).tolist(),
        **({"gravity_of_time": gravity_in_words(scene.gravity)} if callable(scene.gravity) else {}),
        **({"loads": [repr(one) for one in scene.loads]} if scene.loads else {}),
        "schedule": len(scene.schedule),
        "digest": digest(scene),
        "command": list(sys.argv),
        "versions": {package: _version(package) for package in ("msdwarp", "warp-lang", "numpy", "h5py")},
        "commit": commit(),
    } | script_as_stored(origin.place, origin.script)


def built_again(attributes: Mapping[str, Any], script: Script = UNTOLD) -> tuple[Origin, Scene]:
    """Return the scene that a file's attributes say it came from, built again.

    Its script is run, if it came from one and that may be run.

    Raises
    ------
    ValueError
        If they do not say so, or it cannot be built, or the script may not be run.
    """
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
    """Return a value that JSON held as what it is declared to be, with its paths, tuples and Enum members."""
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
    """Return what stands for a value that JSON cannot hold."""
    if isinstance(value, set | frozenset):
        return sorted(value)
    return value.name if isinstance(value, Enum) else str(value)


def digest(scene: Scene) -> str:
    """Return a short text that two scenes share if the same moves in them in the same surroundings.

    Functions are in it by some of their values: where a collider is now and then, what a change makes of a start.
    """
    found = hashlib.sha256()
    for part in _parts(scene):
        found.update(part)
    return found.hexdigest()[:16]


def _parts(scene: Scene) -> Iterator[bytes]:
    # What no scene had before connections could break is left out where they cannot: digests stay what they were.
    absent = () if scene.system.tears else TEARING_FIELDS
    for field in (field for field in fields(System) if field.name not in absent):
        values = getattr(scene.system, field.name)
        if isinstance(values, np.ndarray):
            yield f"{field.name} {values.shape}".encode()
            yield np.ascontiguousarray(stored(values) if values.ndim == 1 else values).tobytes()
    constant = np.asarray(with_potential(scene.gravity), dtype=float).tolist()
    yield repr((scene.system.damper, constant)).encode()
    if callable(scene.gravity):
        yield gravity_at(scene.gravity, np.linspace(0.0, scene.duration, 9), scene.system.dim).tobytes()
    for collider in scene.colliders:
        held = {field.name: getattr(collider, field.name) for field in fields(collider) if field.name != "motion"}
        yield repr((type(collider).__name__, held)).encode()
        for time in np.linspace(0.0, scene.duration, 9) if collider.motion is not None else ():
            for part in collider.pose(float(time), scene.system.dim):
                yield np.asarray(part, dtype=float).tobytes()
    for one in scene.loads:
        if isinstance(one, PrescribedMotion):
            drive = one.bound(scene.system)
            yield np.concatenate([drive.held, drive.centre]).tobytes()
            for time in np.linspace(0.0, scene.duration, 9):
                for part in drive.pose(float(time)):
                    yield np.asarray(part, dtype=float).tobytes()
        elif isinstance(one, Actuator):
            chosen = one.connections(scene.system)
            yield chosen.tobytes() + one.delays(scene.system, chosen).tobytes()
            yield one.at(np.linspace(0.0, scene.duration, 9)).tobytes()
        else:
            yield from _of_load(one, scene)
    for change in scene.schedule:
        yield repr((change.time, change.set_rest_shape, sorted(change.parameters))).encode()
        if change.unpin is not None:
            yield repr(("release", np.asarray(change.unpin).tolist())).encode()
        if change.gravity is not None:
            yield gravity_at(
                change.gravity, np.linspace(change.time, scene.duration, 9), scene.system.dim
            ).tobytes()
        changed = change.applied_to(scene.system)
        for name in (*PARTICLE_FIELDS, *(name for name in CONNECTION_FIELDS if name not in absent)):
            yield np.ascontiguousarray(getattr(changed, name)).tobytes()


_FIRST_NAMES = {"Contact": "Touch", "EnclosedGas": "Gas", "surface_colliders": "obstacles"}
"""What had other names in version 0.1: the digests of scenes keep those, so that its files are known again."""


def _of_load(load: Load, scene: Scene) -> Iterator[bytes]:
    """Yield what a load is by value: functions of time by some of their values, those of place by their source."""
    times, dim = np.linspace(0.0, scene.duration, 9), scene.system.dim
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
            for time in times:
                for part in value.pose(float(time), dim):
                    yield np.asarray(part, dtype=float).tobytes()
        elif is_device_function(value):
            yield str(value.adj.source).encode()
        elif callable(value):
            yield sampled(value, times).tobytes()
        elif isinstance(value, np.ndarray | tuple | list):
            yield np.asarray(value, dtype=float).tobytes()
        else:
            yield repr(value).encode()


def _version(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:  # run from its sources alone
        return None


def commit() -> str | None:
    """Return the commit of the working copy that this is, with a + where it was changed since; None if none."""
    folder = Path(__file__).parent

    def git(*words: str) -> str:
        done = subprocess.run(["git", *words], cwd=folder, capture_output=True, text=True, check=True, timeout=5)
        return done.stdout.strip()

    try:
        if not git("ls-files", "--", Path(__file__).name):  # a copy that happens to lie within another project
            return None
        return git("rev-parse", "HEAD") + ("+" if git("status", "--porcelain", "--untracked-files=no") else "")
    except (OSError, subprocess.SubprocessError):
        return None
