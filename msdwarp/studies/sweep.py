"""Sweeps: a scene at all points of a grid, each point a separate run, on one or more machines."""

import inspect
import shutil
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from itertools import chain
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from .. import checks, disk
from ..files import TrajectoryWriter
from ..integrators import METHODS
from ..simulation import Readback, Simulation, frame_count
from ..world import Scene
from .grid import OPTIONS, as_json, check_names, check_travels, checked_grid, find_build, points, source
from .sweep_ensembles import ENSEMBLE, ensemble_summary, run_in_ensembles
from .sweep_points import (
    LOST,
    MISSING,
    RESULTS,
    RUNS,
    WORDS,
    Point,
    Row,
    Setup,
    final_numbers,
    import_xarray,
    remove_unfinished,
    run_point,
    stored_row,
    write_results,
)
from .units import unit_in, units_of
from .workers import gpus_for, workers_for

_TRIES = 3
"""Maximal number of attempts at a point whose worker is lost."""
_PAUSE = 0.05
"""Time between two checks of the futures [s]."""

Report = Callable[[int, int], None]
"""Called with (number of points simulated so far, number of all points to simulate)."""


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

    Each point has a folder, named by a hash (digest) of all its parameters, that appears once the point is done.
    So an interrupted sweep can be continued, and a larger grid simulates only new points. A point that diverges
    or fails has a status that says so; the other points continue.

    Parameters
    ----------
    scene
        The name of a scene that comes with msdwarp, or a function that returns a `Scene`, at the top level of a
        module that worker processes can import.
    grid
        Values by parameter name: parameters of the scene's function, or options of `Simulation`. Values are a
        sequence of numbers or texts, or a text such as "1,2,5", "0:100", "1:3:5" or "1e3:1e5:log:20".
    folder
        Folder of runs and results. It may contain an earlier sweep.
    parameters, **options
        Values common to all points: parameters of the scene, options of `Simulation` and the `duration` [s].
    observe
        Functions by name. Each is called with the `Simulation` at the end of the run, and returns a number. A unit
        in brackets in its docstring is that of the result.
    executor
        An object with a method `submit` like that of `concurrent.futures`, such as Dask's `Client` or a submitit
        executor. By default processes on this machine.
    jobs
        Number of processes; "auto" for one per GPU, or one per core without a GPU. With 1, points run in this
        process. With "ensemble", points that differ only in parameters in which worlds of an `Ensemble` may differ
        run together in this process; others as with "auto", with a warning. Automatic substeps are then those of
        the world that needs most, and stay fixed. With a single GPU "auto" also uses ensembles for points with a
        set number of substeps if only summaries are kept.
    keep
        "summary" keeps the parameters and results of a point, "run" also its trajectory.
    report
        A function that is called with the number of finished points and the total.

    Returns
    -------
    xarray.Dataset
        Over the swept parameters: `status` ("done", "diverged", "failed", "lost" or "missing"), `message`, `run`
        (the name of the point's folder in runs/), the energies, momenta and largest strain at the end, the last
        value of each probe, and the observed quantities. Parameters have the attribute `units` if the docstring of
        the scene's function gives a unit in brackets. Also written to results.nc and results.csv.

    Raises
    ------
    ValueError
        If an argument is invalid, or xarray is missing. No file has been changed then.
    OSError
        If the folder cannot be written to, or contains anything but a sweep.
    """
    build, name = find_build(scene)
    values = checked_grid(grid)
    fixed = dict(checks.mapping("parameters", parameters or {}))
    watched = dict(checks.mapping("observe", observe or {}))
    for key, function in watched.items():
        if key in (*WORDS, "seconds", *values):
            raise ValueError(f"a name in observe is {key!r}; the results have a column of that name anyway")
        if not callable(function):
            raise ValueError(
                f"observe[{key!r}] is {checks.repr_short(function)}; it must be a function of the simulation"
            )
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
        own = {"parameters": defaults | built_with, "options": simulated}
        stored = {kind: {key: as_json(value) for key, value in each.items()} for kind, each in own.items()}
        planned.append(Point(always | stored, FunctionTask(build, built_with, simulated, watched)))
    if executor is None and jobs != 1:
        check_travels({"scene": build} | {f"observe[{key!r}]": one for key, one in watched.items()})
    results, worlds, refused = complete(
        values,
        planned,
        Path(folder),
        keep == "run",
        executor=executor,
        jobs=jobs,
        device=options.get("device"),
        report=report,
        units=units_of(build, values)
        | {key: unit for key, one in watched.items() if (unit := unit_in(one.__doc__))},
    )
    if refused and jobs == ENSEMBLE:
        checks.warn(ensemble_summary(worlds, refused))
    return results


class FunctionTask(NamedTuple):
    """A task with the function that builds the scene, and arguments of a simulation."""

    build: Callable[..., Scene]
    parameters: dict[str, Any]
    options: dict[str, Any]
    observe: dict[str, Callable[[Simulation], float]]

    def setup(self) -> Setup:
        """Build the scene, and return the setup with its duration and options."""
        scene = self.build(**self.parameters)
        checks.instance("what scene returns", scene, Scene, "Scene(system=chain(5))")
        options = dict(self.options)
        duration, integrator = options.pop("duration", scene.duration), options.pop("integrator", None)
        if isinstance(integrator, str):
            checks.one_of("integrator", integrator, METHODS)
            integrator = METHODS[integrator]
        return Setup(scene, duration, options | {"integrator": integrator}, self.observe)

    def simulate(self, folder: Path, keeps_files: bool) -> dict[str, float]:
        """Simulate the scene to the end and return the final numbers; write a trajectory if `keeps_files`."""
        scene, duration, options, observe = self.setup()
        simulation = Simulation.from_scene(scene, **options)
        frames = frame_count(duration, simulation.fps)
        if not keeps_files:
            simulation.step(frames)
            return final_numbers(simulation, scene, observe)
        about = {} if callable(scene.gravity) else {"gravity": np.asarray(scene.gravity).tolist()}
        how: dict[str, Any] = {"fps": simulation.fps, "frame_count": frames + 1, "attributes": about}
        with TrajectoryWriter(folder / disk.TRAJECTORY, scene.system, **how) as writer:
            readback = Readback(simulation)
            for k in range(frames + 1):
                if k:
                    simulation.step()
                writer.write_pending(readback.take())
        return final_numbers(simulation, scene, observe)


def complete(
    grid: Mapping[str, Sequence[Any]],
    planned: Sequence[Point],
    folder: Path,
    keeps_files: bool,
    *,
    executor: Any = None,
    jobs: int | str = "auto",
    device: str | None = None,
    report: Report | None = None,
    units: Mapping[str, str] = MappingProxyType({}),
) -> tuple[Any, int, dict[int, str]]:
    """Simulate the planned points that are not in the folder yet, and write the results of all planned points.

    Return (results, number of points that ran in ensembles, why other points did not, by index). Without a
    `device` the processes share the GPUs; `units` are for `write_results`. Other arguments and errors are as for
    `sweep`.
    """
    if executor is not None and not hasattr(executor, "submit"):
        raise ValueError(
            f"executor is {checks.repr_short(executor)}; it must have `submit` as in concurrent.futures"
        )
    import_xarray()
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
            together = together or (jobs == "auto" and not keeps_files and len(gpus_for(device)) == 1)
        disk.writable_folder("folder", folder, runs)
        stack.enter_context(disk.alone_in(folder))
        remove_unfinished(runs)
        rows: list[Row] = [stored_row(runs / point.digest) or {} for point in planned]
        left = {k: planned[k] for k, row in enumerate(rows) if not row}
        for point in left.values():  # a power cut may have left a partial run
            shutil.rmtree(runs / point.digest, ignore_errors=True)
        count, refused = len(left), dict[int, str]()
        tasks = {k: point.task for k, point in left.items()}
        worlds = run_in_ensembles(tasks, refused, fixed_only=jobs != ENSEMBLE) if together else ()
        of_worlds = ((k, run_point(ends, left.pop(k), runs, False, spent=seconds)) for k, ends, seconds in worlds)
        try:
            for done, (k, row) in enumerate(chain(of_worlds, _alone(left, runs, keeps_files, executor)), 1):
                rows[k] = row
                if report is not None:
                    report(done, count)
        finally:
            remove_unfinished(runs)
            absent: Row = {"status": MISSING, "message": "not simulated yet"}
            # A worker may have finished a point after this process considered the worker lost.
            rows = [
                row or stored_row(runs / point.digest) or absent for row, point in zip(rows, planned, strict=True)
            ]
            results = write_results(grid, planned, rows, folder, units)
    return results, count - len(left), refused


def _alone(left: Mapping[int, Point], runs: Path, keeps_files: bool, executor: Any) -> Iterator[tuple[int, Row]]:
    """Yield (index, row) of points that run separately, each when its run has finished."""
    if executor is None:
        for k, point in left.items():
            yield k, run_point(point.task.simulate, point, runs, keeps_files)
        return

    def submit(tries: list[tuple[int, int]]) -> dict[Any, tuple[int, int]]:
        """Return (index, attempt) by future; submitit gets all runs at once, as one Slurm job array."""
        calls = [(left[k].task.simulate, left[k], runs, keeps_files, attempt) for k, attempt in tries]
        if calls and hasattr(executor, "map_array"):
            futures = executor.map_array(run_point, *zip(*calls, strict=True))
        else:
            futures = [executor.submit(run_point, *call) for call in calls]
        return dict(zip(futures, tries, strict=True))

    waiting: dict[Any, tuple[int, int]] = {}
    try:
        waiting |= submit([(k, 1) for k in left])
        while waiting:
            done, again = [future for future in waiting if future.done()], []
            for future in done:
                k, attempt = waiting.pop(future)
                try:
                    yield k, future.result()
                except Exception as error:  # executors raise different errors if a worker is lost
                    if (row := stored_row(runs / left[k].digest)) is not None:
                        yield k, row
                    elif attempt < _TRIES:
                        again.append((k, attempt + 1))
                    else:
                        yield k, {"status": LOST, "message": f"its worker was lost {attempt} times: {error}"}
            waiting |= submit(again)
            if not done:
                time.sleep(_PAUSE)
    finally:
        for future in waiting:
            if hasattr(future, "cancel"):
                future.cancel()


def _check_folder(folder: Path) -> None:
    """Raise OSError if a folder contains anything other than a sweep."""
    if folder.exists() and not folder.is_dir():
        raise NotADirectoryError(f"folder is {folder}, which is a file; it must be a folder, new or of a sweep")
    there = [path for path in folder.iterdir() if not disk.is_unfinished(path)] if folder.exists() else []
    if there and not (folder / RUNS).is_dir() and not (folder / RESULTS).exists():
        raise FileExistsError(f"folder is {folder}, which holds something that is no sweep; name another")
