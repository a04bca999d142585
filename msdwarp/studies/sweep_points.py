"""Points of a sweep: a folder for each, tasks of workers, and the results of all points."""

import hashlib
import json
import os
import secrets
import shutil
import time
import warnings
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple, Protocol

import numpy as np

from .. import checks, disk
from ..simulation import Simulation, SimulationDiverged
from ..world import Scene
from .table import COLUMNS

RUNS, PARAMETERS, SUMMARY = "runs", "parameters.json", "summary.json"
DONE, DIVERGED, FAILED, LOST, MISSING = "done", "diverged", "failed", "lost", "missing"
"""Status of a point. The first two are final; points with another status are tried again by the next call."""
_UNFINISHED = ".unfinished-"

Row = dict[str, Any]
"""Results of a point: its status, a message, and numbers by name."""
Simulate = Callable[[Path, bool], dict[str, float]]
"""Simulate in a folder, and keep the files there if the flag is set; return the final numbers."""
Observe = Mapping[str, Callable[[Simulation], float]]
"""Functions by name, each called with the simulation at the end of its run."""


class Setup(NamedTuple):
    """The simulation of a point: its scene, duration and options."""

    scene: Scene
    duration: float
    """Simulated time [s]."""
    options: dict[str, Any]
    """Arguments of both `Ensemble` and `Simulation`."""
    observe: Observe = MappingProxyType({})
    """Functions, by name, whose results are kept."""


class Task(Protocol):
    """The task of a worker process at a point; it can be pickled."""

    def setup(self) -> Setup:
        """Return the setup; raise ValueError if the point cannot be a world of an ensemble."""
        ...

    def simulate(self, folder: Path, keeps_files: bool) -> dict[str, float]:
        """Simulate the point, and return the final numbers."""
        ...


class Point(NamedTuple):
    """A point of a sweep."""

    parameters: dict[str, Any]
    """All parameters and options, as JSON data."""
    task: Task

    @property
    def digest(self) -> str:
        """The name of the point's folder, a digest: equal parameters have the same name."""
        return hashlib.sha256(json.dumps(self.parameters, sort_keys=True).encode()).hexdigest()[:16]


