"""Running a scene: simulate it, keep every frame, then draw them; and going on with a run that was ended."""

import importlib.util
import os
import shlex
import signal
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from . import checks
from .accuracy import DEFAULT, METHODS, cheapest, simulation_of, tune
from .draw import draw
from .energy_log import EnergyLog
from .options import Options
from .origin import Origin, about, built_again, digest
from .readback import Readback
from .restart import read_restart, write_restart
from .results import RESTART, TRAJECTORY, pictures_in, remove_results, result_folder
from .scene import Scene
from .simulation import Simulation, frame_count
from .trajectory import Trajectory
from .watch import SimulationDiverged
from .writer import TrajectoryWriter


class Interrupted(RuntimeError):
    """A signal asked the run to end, and it has ended between two frames."""

    def __init__(self, message: str, number: int) -> None:
        super().__init__(message)
        self.code = 128 + number
        """What the process should exit with."""


def run_scene(origin: Origin, scene: Scene, options: Options) -> None:
    """Simulate a scene, keep its frames, draw them, and say what was done.

    Raises
    ------
    ValueError, OSError
        If an option is out of its range or `out` cannot be used: before anything is written.
    SimulationDiverged, Interrupted
        If the simulation ends early; what there is until then is kept.
    """
    talk = Console(stderr=True, quiet=options.quiet)
    options = replace(options, duration=scene.duration if options.duration is None else options.duration)
    last = last_frame(options)
    options.check(last)
    if options.tolerance is not None:
        options = _tuned(scene, options, talk)
    simulation = simulation_by(scene, options)
    log = None if options.log is None else EnergyLog(options.log, force=options.force)
    wanted = options.pictures.any or options.trajectory != "none"
    folder = result_folder(origin.name, options.out, options.force) if wanted else None
    made_by = about(origin, scene) | used(simulation, options) if options.trajectory != "none" else {}
    with alone_in(folder):
        if folder is not None and options.force:
            remove_results(folder, origin.name)
        Run(scene, options, simulation, folder, origin.name, made_by, log, talk).to(last)


