"""Work: what loads have done on a system from outside."""

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
import warp as wp
from numpy.typing import NDArray

from ..kernels.loads import sum_work, work
from .effect import Effect

if TYPE_CHECKING:
    from .model import Model

MOST_SHARES = 4096
"""Threads that sum on a GPU."""


class Work(Effect):
    """Keeps what loads have done on each particle of a model [J], float64."""

    def __init__(self, model: "Model") -> None:
        self._device = model.device
        self.piece = work(model.dim, model.scalar)
        self.data = self.piece.Data()
        self.data.done = wp.zeros(model.particle_count, dtype=wp.float64, device=model.device)
        self.data.last = wp.zeros(model.particle_count, dtype=model.vector, device=model.device)
        self._sum = sum_work(model.dim, model.scalar)
        self.before = 0.0
        """What had been done before, by the same loads on a system whose parameters have changed since [J]."""

    def begin(self, substeps: int, dt: float) -> None:
        """Prepare for frames of so many substeps of `dt` seconds."""
        lags = 0.5 if self.steps.lagging else 0.0
        self._remaining = lags * dt
        each = dt * np.asarray(self.steps.weights)
        for name, share in (("weight", 1.0 - lags), ("weight_of_last", lags)):
            rows = np.append(np.tile(share * each, substeps), 0.0)
            setattr(self.data, name, wp.array(rows, dtype=wp.float64, device=self._device))

    def shares(self) -> wp.array:
        """Return room for the sums of many threads."""
        threads = max(1, min(len(self.data.done) // 8, MOST_SHARES)) if self._device.is_cuda else 1
        return wp.zeros(threads, dtype=wp.float64, device=self._device)

    def launch(self, v: wp.array, shares: wp.array) -> None:
        """Launch the sums for particles that move at v, as the method has it; it may be recorded."""
        inputs = [self.data.done, self.data.last, v, self._remaining]
        wp.launch(self._sum, len(shares), inputs, [shares], device=self._device)

    def total(self, v: wp.array) -> float:
        """Return what has been done so far on particles that now move at v [J]."""
        shares = self.shares()
        self.launch(v, shares)
        return self.before + float(shares.numpy().sum())

    @property
    def changing(self) -> list[wp.array]:
        """What has been done on each particle, and the force in the last substep."""
        return [self.data.done, self.data.last]

    def checkpoint(self) -> dict[str, NDArray]:
        """Return what has been done on each particle, and before."""
        arrays = {"work.done": self.data.done, "work.last": self.data.last}
        return {name: array.numpy().copy() for name, array in arrays.items()} | {
            "work.before": np.array([self.before])
        }

    def restore(self, arrays: Mapping[str, NDArray]) -> None:
        """Take back what `checkpoint` gave."""
        self.data.done.assign(arrays["work.done"])
        self.data.last.assign(arrays["work.last"])
        self.before = float(arrays["work.before"][0])
