"""Sums of derivatives by numbers that the elements of a group have in common, on a device."""

from collections.abc import Callable
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from ...kernels.adjoint.elements import sum_numbers
from ..device.csr import rows
from ..model.model import Model

THREADS = 256
"""Threads of a block, which sums one number of a group."""


class NumberSums:
    """Sums the contributions of elements to the derivatives by numbers of their groups, in a fixed order.

    Parameters
    ----------
    model
        The system.
    group
        The group of each element of a world, -1 for none.
    numbers
        How many numbers each element has.
    stages
        Number of stages of a frame that have separate sums; 1 for common sums.
    launch_once
        Function that calls its argument, which launches kernels, in only one of the threads that share a frame.

    Attributes
    ----------
    each
        Contributions of elements since the last `add_up`, shape [worlds element_count, numbers].
    total
        The sums, float64 of shape [worlds, stages, group_count, numbers].
    varies
        Whether stages have separate sums; then `add_up` must be called after each.
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
        """Launch the addition of `each` to `total`, in float64; it sets `each` to 0."""
        threads, device = THREADS if self._model.device.is_cuda else 1, self._model.device
        inputs = [*self._rows, self._count, stage, self.each, self.total]
        kernel, count = sum_numbers(self._model.scalar), self._blocks * threads
        self._launch_once(lambda: wp.launch(kernel, count, inputs, device=device, block_dim=threads))

    def take(self) -> NDArray[np.float64]:
        """Return the sums, and set them to 0."""
        found = np.array(self.total.numpy(), dtype=np.float64)  # copied: on a CPU numpy() is a view
        self.total.zero_()
        return found
