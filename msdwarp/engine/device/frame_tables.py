"""Frame tables: time-dependent values on a device, in tables that are filled for each frame."""

import math
from collections.abc import Callable, Mapping
from typing import Any

import warp as wp
from numpy.typing import NDArray

from .device import view_of

Tables = dict[str, NDArray]
"""Tables by name, in the device's precision; coordinates of vectors and matrices are the last axes."""
Fill = Callable[[float, Tables], None]
_ALIGNED = 4
"""Required alignment of tables, in numbers, for fast reads on the device."""


class InFrames:
    """Tables on a device with values that the host computes for each frame: poses, forces, rest lengths.

    All tables share one allocation, on the device and on the host, so a frame needs one copy. A frame can be
    prepared while the previous frame runs.

    `tables` has the shape and the Warp type of each table by name, all with the scalar type `scalar`.
    A function `fill(time, tables)` writes the host's tables for the frame that begins at `time` [s]; other entries
    keep their values, at first 0. `arrays` are the tables on the device, `tables` those on the host.
    """

    def __init__(self, tables: Mapping[str, tuple[tuple[int, ...], Any]], scalar: Any, device: Any) -> None:
        places, total = {}, 0
        for name, (shape, dtype) in tables.items():
            whole = (*shape, *getattr(dtype, "_shape_", ()))
            places[name] = total, whole
            total += -(-math.prod(whole) // _ALIGNED) * _ALIGNED
        self._device, self._there = device, wp.zeros(total, dtype=scalar, device=device)
        # Only pinned memory can be copied asynchronously.
        self._here = wp.zeros(total, dtype=scalar, device="cpu", pinned=device.is_cuda)
        self._copied = wp.Event(device) if device.is_cuda else None
        numbers, size = self._here.numpy(), wp.types.type_size_in_bytes(scalar)
        self.tables: Tables = {}
        self.arrays: dict[str, wp.array] = {}
        for name, (first, whole) in places.items():
            shape, dtype = tables[name]
            self.tables[name] = numbers[first : first + math.prod(whole)].reshape(whole)
            self.arrays[name] = view_of(self._there, shape, dtype=dtype, offset=first * size)
        self._holds: float | None = None
        """The start of the frame in the host's tables [s]; None if they belong to no frame."""

    def prepare(self, time: float, fill: Fill) -> None:
        """Fill the host's tables for the frame that begins at `time` [s], while another frame may be running.

        An error is raised only when that frame begins.
        """
        try:
            self._fill_in(time, fill)
        except Exception:
            self._holds = None

    def begin_frame(self, time: float, fill: Fill) -> None:
        """Upload the tables of the frame that begins at `time` [s]; first fill them unless `prepare` has done so.

        If `fill` raises, the device's tables stay as they are.
        """
        if self._holds != time:
            self._fill_in(time, fill)
        self._holds = None  # each frame is filled once, since functions may return other values when called again
        self._copy()

    def upload(self, fill: Callable[[Tables], None]) -> None:
        """Change the current tables by `fill`, and upload them; they are valid until a frame begins."""
        self._wait()
        self._holds = None
        fill(self.tables)
        self._copy()

    def _fill_in(self, time: float, fill: Fill) -> None:
        """Fill the host's tables for the frame that begins at `time` [s]."""
        self._holds = None
        self._wait()
        fill(time, self.tables)
        self._holds = time

    def _copy(self) -> None:
        """Launch the device's copy of the host's tables."""
        wp.copy(self._there, self._here)
        if self._copied is not None:
            self._device.stream.record_event(self._copied)

    def _wait(self) -> None:
        """Wait until the device has read the host's tables; they may then be overwritten."""
        if self._copied is not None:
            wp.synchronize_event(self._copied)
