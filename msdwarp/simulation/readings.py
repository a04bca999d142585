"""Readings: what probes have told so far, as time series."""

from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .. import checks
from ..world import Probe


class Series(NamedTuple):
    """What one probe has told, frame by frame."""

    times: NDArray[np.float64]
    """When frames ended [s], shape [reading_count]."""
    values: NDArray[np.float64]
    """What it told then, in SI units, shape [reading_count, d]; of strain two columns, mean and largest."""


class Readings(Mapping[str, Series]):
    """Time series by the names of their probes: a reading for each frame simulated since the start.

    After `Simulation.restore` they begin with the frame behind the checkpoint.
    """

    def __init__(self, probes: Mapping[str, Probe], dim: int) -> None:
        self._times = list[float]()
        self._rows: dict[str, list[NDArray[np.float64]]] = {name: [] for name in probes}
        self._widths = {name: len(one.columns(dim)) for name, one in probes.items()}

    def add(self, time: float, rows: Mapping[str, NDArray[np.float64]]) -> None:
        """Take the readings of the frame that ended at `time` [s]."""
        self._times.append(time)
        for name, row in rows.items():
            self._rows[name].append(row)

    @property
    def last(self) -> list[float]:
        """The numbers of the last frame, side by side, and its time [s] before them; empty if there is none."""
        if not self._times:
            return []
        return [self._times[-1], *(float(number) for rows in self._rows.values() for number in rows[-1])]

    def __getitem__(self, name: str) -> Series:
        """Return the series of a probe; raise KeyError if there is none of this name."""
        if name not in self._rows:
            raise KeyError(f"there is no probe {checks.said(name)}; there are {', '.join(self._rows) or 'none'}")
        rows = np.array(self._rows[name], dtype=np.float64).reshape(len(self._times), self._widths[name])
        return Series(np.array(self._times), rows)

    def __iter__(self) -> Iterator[str]:
        return iter(self._rows)

    def __len__(self) -> int:
        return len(self._rows)
