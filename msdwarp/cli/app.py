"""The `msdwarp` command, and what a scene script runs when it is started by itself.

What a command does is imported once it is known that it will be done: Warp takes longer to import than help does.
"""

import ast
import inspect
import sys
from collections.abc import Callable
from functools import partial, wraps
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, NoReturn

from cyclopts import App, Parameter

from .. import scenes
from .file_commands import (
    export_command,
    info_command,
    plot_command,
    render_command,
    rerun_command,
    resume_command,
    view_command,
)
from .integer_flags import with_wholes
from .options import Options
from .other_options import FitOptions, TuneOptions, ViewOptions
from .process import finish, start_warp, understood
from .scene_files import Build, Origin, find_scene, origin_of, scene_names
from .scene_flags import flags_app
from .signals import at_once

app = App(
    name="msdwarp",
    suppress_keyboard_interrupt=False,
    help="Simulate elastic bodies as particles joined by springs and dampers, on the GPU or the CPU.",
)


def main() -> NoReturn:
    """Run the `msdwarp` command."""
    finish(lambda: understood(app, sys.argv[1:]))


def scene_main(build: Build) -> NoReturn:
    """Run the scene that `build` makes, with flags for its parameters: what a scene script calls."""
    origin = origin_of(build)
    scene_app = partial(_scene_app, origin, f"{origin.name}.py", Options, _run_scene)
    finish(lambda: understood(scene_app(), sys.argv[1:]))


@app.command(name="list")
def list_scenes() -> None:
    """List the scenes that come with msdwarp.

    The 2014 report is by Bladin, Broberg, Forsling Parborg and Gråd: "Fysikalisk simulering av elastiska material"
    (Physical simulation of elastic materials), Linköping University. msdwarp is based on its model.
    """
    for name in scene_names():
        source = Path(scenes.__path__[0], name + ".py").read_text(encoding="utf-8")
        summary = (ast.get_docstring(ast.parse(source)) or "").partition("\n")[0]
        print(f"{name:12} {summary}")


def _exact(command: Callable[..., Any]) -> Callable[..., Any]:
    """Return a command whose flags for whole numbers take no others."""

    @wraps(command)
    def exact(*arguments: Any, **named: Any) -> Any:
        return command(*arguments, **named)

    signature = inspect.signature(command)
    known = [one.replace(annotation=with_wholes(one.annotation)) for one in signature.parameters.values()]
    exact.__signature__ = signature.replace(parameters=known)  # type: ignore[attr-defined]
    exact.__annotations__ = {one.name: one.annotation for one in known}
    return exact


for _name, _command in (
    ("info", info_command),
    ("render", render_command),
    ("plot", plot_command),
    ("export", export_command),
    ("resume", resume_command),
    ("rerun", rerun_command),
):
    app.command(_exact(_command), name=_name)
app.register_install_completion_command(
    help="Set up tab completion of commands, flags and scene names in your shell."
)


Words = Annotated[str, Parameter(allow_leading_hyphen=True)]
if TYPE_CHECKING:
    Name = str
else:  # a scene's name, which a shell completes, or anything else
    Name = Annotated[Literal[tuple(scene_names())] | str, Parameter(allow_leading_hyphen=True, show_choices=False)]


@app.command(help_flags=())
def run(scene: Name, /, *flags: Words) -> None:
    """Simulate a scene and draw it.

    `msdwarp run SCENE --help` shows the flags of a scene.

    Parameters
    ----------
    scene
        A name from `msdwarp list`, or the path of a scene script.
    flags
        The scene's parameters, and the flags of every run.
    """
    _with_scene("run", scene, flags, Options, _run_scene)


def _run_scene(origin: Origin, options: Options) -> None:
    with at_once():
        from .run import run_scene
    run_scene(origin, origin.scene(), options)


