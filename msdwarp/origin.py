"""Origins: the scene a run came from, as text that a file can hold, and the scene built again from that text."""

import hashlib
import importlib
import importlib.util
import inspect
import json
import pkgutil
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping
from dataclasses import fields
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, NamedTuple, get_origin

import numpy as np

from . import checks, scenes
from .scene import Scene
from .system import System, constant

Build = Callable[..., Scene]


class Origin(NamedTuple):
    """Where a scene comes from."""

    name: str
    """What its results are called."""
    place: str
    """A name that `msdwarp list` shows, or the absolute path of a script."""
    build: Build
    """Builds it."""
    parameters: Mapping[str, Any]
    """What it was built with; what is not among them is as `build` has it."""

    def scene(self) -> Scene:
        """Return the scene; raise ValueError if `build` returns something else."""
        scene = self.build(**self.parameters)
        if not isinstance(scene, Scene):
            raise ValueError(f"build of scene {self.name!r} returned {scene!r}; it must return a Scene")
        return scene


def scene_names() -> list[str]:
    """Return the names of the scenes that come with msdwarp."""
    return sorted(module.name for module in pkgutil.iter_modules(scenes.__path__))


def find_scene(scene: str) -> Origin:
    """Return a scene, given by name or by the path of its script, with no parameters.

    Raises
    ------
    ValueError
        If there is no such scene, or its script has no `build`.
    """
    path = Path(scene)
    if scene in scene_names():
        name, module = scene, importlib.import_module(f"{scenes.__name__}.{scene}")
    elif path.suffix == ".py" and path.is_file():
        spec = importlib.util.spec_from_file_location(path.stem, path)
        assert spec is not None
        assert spec.loader is not None
        name, module = path.stem, importlib.util.module_from_spec(spec)
        sys.modules[spec.name] = module  # where dataclasses, among others, look their module up
        sys.path.insert(0, str(path.parent.resolve()))  # as `python my_scene.py` has it
        spec.loader.exec_module(module)
    else:
        raise ValueError(f"scene is {scene!r}; it must be a script's path or one of {', '.join(scene_names())}")
    if not callable(getattr(module, "build", None)):
        raise ValueError(f"scene is {scene!r}, whose script has no function `build`")
    place = scene if scene in scene_names() else str(path.resolve())
    return Origin(name, place, module.build, {})


def origin_of(build: Build) -> Origin:
    """Return the origin of the scenes that a script's `build` makes."""
    path = Path(inspect.getfile(build)).resolve()
    own = path.parent in {Path(folder).resolve() for folder in scenes.__path__}
    return Origin(path.stem, path.stem if own else str(path), build, {})


def about(origin: Origin, scene: Scene) -> dict[str, Any]:
    """Return what made a run, as JSON has it: the scene, how it is built again, and by what program."""
    defaults = inspect.signature(origin.build).parameters.items()
    parameters = {name: one.default for name, one in defaults if one.default is not one.empty}
    return {
        "scene": origin.place,
        # What JSON cannot hold, such as a path, is held by its text.
        "parameters": json.loads(json.dumps({**parameters, **origin.parameters}, default=str)),
        "gravity": np.asarray(scene.gravity).tolist(),
        "schedule": len(scene.schedule),
        "digest": digest(scene),
        "command": list(sys.argv),
        "versions": {package: _version(package) for package in ("msdwarp", "warp-lang", "numpy", "h5py")},
        "commit": commit(),
    }


def built_again(attributes: Mapping[str, Any]) -> tuple[Origin, Scene]:
    """Return the scene that a file's attributes say it came from, built again.

    Its script is run, if it came from one.

    Raises
    ------
    ValueError
        If they do not say so, or it cannot be built.
    """
    place = str(checks.member("the file", attributes, "scene"))
    found = find_scene(place)
    known = inspect.signature(found.build, eval_str=True).parameters
    stored = checks.member("the file", attributes, "parameters")
    unknown = stored.keys() - known.keys()
    if unknown:
        raise ValueError(f"build of scene {place!r} no longer has the parameters {sorted(unknown)}")
    parameters = {name: _as_declared(value, known[name].annotation) for name, value in stored.items()}
    found = found._replace(parameters=parameters)
    return found, found.scene()


def _as_declared(value: Any, annotation: Any) -> Any:
    """Return a value that JSON held as what a parameter is declared to be."""
    if isinstance(value, list) and (get_origin(annotation) or annotation) is tuple:
        return tuple(value)
    return Path(value) if annotation is Path and isinstance(value, str) else value


def digest(scene: Scene) -> str:
    """Return a short text that two scenes share if the same moves in them in the same surroundings.

    All numbers are in it, and no functions: a collider's motion, or a change that depends on what was before.
    """
    found = hashlib.sha256()
    for part in _parts(scene):
        found.update(part)
    return found.hexdigest()[:16]


def _parts(scene: Scene) -> Iterator[bytes]:
    for field in fields(System):
        values = getattr(scene.system, field.name)
        if isinstance(values, np.ndarray):
            once = field.name not in ("position", "connections") and len(values) > 0 and constant(values)
            yield f"{field.name} {values.shape}".encode()
            yield np.ascontiguousarray(values[:1] if once else values).tobytes()
    yield repr((scene.system.damper, np.asarray(scene.gravity, dtype=float).tolist())).encode()
    for one in (*scene.colliders, *scene.schedule):
        held = {field.name: getattr(one, field.name) for field in fields(one)}
        yield repr((type(one).__name__, {name: _words(value) for name, value in held.items()})).encode()


def _words(value: Any) -> Any:
    """Return what of a value has the same text each time."""
    if callable(value):
        return "a function"
    if isinstance(value, Mapping):
        return {name: _words(one) for name, one in value.items()}
    return np.asarray(value).tolist() if isinstance(value, np.ndarray | tuple | list) else value


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
