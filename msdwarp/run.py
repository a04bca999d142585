"""Running a scene: simulate it, draw every frame, write frames and a film."""

import re
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import nullcontext
from dataclasses import dataclass, replace
from importlib.metadata import version
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from cyclopts import Parameter
from numpy.typing import NDArray
from PIL import Image
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from . import checks, film
from .accuracy import DEFAULT, METHODS, cheapest, simulation_of, tune
from .energy_log import EnergyLog
from .opengl import ADVICE
from .render import Renderer
from .scene import Scene
from .simulation import Simulation, frame_count
from .timelapse import timelapse
from .watch import SimulationDiverged
from .writer import TrajectoryWriter


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class Options:
    """What can be said of every run, whatever the scene.

    Parameters
    ----------
    device
        Where to simulate: cpu, cuda:0 ...; by default the first GPU, else the CPU.
    precision
        Numbers of the simulation; by default float32.
    route
        How forces are summed, a matter of speed alone; auto takes the fastest. On a GPU gather and stencil (of
        lattices) give the same result to the last bit each time.
    integrator
        Time-stepping method; by default symplectic-euler.
    substeps
        Integrator steps per frame; auto chooses them by the scene's stability limit.
    allow_unstable
        Accept substeps beyond the stability limit.
    tolerance
        Choose integrator, precision and substeps so that the error stays under this share of the body's size
        (see `msdwarp tune`).
    duration
        Simulated time [s]; by default the scene's own.
    fps
        Frames per second of simulated time.
    out
        Folder for the results; by default out/SCENE, or out/SCENE-2 ... where that is taken.
    frames
        Format of the single frames.
    video
        Format of the film; mp4 needs the extra `video`. With both none and no overlay it only simulates.
    overlay
        Lay this many poses, evenly spaced in time, over each other in one picture, SCENE_overlay.png.
    trajectory
        Write every frame to SCENE.vtkhdf, which ParaView opens, and `msdwarp info` and `msdwarp export`: plain, or
        compressed (smaller, and slower).
    resolution
        Width and height of the pictures in pixels.
    log
        Write energies, momentum and strain of every frame to this CSV file, and a plot beside it.
    colour
        The surface, or connections from green (rest) to red (strained); by default as the scene looks best.
    force
        Replace an earlier run's results in --out and --log.
    quiet
        Print errors only.
    verbose
        Let Warp and VTK speak too.
    """

    device: str | None = None
    precision: Literal["float32", "float32-compensated", "float64"] | None = None
    route: Literal["auto", "scatter", "gather", "stencil"] = "auto"
    integrator: (
        Literal["symplectic-euler", "leapfrog", "leapfrog-extrapolated", "rk4", "rkc2", "linearly-implicit-euler"]
        | None
    ) = None
    substeps: int | Literal["auto"] = "auto"
    allow_unstable: Annotated[bool, Parameter(negative=())] = False
    tolerance: float | None = None
    duration: float | None = None
    fps: float = 60.0
    out: Path | None = None
    frames: Literal["png", "none"] = "png"
    video: Literal["webp", "mp4", "gif", "none"] = "webp"
    overlay: int | None = None
    trajectory: Literal["none", "plain", "compressed"] = "none"
    resolution: str = "1280x720"
    log: Path | None = None
    colour: Literal["texture", "strain"] | None = None
    force: Annotated[bool, Parameter(negative=())] = False
    quiet: Annotated[bool, Parameter(negative=())] = False
    verbose: Annotated[bool, Parameter(negative=())] = False


