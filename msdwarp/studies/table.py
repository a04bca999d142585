"""A table of numbers on disk, a CSV file that grows with a run."""

import csv
import io
import math
from collections.abc import Sequence
from pathlib import Path
from typing import BinaryIO, Self

from ..disk import replacing


class GrowingTable:
    """Writes lines of numbers, each at once to disk.

    When an existing file is continued, its later lines stay as long as the same ones are written again. The first
    that differs takes the place of all that follow, once it is on disk.

    Parameters
    ----------
    path, head
        The CSV file, which is replaced unless it is continued, and the names of its columns.
    behind, until
        Continue the existing file after so many lines, or after the line that begins with this time [s]; if it is
        missing, begin a new one. ValueError is raised if it is not such a table, or lacks lines.
    word
        Name of the file in errors.
    columns_before
        Columns of files of earlier versions; missing ones stay empty.
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
        self._file: BinaryIO | None = None
        self._lines, self._kept = self._existing(behind, until, word)

    def _existing(self, behind: int, until: float, word: str) -> tuple[list[list[str]], int]:
        """Return the existing lines of a file to continue, and how many of them to keep."""
        if not (behind or until) or not self.path.exists():
            return [], 0
        with self.path.open(newline="", encoding="utf-8", errors="replace") as file:
            head, *lines = list(csv.reader(file)) or [[]]
        if until:
            behind = _lines_until(until, lines)
        if head not in self._heads or len(lines) < behind:
            raise ValueError(f"{word} is {self.path}, which is not what the run had written there; move it away")
        return [line + [""] * (len(self._head) - len(head)) for line in lines], behind

    def __enter__(self) -> Self:
        """Open the file."""
        kept = _as_csv([self._head, *self._lines[: self._kept]])
        whole = kept + _as_csv(self._lines[self._kept :])
        if not self._lines or self.path.read_bytes() != whole:  # new, of an earlier version, or cut short
            with replacing(self.path) as unfinished:
                unfinished.write_bytes(whole)
        self._file = self.path.open("r+b")
        self._file.seek(len(kept))
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
        """Add a line, unless it is the next one already."""
        assert self._file is not None
        line = _as_csv([[f"{number:.9g}" for number in numbers]])
        try:
            there = self._file.read(len(line))
            if there != line:
                self._file.seek(-len(there), io.SEEK_CUR)
                self._file.write(line)
                self._file.flush()
                self._file.truncate()
        except OSError as error:
            raise OSError(f"{self.path} could not be written further: {error.strerror or error}") from error


def _as_csv(lines: Sequence[Sequence[str]]) -> bytes:
    """Return lines as they are in the file."""
    text = io.StringIO(newline="")
    csv.writer(text).writerows(lines)
    return text.getvalue().encode()


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
