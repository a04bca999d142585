"""Running a scene: simulate it, keep every frame, then draw them."""

import shlex
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.progress import Progress

from ..files import Trajectory, TrajectoryWriter, write_restart
from ..integrators import DEFAULT, METHODS
from ..simulation import Readback, Simulation, SimulationDiverged, frame_count
from ..studies import EnergyLog, cheapest, tune
from ..world import Scene, Stored, scene_as_stored
from .draw import draw
from .options import Options
from .probe_tables import ProbeTables, described, told_last
from .process import progress_on, stop_asked_for, telling
from .provenance import about
from .results import RESTART, TRAJECTORY, check_names, overlay_path, own_folder, remove_results, wanted_folder
from .scene_files import Origin
from .signals import Interrupted, at_once, word

_POSES, _MOST_POSES = 61, 1 << 14
"""Times at which it is kept where moving obstacles are: over the scene's duration, and in frames at most."""
MOST_CHANGES_SAID = 6
"""More changes of the number of substeps are summed up."""


def run_scene(origin: Origin, scene: Scene, options: Options) -> Simulation:
    """Simulate a scene, keep its frames, draw them, and say what was done; return the simulation at its end.

    Raises
    ------
    ValueError, OSError
        If an option is out of range or `out` cannot be used: before anything is written.
    SimulationDiverged, Interrupted
        If the simulation ends early; what there is until then is kept.
    """
    talk = Console(stderr=True, quiet=options.quiet)
    options = replace(options, duration=scene.duration if options.duration is None else options.duration)
    last = last_frame(options)
    options.check(last)
    if options.tolerance is not None:
        options = _tuned(scene, options, talk)
    if options.pictures.any or options.trajectory != "none":
        check_names(origin.name, options.out or Path())
    with at_once():  # kernels are compiled, which takes its time
        simulation = simulation_by(scene, options)
    wanted = options.pictures.any or options.trajectory != "none" or options.logs_in_folder or bool(scene.probes)
    # What is wrong with the log or the folder is said before anything is made.
    tentative = wanted_folder(origin.name, options.out, options.force) if wanted else None
    log = _log(options, tentative, origin.name)
    made_by = {}
    if options.trajectory != "none":
        with at_once():
            made_by = about(origin, scene) | used(simulation, options)
    with ExitStack() as stack:
        folder = None
        if wanted:
            folder = stack.enter_context(own_folder(origin.name, options.out, options.force))
            if folder != tentative:  # which another run has taken meanwhile
                log = _log(options, folder, origin.name)
            if options.force:
                remove_results(folder, origin.name)
        Run(scene, options, simulation, folder, origin.name, made_by, log, talk).to(last)
    return simulation


def _log(options: Options, folder: Path | None, name: str) -> EnergyLog | None:
    """Return the log that is asked for, whose plot must not have the name of another picture of the run."""
    path = options.log_path(folder)
    if path is None:
        return None
    if folder is not None and path.with_suffix(".png") == overlay_path(folder, name):
        raise ValueError(f"log is {path}; its plot would have the name of the overlay")
    if not options.logs_in_folder and not path.parent.exists():
        raise FileNotFoundError(
            f"log is {path}, whose folder is not there; it must be, or log a bare name, which goes into the run's"
        )
    return EnergyLog(path, force=options.force or options.logs_in_folder)  # the run's folder is free, or forced


def last_frame(options: Options) -> int:
    """Return the number of the last frame, counted from 0."""
    assert options.duration is not None
    return frame_count(options.duration, options.fps)


def simulation_by(scene: Scene, options: Options) -> Simulation:
    """Return the simulation of a scene that options ask for."""
    return Simulation.from_scene(
        scene,
        integrator=METHODS[options.integrator or DEFAULT],
        fps=options.fps,
        substeps=options.substeps,
        allow_unstable=options.allow_unstable,
        device=options.device,
        precision=options.precision or "float32",
        force_algorithm=options.force_algorithm,
        threads=options.threads,
        contact_forces=options.sums_contact,
    )