def parse_resolution(text: str) -> tuple[int, int]:
    """Return (width, height) of "WIDTHxHEIGHT"; raise ValueError unless both are even, from 64 to 16384."""
    match = re.fullmatch(r"(\d+)x(\d+)", text)
    size = tuple(map(int, match.groups())) if match else ()
    if len(size) != 2 or any(not 64 <= n <= 16384 or n % 2 for n in size):
        raise ValueError(
            f"resolution is {text!r}; it must be WIDTHxHEIGHT, both even and from 64 to 16384, such as 1280x720"
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
    checks.writable_folder("out", folder, folder)
    if force:
        stale = [*folder.glob("frame_[0-9]*.png"), *(folder / f"{name}.{end}" for end in film.FILM_FORMATS)]
        stale += [overlay_path(folder / name), trajectory_path(folder / name)]
        for path in stale:
            path.unlink(missing_ok=True)
    return folder


def overlay_path(target: Path) -> Path:
    """Return the file of the picture of several poses, beside the film `target`, given without its ending."""
    return target.with_name(f"{target.name}_overlay.png")


def trajectory_path(target: Path) -> Path:
    """Return the file of the trajectory, beside the film `target`, given without its ending."""
    return target.with_name(f"{target.name}.vtkhdf")


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
    if options.overlay is not None and checks.count("overlay", options.overlay, 2) > count:
        raise ValueError(f"overlay is {options.overlay}; the run has {count} frames, and it must be at most that")
    talk = Console(stderr=True, quiet=options.quiet)
    if options.tolerance is not None:
        options = _tuned(scene, options, talk)
    integrator, precision = options.integrator or DEFAULT, options.precision or "float32"
    simulation = simulation_of(
        scene,
        integrator=METHODS[integrator],
        fps=options.fps,
        substeps=options.substeps,
        allow_unstable=options.allow_unstable,
        device=options.device,
        precision=precision,
        route=options.route,
    )
    log = None if options.log is None else EnergyLog(options.log, force=options.force)
    drawing = options.overlay is not None or not options.frames == options.video == "none"
    keeping = options.trajectory != "none"
    folder = result_folder(name, options.out, options.force) if drawing or keeping else None
    writer = nullcontext()
    if folder is not None and keeping:
        writer = TrajectoryWriter(
            trajectory_path(folder / name),
            scene.system,
            fps=options.fps,
            frame_count=count,
            compress=options.trajectory == "compressed",
            attributes=_about(name, simulation, integrator),
        )
    with tempfile.TemporaryDirectory() as scratch, _progress(talk) as progress:
        # Positions wait on disk until all are known, so that one camera can be chosen that sees them all.
        positions = np.lib.format.open_memmap(
            Path(scratch) / "positions.npy", "w+", np.float32, (count, *scene.system.position.shape)
        )
        began, done, trouble = time.perf_counter(), 0, None
        try:
            with log or nullcontext(), writer:
                frames = simulation.frames(duration)
                for frame in progress.track(frames, count, description="simulating"):
                    if drawing:
                        positions[done] = frame.position
                    if isinstance(writer, TrajectoryWriter):
                        writer.write(frame)
                    done += 1
                    if log is not None:
                        log.write(frame.time, simulation.measure())
        except SimulationDiverged as error:
            trouble = error  # told once what there is has been drawn
        lines = list(_summary(simulation, integrator, time.perf_counter() - began))
        if folder is not None and keeping:
            path = trajectory_path(folder / name)
            lines.append(f"wrote {path} ({path.stat().st_size / 1e6:.1f} MB)")
        if folder is not None and drawing:
            lines.append(_draw(scene, positions[:done], folder / name, resolution, options, progress))
    if not options.quiet:
        print(*lines, sep="\n")
    if trouble is not None:
        raise trouble


def _about(name: str, simulation: Simulation, integrator: str) -> dict[str, Any]:
    """Return what made a run, for its trajectory."""
    return {
        "scene": name,
        "command": sys.argv,
        "integrator": integrator,
        "precision": simulation.model.precision,
        "substeps": simulation.substeps,
        "route": simulation.model.route,
        "device": simulation.device,
        "versions": {package: version(package) for package in ("msdwarp", "warp-lang", "numpy", "h5py")},
    }


def _tuned(scene: Scene, options: Options, talk: Console) -> Options:
    """Return the options with the cheapest method under their tolerance."""
    assert options.tolerance is not None
    if options.integrator or options.precision or options.substeps != "auto":
        raise ValueError("tolerance chooses integrator, precision and substeps; they cannot be given beside it")
    if options.fps != 60.0:
        raise ValueError(f"fps is {options.fps:g}; with a tolerance it must be 60")
    with talk.status("tuning"):
        found, _ = tune(scene, options.tolerance, device=options.device)
    best: Any = cheapest(found, options.tolerance)
    talk.print(f"tuned: {best.method} keeps the error to {best.error:.1e} of the body's size", highlight=False)
    return replace(options, integrator=best.method, precision=best.precision, substeps=best.substeps)


def _draw(
    scene: Scene,
    positions: NDArray,
    target: Path,
    resolution: tuple[int, int],
    options: Options,
    progress: Progress,
) -> str:
    """Draw all frames and write them beside the film `target`; return a line that says so."""
    began = time.perf_counter()
    renderer = Renderer(scene, positions, resolution=resolution, colouring=options.colour)
    if not renderer.uses_opengl:
        progress.console.print(f"no OpenGL library found: frames are ray cast; {ADVICE}", soft_wrap=True)
    count, folder, drawn, results = len(positions), target.parent, [], []
    if not options.frames == options.video == "none":
        shown = progress.track(positions, count, description="drawing")
        images = (renderer.image(position, k / options.fps) for k, position in enumerate(shown))
        path = film.write(
            images, count, folder, name=target.name, fps=options.fps, frames=options.frames, video=options.video
        )
        drawn.append(f"{count} frames")
        if options.frames == "png":
            results.append(f"{folder / 'frame_0000.png'} ... frame_{count - 1:04d}.png")
        if path is not None:
            results.append(f"{path} ({path.stat().st_size / 1e6:.1f} MB)")
    if options.overlay is not None:
        chosen = np.unique(np.linspace(0, count - 1, options.overlay).round().astype(int))
        path = overlay_path(target)
        Image.fromarray(timelapse(renderer, positions[chosen], chosen / options.fps)).save(path)
        drawn.append(f"an overlay of {len(chosen)} poses")
        results.append(str(path))
    seconds = time.perf_counter() - began
    return f"drew {' and '.join(drawn)} in {seconds:.2f} s: " + " and ".join(results)


def _progress(console: Console) -> Progress:
    columns = ("{task.description}", BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    columns = [TextColumn(c) if isinstance(c, str) else c for c in columns]
    return Progress(*columns, console=console, transient=True, disable=not console.is_terminal)


def _summary(simulation: Simulation, integrator: str, seconds: float) -> Iterator[str]:
    """Say what was simulated, with which steps and why, and how fast."""
    system = simulation.system
    yield (
        f"{system.particle_count} particles and {system.connection_count} connections by {integrator} in "
        f"{simulation.model.precision} on {simulation.device}: {simulation.choice}"
    )
    rate = simulation.time / seconds
    yield f"simulated {simulation.time:.4g} s in {seconds:.2f} s, {rate:.2g} times real time"
