"""An array on disk with the frames as its first axis."""

from typing import Any

import numpy as np
from numpy.typing import NDArray


class FrameArray:
    """An array on disk with the frames as its first axis: what it is indexed with is read, and no more.

    Each index counts for its own axis: a number, a slice, or a list, array or mask of several.
    """

    def __init__(self, dataset: Any, frames: int, stride: int, count: int, axes: list[int] | None = None) -> None:
        self._dataset, self._stride, self._axes = dataset, stride, axes
        self.shape = (frames, count) if axes is None else (frames, count, len(axes))
        self.dtype, self.ndim = dataset.dtype, len(self.shape)

    def __len__(self) -> int:
        """Return the number of frames."""
        return self.shape[0]

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray:
        """Return all of it."""
        return np.asarray(self[:], dtype=dtype)

    def __getitem__(self, key: Any) -> NDArray:
        """Return a part of it, as an array of its own."""
        keys = key if isinstance(key, tuple) else (key,)
        dots = [k for k, one in enumerate(keys) if one is Ellipsis]
        if len(keys) - len(dots) > self.ndim or len(dots) > 1:
            raise IndexError(f"{len(keys)} indices are given; there are {self.ndim} axes")
        at = dots[0] if dots else len(keys)
        whole = [slice(None)] * (self.ndim - len(keys) + len(dots))
        frames, items, *coordinates = *keys[:at], *whole, *keys[at + 1 :]
        values = self._read(_chosen(self.shape[0], frames), _chosen(self.shape[1], items))
        values = values[..., coordinates[0]] if coordinates else values
        values = values[:, 0] if isinstance(items, int | np.integer) else values
        return values[0] if isinstance(frames, int | np.integer) else values

    def _read(self, frames: NDArray[np.intp], items: NDArray[np.intp]) -> NDArray:
        """Return some items of some frames."""
        values = np.empty((len(frames), len(items), *self.shape[2:]), dtype=self.dtype)
        if not values.size:
            return values
        low, high, start = items.min(), items.max() + 1, frames[0] * self._stride
        axes = ... if self._axes is None or len(self._axes) == 3 else (..., self._axes)
        step = frames[1] - frames[0] if len(frames) > 1 else 1
        if high - low == 1 and step > 0 and np.all(np.diff(frames) == step):  # one item's path
            stop = frames[-1] * self._stride + high
            values[:] = self._dataset[start + low : stop : step * self._stride][axes][:, None]
            return values
        every = len(items) == high - low and np.all(np.diff(items) == 1)
        for k, frame in enumerate(frames):
            rows = self._dataset[frame * self._stride + low : frame * self._stride + high][axes]
            values[k] = rows if every else rows[items - low]
        return values


def _chosen(count: int, key: Any) -> NDArray[np.intp]:
    """Return the numbers of what an index chooses among so many."""
    return np.atleast_1d(np.arange(count)[key])
