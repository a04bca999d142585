"""The commands that begin with a file of a run: to look at it, draw it, go on with it, make it again."""

import shlex
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Literal

from cyclopts import Parameter
from rich.console import Console

from .. import checks, disk
from ..files import Trajectory, export
from ..studies import plot_history, write_history
from ..world import Scene
from .draw import draw
from .options import Pictures
from .process import progress_on, start_warp
from .provenance import built_again
from .rerun import rerun
from .results import RESTART, TRAJECTORY, free_folder, pictures_in
from .resume import resume_run

PICTURES = Pictures()
Flag = Annotated[bool, Parameter(negative=())]


def trajectory_in(file: Path) -> Path:
    """Return a trajectory, given by itself or by the folder of its run."""
    return file / TRAJECTORY if file.is_dir() else file


def info_command(file: Path, /) -> None:
    """Say what is in a trajectory, and what made it.

    Parameters
    ----------
    file
        A trajectory, *.vtkhdf, or the folder of a run.
    """
    path = trajectory_in(file)
    with Trajectory(path) as trajectory:
        system, times = trajectory.system, trajectory.times
        megabytes = path.stat().st_size / 1e6
        print(f"{path}: {len(trajectory)} frames from {times[0]:.4g} to {times[-1]:.4g} s, {megabytes:.1f} MB")
        particles = f"{system.particle_count} particles with {system.dim} coordinates"
        print(f"{particles}, {system.connection_count} connections")
        for name, value in trajectory.attributes.items():
            print(f"{name}: {_words(value)}")
    if path.with_name(RESTART).exists():
        print(f"{path.with_name(RESTART)}: `msdwarp resume {shlex.quote(str(path.parent))}` goes on from it")


def _words(value: Any) -> str:
    """Return a value of JSON as it is read best."""
    if isinstance(value, dict):
        return ", ".join(f"{name} {_words(one)}" for name, one in value.items() if one is not None)
    return " ".join(map(_words, value)) if isinstance(value, list) else str(value)


