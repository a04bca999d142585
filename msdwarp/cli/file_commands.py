"""The commands that take a file of a run: describe, draw, plot, convert, continue and repeat it."""

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter
from rich.console import Console

from .. import checks, disk
from ..files import Trajectory, export, probe
from ..studies import RESULTS, plot_history, plot_sweep, write_history
from ..world import Change, Scene, known_until, scene_from_stored
from .draw import draw
from .info import told
from .options import Pictures
from .printable import printable
from .process import progress_on, start_warp
from .provenance import UNTOLD, built_again
from .rerun import rerun
from .results import TRAJECTORY, free_folder, pictures_in
from .resume import resume_run
from .trust import Script
from .view import ViewOptions, view_trajectory

VIEW = ViewOptions()
PICTURES = Pictures()
_MOST_FPS = 60.0
"""Pictures a second beyond which a film that is played faster leaves some out."""
Flag = Annotated[bool, Parameter(negative=())]


def trajectory_in(file: Path) -> Path:
    """Return a trajectory that can be read, given by itself or by the folder of its run.

    Raises
    ------
    OSError, ValueError
        If there is none, or HDF5 cannot read it.
    """
    if file.is_dir() and not (file / TRAJECTORY).exists():
        raise FileNotFoundError(f"file is {file}, a folder without {TRAJECTORY}; it must be the folder of a run")
    if not file.exists():
        raise FileNotFoundError(f"file is {file}, which does not exist; it must be a trajectory or a run's folder")
    path = file / TRAJECTORY if file.is_dir() else file
    probe(path)
    return path


def info_command(file: Path, /) -> None:
    """Describe a trajectory: its contents, and the run that made it.

    Parameters
    ----------
    file
        A trajectory (*.vtkhdf) or a run's folder.
    """
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
    talk = Console(stderr=True, quiet=quiet_)
    path = trajectory_in(file)
    with Trajectory(path) as trajectory:
        shown, fps = _shown(trajectory, first, last, every, speed)
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
    with Trajectory(trajectory_in(file)) as trajectory:
        name, scene = scene_of(trajectory, Console(stderr=True), script)
        view_trajectory(trajectory, scene, name, options)


def _shown(trajectory: Trajectory, first: int, last: int, every: int, speed: float) -> tuple[range, float]:
    """Return the numbers of the frames that are drawn, and how many of them the film shows in a second."""
    count = len(trajectory)
    if not count:
        raise ValueError(f"{trajectory.path} has no frames to draw")
    for name, k in (("first", first), ("last", last)):
        if not -count <= k < count:
            raise ValueError(
                f"{name} is {k}; the run has {count} frames, and it must be from {-count} to {count - 1}"
            )
    shown = range(first % count, last % count + 1, checks.count("every", every, 1))
    if not shown:
        raise ValueError(f"last is {last}; it must not be before first, which is {first}")
    usual = trajectory.fps / every
    fps = usual * checks.between("speed", speed, 0.01, 100)
    step = math.ceil(fps / max(usual, _MOST_FPS) - 1e-9)
    return shown[::step], fps / step


def scene_of(trajectory: Trajectory, talk: Console, script: Script) -> tuple[str, Scene]:
    """Return the name and the scene of a trajectory; without obstacles where it does not tell what they were."""
    system, stored = trajectory.system, trajectory.scene
    kept = None if stored is None or script.asked_for else scene_from_stored(system, *stored)
    end = trajectory.times[-1]
    if kept is not None and end < known_until(kept) + 1e-9:
        return _name_of(trajectory), kept
    try:
        origin, scene = built_again(trajectory.attributes, script)
        if scene.system.position.shape != system.position.shape:
            raise ValueError(f"scene {origin.place!r} has another system now")
    except Exception as error:  # of a script of any kind, or none
        if kept is not None:
            without = f"drawn with moving obstacles that stand still from {known_until(kept):.4g} s on"
        else:
            without = "drawn without obstacles, in a plain look"
        talk.print(f"{without}: {printable(str(error))}", soft_wrap=True, highlight=False, markup=False)
        return (trajectory.path.stem, Scene(system=system)) if kept is None else (_name_of(trajectory), kept)
    return origin.name, replace(scene, system=system)


def _name_of(trajectory: Trajectory) -> str:
    """Return what pictures are called: as the scene is, by the file, or as the file is."""
    name = Path(str(trajectory.attributes.get("scene", ""))).stem
    return name if name and name.isprintable() else trajectory.path.stem


def _schedule_of(trajectory: Trajectory, script: Script) -> Sequence[Change]:
    """Return what changes on the way: by the file, or by the scene's script where an earlier version wrote it."""
    stored = trajectory.scene
    if stored is None or script.asked_for:
        return built_again(trajectory.attributes, script)[1].schedule
    return scene_from_stored(trajectory.system, *stored).schedule


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
        schedule = _schedule_of(trajectory, script) if trajectory.attributes.get("schedule") else ()
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

    The result equals that of an uninterrupted run bit for bit. On a GPU this does not hold for the route scatter
    and the integrator linearly-implicit-euler.

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
    path = trajectory_in(file)
    differences = rerun(path, device=device, out=out, quiet=quiet_, script=script)
    if differences is not None:
        raise ValueError(f"{path} was not made again: {differences}")
    if not quiet_:
        print(f"{path} was made again: the same to the last bit")