@app.command(name="tune", help_flags=())
def tune_command(scene: Name, /, *flags: Words) -> None:
    """Find the fastest method, precision and step that keep a scene's error below a tolerance.

    `msdwarp tune SCENE --help` shows the flags. `msdwarp run SCENE --tolerance 1e-3` runs with the choice.

    Parameters
    ----------
    scene
        A name from `msdwarp list`, or the path of a scene script.
    flags
        The scene's parameters, and the flags of every tuning.
    """
    _with_scene("tune", scene, flags, TuneOptions, _tune_scene)


def _tune_scene(origin: Origin, options: TuneOptions) -> None:
    with at_once():
        from .tune import tune_scene
    tune_scene(origin, origin.scene(), options)


@app.command(name="fit", help_flags=())
def fit_command(scene: Name, measured: Words = "--help", /, *flags: Words) -> None:
    """Fit parameters of a scene to a measured motion.

    `msdwarp fit SCENE --help` shows the flags.

    Parameters
    ----------
    scene
        A name from `msdwarp list`, or the path of a scene script.
    measured
        A CSV file of tracked points with columns time, id, x, y, z; or of probe readings, as in a run's
        probes.csv; or a trajectory.
    flags
        The scene's parameters, and the flags of every fit.
    """
    if measured.startswith("-"):
        flags = (measured, *flags)
        if not {"--help", "-h"} & set(flags):
            raise ValueError("measured is missing; `msdwarp fit SCENE MEASURED` takes a CSV file or a trajectory")
    _with_scene("fit", scene, flags, FitOptions, partial(_fit_scene, measured))


def _fit_scene(measured: str, origin: Origin, options: FitOptions) -> None:
    with at_once():
        from .fit import fit_scene
    fit_scene(measured, origin, origin.scene(), options)


@app.command(name="sweep", help_flags=())
def sweep_command(scene: Name, /, *flags: Words) -> None:
    """Simulate a scene for many values of its parameters.

    A flag takes a list (--damping 1,2,5) or a range (--seed 0:100, --mass 1:3:5, --stiffness 1e3:1e5:log:20).
    `msdwarp sweep SCENE --help` shows the flags. Give the same command again to continue an interrupted sweep.

    Parameters
    ----------
    scene
        A name from `msdwarp list`, or the path of a scene script.
    flags
        The scene's parameters, the flags of every run, and those of every sweep.
    """
    if scene in ("--help", "-h"):
        app.help_print(["sweep"])
        return
    origin = find_scene(scene)
    with at_once():
        from .sweep import sweep_scene
    sweep_scene(origin, f"msdwarp sweep {scene}", flags)


@app.command(name="view", help_flags=())
def view(scene: Name, /, *flags: Words) -> None:
    """Show a scene live in a window or a browser, or play a trajectory.

    `msdwarp view SCENE --help` shows the flags of a scene. Press h in the view for the list of keys.

    Parameters
    ----------
    scene
        A name from `msdwarp list`, the path of a scene script, a trajectory (*.vtkhdf) or a run's folder.
    flags
        The scene's parameters, and the flags of every view.
    """
    path = Path(scene)
    if scene not in scene_names() and (path.is_dir() or path.suffix == ".vtkhdf"):
        play = App(name=f"msdwarp view {scene}", version_flags=(), suppress_keyboard_interrupt=False)
        play.default(partial(view_command, path))
        understood(play, flags)
        return
    _with_scene("view", scene, flags, ViewOptions, _view_scene)


def _view_scene(origin: Origin, options: ViewOptions) -> None:
    with at_once():
        from .view import view_scene
    view_scene(origin, origin.scene(), options)


def _with_scene(command: str, scene: str, flags: tuple[str, ...], options_type: type, action: Any) -> None:
    if scene in ("--help", "-h"):
        app.help_print([command])
        return
    understood(_scene_app(find_scene(scene), f"msdwarp {command} {scene}", options_type, action), flags)


def _scene_app(origin: Origin, command: str, options_type: type, action: Any) -> App:
    """Return the command that builds a scene by its flags, and does something with it."""

    def act(chosen: Origin, options: Any) -> None:
        start_warp(options.verbose)
        action(chosen, options)

    return flags_app(origin, command, options_type, act)
