"""Recording: frames of a view kept in a file, with what was done by hand, so that `rerun` can do it again."""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from .. import disk
from ..files import TrajectoryWriter
from ..pictures import Renderer
from ..world import Scene, scene_as_stored
from .sources import Running, Source

TRAJECTORY, DEEDS = "trajectory.vtkhdf", "deeds.json"
"""Files of a recording: its frames, and what was done by hand since the start, if anything was."""
FIRST_FRAME = "first_frame"
"""The attribute of a recording's file that says which frame of the simulation its first one is."""


class Recording:
    """Frames of a running simulation, from the present one on, kept in a folder.

    Parameters
    ----------
    source
        The simulation.
    folder
        A folder that is made for it; by default out/NAME-live, or the next that is free.

    Raises
    ------
    FileExistsError
        If the folder is there.
    """

    def __init__(self, source: Running, folder: str | Path | None = None) -> None:
        self._source = source
        self.folder = _free(Path("out"), f"{source.title or 'view'}-live") if folder is None else Path(folder)
        self.folder.mkdir(parents=True)
        self.path = self.folder / TRAJECTORY
        first = source.frame()
        self._begun = source.handling.simulation.frame_index
        scene = scene_as_stored(source.scene, [first.time, first.time + source.scene.duration])
        attributes = dict(source.attributes) | {FIRST_FRAME: self._begun}
        self._writer = TrajectoryWriter(
            self.path, source.scene.system, fps=source.fps, attributes=attributes, scene=scene, strain=False
        )
        self._write()
        source.behind.append(self._write)

    def _write(self) -> None:
        self._writer.write(self._source.frame(), broken_at=self._source.broken_at())

    def close(self) -> str:
        """End, with what was done by hand beside the frames; return what to say."""
        self._source.behind.remove(self._write)
        self._writer.close()
        deeds = self._source.handling.deeds
        if deeds:
            with disk.replacing(self.folder / DEEDS) as path:
                path.write_text(json.dumps(deeds), encoding="utf-8")
        count = self._source.handling.simulation.frame_index - self._begun + 1
        return f"wrote {count} frames: `msdwarp render {self.folder}` draws them"


def read_deeds(folder: Path) -> list[dict[str, Any]] | None:
    """Return what was done by hand in a recording; None where nothing was.

    Raises
    ------
    ValueError
        If the file is damaged.
    """
    path = folder / DEEDS
    if not path.exists():
        return None
    try:
        deeds = json.loads(path.read_text(encoding="utf-8"))
    except (ValueError, RecursionError) as error:
        raise ValueError(f"{path} is damaged: {error}") from error
    if not isinstance(deeds, list) or not all(isinstance(one, dict) for one in deeds):
        raise ValueError(f"{path} is damaged: it is not a list of actions")
    return deeds


class Filming:
    """A film of a recording as it is drawn, in a process of its own: the view goes on meanwhile.

    Parameters
    ----------
    folder
        That of the recording.
    renderer
        What draws: "auto", "raster", "raycast" or "opengl".
    """

    def __init__(self, folder: Path, renderer: str = "auto") -> None:
        self.folder = folder
        command = [
            "render",
            str(folder),
            "--out",
            str(folder),
            "--frames",
            "none",
            "--renderer",
            renderer,
            "--quiet",
        ]
        # Ctrl-C, which ends the view, is not meant for it.
        self._process = subprocess.Popen(
            [sys.executable, "-m", "msdwarp", *command],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )

    def ended(self) -> str | None:
        """Return what to say once it has ended; None while it is drawn."""
        if self._process.poll() is None:
            return None
        _, error = self._process.communicate()
        if self._process.returncode:
            return f"the film failed: {error.strip().splitlines()[-1] if error.strip() else 'it was interrupted'}"
        return f"drew a film in {self.folder}"


def drawn(source: Source, scene: Scene, path: str | Path | None = None, renderer: str = "auto") -> Path:
    """Draw the present frame into a PNG file, by default the next free out/NAME.png; return its path."""
    if path is None:
        Path("out").mkdir(exist_ok=True)
        path = _free(Path("out"), source.title or "view", ".png")
    frame = source.frame()
    pictures = Renderer(scene, frame.position[np.newaxis], backend=renderer, device=source.device)
    Image.fromarray(pictures.image(frame.position, frame.time)).save(path)
    return Path(path)


def _free(folder: Path, name: str, suffix: str = "") -> Path:
    """Return the first of name, name-2, ... that is free in a folder."""
    k = 1
    while (path := folder / f"{name}{'' if k == 1 else f'-{k}'}{suffix}").exists():
        k += 1
    return path
