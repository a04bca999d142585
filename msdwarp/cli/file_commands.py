"""Commands that take the file of a run: describe, draw, plot, convert, continue and repeat the run.

Each command imports its modules when called, so that help and command-line errors appear at once.
"""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Parameter

from ..disk import TRAJECTORY, writable_folder
from .error_messages import printable
from .options import Quiet, Verbose, ViewOptions
from .picture_options import Bodies, Color, Cut, Flag, Pictures, PicturesAgain
from .process import progress_on, start_warp
from .results import free_folder, pictures_in
from .script_signatures import UNTRUSTED, Script
from .signals import at_once

if TYPE_CHECKING:
    from rich.console import Console

    from ..files import DrawnFrame, Trajectory
    from ..world import Change, Scene

File = Annotated[Path, Parameter(help="A trajectory (*.vtkhdf) or a run's folder.")]
DeviceBefore = Annotated[str | None, Parameter(help="Device to simulate on. Default: the one used before.")]
PICTURES, AS_BEFORE, VIEW = Pictures(), PicturesAgain(), ViewOptions()


def info(file: File, /) -> None:
    """Describe a trajectory: its contents, and the run that made it."""
    with at_once():
        from .commands.info import description
    with opened(file) as trajectory:
        print(description(trajectory), end="")


def export(
    file: File,
    /,
    *,
    to: Literal["glb", "usd", "obj", "ply", "stl", "npz"],
    frame: int | None = None,
    every: int = 1,
    body: Bodies = (),
    cut: Cut = None,
    color: Color | None = None,
    up: Literal["y", "z"] | None = None,
    scale: float = 1.0,
    out: Path | None = None,
    script: Script = UNTRUSTED,
    force: Flag = False,
) -> None:
    """Convert frames of a trajectory to the format of another program.

    Parameters
    ----------
    to
        File format. glb (glTF) and usd hold all frames as one animation: glb bodies and obstacles, with materials
        and textures, usd also the ground, light, camera, velocities for motion blur, and ropes as curves. obj, ply
        and stl hold the triangles of the bodies, a file for each frame: obj with materials and textures, ply with
        colors, stl alone. npz holds positions, velocities and times.
    frame
        Convert this frame only, counted from 0; negative numbers count from the end. Default: all frames.
    every
        Convert only every Nth frame.
    color
        What the colors show, as in `msdwarp render`. Default: as in the pictures of the run.
    up
        The axis that points up: y or z. Default: y in glb, as glTF demands, and z in the other formats.
    scale
        Lengths in the file, over those in metres: 100 for centimetres, 1000 for millimetres.
    out
        File to write. Default: the trajectory's name with the format's extension.
    force
        Overwrite existing files.
    """
    with at_once():
        from .. import checks
        from ..files import export
    with opened(file) as trajectory:
        every = checks.count("every", every, 1)
        if to == "npz" and (color or body or cut):
            raise ValueError(
                "color, body or cut is given; where to is 'npz' they must not be: it holds what was simulated"
            )
        if frame is not None and every > 1:
            raise ValueError(f"every is {every}; it must not be given beside frame")
        frames = slice(None, None, every) if frame is None else frame
        given = {name: value for name, value in (("color", color), ("body", body), ("cut", cut)) if value}
        draw = partial(_drawn, trajectory, given, script)
        target = out or trajectory.path.with_suffix(f".{to}")
        paths = export(trajectory, target, to, frames, up=up, scale=scale, force=force, draw=draw)
    more = f" ... {paths[-1].name}" if len(paths) > 1 else ""
    print(f"wrote {paths[0]}{more}")


