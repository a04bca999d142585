"""Found: numbers that a kernel finds about a whole state, and how they get to the host."""

from typing import Any

import warp as wp

from ...kernels.reductions import LOOKING_BLOCK, columns

MOST_BLOCKS = 512
"""Blocks of threads that look over a state on a GPU: some for each multiprocessor."""


class Found:
    """What is found about a state (`msdwarp.kernels.reductions.columns`): a device writes where the host reads.

    Attributes
    ----------
    there
        The array, as kernels write it.
    """

    def __init__(self, device: Any) -> None:
        count, self._device = columns.COLUMNS, device
        self._here = self.state_out = wp.zeros(count, dtype=wp.float64, device="cpu", pinned=device.is_cuda)
        self._seen = self._here.numpy()
        if device.is_cuda:
            self.state_out = wp.array(ptr=self._here.ptr, dtype=wp.float64, shape=count, device=device)
            self._written = wp.Event(device)

    def mark(self) -> None:
        """Have `read` wait for what has been launched by now."""
        if self._device.is_cuda:
            self._device.stream.record_event(self._written)

    def read(self) -> list[float]:
        """Wait up to the mark, and return the numbers: as Python's, with which the host is faster."""
        if self._device.is_cuda:
            wp.synchronize_event(self._written)
        return self._seen.tolist()


class Sweep:
    """Launches kernels that go over a state once, and add up in the same launch what their threads find.

    Parameters
    ----------
    device
        Where it is launched.
    count
        How many things there are at most of a kind to go over.
    columns
        How many numbers are found.
    """

    def __init__(self, device: Any, count: int, columns: int) -> None:
        blocks, self._threads = 1, 1
        if device.is_cuda:
            blocks = min(max(-(-count // LOOKING_BLOCK), 1), MOST_BLOCKS)
            self._threads = LOOKING_BLOCK * blocks
        self._device = device
        self._between = [
            self._threads,
            wp.zeros((columns, blocks), dtype=wp.float64, device=device),
            wp.zeros(1, dtype=int, device=device),
        ]

    def launch(self, kernel: Any, inputs: list[Any], found: wp.array) -> None:
        """Launch a kernel; it may be recorded."""
        inputs = [*inputs, *self._between]
        wp.launch(kernel, self._threads, inputs, [found], device=self._device, block_dim=LOOKING_BLOCK)
