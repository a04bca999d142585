"""Tables on disk that grow during a run: CSV files, such as the log of energies."""

import csv
import io
import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import BinaryIO, Self

import numpy as np

from .. import disk
from ..engine import Measures
from .plots import plot_log

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


class GrowingTable:
    """Writes lines of numbers, each immediately to disk, below a header of column names.

    An existing file is replaced, or continued after `behind` lines, or after the line for the time `until` [s].
    Later lines stay while equal lines are written again; the first different line replaces all that follow.

    Raises ValueError, which calls the file `word`, if the file to continue has other columns or too few lines.
    """

    def __init__(
        self,
        path: Path,
        head: Sequence[str],
        *,
        behind: int = 0,
        until: float = 0.0,
        word: str = "the table",
    ) -> None:
        self.path, self._head = path, list(head)
        self._file: BinaryIO | None = None
        self._lines, self._kept = self._existing(behind, until, word)

    def _existing(self, behind: int, until: float, word: str) -> tuple[list[list[str]], int]:
        """Return (lines of the file to continue, number of lines to keep)."""
        if not (behind or until) or not self.path.exists():
            return [], 0
        with self.path.open(newline="", encoding="utf-8", errors="replace") as file:
            try:
                head, *lines = list(csv.reader(file)) or [[]]
            except csv.Error:  # damaged, so a line is longer than can be
                head, lines = [], []
        if until:  # if no line has this time, keep more than exist
            of_time = [k + 1 for k, line in enumerate(lines) if line and _is_of_time(line, until)]
            behind = max(of_time, default=len(lines) + 1)
        if head != self._head or len(lines) < behind:
            raise ValueError(f"{word} is {self.path}, which is not what the run had written there; move it away")
        return lines, behind

    def __enter__(self) -> Self:
        kept = _as_csv([self._head, *self._lines[: self._kept]])
        whole = kept + _as_csv(self._lines[self._kept :])
        if not self._lines or self.path.read_bytes() != whole:  # a new file, or one cut short
            with disk.replacing(self.path) as unfinished:
                unfinished.write_bytes(whole)
        self._file = self.path.open("r+b")
        self._file.seek(len(kept))
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        """Close the file; an error while closing does not hide an earlier one."""
        assert self._file is not None
        try:
            self._file.close()
        except OSError:
            if kind is None:
                raise

    def write_line(self, numbers: Sequence[float]) -> None:
        """Write a line in place of the next kept line; if they differ, remove all later lines."""
        assert self._file is not None
        line = _as_csv([[f"{number:.9g}" for number in numbers]])
        with disk.failure_named(self.path, "could not be written further"):
            there = self._file.read(len(line))
            if there != line:
                self._file.seek(-len(there), io.SEEK_CUR)
                self._file.write(line)
                self._file.flush()
                self._file.truncate()


def _as_csv(lines: Sequence[Sequence[str]]) -> bytes:
    text = io.StringIO(newline="")
    csv.writer(text).writerows(lines)
    return text.getvalue().encode()


def _is_of_time(line: Sequence[str], time: float) -> bool:
    """Return whether a line begins with this time [s], as written with nine digits."""
    try:
        return abs(float(line[0]) - time) <= 1e-8 * time
    except ValueError:
        return False


class EnergyLog(GrowingTable):
    """Writes a line of measures per frame to a CSV file, each immediately to disk, and plots the file at the end.

    With `behind` an existing file is continued after that number of lines; see `GrowingTable`.

    Raises ValueError if the path does not end in .csv or has a frame's name, and FileExistsError if the file or
    its plot exists and `force` is False.
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
        super().__init__(path, ["time_s", *COLUMNS, "substeps"], behind=behind, word="log")

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        """Close the file, then draw the plot; neither hides an earlier error."""
        try:
            super().__exit__(kind, *_)
            plot_log(self.path, self.plot_path)
        except (OSError, ValueError) as error:
            if kind is None:
                raise OSError(f"{self.plot_path} could not be drawn: {error}") from error

    def write(self, time: float, measures: Measures, substeps: int) -> None:
        """Add a line: the time [s], the measures, and the substeps of the previous frame."""
        self.write_line([time, *(of(measures) for of in COLUMNS.values()), substeps])
