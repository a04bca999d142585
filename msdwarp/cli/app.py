"""The `msdwarp` command, and the command of a scene script.

Modules are imported only when a command is certain to run, since importing Warp takes longer than showing a help.
"""

import ast
from collections.abc import Sequence
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Parameter

from .. import scenes
from . import file_commands
from .options import FitOptions, ModesOptions, Options, SimulationOptions, TuneOptions, ViewOptions
from .picture_options import Flag
from .process import start_warp
from .scene_files import Build, Origin, find_scene, origin_of, scene_names
from .scene_flags import flags_app, new_app
from .signals import at_once

app = new_app(
    "msdwarp",
    help="Simulate elastic bodies as particles joined by springs and dampers, on the GPU or the CPU.",
)


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


for _name in ("info", "render", "plot", "export", "resume", "rerun"):
    app.command(getattr(file_commands, _name), name=_name)
app.register_install_completion_command(
    help="Set up tab completion of commands, flags and scene names in your shell."
)

_A_WORD = Parameter(allow_leading_hyphen=True, show_choices=False)
Words = Annotated[str, _A_WORD, Parameter(help="The scene's parameters, and the flags of this command.")]
if TYPE_CHECKING:
    AnyName = str
else:  # a scene's name, for which a shell offers completion, or any other word
    AnyName = Annotated[Literal[tuple(scene_names())] | str, _A_WORD]
Name = Annotated[AnyName, Parameter(help="A name from `msdwarp list`, or the path of a scene script.")]
_SHOWN = "A name from `msdwarp list`, the path of a scene script, a trajectory (*.vtkhdf) or a run's folder."
Shown = Annotated[AnyName, Parameter(help=_SHOWN)]
_MEASURED = (
    "A CSV file of tracked points with columns time, id, x, y, z; or of probe readings, as in a run's probes.csv; "
    "or a trajectory."
)
_AS_RUN = SimulationOptions()
Measured = Annotated[str, _A_WORD, Parameter(help=_MEASURED)]


@app.command(help_flags=())
def run(scene: Name, /, *flags: Words) -> None:
    """Simulate a scene and draw it.

    `msdwarp run SCENE --help` shows the flags of a scene.
    """
    _with_scene("run", scene, flags, Options)


@app.command(help_flags=())
def tune(scene: Name, /, *flags: Words) -> None:
    """Find the fastest method, precision and step that keep a scene's error below a tolerance.

    `msdwarp tune SCENE --help` shows the flags. `msdwarp run SCENE --tolerance 1e-3` runs with the choice.
    """
    _with_scene("tune", scene, flags, TuneOptions)


@app.command(help_flags=())
def modes(scene: Name, /, *flags: Words) -> None:
    """Find the eigenfrequencies, shapes and damping ratios of a scene's slowest vibrations.

    `msdwarp modes SCENE --help` shows the flags.
    """
    _with_scene("modes", scene, flags, ModesOptions)


@app.command(help_flags=())
def fit(scene: Name, measured: Measured = "--help", /, *flags: Words) -> None:
    """Fit parameters of a scene to a measured motion.

    `msdwarp fit SCENE --help` shows the flags.
    """
    if measured.startswith("-"):
        flags = (measured, *flags)
        if not {"--help", "-h"} & set(flags):
            raise ValueError("measured is missing; `msdwarp fit SCENE MEASURED` takes a CSV file or a trajectory")
    _with_scene("fit", scene, flags, FitOptions, measured)


@app.command(help_flags=())
def sweep(scene: Name, /, *flags: Words) -> None:
    """Simulate a scene for many values of its parameters.

    A flag takes a list (--damping 1,2,5) or a range (--seed 0:100, --mass 1:3:5, --stiffness 1e3:1e5:log:20).
    `msdwarp sweep SCENE --help` shows the flags. Give the same command again to continue an interrupted sweep.
    """
    if scene in ("--help", "-h"):
        app.help_print(["sweep"])
        return
    origin = find_scene(scene)
    with at_once():
        from .commands.sweep import sweep_scene
    sweep_scene(origin, f"msdwarp sweep {scene}", flags)


@app.command(help_flags=())
def view(scene: Shown, /, *flags: Words) -> None:
    """Show a scene live in a window or a browser, or play a trajectory.

    `msdwarp view SCENE --help` shows the flags of a scene. Press h in the view for the list of keys.
    """
    path = Path(scene)
    if scene not in scene_names() and (path.is_dir() or path.suffix == ".vtkhdf"):
        play = new_app(f"msdwarp view {scene}", version_flags=())
        play.default(partial(file_commands.view, path))
        play(flags)
    else:
        _with_scene("view", scene, flags, ViewOptions)


@app.command(name="compile")
def compile_kernels(
    *scenes: Name, arch: str | None = None, all: Flag = False, options: SimulationOptions = _AS_RUN
) -> None:
    """Compile the kernels of scenes, so that later runs need not; nothing is simulated.

    Kernels for a GPU can be compiled where there is none, as in a container's image. Give the flags that the runs
    will have; flags of a scene cannot be given.

    Parameters
    ----------
    scenes
        Names from `msdwarp list`, or paths of scene scripts.
    arch
        GPUs to compile for: their compute capabilities without the point, such as 80,90,100. Default: the device.
    all
        Compile for all scenes of `msdwarp list`.
    """
    names = dict.fromkeys((*scenes, *(scene_names() if all else ())))
    if not names:
        raise ValueError(
            "scene is missing; `msdwarp compile SCENE ...` takes scenes, `msdwarp compile --all` all of them"
        )
    start_warp(False)
    with at_once():
        from .commands.compile import compile_scenes
    compile_scenes(list(names), arch, options)


def run_script(build: Build, flags: Sequence[str]) -> None:
    """Run the scene that a script's `build` returns."""
    origin = origin_of(build)
    _act("run", flags_app(origin, f"{origin.name}.py", Options)(flags))


def _with_scene(command: str, scene: str, flags: tuple[str, ...], options_type: type, *given: Any) -> None:
    """Run a command on a scene, unless the flags only ask for the command's help, which is then shown."""
    if scene in ("--help", "-h"):
        app.help_print([command])
        return
    _act(command, flags_app(find_scene(scene), f"msdwarp {command} {scene}", options_type)(flags), *given)


def _act(command: str, chosen: tuple[Origin, Any] | None, *given: Any) -> None:
    """Call a command's function, such as `run_scene`, with scene and options, unless only help was shown."""
    if chosen is None:
        return
    origin, options = chosen
    start_warp(options.verbose)
    with at_once():
        action = getattr(import_module(f".commands.{command}", __package__), f"{command}_scene")
    action(*given, origin, origin.scene(), options)
