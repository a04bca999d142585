"""Sums of derivatives by the numbers of elements, which the elements of a group share, on a device."""

from collections.abc import Callable
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from ...kernels.adjoint import sum_numbers
from ..device.csr import rows
from ..model.model import Model

THREADS = 256
"""Threads that sum a number of a group."""


class NumberSums:
    """Adds up what elements add to the derivatives by their numbers, in an order that is fixed.

    Parameters
    ----------
    model
        The system.
    group
        The group of each element of a world, -1 for none.
    numbers
        How many numbers an element has.
    stages
        For how many stages of a frame there are sums; 1 if they are not told apart.
    launch_once
        Function that calls its argument, which launches kernels, in only one thread.

    Attributes
    ----------
    each
        What elements have added, shape [worlds element_count, numbers].
    total
        The sums, float64 of shape [worlds, stages, group_count, numbers].
    varies
        Whether stages are told apart; then `add_up` must be called after each.
    """

    def __init__(
        self,
        model: Model,
        group: NDArray[np.integer],
        numbers: int,
        stages: int,
        launch_once: Callable[[Callable[[], Any]], None],
    ) -> None:
        self._model, self._launch_once, self.varies, self._count = model, launch_once, stages > 1, len(group)
        chosen = np.flatnonzero(group >= 0)
        order, first = rows(group[chosen], groups := int(group.max()) + 1)
        self._rows = [wp.array(one, dtype=int, device=model.device) for one in (first, chosen[order])]
        shape = model.worlds, stages, groups, numbers
        self.each = wp.zeros((model.worlds * self._count, numbers), dtype=model.scalar, device=model.device)
        self.total: Any = wp.zeros(shape, dtype=wp.float64, device=model.device)
        self._blocks = model.worlds * groups * numbers

    def clear(self) -> None:
        """Set everything to 0."""
        self.each.zero_()
        self.total.zero_()

    def add_up(self, stage: int = 0) -> None:
        """Launch the sums of what has been added, in float64, and set it to 0."""
        threads, device = THREADS if self._model.device.is_cuda else 1, self._model.device
        inputs = [*self._rows, self._count, stage, self.each, self.total]
        kernel, count = sum_numbers(self._model.scalar), self._blocks * threads
        self._launch_once(lambda: wp.launch(kernel, count, inputs, device=device, block_dim=threads))

    def take(self) -> NDArray[np.float64]:
        """Return the sums, and set them to 0."""
        found = np.array(self.total.numpy(), dtype=np.float64)  # on a CPU it was a view
        self.total.zero_()
        return found