def stored_row(folder: Path) -> Row | None:
    """Return the row stored in a point's folder; None if no row can be read."""
    try:
        row = json.loads((folder / SUMMARY).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    return row if isinstance(row, dict) and row.get("status") in (DONE, DIVERGED) else None


def remove_unfinished(runs: Path) -> None:
    """Remove folders of workers that were lost, or that still run but are no longer waited for."""
    for folder in list(runs.glob(f"{_UNFINISHED}*")):
        taken = runs / f"{_UNFINISHED}{secrets.token_hex(8)}"
        with suppress(OSError):  # the worker has just renamed the folder
            folder.rename(taken)  # now the worker cannot rename it while it is emptied
        shutil.rmtree(taken, ignore_errors=True)


def run_point(
    simulate: Simulate, point: Point, runs: Path, keeps_files: bool, attempt: int = 1, spent: float = 0.0
) -> Row:
    """Simulate a point and return its row; its folder appears complete or not at all. Called by workers.

    Errors are in the row; an exception means that the worker is lost. Dask does not repeat equal calls, so
    `attempt` makes them different. `spent` is the time already spent on the point [s].
    """
    folder = runs / point.digest
    if (row := stored_row(folder)) is not None:  # written by a worker that seemed lost
        return row
    made = runs / f"{_UNFINISHED}{point.digest}-{secrets.token_hex(4)}"
    began = time.perf_counter() - spent
    try:
        made.mkdir(parents=True)
        row = _row(simulate, made, keeps_files) | {"seconds": time.perf_counter() - began}
        if row["status"] == FAILED:
            return row
        if not keeps_files:
            for path in made.iterdir():
                path.unlink()
        for name, content in ((PARAMETERS, point.parameters), (SUMMARY, row)):
            with disk.replacing(made / name, durable=True) as unfinished:
                unfinished.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
        try:
            os.rename(made, folder)
        except OSError:
            if stored_row(folder) is None:  # otherwise another worker was first, with an equal row
                raise
        return row
    except OSError as error:
        return {"status": FAILED, "message": str(error)}
    finally:
        shutil.rmtree(made, ignore_errors=True)


def _row(simulate: Simulate, folder: Path, keeps_files: bool) -> Row:
    with warnings.catch_warnings(record=True) as heard:
        warnings.simplefilter("default")
        try:
            row: Row = {"status": DONE, "message": "", **simulate(folder, keeps_files)}
        except SimulationDiverged as error:
            row = {"status": DIVERGED, "message": str(error), "time_s": error.time}
        except (Exception, SystemExit) as error:  # scenes may raise any error
            row = {"status": FAILED, "message": checks.message(error)}
    if heard and row["status"] == DONE:
        row["message"] = "; ".join(dict.fromkeys(str(one.message) for one in heard))
    return row


def final_numbers(
    simulation: Simulation, scene: Scene, observe: Observe = MappingProxyType({})
) -> dict[str, float]:
    """Return energies, strain, last values of probes and observed quantities, by the names in their tables."""
    measures = simulation.measure()
    numbers = {"time_s": simulation.time, "substeps": simulation.substeps}
    numbers |= {name: of(measures) for name, of in COLUMNS.items()}
    for name, probe in scene.probes.items():
        values = simulation.readings[name].values
        if len(values):
            columns = (f"{name}_{column}" for column in probe.columns(simulation.system.dim))
            numbers |= dict(zip(columns, values[-1], strict=True))
    _, *now = simulation.frame()
    for name, values in scene.observed(*now).items():
        each = {f"{name}_{k}": value for k, value in enumerate(values.ravel())}
        numbers |= each if values.ndim else {name: values}
    for name, function in observe.items():
        given = checks.array(f"what observe[{name!r}] returns", function(simulation))
        if given.size != 1:
            raise ValueError(f"observe[{name!r}] returned {given.size} numbers; it must return one")
        numbers[name] = given.reshape(())
    return {name: float(value) for name, value in numbers.items()}


RESULTS, TABLE = "results.nc", "results.csv"
WORDS = ("status", "message", "run")
"""Results that are texts."""


def import_xarray() -> Any:
    """Return xarray; if it or h5netcdf is not installed, raise ValueError with instructions."""
    missing = "results of a sweep need xarray and h5netcdf: pip install 'msdwarp[sweep]'"
    checks.imported("h5netcdf", missing)
    return checks.imported("xarray", missing)


def write_results(
    grid: Mapping[str, Sequence[Any]],
    planned: Sequence[Point],
    rows: Sequence[Row],
    folder: Path,
    units: Mapping[str, str] = MappingProxyType({}),
) -> Any:
    """Write the rows of all points as NetCDF and as a table; return them as an `xarray.Dataset` over the grid.

    `units` are those of parameters and of observed quantities, by name. A number missing in a row becomes NaN.
    Each file is written under a temporary name, then renamed.
    """
    xarray = import_xarray()
    numbers = dict.fromkeys(name for row in rows for name in row if name not in (*WORDS, *grid))
    columns: dict[str, Any] = {
        "status": np.array([row["status"] for row in rows], dtype=object),
        "message": np.array([row["message"] for row in rows], dtype=object),
        "run": np.array([point.digest for point in planned], dtype=object),
    }
    columns |= {name: np.array([row.get(name, np.nan) for row in rows], dtype=np.float64) for name in numbers}
    shape = [len(values) for values in grid.values()]
    variables = {name: (list(grid), values.reshape(shape)) for name, values in columns.items()}
    coordinates = {name: _coordinate(values) for name, values in grid.items()}
    first = planned[0].parameters
    same = {key: value for key, value in (first["parameters"] | first["options"]).items() if key not in grid}
    about = {"scene": str(first["scene"]), "parameters": json.dumps(same)}
    results = xarray.Dataset(variables, coordinates, about)
    for name in units.keys() & results.variables.keys():
        results[name].attrs["units"] = units[name]
    with disk.replacing(folder / RESULTS) as unfinished:
        results.to_netcdf(unfinished, engine="h5netcdf")
    with disk.replacing(folder / TABLE) as unfinished:
        results.to_dataframe().to_csv(unfinished, na_rep="nan", lineterminator="\r\n")
    return results


def _coordinate(values: Sequence[Any]) -> np.ndarray:
    if all(isinstance(value, int | float) and not isinstance(value, bool) for value in values):
        return np.array(values)
    return np.array([str(value) for value in values], dtype=object)


def read_results(path: Path) -> Any:
    """Return the results in a file; raise OSError or ValueError if it has none."""
    xarray = import_xarray()
    with xarray.open_dataset(path, engine="h5netcdf") as opened:
        results = opened.load()
    if "status" not in results or not results.sizes:
        raise ValueError(f"{path} has no results of a sweep")
    return results