def resume_run(
    folder: Path,
    *,
    duration: float | None = None,
    device: str | None = None,
    force: bool = False,
    quiet: bool = False,
) -> None:
    """Go on with a run from its restart file, to its end or another duration [s], and draw it as it asked for.

    It ends with what it would have ended with if nothing had happened, to the last bit where its route sums in a
    fixed order and the device is the one where it was.

    Raises
    ------
    ValueError
        If the restart file or the trajectory is none, or the scene is no longer what it was.
    FileExistsError
        If pictures are there that would be replaced, and `force` is False.
    SimulationDiverged, Interrupted, OSError
        As by `run_scene`.
    """
    if not (folder / RESTART).exists():
        raise FileNotFoundError(f"{folder} has no {RESTART}: its run wrote none, or ended before its first frame")
    with alone_in(folder):
        arrays, attributes = read_restart(folder / RESTART)
        made_by = checks.member(f"{folder / RESTART}", attributes, "run")
        origin, scene = built_again(made_by)
        if digest(scene) != made_by["digest"]:
            raise ValueError(f"scene {origin.place!r} is no longer what it was when the run began")
        if duration is not None:
            made_by["options"]["duration"] = duration
        device = device or made_by["device"]
        options = Options.stored(made_by["options"], device=device, quiet=quiet, force=force)
        last, behind = last_frame(options), int(attributes["checkpoint"]["frame_index"]) + 1
        simulation = simulation_by(scene, options)
        simulation.restore(arrays, attributes["checkpoint"])
        _check_kept(folder / TRAJECTORY, simulation, made_by, options.every)
        pictures = pictures_in(folder, origin.name) if options.pictures.any else []
        if behind > last and options.pictures.are_in(folder, origin.name, (behind - 1) // options.every + 1):
            if not quiet:
                print(f"all {behind} frames are there, {simulation.time:.4g} s: a longer --duration goes on")
            return
        if behind <= last and pictures and not force:
            raise FileExistsError(f"{pictures[0]} exists, and would be replaced; move it or add --force")
        log = None if options.log is None or behind > last else EnergyLog(options.log, behind=behind)
        talk = Console(stderr=True, quiet=quiet)
        Run(scene, options, simulation, folder, origin.name, made_by, log, talk).to(last, behind=behind)


def _check_kept(path: Path, simulation: Simulation, made_by: dict[str, Any], every: int) -> None:
    """Raise ValueError unless a trajectory is of the run that a simulation was restored from."""
    with Trajectory(path) as kept:
        same = all(kept.attributes.get(name) == made_by[name] for name in ("scene", "parameters", "digest"))
        k, between = divmod(simulation.frame_index, every)
        if same and not between and k < len(kept):
            pairs = zip(kept.frame(k)[1:], simulation.frame()[1:], strict=True)
            same = all(np.array_equal(one, other) for one, other in pairs)
        if not same:
            raise ValueError(f"{path} is of another run than {path.with_name(RESTART)}")


def last_frame(options: Options) -> int:
    """Return the number of the last frame, counted from 0."""
    assert options.duration is not None
    return frame_count(options.duration, options.fps)


def simulation_by(scene: Scene, options: Options) -> Simulation:
    """Return the simulation of a scene that options ask for."""
    return simulation_of(
        scene,
        integrator=METHODS[options.integrator or DEFAULT],
        fps=options.fps,
        substeps=options.substeps,
        allow_unstable=options.allow_unstable,
        device=options.device,
        precision=options.precision or "float32",
        route=options.route,
    )


def used(simulation: Simulation, options: Options) -> dict[str, Any]:
    """Return how it is simulated, and the options that said so or left it open, as JSON has it."""
    model = simulation.model
    return {
        "integrator": options.integrator or DEFAULT,
        "precision": model.precision,
        "substeps": simulation.substeps,
        "route": model.route,
        "device": simulation.device,
        "device_name": model.device.name,
        "options": options.as_stored(),
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


@dataclass
class Run:
    """A simulation, and where its frames go."""

    scene: Scene
    options: Options
    simulation: Simulation
    folder: Path | None
    """Where results go; None where frames are neither kept nor drawn."""
    name: str
    """What the film is called."""
    made_by: dict[str, Any]
    """What made the run."""
    log: EnergyLog | None
    talk: Console
    """Where it is shown how far it is."""

    def __post_init__(self) -> None:
        """See what is to be kept."""
        self._keeps = self.options.trajectory != "none"
        self._strain = self.options.strain and (self._keeps or self.options.pictures.colour == "energy")

    def to(self, last: int, *, behind: int = 0) -> None:
        """Simulate up to frame `last`, keep the frames behind the first `behind`, draw all, and say so.

        Raises
        ------
        SimulationDiverged, Interrupted, OSError
            If it ends early; what was kept until then is whole, and unless it was interrupted it is drawn.
        """
        trouble: SimulationDiverged | None = None
        with ExitStack() as stack:
            progress = stack.enter_context(progress_on(self.talk))
            # Frames that are only drawn wait on disk too until all are known, so that one camera can see them all.
            kept_in = self.folder if self._keeps else None
            path = (kept_in or Path(stack.enter_context(TemporaryDirectory()))) / TRAJECTORY
            began, start = time.perf_counter(), self.simulation.time
            try:
                with ExitStack() as files:
                    log = files.enter_context(self.log) if self.log is not None else None
                    writer = files.enter_context(self._writer(path, last, behind)) if self.folder else None
                    self._simulate(last, behind, writer, log, progress)
            except SimulationDiverged as error:
                trouble = error  # told once what there is has been drawn
            lines = list(_summary(self.simulation, self.options, start, time.perf_counter() - began))
            if self._keeps:
                lines.append(f"wrote {path} ({path.stat().st_size / 1e6:.1f} MB)")
            if self.folder is not None and self.options.pictures.any:
                with Trajectory(path) as trajectory:
                    pictures = self.options.pictures
                    lines.append(draw(self.scene, trajectory, self.folder, self.name, pictures, progress))
        if not self.options.quiet:
            print(*lines, sep="\n")
        if trouble is not None:
            raise trouble

    def _writer(self, path: Path, last: int, behind: int) -> TrajectoryWriter:
        return TrajectoryWriter(
            path,
            self.scene.system,
            fps=self.options.fps,
            frame_count=last + 1,
            compress=self.options.trajectory == "compressed",
            every=self.options.every,
            strain=self._strain,
            attributes=self.made_by,
            behind=behind,
        )

    def _simulate(
        self, last: int, behind: int, writer: TrajectoryWriter | None, log: EnergyLog | None, progress: Progress
    ) -> None:
        """Simulate frame by frame."""
        simulation, readback = self.simulation, Readback(self.simulation, strain=self._strain)
        saved = time.monotonic()
        with _stop_asked_for(self.talk) as asked:
            for k in progress.track(range(behind, last + 1), description="simulating"):
                if k:
                    self._step(writer)
                if writer is not None:
                    writer.write_pending(readback.take() if writer.wants_next() else None)
                if log is not None:
                    log.write(simulation.time, simulation.measure())
                if asked:
                    self._save(writer)
                    raise Interrupted(self._farewell(asked[0], last), asked[0])
                if k == behind or time.monotonic() - saved > self.options.restart:
                    self._save(writer)
                    saved = time.monotonic()
            self._save(writer)

    def _step(self, writer: TrajectoryWriter | None) -> None:
        """Advance by a frame; if that fails, the simulation is at the frame before."""
        try:
            self.simulation.step()
        except SimulationDiverged:
            self._save(writer)
            raise

    def _save(self, writer: TrajectoryWriter | None) -> None:
        """Write the restart file, once the frames up to the present one are on the disk."""
        if writer is None or self.folder is None or not self._keeps or not self.options.restart:
            return
        writer.flush()
        arrays, numbers = self.simulation.checkpoint()
        write_restart(self.folder / RESTART, arrays, {"checkpoint": numbers, "run": self.made_by})

    def _farewell(self, number: int, last: int) -> str:
        """Say where the run has ended, and how it goes on."""
        word = "interrupted" if number == signal.SIGINT else "terminated"
        said = f"{word} at {self.simulation.time:.4g} s, after frame {self.simulation.frame_index} of {last}"
        return (
            f"{said}: `msdwarp resume {shlex.quote(str(self.folder))}` goes on"
            if self._keeps and self.options.restart
            else said
        )


def heard(*names: str) -> list[int]:
    """Return those of some signals that this system has and that are not ignored, as nohup ignores SIGHUP."""
    numbers = [getattr(signal, name) for name in names if hasattr(signal, name)]
    return [number for number in numbers if signal.getsignal(number) != signal.SIG_IGN]


@contextmanager
def _stop_asked_for(talk: Console) -> Iterator[list[int]]:
    """Give a list in which Ctrl-C, SIGTERM and SIGHUP leave their number; a second one acts as it always does."""
    asked: list[int] = []
    if threading.current_thread() is not threading.main_thread():
        yield asked  # only there signals are heard
        return
    before = {number: signal.getsignal(number) for number in heard("SIGINT", "SIGTERM", "SIGHUP")}

    def ask(number: int, _: Any) -> None:
        asked.append(number)
        for each, handler in before.items():
            signal.signal(each, handler)
        if talk.is_terminal:
            talk.print("ending after this frame; once more ends at once")

    for number in before:
        signal.signal(number, ask)
    try:
        yield asked
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextmanager
def alone_in(folder: Path | None) -> Iterator[None]:
    """Keep other runs from writing in a folder meanwhile; raise ValueError if one does already.

    The lock is on the folder, and goes with the process, however that ends. Where there are none it does nothing.
    """
    if folder is None or importlib.util.find_spec("fcntl") is None:
        yield
        return
    import fcntl

    number = os.open(folder, os.O_RDONLY)
    try:
        try:
            fcntl.flock(number, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise ValueError(f"another run is writing in {folder}; wait for it, or name another folder") from error
        except OSError:
            pass
        yield
    finally:
        os.close(number)


def progress_on(console: Console) -> Progress:
    """Return bars that show how far something is, on a terminal."""
    columns = ("{task.description}", BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    columns = [TextColumn(c) if isinstance(c, str) else c for c in columns]
    return Progress(*columns, console=console, transient=True, disable=not console.is_terminal)


def _summary(simulation: Simulation, options: Options, start: float, seconds: float) -> Iterator[str]:
    """Say what was simulated, with which steps and why, and how fast."""
    system = simulation.system
    yield (
        f"{system.particle_count} particles and {system.connection_count} connections by "
        f"{options.integrator or DEFAULT} in {simulation.model.precision} on {simulation.device}: "
        f"{simulation.choice}"
    )
    time_simulated = simulation.time - start
    yield f"simulated {time_simulated:.4g} s in {seconds:.2f} s, {time_simulated / seconds:.2g} times real time"
