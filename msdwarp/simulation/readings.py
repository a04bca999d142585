"""Readings: measurements of the probes so far, as time series."""

from collections.abc import Iterator, Mapping

import numpy as np
from numpy.typing import NDArray

from .. import checks
from ..bodies import Series
from ..world import FRAME, SUBSTEP, Probe, probes_by


class Readings(Mapping[str, Series]):
    """Time series by probe name: a reading for each frame or substep since the start.

    After `Simulation.restore` series begin with the frame after the checkpoint.
    """

    def __init__(self, probes: Mapping[str, Probe], dim: int) -> None:
        widths = {name: len(one.columns(dim)) for name, one in probes.items()}
        self._frames = {name: [Series(np.zeros(0), np.zeros((0, width)))] for name, width in widths.items()}
        self._names = {every: list(probes_by(every, probes)) for every in (FRAME, SUBSTEP)}

    def add(self, time: float, seconds: float, rows: Mapping[str, NDArray[np.float64]]) -> None:
        """Add the readings of a frame of `seconds` that ended at `time` [s].

        A probe's rows are evenly spaced in time; the last row is at the end of the frame.
        """
        for name, values in rows.items():
            before = np.arange(len(values) - 1, -1, -1) / len(values)
            self._frames[name].append(Series(time - seconds * before, values))

    def last(self, every: str = FRAME) -> NDArray[np.float64]:
        """Return the last frame's readings of all probes read by frame, or by substep, as columns.

        Column 0 is the time [s]. Shape [readings in a frame, 1 + widths]; [0, 0] without any probe.
        """
        last = [self._frames[name][-1] for name in self._names[every]]
        return np.column_stack([last[0].times, *(one.values for one in last)]) if last else np.zeros((0, 0))

    def __getitem__(self, name: str) -> Series:
        """Return the series of a probe; raise KeyError if no probe has this name."""
        if name not in self._frames:
            raise KeyError(
                f"there is no probe {checks.repr_short(name)}; there are {', '.join(self._frames) or 'none'}"
            )
        times, values = zip(*self._frames[name], strict=True)
        return Series(np.concatenate(times), np.concatenate(values))

    def __repr__(self) -> str:
        series = (f"{name!r}: times and values of {len(self[name].times)} readings" for name in self)
        return f"Readings({{{', '.join(series)}}})"

    def __iter__(self) -> Iterator[str]:
        return iter(self._frames)

    def __len__(self) -> int:
        return len(self._frames)
