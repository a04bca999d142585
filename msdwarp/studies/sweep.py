"""Sweeps: a scene at all points of a grid, each point a run of its own, on as many machines as there are."""

import inspect
import time
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from itertools import chain
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from .. import checks, disk
from ..files import TrajectoryWriter
from ..integrators import METHODS
from ..simulation import Readback, Simulation, frame_count
from ..world import Scene
from .grid import checked_grid, points
from .sweep_arguments import OPTIONS, as_stored, check_names, check_travels, found, source
from .sweep_ensembles import ENSEMBLE, Asked, as_worlds, in_words
from .sweep_points import (
    LOST,
    MISSING,
    RUNS,
    Point,
    Row,
    Simulate,
    carry_out,
    numbers_of,
    remove_unfinished,
    stored_row,
)
from .sweep_results import RESULTS, dataset, import_xarray, write_results
from .workers import gpus_for, workers_for

_TRIES = 3
"""How often a point is begun whose worker is lost."""
_PAUSE = 0.05
"""Seconds between two looks at what is under way."""

Report = Callable[[int, int], None]
"""Called with how many of the points that were to be simulated are, and how many there are."""
Say = Callable[[int, Mapping[int, str]], None]
"""Called with how many points were worlds of ensembles, and why the others, by number, were not."""


def sweep(
    scene: str | Callable[..., Scene],
    grid: Mapping[str, Any],
    folder: str | Path,
    *,
    parameters: Mapping[str, Any] | None = None,
    observe: Mapping[str, Callable[[Simulation], float]] | None = None,
    executor: Any = None,
    jobs: int | str = "auto",
    keep: str = "summary",
    report: Report | None = None,
    **options: Any,
) -> Any:
    """Simulate a scene at every point of a grid, and collect the results.

    Each point has a folder, named by a hash (digest) of all its parameters, that appears once it is done. So an
    interrupted sweep can be continued, and a larger grid simulates only the new points. If a point diverges or
    fails, its status says so, and the others continue.

    Parameters
    ----------
    scene
        The name of a scene that comes with msdwarp, or a function that returns a `Scene`, at the top level of a
        module that worker processes can import.
    grid
        Values by parameter name: parameters of the scene's function, or options of `Simulation`. Values are a
        sequence of numbers or texts, or a text such as "1,2,5", "0:100", "1:3:5" or "1e3:1e5:log:20".
    folder
        Folder of the runs and results. It may contain those of an earlier sweep.
    parameters
        Parameters of the scene that are the same at all points.
    observe
        Functions by name. Each is called with the `Simulation` at its end and returns a number.
    executor
        An object with a method `submit` like that of `concurrent.futures`, such as Dask's `Client` or a submitit
        executor. By default processes on this machine.
    jobs
        Number of processes; "auto" for one per GPU, or one per core without a GPU. With 1, points are simulated in
        this process. With "ensemble", points that differ only in parameters that worlds of an `Ensemble` may
        differ in are simulated together in this process, and the others as with "auto", with a warning. Automatic
        substeps are then those of the world that needs most, and stay fixed. With a single GPU "auto" also uses
        ensembles for points with a set number of substeps of which only summaries are kept.
    keep
        "summary" keeps the parameters and results of a point, "run" also its trajectory.
    report
        A function that is called with the number of finished points and the total.
    **options
        Options of `Simulation` that are the same at all points, and the `duration` [s].

    Returns
    -------
    xarray.Dataset
        Over the swept parameters: `status` ("done", "diverged", "failed", "lost" or "missing"), `message`, `run`
        (the name of its folder in runs/), the energies, momenta and the largest strain at the end, the last value
        of each probe, and the observed quantities. It is also written to results.nc and results.csv.

    Raises
    ------
    ValueError
        If an argument is invalid, or xarray is missing. No file has been changed then.
    OSError
        If the folder cannot be written to, or contains something else.
    """
    import_xarray()
    build, name = found(scene)
    values = checked_grid(grid)
    fixed = dict(checks.mapping("parameters", parameters or {}))
    watched = dict(checks.mapping("observe", observe or {}))
    check_names(build, values, fixed, options)
    checks.one_of("keep", keep, ("summary", "run"))
    known = inspect.signature(build).parameters
    defaults = {key: one.default for key, one in known.items() if one.default is not one.empty}
    sources = {key: source(function) for key, function in watched.items()}
    always = {"scene": name, "source": source(build), "observe": sources}
    planned = []
    for given in points(values):
        built_with = fixed | {key: value for key, value in given.items() if key not in OPTIONS or key in known}
        simulated = options | {key: value for key, value in given.items() if key not in built_with}
        own = {"parameters": as_stored(defaults | built_with), "options": as_stored(simulated)}
        planned.append(Point(given, always | own, Task(build, built_with, simulated, watched)))
    if executor is None and jobs != 1:
        check_travels({"scene": build} | {f"observe[{key!r}]": one for key, one in watched.items()})

    def say(done: int, refused: Mapping[int, str]) -> None:
        if refused and jobs == ENSEMBLE:
            warnings.warn(in_words(done, refused), stacklevel=4)

    return complete(
        values,
        planned,
        Path(folder),
        simulate_task,
        keep == "run",
        executor,
        jobs,
        options.get("device"),
        report,
        ask=asked_of,
        observe=watched,
        say=say,
    )