def used(simulation: Simulation, options: Options) -> dict[str, Any]:
    """Return how it is simulated, and the options that said so or left it open, as JSON has it."""
    model = simulation.model
    return {
        "integrator": options.integrator or DEFAULT,
        "precision": model.precision,
        "substeps": simulation.substeps,
        "force_algorithm": model.force_algorithm,
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
    with telling(talk, "tuning") as tell:
        found, _ = tune(scene, options.tolerance, device=options.device, report=tell)
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
        self._writes = self._keeps or self.options.pictures.any
        self._tables = None
        if self.scene.probes and self.folder is not None:
            self._tables = ProbeTables(self.folder, self.scene.probes, self.simulation)
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
                # Signals are noted from before the files are opened until they are closed and the log is plotted:
                # what is imported for that may not stand an exception meanwhile.
                with stop_asked_for(self.talk) as asked:
                    with ExitStack() as files:
                        log = files.enter_context(self.log) if self.log is not None else None
                        writer = files.enter_context(self._writer(path, last, behind)) if self._writes else None
                        if self._tables is not None:
                            files.enter_context(self._tables)
                        self._simulate(last, behind, writer, log, progress, asked)
                    if asked:
                        raise Interrupted(self._farewell(asked[0], last), asked[0])
            except SimulationDiverged as error:
                trouble = error  # told once what there is has been drawn
            lines = list(_summary(self.simulation, self.options, start, time.perf_counter() - began))
            if trouble is None and self.scene.observe:
                _, *now = self.simulation.frame()
                lines += [f"{name}: {_said(told)}" for name, told in self.scene.observed(*now).items()]
            if self._keeps:
                lines.append(f"wrote {path} ({path.stat().st_size / 1e6:.1f} MB)")
            if self._tables is not None:
                lines.append(f"wrote {' and '.join(map(str, self._tables.paths))}")
            if self.log is not None:
                lines.append(f"wrote {self.log.path} and {self.log.plot_path.name}")
            if self.folder is not None and self.options.pictures.any:
                with Trajectory(path) as trajectory:
                    pictures = self.options.pictures
                    try:
                        what = self.scene, trajectory, self.folder, self.name, pictures, progress
                        lines.append(draw(*what, device=self.simulation.device))
                    except Interrupted as error:
                        raise Interrupted(self._continued(str(error)), error.number) from None
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
            contact_forces=self.options.sums_contact,
            attributes=self.made_by,
            readings=described(self.scene.probes, self.scene.system.dim),
            scene=None if behind else self._scene_as_stored(last),
            behind=behind,
        )

    def _scene_as_stored(self, last: int) -> Stored:
        """Return the scene by value, with moving obstacles where they are in the frames and over the whole run."""
        frames = np.unique(np.linspace(0, last, min(last + 1, _MOST_POSES)).round()) / self.options.fps
        return scene_as_stored(self.scene, [*frames, *np.linspace(0, self.scene.duration, _POSES)])

    def _simulate(
        self,
        last: int,
        behind: int,
        writer: TrajectoryWriter | None,
        log: EnergyLog | None,
        progress: Progress,
        asked: list[int],
    ) -> None:
        """Simulate frame by frame, until a signal asks to end."""
        simulation, kept = self.simulation, {"strain": self._strain, "contact_forces": self.options.sums_contact}
        readback = Readback(simulation, **kept)
        saved = time.monotonic()
        for k in progress.track(range(behind, last + 1), description="simulating"):
            if k:
                self._step(writer)
            if writer is not None:
                rows = told_last(simulation) if k else {}
                writer.write_pending(readback.take() if writer.wants_next() else None, rows)
            if log is not None:
                log.write(simulation.time, simulation.measure(), simulation.substeps)
            if self._tables is not None and k:
                self._tables.write()
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
        """Write the restart file, once the frames up to the present one are on the disk.

        Where a run that goes on differs from what was there, it waits until there are as many frames as before:
        should it fail, the run ends.
        """
        if writer is None or self.folder is None or not self._keeps or not self.options.restart:
            return
        writer.flush()
        if writer.has_fewer:
            return
        arrays, numbers = self.simulation.checkpoint()
        write_restart(self.folder / RESTART, arrays, {"checkpoint": numbers, "run": self.made_by})

    def _farewell(self, number: int, last: int) -> str:
        """Say where the run has ended, and how it goes on."""
        said = f"{word(number)} at {self.simulation.time:.4g} s"
        return self._continued(f"{said}, after frame {self.simulation.frame_index} of {last}")

    def _continued(self, said: str) -> str:
        """Say how a run that has ended goes on, if it can."""
        if self._keeps and self.options.restart:
            return f"{said}: `msdwarp resume {shlex.quote(str(self.folder))}` goes on"
        return said


def _said(told: NDArray) -> str:
    """Return a few numbers as text."""
    return np.array2string(told, precision=4, threshold=20, separator=", ")


def _over_time(chosen: Sequence[tuple[float, int]]) -> str:
    """Say when how many substeps a frame took: each time where these are few, else the first and the range."""
    if len(chosen) <= MOST_CHANGES_SAID:
        return ", ".join(f"{count} from {time:.4g} s on" for time, count in chosen)
    counts = [count for _, count in chosen]
    return (
        f"{counts[0]} at the start, {counts[-1]} at the end, changed {len(counts) - 1} times, "
        f"between {min(counts)} and {max(counts)}"
    )


def _summary(simulation: Simulation, options: Options, start: float, seconds: float) -> Iterator[str]:
    """Say what was simulated, with which steps and why, and how fast."""
    system = simulation.system
    yield (
        f"{system.particle_count} particles and {system.connection_count} connections by "
        f"{options.integrator or DEFAULT} in {simulation.model.precision} on {simulation.device} "
        f"(forces by {simulation.model.force_algorithm}): "
        f"{simulation.choice}"
    )
    if len(simulation.substep_history) > 1:
        yield f"substeps: {_over_time(simulation.substep_history)}"
    time_simulated = simulation.time - start
    yield f"simulated {time_simulated:.4g} s in {seconds:.2f} s, {time_simulated / seconds:.2g} times real time"
