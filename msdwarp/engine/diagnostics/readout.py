"""Found: sums over the state of each world on the device, and their transfer to the host."""

from typing import Any

import warp as wp

from ...kernels.reductions import columns
from ...kernels.reductions.measure import SUMMING_BLOCKS
from ..model.model import Model

FEW = 64
"""Up to this number of particles or connections in a world, the sums use a small block of threads."""
MOST_BLOCKS = 512
"""Maximal number of blocks that sum over a state on a GPU: a few per multiprocessor."""


class Found:
    """Sums and extremes of the state of each world; `msdwarp.kernels.reductions.columns` lists them.

    For a single world the device writes the sums into host memory. In an ensemble they stay on the device. Kernels
    write `state_out`, an array of shape [worlds, COLUMNS].
    """

    def __init__(self, model: Model) -> None:
        shape, self._device = (model.worlds, columns.COLUMNS), model.device
        pinned = self._device.is_cuda and not model.in_worlds
        where = self._device if model.in_worlds else "cpu"
        self._here = self.state_out = wp.zeros(shape, dtype=wp.float64, device=where, pinned=pinned)
        if pinned:
            self.state_out = wp.array(ptr=self._here.ptr, dtype=wp.float64, shape=shape, device=self._device)
        if not model.in_worlds:
            self._seen = self._here.numpy()[0]
        if self._device.is_cuda:
            self._written = wp.Event(self._device)

    def mark(self) -> None:
        """Record an event after the launches so far; `wait` waits for it."""
        if self._device.is_cuda:
            self._device.stream.record_event(self._written)

    def wait(self) -> None:
        """Wait for the event of `mark`."""
        if self._device.is_cuda:
            wp.synchronize_event(self._written)

    def read(self) -> list[float]:
        """Wait for the device, and return the sums of a single world as a list, faster to read than arrays."""
        self.wait()
        return self._seen.tolist()


class Sweep:
    """Launches kernels that pass over all worlds once and combine the results of threads in the same launch.

    A world has up to `count` particles or connections; `found` is the number of sums.
    """

    def __init__(self, model: Model, count: int, found: int) -> None:
        worlds, self._device = model.worlds, model.device
        blocks, self.block = 1, 1
        if self._device.is_cuda:
            self.block = SUMMING_BLOCKS[0 if model.in_worlds and count <= FEW else 1]
            blocks = min(max(-(-count // self.block), 1), max(MOST_BLOCKS // worlds, 1))
        threads = self.block * blocks
        self._threads = worlds * threads
        self._between = [
            model.stride,
            threads,
            wp.zeros((worlds, found, blocks), dtype=wp.float64, device=self._device),
            wp.zeros(worlds, dtype=int, device=self._device),
        ]

    def launch(self, kernel: Any, inputs: list[Any], found: wp.array) -> None:
        """Launch a kernel, composed for `block` threads per block; a graph may record it."""
        inputs = [*inputs, *self._between]
        wp.launch(kernel, self._threads, inputs, [found], device=self._device, block_dim=self.block)
