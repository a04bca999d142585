"""Run a scene: simulate it, store every frame, then draw the frames."""

import shlex
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from rich.console import Console
from rich.progress import Progress

from ...bodies import stress
from ...disk import TRAJECTORY
from ...files import Trajectory, TrajectoryWriter, write_restart
from ...integrators import DEFAULT, METHODS
from ...pictures import particles_of
from ...runtime import Compiling
from ...simulation import Readback, Simulation, SimulationDiverged, frame_count
from ...studies import EnergyLog, GrowingTable, cheapest, particle_energies, tune
from ...world import FRAME, SUBSTEP, Scene, probe_columns, probes_by, scene_as_stored
from ..options import Options
from ..process import progress_on, status_on, stop_requests, tell_compiling
from ..provenance import source_of
from ..results import PROBES, PROBES_BY_SUBSTEP, RESTART, check_names, overlay_path, own_folder, wanted_folder
from ..scene_files import Origin
from ..signals import Interrupted, at_once, word
from .draw import draw

_POSES, _MOST_POSES = 61, 1 << 14
"""Number of times at which obstacles' poses are stored in a scene's duration; maximal number in frames."""
MOST_CHANGES_SHOWN = 6
"""If the number of substeps changes more often than this, the changes are summarised."""


def run_scene(origin: Origin, scene: Scene, options: Options) -> "Case":
    """Simulate a scene, store and draw its frames, and print a summary; return the case, at its end.

    Raise ValueError or OSError for an option that is out of range, before anything is written. If
    SimulationDiverged or Interrupted ends the run early, earlier frames are kept.
    """
    talk = Console(stderr=True, quiet=options.quiet)
    duration = scene.duration if options.duration is None else options.duration
    options, last = replace(options, duration=duration), frame_count(duration, options.fps)
    options.check(last)
    check_drawable(scene, options)
    if options.tolerance is not None:
        options = _tuned(scene, options, talk)
    if options.pictures.any or options.trajectory != "none":
        check_names(origin.name, options.out or Path())
    with at_once():  # compiling kernels takes time
        simulation = simulation_by(scene, options)
    if simulation.start is not None:
        talk.print(str(simulation.start), highlight=False)
    wanted = options.pictures.any or options.trajectory != "none" or options.logs_in_folder or bool(scene.probes)
    # Errors about the log or folder are raised before anything is created.
    tentative = wanted_folder(origin.name, options.out, options.force) if wanted else None
    log = _log(options, tentative, origin.name)
    made_by = {}
    if options.trajectory != "none":
        with at_once():
            made_by = about(origin, scene, simulation, options)
    with ExitStack() as stack:
        folder = None
        if wanted:
            folder = stack.enter_context(own_folder(origin.name, options.out, options.force))
            if folder != tentative:  # another run has taken the tentative folder meanwhile
                log = _log(options, folder, origin.name)
        case = Case(scene, options, simulation, folder, origin.name, made_by, log, talk)
        case.to(last)
    return case


def check_drawable(scene: Scene, options: Options) -> None:
    """Raise ValueError if the scene lacks a body or a quantity that pictures are to show."""
    replace(scene, look=options.pictures.aimed(scene.look))
    particles_of(scene.system, options.pictures.body)
    if options.pictures.color in ("energy", "stress"):
        if not options.strain:
            raise ValueError(f"--color {options.pictures.color} needs the strains that --no-strain leaves out")
        {"energy": particle_energies, "stress": stress}[options.pictures.color](scene.system)


def _log(options: Options, folder: Path | None, name: str) -> EnergyLog | None:
    """Return the requested log; raise if its plot would replace another picture, or the folder is missing."""
    path = options.log_path(folder)
    if path is None:
        return None
    if folder is not None and path.with_suffix(".png") == overlay_path(folder, name):
        raise ValueError(f"log is {path}; its plot would have the name of the overlay")
    if folder is not None and path in (folder / PROBES, folder / PROBES_BY_SUBSTEP):
        raise ValueError(f"log is {path}; it would have the name of the probes' readings")
    if not options.logs_in_folder and not path.parent.exists():
        raise FileNotFoundError(
            f"log is {path}, whose folder does not exist; create it, or give a bare name, for the run's folder"
        )
    return EnergyLog(path, force=options.force or options.logs_in_folder)  # the run's folder is empty, or forced


def method_of(options: Options) -> dict[str, Any]:
    """Return the arguments of a simulation that the method's options set."""
    names = ("fps", "substeps", "allow_unstable", "device", "force_algorithm")
    method = {"integrator": METHODS[options.integrator or DEFAULT], "precision": options.precision or "float32"}
    return method | {name: getattr(options, name) for name in names}


