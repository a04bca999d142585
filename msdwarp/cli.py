"""The `msdwarp` command, and what a scene script runs when it is started by itself."""

import ast
import contextlib
import importlib
import importlib.util
import inspect
import os
import pkgutil
import signal
import sys
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal, NoReturn

import warp as wp
from cyclopts import App, Parameter

from . import scenes
from .export import export
from .run import Options, run_scene
from .scene import Scene
from .trajectory import Trajectory
from .tune import TuneOptions, tune_scene
from .watch import SimulationDiverged

Build = Callable[..., Scene]

app = App(name="msdwarp", help="Elastic bodies as particles joined by springs and dampers, on the GPU.")


def main() -> NoReturn:
    """Run the `msdwarp` command."""
    _finish(lambda: app(sys.argv[1:], result_action="return_value"))


def scene_main(build: Build) -> NoReturn:
    """Run the scene that `build` makes, with flags for its parameters: what a scene script calls."""
    name = Path(inspect.getfile(build)).stem
    scene_app = partial(_scene_app, name, f"{name}.py", build, Options, run_scene)
    _finish(lambda: scene_app()(sys.argv[1:], result_action="return_value"))


@app.command(name="list")
def list_scenes() -> None:
    """List the scenes that come with msdwarp."""
    for module in sorted(pkgutil.iter_modules(scenes.__path__), key=lambda m: m.name):
        source = Path(scenes.__path__[0], module.name + ".py").read_text(encoding="utf-8")
        summary = (ast.get_docstring(ast.parse(source)) or "").partition("\n")[0]
        print(f"{module.name:12} {summary}")


@app.command
def info(file: Path, /) -> None:
    """Say what is in a trajectory.

    Parameters
    ----------
    file
        A trajectory, *.vtkhdf.
    """
    with Trajectory(file) as trajectory:
        system, times = trajectory.system, trajectory.times
        print(f"{file}: {len(trajectory)} frames from {times[0]:.4g} to {times[-1]:.4g} s")
        particles = f"{system.particle_count} particles with {system.dim} coordinates"
        print(f"{particles}, {system.connection_count} connections")
        for name, value in trajectory.attributes.items():
            words = " ".join(map(str, value)) if isinstance(value, list) else value
            print(f"{name}: {words}")


@app.command(name="export")
def export_command(
    file: Path,
    /,
    *,
    to: Literal["obj", "stl", "ply", "gltf", "usd", "npz"],
    frame: int | None = None,
    out: Path | None = None,
    force: Annotated[bool, Parameter(negative=())] = False,
) -> None:
    """Write a trajectory's frames in the format of another program.

    Parameters
    ----------
    file
        A trajectory, *.vtkhdf.
    to
        The format; npz holds positions, velocities and times, the others what is drawn.
    frame
        One frame's number, counted from 0, or from the end if negative; by default all.
    out
        The file; by default beside the trajectory, with the format's ending.
    force
        Replace files that are there.
    """
    with Trajectory(file) as trajectory:
        frames = slice(None) if frame is None else frame
        paths = export(trajectory, out or file.with_suffix(f".{to}"), to, frames, force=force)
    more = f" ... {paths[-1].name}" if len(paths) > 1 else ""
    print(f"wrote {paths[0]}{more}")


Words = Annotated[str, Parameter(allow_leading_hyphen=True)]


@app.command(help_flags=())
def run(scene: Words, /, *flags: Words) -> None:
    """Simulate a scene and draw it.

    `msdwarp run SCENE --help` shows the flags of a scene.

    Parameters
    ----------
    scene
        A name that `msdwarp list` shows, or the path of a scene script.
    flags
        The scene's own flags, and those of every run.
    """
    _with_scene("run", scene, flags, Options, run_scene)


