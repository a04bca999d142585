"""PinnedStaging: copies arrays from a device to the host."""

import threading
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from ..runtime import CAPTURE_LOCK, record


class PinnedStaging:
    """Copies arrays from a GPU through pinned memory, by one recorded graph.

    `array.numpy()` allocates host memory and waits for the device for each array, which takes longer than a frame
    of a small body.
    """

    def __init__(self) -> None:
        self._pinned: list[wp.array] = []
        self._views: list[NDArray] = []
        self._graph: Any = None
        self._recorded: list[wp.array] = []
        """The arrays that the graph copies."""
        self._lock = threading.Lock()
        """Locked while the pinned memory is in use, since two threads may read frames."""

    def host_copies(self, *arrays: wp.array) -> list[NDArray]:
        """Return host copies of device arrays, once written; shapes and types must be the same in all calls."""
        device = wp.get_device(arrays[0].device)
        if not device.is_cuda:
            return [to_host(array) for array in arrays]
        with self._lock:
            if [one.ptr for one in arrays] != [one.ptr for one in self._recorded]:
                self._record(arrays)
            with CAPTURE_LOCK:
                wp.capture_launch(self._graph)
                wp.synchronize_stream(device)
            return [view.copy() for view in self._views]

    def _record(self, arrays: tuple[wp.array, ...]) -> None:
        if not self._pinned:
            self._pinned = [wp.empty(len(one), dtype=one.dtype, device="cpu", pinned=True) for one in arrays]
            self._views = [array.numpy() for array in self._pinned]

        def copy() -> None:
            for pinned, array in zip(self._pinned, arrays, strict=True):
                wp.copy(pinned, array)

        self._graph, self._recorded = record(copy, arrays[0].device, force_module_load=False), list(arrays)


def to_host(array: wp.array) -> NDArray:
    """Return a copy on the host; on the CPU `numpy()` alone would share the array's memory."""
    return np.array(array.numpy())
