"""The commands that take a file of a run: describe, draw, plot, convert, continue and repeat it.

Each imports what it needs when it is called, so that help and errors of the command line need not wait for it.
"""

from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from .options import Pictures
from .other_options import ViewOptions
from .process import progress_on, start_warp
from .results import free_folder, pictures_in
from .script_signatures import UNTOLD, Script
from .signals import at_once

VIEW = ViewOptions()
PICTURES = Pictures()
Flag = Annotated[bool, Parameter(negative=())]


def info_command(file: Path, /) -> None:
    """Describe a trajectory: its contents, and the run that made it.

    Parameters
    ----------
    file
        A trajectory (*.vtkhdf) or a run's folder.
    """
    with at_once():
        from ..files import Trajectory
        from .info import told
        from .of_files import trajectory_in
    with Trajectory(trajectory_in(file)) as trajectory:
        print(told(trajectory), end="")


def export_command(
    file: Path,
    /,
    *,
    to: Literal["obj", "stl", "ply", "gltf", "usd", "npz"],
    frame: int | None = None,
    out: Path | None = None,
    force: Flag = False,
) -> None:
    """Convert frames of a trajectory to the format of another program.

    Parameters
    ----------
    file
        A trajectory (*.vtkhdf) or a run's folder.
    to
        File format. npz holds positions, velocities and times; the others hold the surface that is drawn.
    frame
        Convert this frame only, counted from 0; negative numbers count from the end. Default: all frames.
    out
        File to write. Default: the trajectory's name with the format's extension.
    force
        Overwrite existing files.
    """
    with at_once():
        from ..files import Trajectory, export
        from .of_files import trajectory_in
    path = trajectory_in(file)
    with Trajectory(path) as trajectory:
        frames = slice(None) if frame is None else frame
        paths = export(trajectory, out or path.with_suffix(f".{to}"), to, frames, force=force)
    more = f" ... {paths[-1].name}" if len(paths) > 1 else ""
    print(f"wrote {paths[0]}{more}")


def render_command(
    file: Path,
    /,
    *,
    pictures: Pictures = PICTURES,
    first: int = 0,
    last: int = -1,
    every: int = 1,
    speed: float = 1.0,
    out: Path | None = None,
    script: Script = UNTOLD,
    force: Flag = False,
    quiet_: Annotated[bool, Parameter(name="--quiet", negative=())] = False,
    verbose: Flag = False,
) -> None:
    """Draw a trajectory: images, a film, or several poses in one picture.

    Obstacles and colours come from the file. With --scene or --trust they come from the script as it is now.

    Parameters
    ----------
    file
        A trajectory (*.vtkhdf) or a run's folder.
    first
        First frame to draw, counted from 0; negative numbers count from the end.
    last
        Last frame to draw, counted the same way.
    every
        Draw only every Nth frame.
    speed
        Playback speed of the film; 1 is real time, 0.25 is slow motion. A fast film skips frames to stay at 60 a
        second.
    out
        Folder for the pictures. Default: `render` beside the trajectory, or render-2 ... if that exists.
    force
        Overwrite existing pictures.
    quiet_
        Print errors only.
    verbose
        Print messages from Warp and VTK too.
    """
    start_warp(verbose)
    with at_once():
        from rich.console import Console

        from .. import disk
        from ..files import Trajectory
        from .draw import draw
        from .of_files import scene_of, shown_of, trajectory_in
    talk = Console(stderr=True, quiet=quiet_)
    path = trajectory_in(file)
    with Trajectory(path) as trajectory:
        shown, fps = shown_of(trajectory, first, last, every, speed)
        pictures.check(len(shown))
        if not pictures.any:
            raise ValueError("frames and video are none, and overlay is not given: nothing would be drawn")
        name, scene = scene_of(trajectory, talk, script)
        folder = out or (path.parent / "render" if force else free_folder(path.parent / "render"))
        there = pictures_in(folder, name)
        if there and not force:
            raise FileExistsError(f"{there[0]} exists, and would be replaced; name another --out or add --force")
        disk.writable_folder("out", folder, folder)
        for picture in there:  # none of an earlier, longer film is left
            picture.unlink()
        with progress_on(talk) as progress:
            line = draw(scene, trajectory, folder, name, pictures, progress, shown=shown, fps=fps)
    if not quiet_:
        print(line)


