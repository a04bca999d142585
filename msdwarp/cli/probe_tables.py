"""The tables that a run writes of what its probes tell: a line for each frame, or for each substep."""

from collections.abc import Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import Self

import numpy as np
from numpy.typing import NDArray

from ..simulation import Simulation
from ..studies import GrowingTable
from ..world import FRAME, SUBSTEP, Probe, probe_columns, probes_by
from .results import PROBES, PROBES_BY_SUBSTEP


def described(probes: Mapping[str, Probe], dim: int) -> dict[str, tuple[str, list[str]]]:
    """Return how often each probe is read, and what its numbers are called, as a trajectory's writer wants it."""
    return {name: (one.every, one.columns(dim)) for name, one in probes.items()}


def told_last(simulation: Simulation) -> dict[str, NDArray[np.float64]]:
    """Return what probes told of the last frame, as a trajectory's writer wants it."""
    rows = {every: simulation.readings.last(every) for every in (FRAME, SUBSTEP)}
    return {every: values for every, values in rows.items() if values.size}


class ProbeTables:
    """Writes what probes told of each frame, those by frame to one table and those by substep to another.

    Parameters
    ----------
    folder
        Where the tables go.
    probes
        The probes, by name.
    simulation
        What they are in; it has come to the frame behind which the tables go on, of the present time.
    """

    def __init__(self, folder: Path, probes: Mapping[str, Probe], simulation: Simulation) -> None:
        self._simulation, self._files = simulation, ExitStack()
        self._tables: dict[str, GrowingTable] = {}
        for every, name in ((FRAME, PROBES), (SUBSTEP, PROBES_BY_SUBSTEP)):
            if requested := probes_by(every, probes):
                head = ["time_s", *probe_columns(requested, simulation.system.dim)]
                table = GrowingTable(folder / name, head, until=simulation.time, word="the file of probes")
                self._tables[every] = table

    @property
    def paths(self) -> list[Path]:
        """The files."""
        return [table.path for table in self._tables.values()]

    def __enter__(self) -> Self:
        """Open the files."""
        with ExitStack() as opened:
            for table in self._tables.values():
                opened.enter_context(table)
            self._files = opened.pop_all()
        return self

    def __exit__(self, *error) -> None:
        """Close the files."""
        self._files.__exit__(*error)

    def write(self) -> None:
        """Write what was told of the last frame."""
        for every, table in self._tables.items():
            for numbers in self._simulation.readings.last(every):
                table.write_line(numbers)
