"""A log of energies: a CSV file that grows with the run, and a plot of it."""

import csv
import re
from collections.abc import Callable
from pathlib import Path
from typing import Self, TextIO

import numpy as np

from . import checks
from .measure import Measures

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


class EnergyLog:
    """Writes a line of measures per frame, at once to disk.

    Parameters
    ----------
    path
        The CSV file; the plot stands beside it with the ending .png.

    Raises
    ------
    ValueError
        If the path does not end in .csv, or is called as a frame is.
    FileExistsError
        If the file or its plot exists and `force` is False.
    OSError
        If nothing can be written there.
    """

    def __init__(self, path: Path, *, force: bool = False) -> None:
        if path.suffix != ".csv":
            raise ValueError(f"log is {path}; its name must end in .csv")
        if re.fullmatch(r"frame_\d+", path.stem):
            raise ValueError(f"log is {path}; its plot would have the name of a frame")
        self.path, self.plot_path = path, path.with_suffix(".png")
        for existing in (self.path, self.plot_path):
            if existing.exists() and not force:
                raise FileExistsError(f"log would replace {existing}; name another file or add --force")
        checks.writable_folder("log", path, path.parent)
        self._file: TextIO | None = None

    def __enter__(self) -> Self:
        """Open the file."""
        self._file = self.path.open("w", newline="", encoding="utf-8")
        self._writer = csv.writer(self._file)
        self._writer.writerow(["time_s", *COLUMNS])
        return self

    def __exit__(self, *_: object) -> None:
        """Close the file, then draw the plot."""
        assert self._file is not None
        self._file.close()
        plot(self.path, self.plot_path)

    def write(self, time: float, measures: Measures) -> None:
        """Add a line."""
        assert self._file is not None
        self._writer.writerow([f"{time:.9g}", *(f"{of(measures):.9g}" for of in COLUMNS.values())])
        self._file.flush()


def plot(csv_path: Path, png_path: Path) -> None:
    """Draw the energies of a log against time."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    table = np.atleast_1d(np.genfromtxt(csv_path, delimiter=",", names=True))
    if not table.size:
        return
    figure = Figure(figsize=(8, 4.5), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots()
    start = table["gravitational_J"][0]
    curves = {
        "kinetic": (table["kinetic_J"], "#e4633f"),
        "elastic": (table["elastic_J"], "#2f6f9f"),
        "gravitational, from the start's": (table["gravitational_J"] - start, "#5a9e6f"),
        "total": (table["total_J"] - start, "#333a40"),
    }
    for label, (values, colour) in curves.items():
        axes.plot(table["time_s"], values, label=label, color=colour, lw=2.2 if label == "total" else 1.5)
    axes.set_xlabel("time [s]")
    axes.set_ylabel("energy [J]")
    axes.margins(x=0)
    axes.grid(alpha=0.25)
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(frameon=False)
    figure.savefig(png_path, dpi=150)
