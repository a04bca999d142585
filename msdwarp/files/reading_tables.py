"""What probes told, in the file of a trajectory: a table by frame, one by substep, and how far each frame came.

VTK does not look into the group where they are. Files come as open h5py files; see `msdwarp.files.vtkhdf`.
"""

import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import checks
from ..bodies import Series
from .names import OWN, READINGS, restored, same, store_text
from .validation import too_large

Columns = Mapping[str, tuple[str, Sequence[str]]]
"""Of each probe, by its name, how often it is read ("frame" or "substep") and what its numbers are called."""
Rows = Mapping[str, NDArray]
"""Readings by how often they are made: times [s], and beside them the numbers of all such probes."""
EVERY = ("frame", "substep")
_CHUNK = 1 << 14
"""Bytes of a chunk of a table."""


class ReadingTables:
    """The tables of a file that grows by frames.

    Parameters
    ----------
    columns
        What is told.
    """

    def __init__(self, columns: Columns) -> None:
        for name, (every, _) in columns.items():
            checks.one_of(f"every of readings[{name!r}]", every, EVERY)
        self.columns = {name: (every, list(names)) for name, (every, names) in columns.items()}
        self.widths = {
            every: 1 + sum(len(names) for when, names in self.columns.values() if when == every)
            for every in EVERY
            if any(when == every for when, _ in self.columns.values())
        }
        """How many numbers a row of each table has."""
        self._tables: dict[str, Any] = {}
        self._ends: Any = None
        self._at: dict[str, int] = {}
        """Of each table, how many of its rows are told by now: what it has beyond them may be told again."""

    @classmethod
    def of(cls, file: Any) -> "ReadingTables | None":
        """Return the tables that a file has; None where it has none. Raise ValueError if they are damaged."""
        if READINGS not in file[OWN]:
            return None
        group = file[OWN][READINGS]
        columns = json.loads(restored(group["description"]))
        for name, (_, names) in checks.mapping("readings", columns).items():
            if not all(isinstance(one, str) for one in names):
                raise ValueError(f"the columns of readings[{name!r}] are {names!r}; they must be names")
        tables = cls(columns)
        tables._tables = {every: group[f"by_{every}"] for every in tables.widths}
        tables._ends = group["ends"]
        tables._at = {every: len(table) for every, table in tables._tables.items()}
        for item, width in [(tables._ends, len(EVERY))] + [
            (tables._tables[one], tables.widths[one]) for one in tables.widths
        ]:
            kind = "i" if item is tables._ends else "f"
            if (item.maxshape, item.dtype.kind) != ((None, width), kind):
                raise ValueError(f"{item.name} is no table of {width} columns")
        return tables

    def begin(self, group: Any, foreseen: int) -> None:
        """Create the tables in the group `msdwarp` of a file."""
        store_text(group, f"{READINGS}/description", json.dumps(self.columns))
        for every, width in self.widths.items():
            rows = max(1, _CHUNK // (8 * width))
            _create(group, f"{READINGS}/by_{every}", width, np.float64, rows)
        _create(group, f"{READINGS}/ends", len(EVERY), np.int64, foreseen)

    def growth(self, k: int, rows: Rows) -> int:
        """Return by how many bytes frame k, and rows, let the tables grow, at most, as chunks are taken whole."""
        size = 0 if k < len(self._ends) else self._ends.chunks[0] * len(EVERY) * 8
        for every, values in rows.items():
            table = self._tables[every]
            chunk = table.chunks[0]
            size += (-(-len(values) // chunk) + 1) * chunk * self.widths[every] * 8
        return size

    def holds(self, rows: Rows, k: int | None = None) -> bool:
        """Tell whether rows come next, and are then those up to frame k."""
        ends = {every: at + len(rows.get(every, ())) for every, at in self._at.items()}
        told = all(same(self._tables[every][self._at[every] : ends[every]], rows[every]) for every in rows)
        return told and (k is None or self._ends[k].tolist() == [ends.get(every, 0) for every in EVERY])

    def add(self, rows: Rows) -> None:
        """Write rows behind those that are told, unless they are there."""
        there = self.holds(rows)
        for every, values in rows.items():
            table, at = self._tables[every], self._at[every]
            self._at[every] = at + len(values)
            if not there:
                table.resize(at, axis=0)
                table.resize(self._at[every], axis=0)
                table[at:] = values

    def note(self, k: int) -> None:
        """Note that the rows that are told by now are those up to frame k."""
        if len(self._ends) <= k:
            self._ends.resize(k + self._ends.chunks[0], axis=0)
        self._ends[k] = [self._at.get(every, 0) for every in EVERY]

    def go_on_behind(self, k: int, kept_until: float, until: float) -> None:
        """Go on at a time [s] at which a frame ended, the first k frames being kept up to another."""
        for column, (every, table) in self._columns():
            end = int(self._ends[k - 1, column]) if k else 0
            rounded = 1e-9 * until
            if until > kept_until + rounded:  # frames that are not kept have readings too
                while end < len(table) and (time := float(table[end, 0])) <= until + rounded:
                    end += 1
                    if time >= until - rounded:
                        break
                else:
                    raise ValueError(f"{table.file.filename} lacks readings by {every} up to {until:g} s")
            self._at[every] = end

    def _columns(self) -> Any:
        return ((EVERY.index(every), (every, table)) for every, table in self._tables.items())

    def read(self, frame_count: int, file_size: int) -> dict[str, Series]:
        """Return the time series of each probe up to the last frame; raise ValueError if they are damaged."""
        read: dict[str, NDArray] = {}
        done: dict[str, int] = dict.fromkeys(EVERY, 1)
        for column, (every, table) in self._columns():
            end = int(self._ends[frame_count - 1, column]) if frame_count else 0
            if not 0 <= end <= len(table):
                raise ValueError(f"it has {len(table)} readings by {every}, and its frames {end}")
            if wrong := too_large(table, end * self.widths[every], file_size):
                raise ValueError(f"the table by {every} {wrong}")
            read[every] = table[:end]
            if not np.isfinite(read[every][:, 0]).all() or (np.diff(read[every][:, 0]) <= 0).any():
                raise ValueError(f"the times of its readings by {every} do not rise")
        series = {}
        for name, (every, names) in self.columns.items():
            first = done[every]
            done[every] += len(names)
            series[name] = Series(read[every][:, 0].copy(), read[every][:, first : done[every]].copy())
        return series


def _create(group: Any, name: str, width: int, dtype: Any, rows: int) -> None:
    """Create a table of no rows, whose chunks have so many."""
    shape = {"shape": (0, width), "maxshape": (None, width), "chunks": (rows, width)}
    table = group.create_dataset(name, dtype=dtype, fill_time="never", **shape)
    # HDF5 makes the index of chunks with the first row, and a file would not open while that is being written:
    # it is made here, before the file has its name.
    table.resize(1, axis=0)
    table[0] = 0
    table.resize(0, axis=0)
