"""Probe readings in a trajectory's file: tables by frame and by substep, and the last row of each frame in them.

The tables are in the group `msdwarp`, which VTK does not read.
"""

import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import checks
from ..bodies import Series
from .names import OWN, READINGS, Growing, load, same, store_text
from .validation import too_large

Columns = Mapping[str, tuple[str, Sequence[str]]]
"""For each probe how often it is read ("frame" or "substep"), and the names of its columns."""
Rows = Mapping[str, NDArray]
"""New rows of the tables "frame" and "substep": time [s], then the values of all probes read that often."""
EVERY = ("frame", "substep")
_CHUNK = 1 << 14
"""Size of a table's chunk [bytes]."""


class ReadingTables:
    """The tables of probe readings in a growing file; `foreseen` is the expected number of frames."""

    def __init__(self, columns: Columns, foreseen: int = 1) -> None:
        for name, (every, _) in columns.items():
            checks.one_of(f"every of readings[{name!r}]", every, EVERY)
        self.columns = {name: (every, list(names)) for name, (every, names) in columns.items()}
        self.widths = {
            every: 1 + sum(len(names) for when, names in self.columns.values() if when == every)
            for every in EVERY
            if any(when == every for when, _ in self.columns.values())
        }
        """Number of entries in a row of each table."""
        self._arrays = {
            every: Growing(f"{READINGS}/by_{every}", (width,), np.float64, max(1, _CHUNK // (8 * width)))
            for every, width in self.widths.items()
        }
        self._of_ends = Growing(f"{READINGS}/ends", (len(EVERY),), np.int64, foreseen)
        self._tables: dict[str, Any] = {}
        self._ends: Any = None
        self._at: dict[str, int] = {}
        """Number of rows in use in each table; later rows may be overwritten."""

    @classmethod
    def of(cls, file: Any) -> "ReadingTables | None":
        """Return a file's tables, None if the file has none; raise ValueError if they are damaged."""
        if READINGS not in file[OWN]:
            return None
        columns = json.loads(load(file[OWN][READINGS]["description"]))
        for name, (_, names) in checks.mapping("readings", columns).items():
            if not all(isinstance(one, str) for one in names):
                raise ValueError(f"the columns of readings[{name!r}] are {names!r}; they must be names")
        tables = cls(columns)
        tables._tables = {every: one.open(file[OWN]) for every, one in tables._arrays.items()}
        tables._ends = tables._of_ends.open(file[OWN])
        tables._at = {every: len(table) for every, table in tables._tables.items()}
        return tables

    def begin(self, group: Any) -> None:
        """Create the tables in the group `msdwarp` of a file."""
        store_text(group, f"{READINGS}/description", json.dumps(self.columns))
        for one in (*self._arrays.values(), self._of_ends):
            # HDF5 creates a chunk index with the first row, and the file cannot be opened meanwhile. So the index
            # is created here, while the file has a temporary name.
            table = one.create(group)
            table.resize(1, axis=0)
            table[0] = 0
            table.resize(0, axis=0)

    def growth(self, k: int, rows: Rows) -> int:
        """Return an upper bound of the bytes that frame k and its `rows` add to the tables."""
        size = 0 if k < len(self._ends) else self._ends.chunks[0] * len(EVERY) * 8
        for every, values in rows.items():
            size += self._arrays[every].growth(0, len(values) + self._arrays[every].chunk)
        return size

    def holds(self, rows: Rows, k: int | None = None) -> bool:
        """Return whether the tables' next rows equal `rows`, and whether frame k, if given, ends with them."""
        ends = {every: at + len(rows.get(every, ())) for every, at in self._at.items()}
        there = all(same(self._tables[every][self._at[every] : ends[every]], rows[every]) for every in rows)
        return there and (k is None or self._ends[k].tolist() == [ends.get(every, 0) for every in EVERY])

    def add(self, rows: Rows) -> None:
        """Write rows after the rows in use, unless equal rows are already there."""
        there = self.holds(rows)
        for every, values in rows.items():
            table, at = self._tables[every], self._at[every]
            self._at[every] = at + len(values)
            if not there:
                table.resize(at, axis=0)
                table.resize(self._at[every], axis=0)
                table[at:] = values

    def note(self, k: int) -> None:
        """Store that the rows up to the end of frame k are in use."""
        if len(self._ends) <= k:
            self._ends.resize(k + self._ends.chunks[0], axis=0)
        self._ends[k] = [self._at.get(every, 0) for every in EVERY]

    def continue_after(self, k: int, kept_until: float, until: float) -> None:
        """Continue after readings up to `until` [s]; the first k kept frames end at `kept_until` [s]."""
        for every, table in self._tables.items():
            end = self._end(k, every)
            rounded = 1e-9 * until
            if until > kept_until + rounded:  # later frames were not kept, but have readings
                while end < len(table) and (time := float(table[end, 0])) <= until + rounded:
                    end += 1
                    if time >= until - rounded:
                        break
                else:
                    raise ValueError(f"{table.file.filename} lacks readings by {every} up to {until:g} s")
            self._at[every] = end

    def _end(self, k: int, every: str) -> int:
        """Return the number of a table's rows that belong to the first k frames."""
        return int(self._ends[k - 1, EVERY.index(every)]) if k else 0

    def read(self, frame_count: int, file_size: int) -> dict[str, Series]:
        """Return each probe's time series up to the last frame; raise ValueError if tables are damaged."""
        read: dict[str, NDArray] = {}
        for every, table in self._tables.items():
            end = self._end(frame_count, every)
            if not 0 <= end <= len(table):
                raise ValueError(f"it has {len(table)} readings by {every}, and its frames {end}")
            if wrong := too_large(table, end * self.widths[every], file_size):
                raise ValueError(f"the table by {every} {wrong}")
            read[every] = table[:end]
            if not np.isfinite(read[every][:, 0]).all() or (np.diff(read[every][:, 0]) <= 0).any():
                raise ValueError(f"the times of its readings by {every} do not rise")
        series = {}
        first: dict[str, int] = dict.fromkeys(EVERY, 1)
        for name, (every, names) in self.columns.items():
            columns = slice(first[every], first[every] + len(names))
            series[name] = Series(read[every][:, 0].copy(), read[every][:, columns].copy())
            first[every] = columns.stop
        return series
