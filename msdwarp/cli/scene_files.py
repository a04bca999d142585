"""Scene files: a scene is found by its name or script."""

import hashlib
import importlib.util
import inspect
import pkgutil
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from .. import scenes
from ..runtime import did_you_mean
from .error_messages import remember_script
from .signals import at_once

if TYPE_CHECKING:
    from ..world import Scene

Build = Callable[..., "Scene"]


class Origin(NamedTuple):
    """The origin of a scene: its name or script, and parameters."""

    name: str
    """Name for the results."""
    place: str
    """A scene's name in `msdwarp list`, or the absolute path of a script."""
    build: Build
    parameters: Mapping[str, Any]
    """Arguments of `build`; missing ones have their defaults."""
    script: str | None = None
    """SHA-256 of the script that was run; None for a scene that comes with msdwarp."""

    def scene(self) -> "Scene":
        """Return the scene; raise ValueError if `build` returns an object of another type."""
        with at_once():  # an exception may break modules, such as PyVista, while they are imported
            from ..world import Scene

            scene = self.build(**self.parameters)
        if not isinstance(scene, Scene):
            raise ValueError(f"build of scene {self.name!r} returned {scene!r}; it must return a Scene")
        return scene


def scene_names() -> list[str]:
    """Return the names of the scenes that come with msdwarp."""
    return sorted(module.name for module in pkgutil.iter_modules(scenes.__path__))


def find_scene(scene: str, check: Callable[[str], None] | None = None) -> Origin:
    """Return the origin of a scene, given by name or script path, without parameters.

    Before a script runs, `check` is called with the SHA-256 of its bytes, and may raise. Raise ValueError if
    there is no such scene, or its script has no `build`.
    """
    path, digest = Path(scene), None
    if scene in scene_names():
        with at_once():
            name, module = scene, importlib.import_module(f"{scenes.__name__}.{scene}")
    elif path.suffix == ".py" and path.is_file():
        source = path.read_bytes()  # read once, so that the checked bytes run, not a compiled file
        if b"\0" in source:  # Python's own error names no file
            raise ValueError(f"scene is {scene!r}, whose script has null bytes; it must be text in UTF-8")
        digest = hashlib.sha256(source).hexdigest()
        if check is not None:
            check(digest)
        remember_script(path)
        # Under its own name the script could replace a module such as numpy.
        spec = importlib.util.spec_from_file_location(f"msdwarp_scene_{path.stem}", path)
        assert spec is not None
        name, module = path.stem, importlib.util.module_from_spec(spec)
        sys.modules[spec.name] = module  # dataclasses look up their module in sys.modules
        folder = str(path.parent.resolve())
        if folder not in sys.path:  # for modules in the script's folder, after all other folders
            sys.path.append(folder)
        try:
            with at_once():
                exec(compile(source, str(path), "exec"), module.__dict__)
        except SystemExit as error:
            guard = 'scene_main(build) must stand below `if __name__ == "__main__":`'
            raise ValueError(f"scene is {scene!r}, whose script ended by itself; {guard}") from error
    elif path.suffix == ".py":
        raise ValueError(f"scene is {scene!r}, a script that does not exist")
    else:
        meant = did_you_mean(scene, scene_names())
        raise ValueError(
            f"scene is {scene!r}; it must be a script's path or one of {', '.join(scene_names())}{meant}"
        )
    if not callable(getattr(module, "build", None)):
        raise ValueError(f"scene is {scene!r}, whose script has no function `build`")
    place = scene if scene in scene_names() else str(path.resolve())
    return Origin(name, place, module.build, {}, digest)


def origin_of(build: Build) -> Origin:
    """Return the origin of scenes made by a script's `build`."""
    path = Path(inspect.getfile(build)).resolve()
    own = path.parent in {Path(folder).resolve() for folder in scenes.__path__}
    if not own:
        remember_script(path)
    digest = None if own else hashlib.sha256(path.read_bytes()).hexdigest()
    return Origin(path.stem, path.stem if own else str(path), build, {}, digest)
