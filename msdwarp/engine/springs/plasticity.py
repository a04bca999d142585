"""Plasticity: springs that deform permanently; their rest lengths are part of the state."""

from collections.abc import Mapping

import numpy as np
import warp as wp
from numpy.typing import NDArray

from ...kernels.springs.plasticity import yielding
from ..device.device import upload_fields
from ..model.effect import Effect
from ..model.model import Model

STORED = ("original_length", "yield_strain", "relaxation_time", "largest_plastic_strain")
"""Fields of the system with the parameters of yielding."""


class Plasticity(Effect):
    """Lets springs of a model yield at the start of each substep; see `msdwarp.kernels.springs.plasticity`."""

    conserves = True

    def __init__(self, model: Model) -> None:
        self._model = model
        self.term = yielding(model.dim, model.scalar, model.compensated)
        self.data = self.term.Data()
        self.data.connections = model.connections
        values = {name: model.ordered(np.array(getattr(model.system, name))) for name in STORED}
        upload_fields(self.data, model.device, **values)
        self.rest_length = model.rest_length
        """The current rest lengths [m], in the device's order, concatenated by world."""
        if model.in_worlds:
            self.by_world = ("rest_length",)
            each = model.of_each_world(model.row_of("rest_length"))
            self.rest_length = wp.array(each, dtype=model.scalar, device=model.device)
            model.tables["rest_length"] = self.rest_length.reshape((model.worlds, model.connection_count))
            if "rest_length" in model.rows:
                self.by_world = ("rest_length", "original_length")
                self.data.original_length = wp.clone(self.rest_length)
        self.data.rest_length = self.rest_length

    def begin(self, substeps: int, dt: float) -> None:
        """Prepare for frames of this many substeps of `dt` seconds."""
        self.data.h = dt

    @property
    def changing(self) -> list[wp.array]:
        """The rest lengths."""
        return [self.rest_length]

    def checkpoint(self) -> dict[str, NDArray]:
        """Return the rest lengths of the system's springs [m], in the model's precision."""
        return {"rest_length": self._model.in_system_order(self.rest_length.numpy().copy())}

    def restore(self, arrays: Mapping[str, NDArray]) -> None:
        """Restore the state that `checkpoint` returned."""
        self.rest_length.assign(self._model.ordered(arrays["rest_length"]))

    def changed_fields(self) -> dict[str, NDArray]:
        """Return the current rest lengths, and the original ones, which do not change [m]."""
        return self.checkpoint() | {"original_length": self._model.system.original_length}
