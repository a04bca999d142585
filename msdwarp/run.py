"""Running a scene: simulate it, draw every frame, write frames and a film."""

import re
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from cyclopts import Parameter
from numpy.typing import NDArray
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from . import film
from .integrators import RK4, Integrator, Leapfrog, SymplecticEuler
from .opengl import ADVICE
from .render import Renderer
from .scene import Scene
from .simulation import Simulation, frame_count

INTEGRATORS: dict[str, type[Integrator]] = {
    "symplectic-euler": SymplecticEuler,
    "leapfrog": Leapfrog,
    "rk4": RK4,
}


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class Options:
    """What can be said of every run, whatever the scene.

    Parameters
    ----------
    device
        Where to simulate: cpu, cuda:0 ...; by default the first GPU, else the CPU.
    precision
        Numbers of the simulation.
    integrator
        Time-stepping method.
    substeps
        Integrator steps per frame; auto chooses them by the scene's stability limit.
    duration
        Simulated time [s]; by default the scene's own.
    fps
        Frames per second of simulated time.
    out
        Folder for the results; by default out/SCENE, or out/SCENE-2 ... where that is taken.
    frames
        Format of the single frames.
    video
        Format of the film; mp4 needs the extra `video`. With both none it only simulates.
    resolution
        Width and height of the pictures in pixels.
    colour
        The scene's look, or connections from green (rest) to red (strained).
    force
        Replace an earlier run's results in --out.
    quiet
        Print errors only.
    verbose
        Let Warp and VTK speak too.
    """

    device: str | None = None
    precision: Literal["float32", "float64"] = "float32"
    integrator: Literal["symplectic-euler", "leapfrog", "rk4"] = "symplectic-euler"
    substeps: int | Literal["auto"] = "auto"
    duration: float | None = None
    fps: float = 60.0
    out: Path | None = None
    frames: Literal["png", "none"] = "png"
    video: Literal["webp", "mp4", "gif", "none"] = "webp"
    resolution: str = "1280x720"
    colour: Literal["texture", "strain"] = "texture"
    force: Annotated[bool, Parameter(negative=())] = False
    quiet: Annotated[bool, Parameter(negative=())] = False
    verbose: Annotated[bool, Parameter(negative=())] = False


def parse_resolution(text: str) -> tuple[int, int]:
    """Return (width, height) of "WIDTHxHEIGHT"; raise ValueError unless both are even and at least 64."""
    match = re.fullmatch(r"(\d+)x(\d+)", text)
    size = tuple(map(int, match.groups())) if match else ()
    if len(size) != 2 or any(n < 64 or n % 2 for n in size):
        raise ValueError(
            f"resolution is {text!r}; it must be WIDTHxHEIGHT, both even and at least 64, such as 1280x720"
        )
    return size


def result_folder(name: str, out: Path | None, force: bool) -> Path:
    """Create and return the folder for results; nothing of an earlier run is touched without `force`.

    Raises
    ------
    FileExistsError
        If `out` is given, holds something, and `force` is False.
    OSError
        If it cannot be created or written to.
    """
    folder = out
    if folder is None:
        folder, k = Path("out") / name, 2
        while not force and folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
            folder, k = Path("out") / f"{name}-{k}", k + 1
    elif not force and folder.is_dir() and any(folder.iterdir()):
        raise FileExistsError(f"out is {folder}, which is not empty; name another folder or add --force")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        reason = error.strerror or error
        raise OSError(f"out is {folder}, which cannot be written to: {reason}") from error
    if force:
        stale = [*folder.glob("frame_[0-9]*.png"), *(folder / f"{name}.{end}" for end in film.FILM_FORMATS)]
        for path in stale:
            path.unlink(missing_ok=True)
    return folder


def run_scene(name: str, scene: Scene, options: Options) -> None:
    """Simulate a scene, draw every frame and write the results, unless nothing is to be drawn.

    Raises
    ------
    ValueError, OSError
        If an option is out of its range or `out` cannot be used: before anything is written.
    SimulationDiverged
        If the simulation fails.
    """
    film.check_formats(options.frames, options.video)
    resolution = parse_resolution(options.resolution)
    duration = scene.duration if options.duration is None else options.duration
    count = frame_count(duration, options.fps) + 1
    began = time.perf_counter()
    simulation = Simulation(
        scene.system,
        gravity=scene.gravity,
        colliders=scene.colliders,
        integrator=INTEGRATORS[options.integrator](),
        fps=options.fps,
        substeps=options.substeps,
        device=options.device,
        precision=options.precision,
    )
    drawing = not options.frames == options.video == "none"
    folder = result_folder(name, options.out, options.force) if drawing else None
    talk = Console(stderr=True, quiet=options.quiet)
    with tempfile.TemporaryDirectory() as scratch, _progress(talk) as progress:
        # Positions wait on disk until all are known, so that one camera can be chosen that sees them all.
        positions = np.lib.format.open_memmap(
            Path(scratch) / "positions.npy", "w+", np.float32, (count, *scene.system.position.shape)
        )
        frames = simulation.frames(duration)
        for k, frame in enumerate(progress.track(frames, count, description="simulating")):
            positions[k] = frame.position
        lines = list(_summary(simulation, options.integrator, time.perf_counter() - began))
        if folder is not None:
            lines += _draw(scene, positions, folder / name, resolution, options, progress)
    if not options.quiet:
        print(*lines, sep="\n")


def _draw(
    scene: Scene,
    positions: NDArray,
    target: Path,
    resolution: tuple[int, int],
    options: Options,
    progress: Progress,
) -> Iterator[str]:
    """Draw all frames and write them beside the film `target`; then say so."""
    began = time.perf_counter()
    renderer = Renderer(scene, positions, resolution=resolution, colouring=options.colour)
    if not renderer.uses_opengl:
        progress.console.print(f"no OpenGL library found: frames are ray cast; {ADVICE}", soft_wrap=True)
    count, folder, name = len(positions), target.parent, target.name
    images = map(renderer.image, progress.track(positions, count, description="drawing"))
    path = film.write(
        images, count, folder, name=name, fps=options.fps, frames=options.frames, video=options.video
    )
    seconds = time.perf_counter() - began
    results = []
    if options.frames == "png":
        results.append(f"{folder / 'frame_0000.png'} ... frame_{count - 1:04d}.png")
    if path is not None:
        results.append(f"{path} ({path.stat().st_size / 1e6:.1f} MB)")
    yield f"drew {count} frames in {seconds:.2f} s: " + " and ".join(results)


def _progress(console: Console) -> Progress:
    columns = ("{task.description}", BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    columns = [TextColumn(c) if isinstance(c, str) else c for c in columns]
    return Progress(*columns, console=console, transient=True, disable=not console.is_terminal)


def _summary(simulation: Simulation, integrator: str, seconds: float) -> Iterator[str]:
    """Say what was simulated, and how fast."""
    system = simulation.system
    yield (
        f"{system.particle_count} particles and {system.connection_count} connections by {integrator}, "
        f"{simulation.substeps} substeps a frame, {simulation.model.precision} on {simulation.device}"
    )
    rate = simulation.time / seconds
    yield f"simulated {simulation.time:.4g} s in {seconds:.2f} s, {rate:.2g} times real time"