class Task(NamedTuple):
    """What a worker is given to simulate."""

    build: Callable[..., Scene]
    parameters: dict[str, Any]
    options: dict[str, Any]
    observe: dict[str, Callable[[Simulation], float]]


def asked_of(task: Task) -> Asked:
    """Return what is to be simulated for a task: the scene is built."""
    scene = task.build(**task.parameters)
    checks.instance("what scene returns", scene, Scene, "Scene(system=chain(5))")
    options = dict(task.options)
    duration, integrator = options.pop("duration", scene.duration), options.pop("integrator", None)
    if isinstance(integrator, str):
        checks.one_of("integrator", integrator, METHODS)
        integrator = METHODS[integrator]
    return Asked(scene, duration, options | {"integrator": integrator})


def simulate_task(task: Task, folder: Path, keeps_files: bool) -> dict[str, float]:
    """Simulate a scene to its end, and return the numbers that are kept of it."""
    scene, duration, options = asked_of(task)
    simulation = Simulation.from_scene(scene, **options)
    last = frame_count(duration, simulation.fps)
    with ExitStack() as stack:
        writer = readback = None
        if keeps_files:
            path, about = folder / "trajectory.vtkhdf", {"gravity": np.asarray(scene.gravity).tolist()}
            about = {} if callable(scene.gravity) else about
            writer = stack.enter_context(
                TrajectoryWriter(path, scene.system, fps=simulation.fps, frame_count=last + 1, attributes=about)
            )
            readback = Readback(simulation)
        for k in range(last + 1):
            if k:
                simulation.step()
            if writer is not None and readback is not None:
                writer.write_pending(readback.take(), {})
    return numbers_of(simulation, scene, task.observe)


def complete(
    grid: Mapping[str, Sequence[Any]],
    planned: Sequence[Point],
    folder: Path,
    simulate: Simulate,
    keeps_files: bool,
    executor: Any = None,
    jobs: int | str = "auto",
    device: str | None = None,
    report: Report | None = None,
    *,
    ask: Callable[[Any], Asked],
    observe: Mapping[str, Callable[[Simulation], float]] | None = None,
    say: Say | None = None,
) -> Any:
    """Simulate those of the points that are not there yet, write the results of all, and return them.

    Parameters
    ----------
    grid
        The values of what is swept; the last name changes fastest from point to point.
    planned
        All points.
    folder, keeps_files, executor, jobs, report
        See `sweep`.
    simulate
        What a worker does for a point's task.
    device
        The device that is asked for; by default processes share out the GPUs.
    ask
        Returns what is to be simulated for a point's task, where that may be a world of an ensemble.
    observe
        See `sweep`; of what is such a world.
    say
        Told of points that were, and of those that were not.

    Raises
    ------
    ValueError, OSError
        As by `sweep`.
    """
    if executor is not None and not hasattr(executor, "submit"):
        raise ValueError(
            f"executor is {checks.repr_short(executor)}; it must have `submit` as in concurrent.futures"
        )
    together = jobs == ENSEMBLE
    if together and (keeps_files or executor is not None):
        wrong = "keep is 'run'; it must be 'summary'" if keeps_files else "executor is given; it must not be"
        raise ValueError(f"{wrong} where jobs is 'ensemble': worlds are simulated side by side in this process")
    _check_folder(folder)
    runs = (folder / RUNS).absolute()
    with ExitStack() as stack:
        if executor is None and jobs != 1:
            new = sum(stored_row(runs / point.digest) is None for point in planned)
            executor = stack.enter_context(workers_for("auto" if together else jobs, device, new))
            together = together or (jobs == "auto" and not keeps_files and gpus_for(device) == 1)
        disk.writable_folder("folder", folder, runs)
        stack.enter_context(disk.alone_in(folder))
        remove_unfinished(runs)
        rows: list[Row] = [stored_row(runs / point.digest) or {} for point in planned]
        left = [k for k, row in enumerate(rows) if not row]
        for k in left:  # what a power cut has left of a run
            disk.remove_folder(runs / planned[k].digest)
        calls = {
            k: (simulate, planned[k].task, planned[k].parameters, planned[k].digest, runs, keeps_files)
            for k in left
        }
        worlds = iter(())
        if together:
            fixed_only = jobs != ENSEMBLE
            worlds = _in_ensembles(planned, calls, ask, dict(observe or {}), fixed_only, say)
        try:
            for count, (k, row) in enumerate(chain(worlds, _carried_out(calls, executor)), 1):
                rows[k] = row
                if report is not None:
                    report(count, len(left))
        finally:
            remove_unfinished(runs)
            rows = [row or {"status": MISSING, "message": "not simulated yet"} for row in rows]
            results = dataset(grid, planned, rows)
            write_results(results, folder)
    return results


