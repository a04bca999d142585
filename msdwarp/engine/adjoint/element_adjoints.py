"""The adjoint of an effect whose forces are those of elements, on a device."""

from collections.abc import Callable
from typing import Any

import numpy as np
import warp as wp

from ...kernels.adjoint.elements import add_elements, elements_adjoint
from ..device.csr import rows
from ..model.effect import Elements
from ..model.model import Model
from .number_sums import NumberSums


class ElementAdjoints:
    """Adds to ∂L/∂x and ∂L/∂v of a loss L the contributions of the forces F of an effect's elements, given ∂L/∂F.

    Parameters
    ----------
    model
        The system.
    elements
        The elements of the effect.
    time
        The time of each stage of a frame [s].
    launch
        Function (kernel, count, inputs) that launches a kernel over `count` items; it adds `begin`, `end` and
        `threads` to the inputs.
    launch_once
        Function that calls its argument, which launches kernels, in only one of the threads that share a frame.
    sums
        The sums of derivatives by the elements' numbers; None if they are not requested.
    """

    def __init__(
        self,
        model: Model,
        elements: Elements,
        time: wp.array,
        launch: Callable[..., None],
        launch_once: Callable[[Callable[[], Any]], None],
        sums: NumberSums | None = None,
    ) -> None:
        device, scalar, vertices = model.device, model.scalar, elements.vertices
        self._elements, self._time, self._launch, self._launch_once = elements, time, launch, launch_once
        count, worlds, stride = len(elements.points), model.worlds, model.stride
        self._count = worlds * count
        self._apart = [self._count if elements.of_all_worlds else count, stride]
        points = elements.points.ravel()
        particle, weight = points[:, None], np.ones((len(points), 1))
        if vertices is not None:
            particle, weight = vertices.particle[points], vertices.weight[points]
        if worlds > 1:
            begin = stride * np.arange(worlds)[:, None, None]
            particle = np.where(particle < 0, -1, particle + begin).reshape(-1, particle.shape[1])
            weight = np.tile(weight, (worlds, 1))
        self._particle = wp.array(particle, dtype=int, device=device)
        self._weight = wp.array(weight, dtype=scalar, device=device)
        row, column = np.nonzero((particle >= 0) & (weight != 0))
        order, first = rows(particle[row, column], worlds * stride)
        member = np.flatnonzero(np.diff(first))
        self._table = [
            wp.array(each, dtype=int, device=device)
            for each in (member, first[np.append(member, worlds * stride)], row[order])
        ]
        self._table.append(wp.array(weight[row, column][order], dtype=scalar, device=device))
        self._by = [wp.zeros(len(particle), dtype=model.vector, device=device) for _ in range(2)]
        self._by_numbers = sums.each if sums else wp.zeros((0, 1), dtype=scalar, device=device)
        wanted = elements.law.width if sums else 0
        self._lead = elements_adjoint(model.dim, scalar, elements.data._cls, elements.law, wanted)
        self._add = add_elements(model.dim, scalar)

    def propagate(
        self, x: wp.array, v: wp.array, phi: wp.array, by_x: wp.array, by_v: wp.array, stage: int
    ) -> None:
        """Launch the addition of (∂F/∂x)ᵀ φ and (∂F/∂v)ᵀ φ, for forces at (x, v) in a stage of a frame."""
        elements, parts = self._elements, [self._particle, self._weight]
        prepare = elements.prepare
        if prepare is not None:
            self._launch_once(lambda: prepare(*parts, x, phi, self._by_numbers))
        inputs = [elements.data, *self._apart, *parts, self._time, stage, x, v, phi, *self._by, self._by_numbers]
        self._launch(self._lead, self._count, inputs)
        self._launch(self._add, len(self._table[0]), [*self._table, *self._by, by_x, by_v])
