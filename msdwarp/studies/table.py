"""A table of numbers on disk, a CSV file that grows with a run."""

import csv
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Self, TextIO

from ..disk import replacing


class GrowingTable:
    """Writes lines of numbers, each at once to disk.

    Parameters
    ----------
    path
        The CSV file; what is there is replaced.
    head
        What the columns are called.
    behind
        Go on with the file that is there, behind so many of its lines; what it has beyond them is dropped. A file
        that is no longer there begins anew.
    until
        The same where lines begin with a time: go on behind those up to this one [s].
    word
        What the file is called in errors.
    columns_before
        Columns that files of earlier versions had; missing ones stay empty.

    Raises
    ------
    ValueError
        If the file to go on with is none, or lacks lines.
    """

    def __init__(
        self,
        path: Path,
        head: Sequence[str],
        *,
        behind: int = 0,
        until: float = 0.0,
        word: str,
        columns_before: int | None = None,
    ) -> None:
        self.path, self._head = path, list(head)
        self._heads = (self._head, self._head[:columns_before])
        self._file: TextIO | None = None
        self._kept = self._lines(behind, until, word)

    def _lines(self, behind: int, until: float, word: str) -> list[list[str]]:
        """Return so many lines of numbers that are there, or those up to a time."""
        if not (behind or until) or not self.path.exists():
            return []
        with self.path.open(newline="", encoding="utf-8", errors="replace") as file:
            head, *lines = list(csv.reader(file)) or [[]]
        if until:
            behind = _lines_until(until, lines)
        if head not in self._heads or len(lines) < behind:
            raise ValueError(f"{word} is {self.path}, which is not what the run had written there; move it away")
        return [line + [""] * (len(self._head) - len(head)) for line in lines[:behind]]

    def __enter__(self) -> Self:
        """Open the file."""
        with replacing(self.path) as unfinished, unfinished.open("w", newline="", encoding="utf-8") as file:
            csv.writer(file).writerows([self._head, *self._kept])
        self._file = self.path.open("a", newline="", encoding="utf-8")
        self._writer = csv.writer(self._file)
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        """Close the file; an error on the way here is not hidden by one of this."""
        assert self._file is not None
        try:
            self._file.close()
        except OSError:
            if kind is None:
                raise

    def write_line(self, numbers: Sequence[float]) -> None:
        """Add a line."""
        assert self._file is not None
        try:
            self._writer.writerow([f"{number:.9g}" for number in numbers])
            self._file.flush()
        except OSError as error:
            raise OSError(f"{self.path} could not be written further: {error.strerror or error}") from error


def _lines_until(time: float, lines: Sequence[Sequence[str]]) -> int:
    """Return how many lines there are up to the last one of a time [s]; more than there are if none is."""
    found = [k + 1 for k, line in enumerate(lines) if line and abs(_number(line[0]) - time) <= 1e-8 * time]
    return found[-1] if found else len(lines) + 1


def _number(text: str) -> float:
    """Return the number that a text says, written to nine digits; NaN where it says none."""
    try:
        return float(text)
    except ValueError:
        return math.nan