@app.command(name="tune", help_flags=())
def tune_command(scene: Words, /, *flags: Words) -> None:
    """Find the cheapest method, precision and substeps that keep a scene's error under a tolerance.

    `msdwarp tune SCENE --help` shows the flags; `msdwarp run SCENE --tolerance 1e-3` runs with the choice.

    Parameters
    ----------
    scene
        A name that `msdwarp list` shows, or the path of a scene script.
    flags
        The scene's own flags, and those of every tuning.
    """
    _with_scene("tune", scene, flags, TuneOptions, tune_scene)


def _with_scene(command: str, scene: str, flags: tuple[str, ...], options_type: type, action: Any) -> None:
    if scene in ("--help", "-h"):
        app.help_print([command])
        return
    name, build = find_scene(scene)
    scene_app = _scene_app(name, f"msdwarp {command} {scene}", build, options_type, action)
    scene_app(list(flags), result_action="return_value")


def find_scene(scene: str) -> tuple[str, Build]:
    """Return the name and the `build` function of a scene, given by name or by the path of its script.

    Raises
    ------
    ValueError
        If there is no such scene, or its script has no `build`.
    """
    known = sorted(module.name for module in pkgutil.iter_modules(scenes.__path__))
    path = Path(scene)
    if scene in known:
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
        raise ValueError(f"scene is {scene!r}; it must be a script's path or one of {', '.join(known)}")
    if not callable(getattr(module, "build", None)):
        raise ValueError(f"scene is {scene!r}, whose script has no function `build`")
    return name, module.build


def _scene_app(name: str, command: str, build: Build, options_type: type, action: Any) -> App:
    """Return the command whose flags are the parameters of `build` and the fields of `options_type`."""
    defaults = options_type()

    def act(*, options: Any = defaults, **parameters: Any) -> None:
        with _quiet_start(getattr(options, "verbose", False)):
            wp.init()
        scene = build(**parameters)
        if not isinstance(scene, Scene):
            raise ValueError(f"build of scene {name!r} returned {scene!r}; it must return a Scene")
        action(name, scene, options)

    own = inspect.signature(build, eval_str=True).parameters.values()
    own = [parameter.replace(kind=inspect.Parameter.KEYWORD_ONLY) for parameter in own]
    common = inspect.Parameter(
        "options", inspect.Parameter.KEYWORD_ONLY, annotation=options_type, default=defaults
    )
    clash = {parameter.name for parameter in own} & set(options_type.__dataclass_fields__)
    if clash:
        raise ValueError(f"build of scene {name!r} has parameters that every run has: {sorted(clash)}")
    act.__signature__ = inspect.Signature([*own, common])  # type: ignore[attr-defined]
    act.__annotations__ = {parameter.name: parameter.annotation for parameter in (*own, common)}
    act.__doc__ = build.__doc__
    scene_app = App(name=command, version_flags=())
    scene_app.default(act)
    return scene_app


@contextlib.contextmanager
def _quiet_start(verbose: bool) -> Iterator[None]:
    """Keep what libraries say at their start, some of it from C++, off the terminal unless `verbose`."""
    if verbose:
        yield
        return
    wp.config.log_level = 30  # warnings; what is compiled and loaded is not of interest
    sys.stderr.flush()
    kept = os.dup(2)
    with open(os.devnull, "w") as nowhere:
        os.dup2(nowhere.fileno(), 2)
        try:
            yield
        finally:
            os.dup2(kept, 2)
            os.close(kept)


def _finish(command: Callable[[], Any]) -> NoReturn:
    """Run a command and exit: 0, or one line that says what was wrong."""
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))  # so that temporary files are removed
    try:
        command()
    except BrokenPipeError:  # whoever read the output has read enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(1)
    except MemoryError as error:
        print(f"error: out of memory: {error}", file=sys.stderr)
        sys.exit(1)
    except (ValueError, OSError, SimulationDiverged) as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(1)
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        sys.exit(130)
    sys.exit(0)


if __name__ == "__main__":
    main()
