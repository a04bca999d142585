"""Recording: frames of a view in a file, with the user's changes, so that `rerun` can replay them."""

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

DEEDS = "deeds.json"
"""Name of a recording's file with the changes since the start, if there are any."""
FIRST_FRAME = "first_frame"
"""Attribute of a recording's file: the simulation's index of the first recorded frame."""


class Recording:
    """Frames of a running simulation from now on, in a new folder, by default a free out/NAME-live.

    FileExistsError is raised if the folder exists.
    """

    def __init__(self, source: Running, folder: str | Path | None = None) -> None:
        self._source = source
        self.folder = _free_path(f"{source.title or 'view'}-live") if folder is None else Path(folder)
        self.folder.mkdir(parents=True)
        self.path = self.folder / disk.TRAJECTORY
        first, self._first_frame = source.frame(), source.index
        scene = scene_as_stored(source.scene, [first.time, first.time + source.scene.duration])
        attributes = source.attributes | {FIRST_FRAME: self._first_frame}
        self._writer = TrajectoryWriter(
            self.path, source.scene.system, fps=source.fps, attributes=attributes, scene=scene, strain=False
        )
        self._write()
        source.after_frame.append(self._write)

    def _write(self) -> None:
        self._writer.write(self._source.frame(), broken_at=self._source.broken_at())

    def close(self) -> str:
        """End the recording, and write the user's changes to a file in its folder; return a message."""
        self._source.after_frame.remove(self._write)
        self._writer.close()
        deeds = self._source.handling.deeds
        if deeds:
            with disk.replacing(self.folder / DEEDS) as path:
                path.write_text(json.dumps(deeds), encoding="utf-8")
        count = self._source.index - self._first_frame + 1
        return f"wrote {count} frames: `msdwarp render {self.folder}` draws them"


def read_deeds(folder: Path) -> list[dict[str, Any]]:
    """Return the user's changes in a recording; raise ValueError if their file is damaged."""
    path = folder / DEEDS
    if not path.exists():
        return []
    try:
        deeds = json.loads(path.read_text(encoding="utf-8"))
    except (ValueError, RecursionError) as error:
        raise ValueError(f"{path} is damaged: {error}") from error
    if not isinstance(deeds, list) or not all(isinstance(one, dict) for one in deeds):
        raise ValueError(f"{path} is damaged: it is not a list of actions")
    return deeds


class Filming:
    """The process that draws a recording's film while the view continues."""

    def __init__(self, folder: Path, renderer: str = "auto") -> None:
        self.folder = folder
        flags = ["--out", str(folder), "--frames", "none", "--renderer", renderer, "--quiet"]
        self._process = subprocess.Popen(
            [sys.executable, "-m", "msdwarp", "render", str(folder), *flags],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,  # Ctrl-C then ends the view, but not the film
        )

    def ended(self) -> str | None:
        """Return a message once the drawing has ended; None until then."""
        if self._process.poll() is None:
            return None
        _, error = self._process.communicate()
        if self._process.returncode:
            return f"the film failed: {error.strip().splitlines()[-1] if error.strip() else 'it was interrupted'}"
        return f"drew a film in {self.folder}"


def save_picture(source: Source, scene: Scene, path: str | Path | None = None, renderer: str = "auto") -> Path:
    """Draw the current frame to a PNG file, by default the next free out/NAME.png; return the path."""
    if path is None:
        Path("out").mkdir(exist_ok=True)
        path = _free_path(source.title or "view", ".png")
    frame = source.frame()
    pictures = Renderer(scene, frame.position[np.newaxis], backend=renderer, device=source.device)
    with disk.writing(Path(path)) as unfinished:
        Image.fromarray(pictures.image(frame.position, frame.time)).save(unfinished)
    return Path(path)


def _free_path(name: str, suffix: str = "") -> Path:
    """Return the first of out/NAME, out/NAME-2, ... that does not exist."""
    k = 1
    while (path := Path("out") / f"{name}{'' if k == 1 else f'-{k}'}{suffix}").exists():
        k += 1
    return path
