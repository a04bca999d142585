"""Work of loads on a system."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from ...kernels.effect import ForceTerm
from ...kernels.loads.work import NOTHING, add_work, sum_work, work
from ..model.effect import Effect
from ..model.model import Model
from .forces import Steady

_STORED = {
    "BodyContact": "touching",
    "DivisionPlanes": "division",
    "SurfaceContact": "straddling",
    "Colliders": "contact",
    "Drives": "driving",
    "AttachmentSprings": "attached",
}
"""Names of effects' work in checkpoints."""
MOST_THREADS = 4096
"""Maximal number of threads that sum the work on a GPU."""


def _stored(effect: Effect) -> str:
    """Return the name of an effect's work in checkpoints: in version 0.1's words, so that its files still load."""
    name = type(effect).__name__
    return _STORED.get(name, name)


class Work(Effect):
    """Sums the work of loads on a model [J], in float64; per particle if `summed`.

    The work of steady forces is computed from their potential. Work that effects sum themselves is added.
    """

    def __init__(
        self, model: Model, *, summed: bool, steady: Steady | None, others: Sequence[Effect] = ()
    ) -> None:
        self._model, self._device = model, model.device
        count = model.worlds * model.particle_count if summed else 0
        self._others = {f"work.{_stored(one)}": one.done for one in others if one.done is not None}
        self._counts = summed or any(isinstance(one.term, ForceTerm) for one in others)
        self.term = work(model.dim, model.scalar) if self._counts else NOTHING
        self.field = self.term.field
        self.data, self.idle = self.term.Data(), self.term.Data()
        """The data for kernels, and a copy with zero weights, for force evaluations that do no work."""
        self._done = wp.zeros(count, dtype=wp.float64, device=model.device)
        self._last = wp.zeros(count, dtype=model.vector, device=model.device)
        if self._counts:
            for data in (self.data, self.idle):
                data.done, data.last = self._done, self._last
        self._combination = wp.zeros(0, dtype=int, device=model.device)
        self._steady = wp.zeros(0, dtype=model.vector, device=model.device)
        self._sum = model.kernels.note(sum_work(model.dim, model.scalar))
        self._remaining = 0.0
        self.by_world = ("done", "last") if self._counts and summed else ()
        self.before = np.zeros(model.worlds)
        """Term added to each world's sums [J]: −f·x of steady forces at the start, plus earlier work."""
        if steady is not None:
            self._combination, self._steady = steady.data.combination, steady.data.value.flatten()
            forces = steady.sums[self._combination.numpy()]
            rows = model.row_of("position")
            self.before -= (forces * rows).sum(axis=(1, 2))[np.arange(model.worlds) % len(rows)]

    def begin(self, substeps: int, dt: float) -> None:
        """Prepare for frames of this many substeps of `dt` seconds."""
        # With one force per substep, half its work uses the velocity before the kick, half the velocity after it.
        lags = 0.5 if np.count_nonzero(self.steps.weights) == 1 else 0.0
        self._remaining = lags * dt
        if self._others or (self._counts and self.steps.lagging):
            self._model.kernels.note(add_work)
        each = dt * np.asarray(self.steps.weights)
        for name, fraction in (("weight", 1.0 - lags), ("weight_of_last", lags)):
            if not self._counts:
                break
            rows = np.append(np.tile(fraction * each, substeps), 0.0)
            setattr(self.data, name, wp.array(rows, dtype=wp.float64, device=self._device))
            setattr(self.idle, name, wp.zeros(len(rows), dtype=wp.float64, device=self._device))

    @property
    def half_kick(self) -> Any:
        """Data with which a kick by half a substep sums the work of its forces alone; None if there is none."""
        if not (self._counts and len(self._done) and self.steps.lagging):
            return None
        data: Any = type(self.data)()
        data.done, data.last = wp.zeros_like(self._done), self._last
        data.weight = wp.full_like(self.data.weight, self._remaining)
        data.weight_of_last = wp.zeros_like(data.weight)
        return data

    def settle(self, x: wp.array, v: wp.array) -> None:
        """Add the remaining half of the last force's work, before velocities are changed from outside."""
        done = self.totals(x, v)
        self._last.zero_()
        self.before += done - self.totals(x, v)

    def partial_sums(self) -> wp.array:
        """Return an array for the partial sums of threads; each world has equally many threads."""
        most = max(1, MOST_THREADS // self._model.worlds)
        threads = max(1, min(self._model.particle_count // 8, most)) if self._device.is_cuda else 1
        return wp.zeros(self._model.worlds * threads, dtype=wp.float64, device=self._device)

    def launch(self, x: wp.array, v: wp.array, partial: wp.array, more: wp.array | None = None) -> None:
        """Launch the sums for positions x, the method's velocities v and `more` work; a graph may record it."""
        model = self._model
        inputs = [model.particle_count, model.stride, model.worlds, self._done, self._last, v, self._remaining]
        inputs += [self._combination, self._steady, x]
        wp.launch(self._sum, len(partial), inputs, [partial], device=self._device)
        for done in (*self._others.values(), *([] if more is None else [more])):
            wp.launch(add_work, len(partial), [done.flatten(), model.worlds], [partial], device=self._device)

    def totals(self, x: wp.array, v: wp.array) -> NDArray[np.float64]:
        """Return the work so far in each world [J], for current positions x and velocities v."""
        partial = self.partial_sums()
        self.launch(x, v, partial)
        return self.before + partial.numpy().reshape(self._model.worlds, -1).sum(axis=1)

    @property
    def changing(self) -> list[wp.array]:
        """The work on each particle, and the force in the last substep."""
        return [self._done, self._last, *self._others.values()]

    def checkpoint(self) -> dict[str, NDArray]:
        """Return the work on each particle, and the earlier work."""
        arrays = {"work.done": self._done, "work.last": self._last} | self._others
        return {name: array.numpy().copy() for name, array in arrays.items()} | {"work.before": self.before.copy()}

    def restore(self, arrays: Mapping[str, NDArray]) -> None:
        """Restore the state that `checkpoint` returned."""
        self._done.assign(arrays["work.done"])
        self._last.assign(arrays["work.last"])
        for name, done in self._others.items():
            done.assign(arrays[name])
        self.before[:] = arrays["work.before"]
