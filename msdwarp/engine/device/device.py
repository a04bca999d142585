"""Precisions, and arrays uploaded to a device."""

from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from ...bodies import is_uniform

PRECISIONS = {
    "float32": (wp.float32, np.float32),
    "float32-compensated": (wp.float32, np.float32),
    "float64": (wp.float64, np.float64),
}


def scalar_array(values: NDArray[np.float64], scalar: Any, device: Any) -> wp.array:
    """Upload numbers; if all are equal, a single number is stored (a view with stride 0)."""
    if is_uniform(values):
        return view_of(wp.full(1, scalar(values[0]), dtype=scalar, device=device), len(values), (0,))
    return wp.array(values, dtype=scalar, device=device)


def upload_fields(data: Any, device: Any, **values: Any) -> None:
    """Upload arrays of numbers as fields of a kernel's struct, with the element type of each field."""
    for name, numbers in values.items():
        setattr(data, name, wp.array(numbers, dtype=data._cls.vars[name].type.dtype, device=device))


def view_of(array: Any, shape: Any, strides: Any = None, dtype: Any = None, offset: int = 0) -> wp.array:
    """Return a view of an array's memory from `offset` [bytes] on, with strides in bytes."""
    how = {"dtype": dtype or array.dtype, "device": array.device, "capacity": array.capacity}
    view = wp.array(ptr=int(array.ptr or 0) + offset, shape=shape, strides=strides, **how)
    view._ref = array  # a view does not own its memory
    return view