def render(
    file: File,
    /,
    *,
    pictures: Pictures = PICTURES,
    first: int = 0,
    last: int = -1,
    every: int = 1,
    speed: float = 1.0,
    still: float | None = None,
    out: Path | None = None,
    script: Script = UNTRUSTED,
    force: Flag = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Draw a trajectory: images, a film, several poses in one picture, or one frame for print.

    Obstacles and colors come from the file. With --scene or --trust they come from the script as it is now.

    Parameters
    ----------
    first
        First frame to draw, counted from 0; negative numbers count from the end.
    last
        Last frame to draw, counted the same way.
    every
        Draw only every Nth frame.
    speed
        Playback speed of the film; 1 is real time, 0.25 is slow motion. A fast film skips frames to stay at 60 a
        second, a slow one has frames between those of the run.
    still
        Draw only the frame at this time [s], for print: SCENE_still.png, with the camera of the film.
    out
        Folder for the pictures. Default: `render` beside the trajectory, or render-2 ... if that exists.
    force
        Overwrite existing pictures.
    """
    start_warp(verbose)
    with at_once():
        from rich.console import Console

        from .. import checks
        from ..pictures import particles_of
        from .commands.draw import draw
        from .commands.moments import frames_shown
    talk = Console(stderr=True, quiet=quiet)
    with opened(file) as trajectory:
        shown, moments, fps = frames_shown(trajectory, first, last, every, speed)
        if still is not None:
            checks.between("still", still, trajectory.times[shown[0]], trajectory.times[shown[-1]])
            pictures = replace(pictures, frames="none", video="none")
        pictures.check(len(shown))
        if not pictures.any and still is None:
            raise ValueError("frames and video are none, and overlay is not given: nothing would be drawn")
        name, scene = _scene_of(trajectory, talk, script)
        replace(scene, look=pictures.aimed(scene.look))  # raises ValueError if the scene lacks a body
        particles_of(scene.system, pictures.body)
        usual = trajectory.path.parent / "render"
        folder = out or (usual if force else free_folder(usual))
        there = pictures_in(folder, name)
        if there and not force:
            raise FileExistsError(f"{there[0]} exists, and would be replaced; name another --out or add --force")
        writable_folder("out", folder, folder)
        # An earlier, longer film may have left further pictures, so all of them are removed.
        more = {"moments": moments, "still_at": still, "replaced": there}
        with progress_on(talk) as progress:
            line = draw(scene, trajectory, folder, name, pictures, progress, shown=shown, fps=fps, **more)
    if not quiet:
        print(line)


def view(file: File, *, options: ViewOptions = VIEW, script: Script = UNTRUSTED) -> None:
    """Play a trajectory in a window or a browser.

    Obstacles and colors come from the file. With --scene or --trust they come from the script as it is now.
    """
    start_warp(options.verbose)
    with at_once():
        from rich.console import Console

        from .commands.view import view_trajectory
    with opened(file) as trajectory:
        name, scene = _scene_of(trajectory, Console(stderr=True), script)
        view_trajectory(trajectory, scene, name, options)


def plot(
    file: Path,
    /,
    *,
    out: Path | None = None,
    gravity: float | None = None,
    show: str | None = None,
    script: Script = UNTRUSTED,
    force: Flag = False,
    verbose: Verbose = False,
) -> None:
    """Plot energies, momentum and heights of a trajectory, readings of probes, or the results of a sweep.

    Parameters
    ----------
    file
        A trajectory (*.vtkhdf), a run's folder or its probes.csv, a sweep's folder or its results.nc.
    out
        File to write: *.png for a plot, *.csv for a table. Default: the file's name with .png.
    gravity
        Acceleration of free fall [m/s²]. Default: as stored in the file.
    show
        Of a sweep: plot this result only, such as elastic_J.
    force
        Overwrite an existing file.
    """
    start_warp(verbose)
    with at_once():
        from .. import checks
        from ..studies import RESULTS, plot_readings, plot_sweep, write_history
    swept = file / RESULTS if (file / RESULTS).exists() else file
    if swept.suffix == ".nc":
        print(f"wrote {plot_sweep(swept, out or swept.with_suffix('.png'), show=show, force=force)}")
        return
    if show is not None:
        raise ValueError(f"show is {show!r}; it is for the results of a sweep, and {file} is none")
    if file.suffix == ".csv":
        print(f"wrote {plot_readings(file, out or file.with_suffix('.png'), force)}")
        return
    with opened(file) as trajectory:
        stored = trajectory.attributes if gravity is None else {"gravity": gravity}
        acceleration = checks.member("without --gravity, the file", stored, "gravity")
        if gravity is None:
            acceleration = checks.gravity_of_file(acceleration, trajectory.system.dim)
        schedule = _schedule_of(trajectory, script) if trajectory.attributes.get("schedule") else ()
        target = out or trajectory.path.with_suffix(".png")
        if target.suffix not in (".png", ".csv"):
            raise ValueError(f"out is {target}; its name must end in .png or .csv")
        print(f"wrote {write_history(trajectory, target, gravity=acceleration, schedule=schedule, force=force)}")


def resume(
    folder: Path,
    /,
    *,
    duration: float | None = None,
    device: DeviceBefore = None,
    pictures: PicturesAgain = AS_BEFORE,
    script: Script = UNTRUSTED,
    force: Flag = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Continue an interrupted run to its end, and draw it.

    The result equals that of an uninterrupted run bit for bit. On a GPU this does not hold for the algorithm
    scatter and the integrator linearly-implicit-euler. It is drawn as the run was to be, but for the flags of
    pictures that are given.

    Parameters
    ----------
    folder
        The run's folder, or its restart.h5.
    duration
        Total simulated time [s]. Default: that of the run. A larger value extends a finished run.
    force
        Overwrite existing pictures.
    """
    start_warp(verbose)
    with at_once():
        from .commands.stored_runs import resume_run
    if not folder.exists():
        raise FileNotFoundError(f"{folder} does not exist; it must be the folder of a run")
    folder = folder if folder.is_dir() else folder.parent
    given = {"duration": duration, "device": device, "pictures": pictures, "script": script}
    resume_run(folder, force=force, quiet=quiet, **given)


def rerun(
    file: File,
    /,
    *,
    device: DeviceBefore = None,
    out: Path | None = None,
    script: Script = UNTRUSTED,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Repeat the run that made a trajectory, and compare the results.

    The exit code is 0 if they are equal bit for bit, otherwise 1.

    Parameters
    ----------
    out
        Folder to keep the new result in. Default: it is not kept.
    """
    start_warp(verbose)
    with at_once():
        from .commands.stored_runs import rerun
    with opened(file) as trajectory:
        differences = rerun(trajectory, device=device, out=out, quiet=quiet, script=script)
    if differences is not None:
        raise ValueError(f"{trajectory.path} was not made again: {differences}")
    if not quiet:
        print(f"{trajectory.path} was made again: the same to the last bit")


@contextmanager
def opened(file: Path) -> Iterator["Trajectory"]:
    """Open a trajectory after checking that HDF5 can read it; `file` is the trajectory or its run's folder."""
    with at_once():
        from ..files import Trajectory, probe
    if file.is_dir() and not (file / TRAJECTORY).exists():
        raise FileNotFoundError(f"file is {file}, a folder without {TRAJECTORY}; it must be the folder of a run")
    if not file.exists():
        raise FileNotFoundError(f"file is {file}, which does not exist; it must be a trajectory or a run's folder")
    path = file / TRAJECTORY if file.is_dir() else file
    probe(path)
    with Trajectory(path) as trajectory:
        yield trajectory


def _drawn(
    trajectory: "Trajectory",
    given: dict[str, Any],
    script: Script,
    numbers: Sequence[int],
    to: str,
) -> "tuple[Iterator[DrawnFrame], dict[str, Any]]":
    """Return frames of a trajectory as in the pictures of its run, but for given flags; see `drawn.drawn`."""
    start_warp(False)
    with at_once():
        from rich.console import Console

        from .commands.drawn import drawn
        from .provenance import restored_options

    talk = Console(stderr=True, quiet=to == "stl")  # which has no colors
    scene = _scene_of(trajectory, talk, script)[1]
    kept = trajectory.attributes.get("options")
    pictures = restored_options(kept).pictures if isinstance(kept, dict) and "pictures" in kept else PICTURES
    return drawn(scene, trajectory, replace(pictures, **given), numbers, to)


def _scene_of(trajectory: "Trajectory", talk: "Console", script: Script) -> tuple[str, "Scene"]:
    """Return the name and scene of a trajectory: from the file, or from the script if the user requests it.

    The script is also used if the file has no scene, or its moving obstacles end too early. If the script fails, a
    message says what the scene then lacks.
    """
    from ..world import Scene, known_until, scene_from_stored
    from .provenance import rebuild_scene

    system, stored = trajectory.system, trajectory.scene
    kept = None if stored is None or script.requested else scene_from_stored(system, *stored)
    name = Path(str(trajectory.attributes.get("scene", ""))).stem
    name = name if kept is not None and name and name.isprintable() else trajectory.path.stem
    if kept is not None and trajectory.times[-1] < known_until(kept) + 1e-9:
        return name, kept
    try:
        origin, scene = rebuild_scene(trajectory.attributes, script)
        if scene.system.position.shape != system.position.shape:
            raise ValueError(f"scene {origin.place!r} has another system now")
    except Exception as error:  # the script may raise any error
        without = "drawn without obstacles, in a plain look"
        if kept is not None:
            without = f"drawn with moving obstacles that stand still from {known_until(kept):.4g} s on"
        talk.print(f"{without}: {printable(str(error))}", soft_wrap=True, highlight=False, markup=False)
        return name, Scene(system=system) if kept is None else kept
    return origin.name, replace(scene, system=system)


def _schedule_of(trajectory: "Trajectory", script: Script) -> "Sequence[Change]":
    """Return the changes of a run, from its file, or from the scene's script for files of early versions."""
    from ..world import scene_from_stored
    from .provenance import rebuild_scene

    stored = trajectory.scene
    if stored is None or script.requested:
        return rebuild_scene(trajectory.attributes, script)[1].schedule
    return scene_from_stored(trajectory.system, *stored).schedule
