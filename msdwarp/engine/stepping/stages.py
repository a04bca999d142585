"""A substep as data: the stages of a method, and solves between them."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import warp as wp
from numpy.typing import NDArray


class Stage(NamedTuple):
    """One pass over all particles: evaluate forces, if the method needs them, and advance."""

    method: Any
    """One of the functions of `msdwarp.kernels.integrators`."""
    fields: dict[str, Any]
    """The fields of the method's `Step`: arrays that a stage reads and writes, and numbers."""

    def step(self, composition: Any) -> Any:
        """Return the fields as the struct `Step` that the method's kernels take."""
        step = self.method(composition).Step()
        for name, value in self.fields.items():
            setattr(step, name, value)
        return step


class Solve(NamedTuple):
    """Launches of a method itself between two stages, such as those of a linear solver."""

    launch: Callable[[Any], None]
    """Function of the `Dynamics` that makes the launches."""


class StageArrays:
    """Makes the arrays of stages that recorded launches read, and keeps their memory alive."""

    def __init__(self) -> None:
        self._kept: dict[bytes, NDArray[np.uint8]] = {}

    def array_of(self, step: Any, kernel: Any, device: Any) -> wp.array:
        """Return the struct of a stage as an array of shape [2, 1], the argument of kernels of many stages."""
        raw = bytes(step.__ctype__())
        if raw not in self._kept:  # NumPy copies it, since Warp would record the copy
            self._kept[raw] = np.frombuffer(2 * raw, dtype=np.uint8).copy()
        return wp.array(ptr=self._kept[raw].ctypes.data, dtype=_type_in(kernel), shape=(2, 1), device=device)


def stages_for(kernel: Any, stages: wp.array) -> wp.array:
    """Return an array of structs of stages as the type of a kernel's second argument."""
    Step = _type_in(kernel)
    if stages.dtype is Step:
        return stages
    return wp.array(ptr=stages.ptr, dtype=Step, shape=stages.shape, device=stages.device)


def _type_in(kernel: Any) -> Any:
    """Return the struct of stages in a kernel's second argument.

    Warp shares one kernel among identical sources, such as those of a law of springs that is defined twice. So the
    struct may come from another composition, with the same fields.
    """
    return kernel.adj.args[1].type.dtype