def view_command(file: Path, *, options: ViewOptions = VIEW, script: Script = UNTOLD) -> None:
    """Play a trajectory in a window or a browser.

    Obstacles and colours come from the file. With --scene or --trust they come from the script as it is now.

    Parameters
    ----------
    file
        A trajectory (*.vtkhdf) or a run's folder.
    """
    start_warp(options.verbose)
    with at_once():
        from rich.console import Console

        from ..files import Trajectory
        from .of_files import scene_of, trajectory_in
        from .view import view_trajectory
    with Trajectory(trajectory_in(file)) as trajectory:
        name, scene = scene_of(trajectory, Console(stderr=True), script)
        view_trajectory(trajectory, scene, name, options)


def plot_command(
    file: Path,
    /,
    *,
    out: Path | None = None,
    gravity: float | None = None,
    show: str | None = None,
    script: Script = UNTOLD,
    force: Flag = False,
    verbose: Flag = False,
) -> None:
    """Plot energies, momentum and heights of a trajectory against time, or the results of a sweep.

    Parameters
    ----------
    file
        A trajectory (*.vtkhdf), a run's folder, a sweep's folder or its results.nc.
    out
        File to write: *.png for a plot, *.csv for a table. Default: the file's name with .png.
    gravity
        Acceleration of free fall [m/s²]. Default: as stored in the file.
    show
        Of a sweep: plot this result only, such as elastic_J.
    force
        Overwrite an existing file.
    verbose
        Print Warp's messages too.
    """
    start_warp(verbose)
    with at_once():
        from .. import checks
        from ..files import Trajectory
        from ..studies import RESULTS, plot_history, plot_sweep, write_history
        from .of_files import schedule_of, trajectory_in
    swept = file / RESULTS if (file / RESULTS).exists() else file
    if swept.suffix == ".nc":
        print(f"wrote {plot_sweep(swept, out or swept.with_suffix('.png'), show=show, force=force)}")
        return
    if show is not None:
        raise ValueError(f"show is {show!r}; it is for the results of a sweep, and {file} is none")
    path = trajectory_in(file)
    with Trajectory(path) as trajectory:
        stored = trajectory.attributes if gravity is None else {"gravity": gravity}
        acceleration = checks.member("without --gravity, the file", stored, "gravity")
        schedule = schedule_of(trajectory, script) if trajectory.attributes.get("schedule") else ()
        target = out or path.with_suffix(".png")
        if target.suffix not in (".png", ".csv"):
            raise ValueError(f"out is {target}; its name must end in .png or .csv")
        write = write_history if target.suffix == ".csv" else plot_history
        print(f"wrote {write(trajectory, target, gravity=acceleration, schedule=schedule, force=force)}")


def resume_command(
    folder: Path,
    /,
    *,
    duration: float | None = None,
    device: str | None = None,
    script: Script = UNTOLD,
    force: Flag = False,
    quiet_: Annotated[bool, Parameter(name="--quiet", negative=())] = False,
    verbose: Flag = False,
) -> None:
    """Continue an interrupted run to its end, and draw it.

    The result equals that of an uninterrupted run bit for bit. On a GPU this does not hold for the algorithm
    scatter and the integrator linearly-implicit-euler.

    Parameters
    ----------
    folder
        The run's folder, or its restart.h5.
    duration
        Total simulated time [s]. Default: that of the run. A larger value extends a finished run.
    device
        Device to simulate on. Default: the one used before.
    force
        Overwrite existing pictures.
    quiet_
        Print errors only.
    verbose
        Print messages from Warp and VTK too.
    """
    start_warp(verbose)
    with at_once():
        from .resume import resume_run
    if not folder.exists():
        raise FileNotFoundError(f"{folder} does not exist; it must be the folder of a run")
    folder = folder if folder.is_dir() else folder.parent
    resume_run(folder, duration=duration, device=device, force=force, quiet=quiet_, script=script)


def rerun_command(
    file: Path,
    /,
    *,
    device: str | None = None,
    out: Path | None = None,
    script: Script = UNTOLD,
    quiet_: Annotated[bool, Parameter(name="--quiet", negative=())] = False,
    verbose: Flag = False,
) -> None:
    """Repeat the run that made a trajectory, and compare the results.

    The exit code is 0 if they are equal bit for bit, otherwise 1.

    Parameters
    ----------
    file
        A trajectory (*.vtkhdf) or a run's folder.
    device
        Device to simulate on. Default: the one used before.
    out
        Folder to keep the new result in. Default: it is not kept.
    quiet_
        Print errors only.
    verbose
        Print messages from Warp and VTK too.
    """
    start_warp(verbose)
    with at_once():
        from .of_files import trajectory_in
        from .rerun import rerun
    path = trajectory_in(file)
    differences = rerun(path, device=device, out=out, quiet=quiet_, script=script)
    if differences is not None:
        raise ValueError(f"{path} was not made again: {differences}")
    if not quiet_:
        print(f"{path} was made again: the same to the last bit")
