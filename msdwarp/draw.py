"""Drawing a trajectory: single frames, a film, and several poses in one picture."""

import math
import re
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from cyclopts import Parameter
from numpy.typing import NDArray
from PIL import Image
from rich.progress import Progress

from . import checks, film
from .history import particle_energies, system_in
from .opengl import ADVICE
from .picture import Scale, outermost
from .render import Renderer
from .results import overlay_path
from .scene import Scene
from .timelapse import timelapse
from .trajectory import Trajectory

Values = Callable[[int], NDArray[np.float64]]


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class Pictures:
    """What is drawn of a run.

    Parameters
    ----------
    frames
        Format of the single frames.
    video
        Format of the film; mp4 needs the extra `video`. With both none and no overlay nothing is drawn.
    overlay
        Lay this many poses, evenly spaced in time, over each other in one picture, SCENE_overlay.png.
    resolution
        Width and height of the pictures in pixels.
    colour
        The surface as it looks, connections from green (rest) to red (strained), or the body by the speed or the
        energy of its particles; by default as the scene looks best.
    """

    frames: Literal["png", "none"] = "png"
    video: Literal["webp", "mp4", "gif", "none"] = "webp"
    overlay: int | None = None
    resolution: str = "1280x720"
    colour: Literal["texture", "strain", "velocity", "energy"] | None = None

    @property
    def any(self) -> bool:
        """Whether anything is to be drawn."""
        return self.overlay is not None or not self.frames == self.video == "none"

    def are_in(self, folder: Path, name: str, frame_count: int) -> bool:
        """Tell whether all that is to be drawn of so many frames has been."""
        wanted = [] if self.overlay is None else [overlay_path(folder, name)]
        wanted += [] if self.video == "none" else [folder / f"{name}.{self.video}"]
        wanted += [] if self.frames == "none" else [folder / f"frame_{frame_count - 1:04d}.{self.frames}"]
        return all(path.exists() for path in wanted)

    def check(self, frame_count: int) -> None:
        """Raise ValueError unless so many frames can be drawn."""
        film.check_formats(self.frames, self.video)
        parse_resolution(self.resolution)
        if self.overlay is not None and checks.count("overlay", self.overlay, 2) > frame_count:
            raise ValueError(
                f"overlay is {self.overlay}; the run has {frame_count} frames, and it must be at most that"
            )


def parse_resolution(text: str) -> tuple[int, int]:
    """Return (width, height) of "WIDTHxHEIGHT"; raise ValueError unless both are even, from 64 to 16384."""
    match = re.fullmatch(r"(\d+)x(\d+)", text)
    size = tuple(map(int, match.groups())) if match else ()
    if len(size) != 2 or any(not 64 <= n <= 16384 or n % 2 for n in size):
        raise ValueError(
            f"resolution is {text!r}; it must be WIDTHxHEIGHT, both even and from 64 to 16384, such as 1280x720"
        )
    return size


def draw(
    scene: Scene,
    trajectory: Trajectory,
    folder: Path,
    name: str,
    pictures: Pictures,
    progress: Progress,
    *,
    zoom: float = 1.0,
) -> str:
    """Draw a trajectory into a folder; return a line that says so.

    Parameters
    ----------
    scene
        What it is of; its system is the trajectory's.
    trajectory
        The frames.
    folder, name
        Where pictures go, and what the film is called.
    pictures
        What is drawn.
    progress
        Where it is shown how far it is.
    zoom
        How much nearer the camera comes than where it sees all.
    """
    began, count = time.perf_counter(), len(trajectory)
    colouring, values = _colouring(scene, trajectory, pictures.colour)
    size = parse_resolution(pictures.resolution)
    seen = [outermost(trajectory.positions[k], scene.look, size[0] / size[1]) for k in range(count)]
    renderer = Renderer(scene, np.concatenate(seen), resolution=size, colouring=colouring, zoom=zoom)
    if not renderer.uses_opengl:
        progress.console.print(f"no OpenGL library found: frames are ray cast; {ADVICE}", soft_wrap=True)
    positions, times, drawn, results = trajectory.positions, trajectory.times, [], []
    if not pictures.frames == pictures.video == "none":
        shown = progress.track(range(count), count, description="drawing")
        images = (renderer.image(positions[k], times[k], values and values(k)) for k in shown)
        formats = {"frames": pictures.frames, "video": pictures.video}
        path = film.write(images, count, folder, name=name, fps=trajectory.fps, **formats)
        drawn.append(f"{count} frame{'s' if count > 1 else ''}")
        if pictures.frames == "png":
            others = f" ... frame_{count - 1:04d}.png" if count > 1 else ""
            results.append(f"{folder / 'frame_0000.png'}{others}")
        if path is not None:
            results.append(f"{path} ({path.stat().st_size / 1e6:.1f} MB)")
    if pictures.overlay is not None:
        chosen = np.unique(np.linspace(0, count - 1, pictures.overlay).round().astype(int))
        path = overlay_path(folder, name)
        all_values = None if values is None else np.array([values(k) for k in chosen])
        Image.fromarray(timelapse(renderer, positions[chosen], times[chosen], all_values)).save(path)
        drawn.append(f"an overlay of {len(chosen)} poses")
        results.append(str(path))
    seconds = time.perf_counter() - began
    return f"drew {' and '.join(drawn)} in {seconds:.2f} s: " + " and ".join(results)


def _colouring(
    scene: Scene, trajectory: Trajectory, colour: str | None
) -> tuple[str | Scale | None, Values | None]:
    """Return how a body is coloured, and what gives the values of its particles in frame k, if any are shown.

    The scale ends where, in the frame in which they are largest, all but a hundredth of the particles are below.
    """
    if colour not in _SHOWN:
        return colour, None
    label, values_of = _SHOWN[colour]

    def values(k: int) -> NDArray[np.float64]:
        return values_of(scene, trajectory, k)

    largest = max(float(np.quantile(values(k), 0.99)) for k in range(len(trajectory)))
    return Scale(label, _rounded_up(largest)), values


def _speeds(scene: Scene, trajectory: Trajectory, k: int) -> NDArray[np.float64]:
    return np.linalg.norm(trajectory.velocities[k].astype(np.float64), axis=1)


def _energies(scene: Scene, trajectory: Trajectory, k: int) -> NDArray[np.float64]:
    return particle_energies(system_in(trajectory, k, scene.schedule))


_SHOWN: dict[str | None, tuple[str, Callable[[Scene, Trajectory, int], NDArray[np.float64]]]] = {
    "velocity": ("speed [m/s]", _speeds),
    "energy": ("energy of a particle and half its connections [J]", _energies),
}
"""What can be shown of particles, by name: what it is called, and its values in a frame."""


def _rounded_up(value: float) -> float:
    """Return a number of one or two digits that is not less; 1 where nothing is above 0."""
    if value <= 0:
        return 1.0
    power = 10.0 ** math.floor(math.log10(value))
    return next(step * power for step in (1, 1.5, 2, 3, 4, 5, 6, 8, 10) if step * power >= value * (1 - 1e-9))