def simulation_by(scene: Scene, options: Options) -> Simulation:
    """Return the simulation of a scene with these options."""
    more: Any = {"threads": options.threads, "contact_forces": options.sums_contact}
    scene = replace(scene, settled=True) if options.settle else scene
    tell_compiling(Console(stderr=True, quiet=options.quiet))
    return Simulation.from_scene(scene, **method_of(options), **more)


def about(origin: Origin, scene: Scene, simulation: Simulation, options: Options) -> dict[str, Any]:
    """Return the attributes of a run as JSON data: the scene, the simulation's method, and the options."""
    model = simulation.model
    return source_of(origin, scene) | {
        "integrator": options.integrator or DEFAULT,
        "precision": model.precision,
        "substeps": simulation.substeps,
        "force_algorithm": model.force_algorithm,
        "device": simulation.device,
        "device_name": model.device.name,
        "options": options.as_stored(),
    }


def _tuned(scene: Scene, options: Options, talk: Console) -> Options:
    """Return the options with the fastest method within the options' tolerance."""
    assert options.tolerance is not None
    if options.integrator or options.precision or options.substeps != "auto":
        raise ValueError("tolerance chooses integrator, precision and substeps; they cannot be given beside it")
    if options.fps != 60.0:
        raise ValueError(f"fps is {options.fps:g}; with a tolerance it must be 60")
    with status_on(talk, "tuning") as report:
        found, _ = tune(scene, options.tolerance, device=options.device, report=report)
    best: Any = cheapest(found, options.tolerance)
    talk.print(f"tuned: {best.method} keeps the error to {best.error:.1e} of the body's size", highlight=False)
    return replace(options, integrator=best.method, precision=best.precision, substeps=best.substeps)