def _in_ensembles(
    planned: Sequence[Point],
    calls: dict[int, tuple[Any, ...]],
    ask: Callable[[Any], Asked],
    observe: Mapping[str, Callable[[Simulation], float]],
    fixed_only: bool,
    say: Say | None,
) -> Iterator[tuple[int, Row]]:
    """Yield (number, row) of points that can be worlds of ensembles, and take these out of the calls."""
    refused: dict[int, str] = {}
    tasks, done = {k: planned[k].task for k in calls}, 0
    for world in as_worlds(tasks, ask, refused, looks_back=bool(observe), fixed_only=fixed_only):

        def simulate(of: Any, folder: Path, keeps_files: bool) -> dict[str, float]:
            return numbers_of(of.alone(), of.asked.scene, observe)

        _, _, *rest = calls.pop(world.number)
        yield world.number, carry_out(simulate, world, *rest, spent=world.seconds)
        done += 1
    if say is not None and (done or not fixed_only):
        say(done, refused)


def _carried_out(calls: Mapping[int, tuple[Any, ...]], executor: Any) -> Any:
    """Yield (number, row) of points as they are done."""
    if executor is None:
        for k, call in calls.items():
            yield k, carry_out(*call)
        return
    waiting: dict[Any, tuple[int, int]] = {}
    try:
        _submit(executor, [(k, call, 1) for k, call in calls.items()], waiting)
        while waiting:
            done, again = [future for future in waiting if future.done()], []
            for future in done:
                k, attempt = waiting.pop(future)
                try:
                    yield k, future.result()
                except Exception as error:  # whatever an executor raises when it has lost a worker
                    call = calls[k]
                    if (row := stored_row(call[4] / call[3])) is not None:
                        yield k, row
                    elif attempt < _TRIES:
                        again.append((k, call, attempt + 1))
                    else:
                        yield k, {"status": LOST, "message": f"its worker was lost {attempt} times: {error}"}
            _submit(executor, again, waiting)
            if not done:
                time.sleep(_PAUSE)
    finally:
        for future in waiting:
            if hasattr(future, "cancel"):
                future.cancel()


def _submit(
    executor: Any, calls: list[tuple[int, tuple[Any, ...], int]], waiting: dict[Any, tuple[int, int]]
) -> None:
    """Hand calls to an executor; to submitit's all at once, which Slurm takes as one array of jobs."""
    if calls and hasattr(executor, "map_array"):
        columns = zip(*[(*call, attempt) for _, call, attempt in calls], strict=True)
        futures = executor.map_array(carry_out, *columns)
    else:
        futures = [executor.submit(carry_out, *call, attempt) for _, call, attempt in calls]
    waiting |= {future: (k, attempt) for future, (k, _, attempt) in zip(futures, calls, strict=True)}


def _check_folder(folder: Path) -> None:
    """Raise OSError if a folder holds something that is no sweep."""
    if folder.exists() and not folder.is_dir():
        raise NotADirectoryError(f"folder is {folder}, which is a file; it must be a folder, new or of a sweep")
    there = [path for path in folder.iterdir() if not disk.is_unfinished(path)] if folder.exists() else []
    if there and not (folder / RUNS).is_dir() and not (folder / RESULTS).exists():
        raise FileExistsError(f"folder is {folder}, which holds something that is no sweep; name another")
