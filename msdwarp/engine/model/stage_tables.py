"""By stage: effects whose numbers are functions of time, as a table with a row for each stage of a frame."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...world import Load
from ..device.frame_tables import InFrames, Tables
from .effect import Effect
from .model import Model


class StageTables(Effect):
    """An effect that kernels read from a table `value`, with a row for each stage of a frame, and for its end.

    A subclass says what is in a row (`at`), and where kernels find the table (`place_table`).
    """

    _frames: InFrames | None = None
    named: Sequence[tuple[str, Any]] = ()
    """The loads that it is of, and what they are called."""
    now: NDArray[np.float64]
    """The rows of the present frame, or the one row that is held."""

    def set_up(self, model: Model, width: int, dtype: Any, *, varies: bool) -> None:
        """Set up tables of rows of so many numbers, or vectors, of a Warp type."""
        self._stage_model, self._width, self._dtype, self.varies = model, width, dtype, varies
        self.now = self.at(np.zeros(1))  # what a function gets wrong is said before anything runs

    def at(self, times: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the rows at these times, shape [time_count, width] or [time_count, width, d]."""
        raise NotImplementedError

    def place_table(self, table: Any) -> None:
        """Have kernels find the table."""
        raise NotImplementedError

    def exchange(self, others: Mapping[Load, Load]) -> None:
        """Take others in place of some loads, on the same particles."""
        before, self.named = self.named, exchanged(self.named, others)
        try:
            self.at(np.zeros(1))
        except ValueError:
            self.named = before
            raise

    def begin(self, substeps: int, dt: float) -> None:
        """Make room for the rows of a frame."""
        model, shape = self._stage_model, (len(self.steps.times(0.0)), self._width)
        self._frames = InFrames({"value": (shape, self._dtype)}, model.scalar, model.device, self._fill)
        self.place_table(self._frames.arrays["value"])

    def begin_frame(self, time: float) -> None:
        """Take the rows of the frame that begins at `time` [s]."""
        if self.varies and self._frames is not None:
            self._frames.begin_frame(time)

    def prepare(self, time: float) -> None:
        """Compute the rows of the frame that begins at `time` [s], while another is running."""
        if self.varies and self._frames is not None:
            self._frames.prepare(time)

    def hold(self, time: float) -> None:
        """Have all stages see the row at `time` [s]."""
        self.now = self.at(np.array([time]))
        if self._frames is not None:
            self._frames.upload(lambda tables: self._write(tables, self.now))

    def _fill(self, time: float, tables: Tables) -> None:
        self.now = self.at(self.steps.times(time))
        self._write(tables, self.now)

    def _write(self, tables: Tables, rows: NDArray[np.float64]) -> None:
        tables["value"][:] = rows


def exchanged(named: Sequence[tuple[str, Any]], others: Mapping[Load, Load]) -> list[tuple[str, Any]]:
    """Return loads, and what they are called, with what stands for them in place of some."""
    return [(name, others.get(one, one)) for name, one in named]
