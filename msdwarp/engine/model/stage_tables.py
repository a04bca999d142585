"""Effects with time-dependent values, in tables that are filled for each frame."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ... import checks
from ...world import Load, poses
from ..device.frame_tables import InFrames, Tables
from .effect import Effect
from .model import Model

AHEAD = np.arange(61) / 60.0
"""Times after the current one at which stability bounds evaluate values that are functions of time [s]."""

MOST_LOOKED_AT = 64
"""Functions of place are looked at ahead for so many particles, evenly chosen."""


class FrameTables(Effect):
    """An effect whose kernels may read tables that are filled for each frame."""

    _frames: InFrames | None = None
    prescribed: Sequence[tuple[str, Any, Any]] = ()
    """Prescribed motions, each with its name in messages and the centre of its rotation [m]."""
    _last_dt = 0.0
    """Length of substeps for which `done` holds [s]; 0 at first."""
    varies = True
    """Whether tables are filled for each frame; else they keep the values that `hold` wrote."""

    def make_tables(self, tables: Mapping[str, tuple[tuple[int, ...], Any]], scalar: Any, device: Any) -> Tables:
        """Make tables of these shapes and Warp types, store them in `data` by name, and return the host's."""
        self._frames = InFrames(tables, scalar, device)
        for name, array in self._frames.arrays.items():
            self.place_table(name, array)
        return self._frames.tables

    def keep_work(self, dt: float) -> None:
        """Prepare `done` for substeps of `dt` [s]: its second row is half of the next substep's work."""
        if self.done is not None and self._last_dt not in (0.0, dt):
            work, ratio = self.done.numpy(), dt / self._last_dt
            work[0::2] += (1.0 - ratio) * work[1::2]
            work[1::2] *= ratio
            self.done.assign(work)
        self._last_dt = dt

    def place_table(self, name: str, table: Any) -> None:
        """Store a table in `data`, where kernels read it."""
        setattr(self.data, name, table)

    def fill(self, time: float, tables: Tables) -> None:
        """Write the tables of the frame that begins at `time` [s]."""
        raise NotImplementedError

    def look_ahead(self, times: NDArray[np.float64], x: Any, v: Any) -> dict[str, NDArray[np.float64]]:
        """Return each motion's rotation and displacement since the first of these times, to a picometre."""
        found = {}
        for name, motion, centre in self.prescribed:
            turn, shift = poses(name, motion, centre, times, checks.LARGEST)
            values = found[name] = np.zeros((len(times), 2, centre.size**2))
            values[:, 0], values[:, 1, : centre.size] = turn.reshape(len(times), -1), turn @ centre + shift
            values[:] = np.round(values - values[0], 12)
        return found

    def begin_frame(self, time: float) -> None:
        """Upload the tables of the frame that begins at `time` [s]."""
        if self._frames is not None and self.varies:
            self._frames.begin_frame(time, self.fill)

    def prepare(self, time: float) -> None:
        """Fill the tables of the frame that begins at `time` [s], while another frame is running."""
        if self._frames is not None and self.varies:
            self._frames.prepare(time, self.fill)


class StageTables(FrameTables):
    """An effect with a table that kernels read: a row for each stage of a frame, and one for the frame's end.

    A row has the value of each of the effect's loads at that time, unless a subclass overrides `at`.
    """

    table = "value"
    """Name of the table in kernels."""
    named: Sequence[tuple[str, Any]] = ()
    """The effect's loads, each with the name of its values in messages."""
    now: NDArray[np.float64]
    """The rows of the current frame, or the single row set by `hold`."""
    _time = 0.0
    """Start of the current frame, or the time set by `hold` [s]."""

    def set_up(self, model: Model, width: int, dtype: Any, *, varies: bool) -> None:
        """Set up rows with `width` elements of a Warp type."""
        self._model, self._width, self._dtype, self.varies, self.timed = model, width, dtype, varies, varies
        self.now = self.at(np.zeros(1))  # a function that raises should do so before anything runs

    def at(self, times: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the table's rows at these times, shape [time_count, width] or [time_count, width, d]."""
        return np.stack([one.at(times, self._model.dim, name) for name, one in self.named], axis=1)

    def look_ahead(self, times: NDArray[np.float64], x: Any, v: Any) -> dict[str, NDArray[np.float64]]:
        """Return the table's rows at these times, all under one name if there is not one element for each load."""
        names, rows = list(dict.fromkeys(name for name, _ in self.named)), self.at(times)
        rows = rows.reshape(*rows.shape[:2], -1)
        if len(names) != rows.shape[1]:
            return {", ".join(names): rows}
        return {name: rows[:, k, None] for k, name in enumerate(names)}

    def now_and_ahead(self) -> NDArray[np.float64]:
        """Return the current frame's rows and those of the next second, for stability bounds."""
        if not self.varies:
            return self.now
        try:
            return np.concatenate([self.now, self.at(self._time + AHEAD)])
        except ValueError:  # the values may be defined for a shorter run only
            return self.now

    def exchange(self, others: Mapping[Load, Load]) -> None:
        """Replace loads by other loads on the same particles."""
        before, self.named = self.named, exchanged(self.named, others)
        try:
            self.at(np.zeros(1))
        except ValueError:
            self.named = before
            raise

    def begin(self, substeps: int, dt: float) -> None:
        """Allocate the rows of a frame."""
        shape = (len(self.steps.times(0.0)), self._width)
        self.make_tables({self.table: (shape, self._dtype)}, self._model.scalar, self._model.device)

    def hold(self, time: float) -> None:
        """Write the row at `time` [s] for all stages."""
        self._time, self.now = time, self.at(np.array([time]))
        if self._frames is not None:
            self._frames.upload(self._write)

    def begin_frame(self, time: float) -> None:
        """Upload the rows of the frame that begins at `time` [s]."""
        self._time = time
        super().begin_frame(time)

    def fill(self, time: float, tables: Tables) -> None:
        """Write the rows of the frame that begins at `time` [s]."""
        self.now = self.at(self.steps.times(time))
        self._write(tables)

    def _write(self, tables: Tables) -> None:
        tables[self.table][:] = self.now


def exchanged(named: Sequence[tuple[str, Any]], others: Mapping[Load, Load]) -> list[tuple[str, Any]]:
    """Return named loads; each load that is a key of `others` is replaced by the value."""
    return [(name, others.get(one, one)) for name, one in named]
