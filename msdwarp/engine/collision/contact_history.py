"""WithHistory: which bodies touch, and their tangential displacements, also in checkpoints."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from ...kernels.collision.contact_data import HISTORY
from ..model.effect import Effect
from ..model.model import Model

SEPARATION_TIME = 0.5
"""Bodies that overlap at the start are moved apart within this time [s]."""
STORED = {
    "tangential_displacement": "slip",
    "contact_body": "partner",
    "fastest": "fastest",
    "initial_overlap": "allowed",
    "side": "way",
    "level": "level",
}
"""Names of the arrays in checkpoints: those of version 0.1."""


class WithHistory(Effect):
    """An effect whose state is a contact history.

    The history has the bodies that points or facets touch, tangential displacements, and the overlap that is still
    allowed since the start.
    """

    overlapping_at_start = False
    """Whether anything overlapped at the start, which needs other kernels."""

    def set_up_history(
        self, model: Model, data: Any, count: int, prefix: str, more: Mapping[str, Any] = MappingProxyType({})
    ) -> None:
        """Make the arrays for `count` points or facets, as fields of the struct `data`.

        `more` has the types of additional arrays by name. In checkpoints names begin with `prefix`.
        """
        self._model, self._history, self._prefix = model, data, prefix
        types = {"tangential_displacement": model.vector, "contact_body": int, **more}
        for name, dtype in types.items():
            setattr(data, name, wp.zeros((HISTORY, count), dtype=dtype, device=model.device))
        data.contact_body.fill_(-1)
        data.initial_overlap = wp.zeros(count, dtype=model.scalar, device=model.device)
        self._names = tuple(types)

    def allow(self, overlap: NDArray[np.float64]) -> None:
        """Allow each point or facet the overlap that it has at the start [m]; the allowance then shrinks."""
        self.overlapping_at_start = True
        self._history.initial_overlap.assign(overlap.astype(self._model.dtype))
        self.release_overlap_within(SEPARATION_TIME)

    def release_overlap_within(self, seconds: float) -> None:
        """Move apart what overlaps at the start within a time [s]."""
        self._history.overlap_release_speed = float(self._history.initial_overlap.numpy().max()) / seconds

    def allow_none(self) -> None:
        """Allow no overlap any more: what overlaps is pressed apart by its whole depth."""
        self._history.initial_overlap.zero_()

    def go_on_from(self, other: Effect) -> None:
        """Copy the contact history of `other`, the effect of another model with the same bodies."""
        assert isinstance(other, WithHistory)
        if other._history.contact_body.shape == self._history.contact_body.shape:
            for name in self._names:
                wp.copy(getattr(self._history, name), getattr(other._history, name))

    def take_history(self, arrays: Mapping[str, NDArray]) -> None:
        """Take the bodies that touch, and their tangential displacements, from a `checkpoint`."""
        for name in self._names:
            if (stored := f"{self._prefix}.{STORED[name]}") in arrays:  # those of before 0.3 lack some
                getattr(self._history, name).assign(arrays[stored])

    @property
    def changing(self) -> list[wp.array]:
        """The arrays that substeps change: the history."""
        return [getattr(self._history, name) for name in (*self._names, "initial_overlap")]

    def checkpoint(self) -> dict[str, NDArray]:
        """Return the arrays of the contact history, by their names in checkpoints."""
        names = (*self._names, *("initial_overlap",) * self.overlapping_at_start)
        arrays = {f"{self._prefix}.{STORED[name]}": getattr(self._history, name).numpy().copy() for name in names}
        if self.overlapping_at_start:
            arrays[f"{self._prefix}.outwards"] = np.array([self._history.overlap_release_speed])
        return arrays

    def restore(self, arrays: Mapping[str, NDArray]) -> None:
        """Restore the arrays that `checkpoint` returned."""
        self.overlapping_at_start = f"{self._prefix}.allowed" in arrays
        self._model.generation += 1  # new kernels are composed
        self.take_history(arrays)
        if self.overlapping_at_start:
            self._history.initial_overlap.assign(arrays[f"{self._prefix}.{STORED['initial_overlap']}"])
            self._history.overlap_release_speed = float(arrays[f"{self._prefix}.outwards"][0])
