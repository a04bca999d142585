"""PinnedStaging: where arrays of a device arrive on the host."""

import threading
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

CAPTURE_LOCK = threading.Lock()
"""Held while a graph is recorded: no thread may wait for a device meanwhile."""


class PinnedStaging:
    """Pinned memory through which arrays come from a GPU to the host; on a CPU nothing is needed.

    `array.numpy()` allocates an array on the host and waits for the device, for each array. That takes longer than
    a frame of a small body. Here the copies are recorded once, and replayed together.
    """

    def __init__(self) -> None:
        self._pinned: list[wp.array] = []
        self._shown: list[NDArray] = []
        self._graph: Any = None
        self._recorded: list[wp.array] = []
        """What the graph copies."""
        self._landing = threading.Lock()
        """Held while anything is there: two threads may read frames."""

    def host_copies(self, *arrays: wp.array) -> list[NDArray]:
        """Return copies of arrays, the same in kind and number each time, when the device has written them."""
        device = wp.get_device(arrays[0].device)
        if not device.is_cuda:
            return [to_host(array) for array in arrays]
        with self._landing:
            if [one.ptr for one in arrays] != [one.ptr for one in self._recorded]:
                self._record(arrays)
            with CAPTURE_LOCK:
                wp.capture_launch(self._graph)
                wp.synchronize_stream(device)
            return [shown.copy() for shown in self._shown]

    def _record(self, arrays: tuple[wp.array, ...]) -> None:
        if not self._pinned:
            self._pinned = [wp.empty(len(one), dtype=one.dtype, device="cpu", pinned=True) for one in arrays]
            self._shown = [array.numpy() for array in self._pinned]
        with CAPTURE_LOCK, wp.ScopedCapture(device=arrays[0].device, force_module_load=False) as capture:
            for pinned, array in zip(self._pinned, arrays, strict=True):
                wp.copy(pinned, array)
        self._graph, self._recorded = capture.graph, list(arrays)


def to_host(array: wp.array) -> NDArray:
    """Copy to the host; on the CPU `numpy()` alone would show the array as it goes on changing."""
    return np.array(array.numpy())