def export_command(
    file: Path,
    /,
    *,
    to: Literal["obj", "stl", "ply", "gltf", "usd", "npz"],
    frame: int | None = None,
    out: Path | None = None,
    force: Flag = False,
) -> None:
    """Write a trajectory's frames in the format of another program.

    Parameters
    ----------
    file
        A trajectory, *.vtkhdf, or the folder of a run.
    to
        The format; npz holds positions, velocities and times, the others what is drawn.
    frame
        One frame's number, counted from 0, or from the end if negative; by default all.
    out
        The file; by default beside the trajectory, with the format's ending.
    force
        Replace files that are there.
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
    azimuth: float | None = None,
    elevation: float | None = None,
    zoom: float = 1.0,
    out: Path | None = None,
    force: Flag = False,
    quiet_: Annotated[bool, Parameter(name="--quiet", negative=())] = False,
    verbose: Flag = False,
) -> None:
    """Draw a trajectory: single frames, a film, several poses in one picture.

    Obstacles and looks are those of the scene that made it, whose script is run where it came from one.

    Parameters
    ----------
    file
        A trajectory, *.vtkhdf, or the folder of a run.
    azimuth
        Direction from the body to the camera, anticlockwise from x seen from above [degrees].
    elevation
        The same above the horizon [degrees].
    zoom
        How much nearer the camera comes than where it sees all.
    out
        Folder for the pictures; by default `render` beside the trajectory, or render-2 ... where that is taken.
    force
        Replace pictures that are there.
    quiet_
        Print errors only.
    verbose
        Let Warp and VTK speak too.
    """
    start_warp(verbose)
    talk = Console(stderr=True, quiet=quiet_)
    path = trajectory_in(file)
    with Trajectory(path) as trajectory:
        pictures.check(len(trajectory))
        if not pictures.any:
            raise ValueError("frames and video are none, and overlay is not given: nothing would be drawn")
        name, scene = _scene_of(trajectory, talk)
        turned = {"azimuth": azimuth, "elevation": elevation}
        turned = {key: value for key, value in turned.items() if value is not None}
        scene = replace(scene, look=replace(scene.look, **turned))
        folder = out or (path.parent / "render" if force else free_folder(path.parent / "render"))
        there = pictures_in(folder, name)
        if there and not force:
            raise FileExistsError(f"{there[0]} exists, and would be replaced; name another --out or add --force")
        disk.writable_folder("out", folder, folder)
        for picture in there:  # none of an earlier, longer film is left
            picture.unlink()
        with progress_on(talk) as progress:
            line = draw(scene, trajectory, folder, name, pictures, progress, zoom=zoom)
    if not quiet_:
        print(line)


def _scene_of(trajectory: Trajectory, talk: Console) -> tuple[str, Scene]:
    """Return the name and the scene of a trajectory; without obstacles where it does not tell what they were."""
    system = trajectory.system
    try:
        origin, scene = built_again(trajectory.attributes)
        if scene.system.position.shape != system.position.shape:
            raise ValueError(f"scene {origin.place!r} has another system now")
    except Exception as error:  # of a script of any kind, or none
        talk.print(f"drawn without obstacles, in a plain look: {error}", soft_wrap=True, highlight=False)
        return trajectory.path.stem, Scene(system=system)
    return origin.name, replace(scene, system=system)


def plot_command(
    file: Path,
    /,
    *,
    out: Path | None = None,
    gravity: float | None = None,
    force: Flag = False,
    verbose: Flag = False,
) -> None:
    """Plot energies, momentum and heights of a trajectory against time.

    Parameters
    ----------
    file
        A trajectory, *.vtkhdf, or the folder of a run.
    out
        The picture, *.png, or the same numbers as *.csv; by default a picture beside the trajectory, of its name.
    gravity
        Acceleration of free fall [m/s²]; by default what the file says.
    force
        Replace a file that is there.
    verbose
        Let Warp speak too.
    """
    start_warp(verbose)
    path = trajectory_in(file)
    with Trajectory(path) as trajectory:
        stored = trajectory.attributes if gravity is None else {"gravity": gravity}
        acceleration = checks.member("without --gravity, the file", stored, "gravity")
        # What changes on the way is known to the scene alone.
        schedule = built_again(trajectory.attributes)[1].schedule if trajectory.attributes.get("schedule") else ()
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
    force: Flag = False,
    quiet_: Annotated[bool, Parameter(name="--quiet", negative=())] = False,
    verbose: Flag = False,
) -> None:
    """Go on with a run that was ended, to where it would have come, and draw it.

    It ends with what it would have ended with, to the last bit where its route sums in a fixed order.

    Parameters
    ----------
    folder
        The folder of the run, or its restart.h5.
    duration
        Simulated time in all [s]; by default as the run asked for. A run that is complete goes on for longer.
    device
        Where to simulate; by default where it was.
    force
        Replace pictures that are there.
    quiet_
        Print errors only.
    verbose
        Let Warp and VTK speak too.
    """
    start_warp(verbose)
    if not folder.exists():
        raise FileNotFoundError(f"{folder} does not exist; it must be the folder of a run")
    folder = folder if folder.is_dir() else folder.parent
    resume_run(folder, duration=duration, device=device, force=force, quiet=quiet_)


def rerun_command(
    file: Path,
    /,
    *,
    device: str | None = None,
    out: Path | None = None,
    quiet_: Annotated[bool, Parameter(name="--quiet", negative=())] = False,
    verbose: Flag = False,
) -> None:
    """Simulate again what a trajectory holds, and say whether the result differs.

    The exit code is 0 where it is the same to the last bit, else 1.

    Parameters
    ----------
    file
        A trajectory, *.vtkhdf, or the folder of a run.
    device
        Where to simulate; by default where it was.
    out
        Folder to keep the result in, drawn as the run was; by default it is not kept.
    quiet_
        Print errors only.
    verbose
        Let Warp and VTK speak too.
    """
    start_warp(verbose)
    path = trajectory_in(file)
    differences = rerun(path, device=device, out=out, quiet=quiet_)
    if differences is not None:
        raise ValueError(f"{path} was not made again: {differences}")
    if not quiet_:
        print(f"{path} was made again: the same to the last bit")
