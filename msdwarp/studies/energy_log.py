"""A log of energies: a CSV file that grows with the run, and a plot of it."""

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np

from .. import disk
from ..engine import Measures
from .plots import plot_log
from .table import GrowingTable

COLUMNS: dict[str, Callable[[Measures], float]] = {
    "kinetic_J": lambda m: m.kinetic_energy,
    "elastic_J": lambda m: m.elastic_energy,
    "gravitational_J": lambda m: m.gravitational_energy,
    "total_J": lambda m: m.energy,
    "dissipated_W": lambda m: m.dissipated_power,
    "momentum_kg_m_s": lambda m: float(np.linalg.norm(m.momentum)),
    "angular_momentum_kg_m2_s": lambda m: float(np.linalg.norm(m.angular_momentum)),
    "largest_strain": lambda m: m.largest_strain,
}


class EnergyLog(GrowingTable):
    """Writes a line of measures per frame to a CSV file, at once to disk, and draws it at the end.

    With `behind` it goes on after so many lines of an existing file; see `GrowingTable`.

    Raises ValueError if the path does not end in .csv or has the name of a frame, and FileExistsError if it or its
    plot exists and `force` is False.
    """

    def __init__(self, path: Path, *, force: bool = False, behind: int = 0) -> None:
        if path.suffix != ".csv":
            raise ValueError(f"log is {path}; its name must end in .csv")
        if re.fullmatch(r"frame_\d+", path.stem):
            raise ValueError(f"log is {path}; its plot would have the name of a frame")
        self.plot_path = path.with_suffix(".png")
        for existing in (path, self.plot_path):
            if existing.exists() and not force and not behind:
                raise FileExistsError(f"log would replace {existing}; name another file or add --force")
        disk.writable_folder("log", path, path.parent)
        head = ["time_s", *COLUMNS, "substeps"]  # files of earlier versions have no substeps
        super().__init__(path, head, behind=behind, word="log", columns_before=-1)

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        """Close the file, then draw the plot; neither hides an earlier error."""
        try:
            super().__exit__(kind, *_)
            plot_log(self.path, self.plot_path)
        except (OSError, ValueError) as error:
            if kind is None:
                raise OSError(f"{self.plot_path} could not be drawn: {error}") from error

    def write(self, time: float, measures: Measures, substeps: int) -> None:
        """Add a line: the time [s], its measures, and the substeps of the frame before."""
        self.write_line([time, *(of(measures) for of in COLUMNS.values()), substeps])
