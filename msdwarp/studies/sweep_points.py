"""The points of a sweep: a folder for each, and what a worker does for one."""

import hashlib
import json
import os
import secrets
import shutil
import time
import warnings
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from .. import checks, disk
from ..simulation import Simulation, SimulationDiverged
from ..world import Scene
from .energy_log import COLUMNS

RUNS, PARAMETERS, SUMMARY = "runs", "parameters.json", "summary.json"
DONE, DIVERGED, FAILED, LOST, MISSING = "done", "diverged", "failed", "lost", "missing"
"""What has become of a point. The first two are results, and kept; the others are tried again by the next call."""
_UNFINISHED = ".unfinished-"

Row = dict[str, Any]
"""What is known of a point: its status, what was said, and numbers by name."""
Simulate = Callable[[Any, Path, bool], dict[str, float]]
"""(task, folder, whether files are kept) -> numbers; a function of a module, which workers can import."""


class Point(NamedTuple):
    """A point of a sweep."""

    given: dict[str, Any]
    """The values of what is swept, by name."""
    parameters: dict[str, Any]
    """All that says what is simulated, as JSON has it."""
    task: Any
    """What a worker is given to simulate it."""

    @property
    def digest(self) -> str:
        """A short text that two points share if their parameters are the same: the name of the folder."""
        return hashlib.sha256(json.dumps(self.parameters, sort_keys=True).encode()).hexdigest()[:16]


def stored_row(folder: Path) -> Row | None:
    """Return the row that a worker has left in the folder of a point; None if there is none that can be read."""
    try:
        row = json.loads((folder / SUMMARY).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    return row if isinstance(row, dict) and row.get("status") in (DONE, DIVERGED) else None


def remove_unfinished(runs: Path) -> None:
    """Remove what workers that were lost have left."""
    for folder in runs.glob(f"{_UNFINISHED}*"):
        shutil.rmtree(folder, ignore_errors=True)


def carry_out(
    simulate: Simulate,
    task: Any,
    parameters: dict[str, Any],
    digest: str,
    runs: Path,
    keeps_files: bool,
    attempt: int = 1,
    spent: float = 0.0,
) -> Row:
    """Simulate a point, and return its row; its folder appears whole, or not at all. A worker does this.

    `spent` is how many seconds it has taken already.
    What goes wrong is in the row, so that whatever is raised from here is the fault of a lost worker.
    """
    folder = runs / digest
    if (row := stored_row(folder)) is not None:  # of a worker that was taken for lost
        return row
    made = runs / f"{_UNFINISHED}{digest}-{secrets.token_hex(4)}"
    try:
        runs.mkdir(parents=True, exist_ok=True)
        made.mkdir()
        row = _row(simulate, task, made, keeps_files, time.perf_counter() - spent)
        if row["status"] == FAILED:
            return row
        if not keeps_files:
            for path in made.iterdir():
                path.unlink()
        for name, content in ((PARAMETERS, parameters), (SUMMARY, row)):
            with disk.replacing(made / name, durable=True) as unfinished:
                unfinished.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
        try:
            os.rename(made, folder)
        except OSError:
            if stored_row(folder) is None:  # else another worker came first, with the same
                raise
        return row
    except OSError as error:
        return {"status": FAILED, "message": str(error)}
    finally:
        shutil.rmtree(made, ignore_errors=True)


def _row(simulate: Simulate, task: Any, folder: Path, keeps_files: bool, began: float) -> Row:
    """Simulate, and return what has become of it."""
    with warnings.catch_warnings(record=True) as heard:
        warnings.simplefilter("default")
        try:
            numbers = simulate(task, folder, keeps_files)
            row: Row = {"status": DONE, "message": "", **numbers}
        except SimulationDiverged as error:
            row = {"status": DIVERGED, "message": str(error), "time_s": error.time}
        except Exception as error:  # of a scene of any kind
            said = str(error) if isinstance(error, ValueError | OSError) else f"{type(error).__name__}: {error}"
            row = {"status": FAILED, "message": said}
    if heard and row["status"] == DONE:
        row["message"] = "; ".join(dict.fromkeys(str(one.message) for one in heard))
    return row | {"seconds": time.perf_counter() - began}


def final_numbers(simulation: Simulation, scene: Scene) -> dict[str, float]:
    """Return what is kept of the end of a run: energies, strain, what each probe told last, and what is observed.

    Names and units are those of the log of energies and of the table of probes.
    """
    measures = simulation.measure()
    numbers = {"time_s": simulation.time, "substeps": simulation.substeps}
    numbers |= {name: of(measures) for name, of in COLUMNS.items()}
    for name, probe in scene.probes.items():
        told = simulation.readings[name].values
        if len(told):
            columns = (f"{name}_{column}" for column in probe.columns(simulation.system.dim))
            numbers |= dict(zip(columns, told[-1], strict=True))
    _, *now = simulation.frame()
    for name, told in scene.observed(*now).items():
        each = {f"{name}_{k}": value for k, value in enumerate(told.ravel())}
        numbers |= each if told.ndim else {name: told}
    return {name: float(value) for name, value in numbers.items()}


def numbers_of(
    simulation: Simulation, scene: Scene, observe: Mapping[str, Callable[[Simulation], float]]
) -> dict[str, float]:
    """Return what is kept of the end of a run, and what functions tell of it."""
    numbers = final_numbers(simulation, scene)
    for name, function in observe.items():
        numbers[name] = float(checks.array(f"what observe[{name!r}] returns", function(simulation)).reshape(()))
    return numbers
