"""What commands make of the file of a run: its trajectory, its scene, the frames that are drawn."""

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from rich.console import Console

from .. import checks
from ..files import Trajectory, probe
from ..world import Change, Scene, known_until, scene_from_stored
from .printable import printable
from .provenance import built_again
from .results import TRAJECTORY
from .script_signatures import Script

_MOST_FPS = 60.0
"""Pictures a second beyond which a film that is played faster leaves some out."""


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


def shown_of(trajectory: Trajectory, first: int, last: int, every: int, speed: float) -> tuple[range, float]:
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
    kept = None if stored is None or script.requested else scene_from_stored(system, *stored)
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


def schedule_of(trajectory: Trajectory, script: Script) -> Sequence[Change]:
    """Return what changes on the way: by the file, or by the scene's script where an earlier version wrote it."""
    stored = trajectory.scene
    if stored is None or script.requested:
        return built_again(trajectory.attributes, script)[1].schedule
    return scene_from_stored(trajectory.system, *stored).schedule