@dataclass
class Case:
    """A simulation and the folder of its results, which it fills."""

    scene: Scene
    options: Options
    simulation: Simulation
    folder: Path | None
    """Folder of results; None if frames are neither stored nor drawn."""
    name: str
    """Name of the film and the pictures."""
    made_by: dict[str, Any]
    """Attributes of the trajectory."""
    log: EnergyLog | None
    talk: Console
    """Console that shows progress."""

    def __post_init__(self) -> None:
        self._keeps = self.options.trajectory != "none"
        self._writes = self._keeps or self.options.pictures.any
        of_springs = self.options.pictures.color in ("energy", "stress")
        self._strain = self.options.strain and (self._keeps or of_springs)
        self._held_back, self._held_back_at = 0.0, 0.0
        self._tables: dict[str, GrowingTable] = {}
        for every, name in ((FRAME, PROBES), (SUBSTEP, PROBES_BY_SUBSTEP)):
            if self.folder is not None and (probes := probes_by(every, self.scene.probes)):
                head = ["time_s", *probe_columns(probes, self.scene.system.dim)]
                path, until = self.folder / name, self.simulation.time
                self._tables[every] = GrowingTable(path, head, until=until, word="the file of probes")

    def to(self, last: int, *, behind: int = 0) -> None:
        """Simulate up to frame `last`, store the frames after the first `behind`, draw all, and print a summary.

        After an error earlier frames are kept; after SimulationDiverged they are also drawn.
        """
        trouble: SimulationDiverged | None = None
        with ExitStack() as stack:
            progress = stack.enter_context(progress_on(self.talk))
            # Frames that are only drawn are also stored temporarily, so that the camera can be fitted to all.
            kept_in = self.folder if self._keeps else None
            path = (kept_in or Path(stack.enter_context(TemporaryDirectory()))) / TRAJECTORY
            began, start = time.perf_counter(), self.simulation.time
            try:
                # From before files are opened until they are closed and the log is plotted, signals are noted:
                # an exception could break modules that are being imported.
                with stop_requests(self.talk) as requests:
                    with ExitStack() as files:
                        log = files.enter_context(self.log) if self.log is not None else None
                        writer = files.enter_context(self._writer(path, last, behind)) if self._writes else None
                        for table in self._tables.values():
                            files.enter_context(table)
                        self._simulate(last, behind, writer, log, progress, requests)
                    if requests:
                        raise self._interruption(requests[0], last)
            except SimulationDiverged as error:
                trouble = error  # raised after drawing
            lines = list(_summary(self.simulation, self.options, start, time.perf_counter() - began))
            if self._held_back:
                where = f"at about {self._held_back_at:.4g} s by {self._held_back:.2g} m in a substep"
                lines.append(f"contact held particles back, {where}: collisions were inexact there")
            if trouble is None and self.scene.observe:
                _, *now = self.simulation.frame()
                for name, values in self.scene.observed(*now).items():
                    lines.append(f"{name}: {np.array2string(values, precision=4, threshold=20, separator=', ')}")
            if self._keeps:
                lines.append(f"wrote {path} ({path.stat().st_size / 1e6:.1f} MB)")
            if self._tables:
                lines.append(f"wrote {' and '.join(str(table.path) for table in self._tables.values())}")
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
        scene, options = self.scene, self.options
        # Poses of moving obstacles are stored at the frames and over the scene's duration.
        frames = np.unique(np.linspace(0, last, min(last + 1, _MOST_POSES)).round()) / options.fps
        times = [*frames, *np.linspace(0, scene.duration, _POSES)]
        try:
            stored = None if behind else scene_as_stored(scene, times)
        except Exception:  # of a motion that is defined for this run only
            stored = scene_as_stored(scene, frames)
        return TrajectoryWriter(
            path,
            scene.system,
            fps=options.fps,
            frame_count=last + 1,
            compress=options.trajectory == "compressed",
            every=options.every,
            strain=self._strain,
            contact_forces=options.sums_contact,
            attributes=self.made_by,
            readings={name: (one.every, one.columns(scene.system.dim)) for name, one in scene.probes.items()},
            scene=stored,
            behind=behind,
        )

    def _simulate(
        self,
        last: int,
        behind: int,
        writer: TrajectoryWriter | None,
        log: EnergyLog | None,
        progress: Progress,
        requests: list[int],
    ) -> None:
        """Simulate up to frame `last` and write results; stop early after a signal."""
        simulation, kept = self.simulation, {"strain": self._strain, "contact_forces": self.options.sums_contact}
        readback = Readback(simulation, **kept)
        saved = time.monotonic()
        task = progress.add_task("simulating", total=last + 1 - behind)
        for k in progress.track(range(behind, last + 1), task_id=task):
            if k:
                try:
                    simulation.step()
                except (SimulationDiverged, KeyboardInterrupt) as end:
                    if simulation.frame_index < k:
                        self._save(writer)  # of the previous frame
                    if requests and isinstance(end, KeyboardInterrupt):  # in a frame that takes long
                        raise self._interruption(requests[0], last) from None
                    raise
                if simulation.held_back > self._held_back:
                    self._held_back, self._held_back_at = simulation.held_back, simulation.time
            readings = {every: simulation.readings.last(every) for every in (FRAME, SUBSTEP) if k}
            readings = {every: rows for every, rows in readings.items() if rows.size}
            if writer is not None:
                writer.write_pending(readback.take() if writer.wants_next() else None, readings)
            if log is not None:
                log.write(simulation.time, simulation.measure(), simulation.substeps)
            for every, table in self._tables.items():
                for numbers in readings.get(every, ()):
                    table.write_line(numbers)
            if requests:
                self._save(writer)
                raise self._interruption(requests[0], last)
            if k == behind or time.monotonic() - saved > self.options.restart:
                self._save(writer)
                saved = time.monotonic()
        self._save(writer)

    def _save(self, writer: TrajectoryWriter | None) -> None:
        """Write the restart file, once the frames up to the current one are on disk.

        While a continued run replaces frames, no restart file is written until the file has as many as before.
        """
        if writer is None or self.folder is None or not self._keeps or not self.options.restart:
            return
        writer.flush()
        if writer.has_fewer:
            return
        arrays, numbers = self.simulation.checkpoint()
        write_restart(self.folder / RESTART, arrays, {"checkpoint": numbers, "run": self.made_by})

    def _interruption(self, number: int, last: int) -> Interrupted:
        """Return the error for signal `number`, which arrived between two frames."""
        simulation = self.simulation
        where = f"{word(number)} at {simulation.time:.4g} s, after frame {simulation.frame_index} of {last}"
        return Interrupted(self._continued(where), number)

    def _continued(self, message: str) -> str:
        """Return a message; if the run can be continued, with the command for it."""
        if self._keeps and self.options.restart:
            return f"{message}: `msdwarp resume {shlex.quote(str(self.folder))}` goes on"
        return message


def _over_time(history: Sequence[tuple[float, int]]) -> str:
    """Return the numbers of substeps over time as text: all if there are few, otherwise a summary."""
    if len(history) <= MOST_CHANGES_SHOWN:
        return ", ".join(f"{count} from {time:.4g} s on" for time, count in history)
    counts = [count for _, count in history]
    return (
        f"{counts[0]} at the start, {counts[-1]} at the end, changed {len(counts) - 1} times, "
        f"between {min(counts)} and {max(counts)}"
    )


def _summary(simulation: Simulation, options: Options, start: float, seconds: float) -> Iterator[str]:
    """Yield lines of a summary: the system, the method, the substeps and the speed."""
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
    new = f"; compiled {Compiling.modules} kernels in {Compiling.seconds:.1f} s" if Compiling.modules else ""
    speed = f"{time_simulated / seconds:.2g} times real time"
    yield f"simulated {time_simulated:.4g} s in {seconds:.2f} s, {speed}{new}"
