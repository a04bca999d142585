"""Loads that are sums over elements, on a device: what they do is one function in `kernels`."""

from collections.abc import Sequence
from importlib import import_module

import numpy as np
import warp as wp
from numpy.typing import NDArray

from ...kernels.loads.elements import element_load
from ...world import ElementLoad, Load
from ..device.csr import rows
from ..device.device import upload_fields
from ..model.effect import Effect, Elements, summed
from ..model.model import Model


def element_loads_of(model: Model, loads: Sequence[Load]) -> list[Effect]:
    """Return the effects of the loads of a scene that are sums over elements, one for each law."""
    kinds = dict[tuple[str, str], list[ElementLoad]]()
    for one in loads:
        if isinstance(one, ElementLoad):
            kinds.setdefault((type(one).__module__, one.law), []).append(one)
    return [ElementLoads(model, several) for several in kinds.values()]


class ElementLoads(Effect):
    """All loads of a law, a function in the file of `kernels/loads` that is named as that of their class."""

    def __init__(self, model: Model, loads: Sequence[ElementLoad]) -> None:
        self._model, self.conserves = model, loads[0].stores
        name = type(loads[0]).__module__.rpartition(".")[2]
        evaluate = getattr(import_module(f"msdwarp.kernels.loads.{name}"), loads[0].law)
        each = zip(*(one.elements(model.system) for one in loads), strict=True)
        points, own = (np.concatenate(arrays) for arrays in each)
        how = evaluate, points.shape[1], own.shape[1], self.conserves
        composed = element_load(model.dim, model.scalar, model.compensated, *how)
        term, self._law, self._blocks, self._energies = composed
        model.kernels.note(self._blocks, self._energies)
        order, first = rows(points.ravel(), model.particle_count)
        self.members = np.diff(first) > 0
        self.term, self.data, self._points = term, term.Data(), points
        upload_fields(self.data, model.device, particle=points, own=own, first=first, entry=order)

    def add_blocks(self, x: wp.array, v: wp.array, stiffness: wp.array, damping: wp.array, world: int = 0) -> None:
        """Add half of the sums of the magnitudes of Warp's derivatives, which the stability bound doubles."""
        inputs = [self.data, self._points.shape[1] * self._model.dim, x, v]
        wp.launch(self._blocks, len(self._points), inputs, [stiffness, damping], device=self._model.device)

    def elements(self) -> Elements:
        """Return the elements, for gradients."""
        return Elements(self.data, self._law, self._points)

    def energies_and_powers(self, x: wp.array, v: wp.array) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the stored energy [J]; none if the force is not that of an energy, but does work."""
        if not self.conserves:
            return super().energies_and_powers(x, v)
        inputs = [self.data, self._model.stride, x, v]
        return summed(self._model, self._energies, len(self._points), inputs)
