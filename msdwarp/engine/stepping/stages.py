"""A substep as data: the stages of a method, and the solves between them."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import warp as wp
from numpy.typing import NDArray


class Stage(NamedTuple):
    """One pass over all particles: forces are evaluated where the method asks for them, then particles advance."""

    method: Any
    """One of the functions of `msdwarp.kernels.integrators`."""
    fields: dict[str, Any]
    """The fields of its `Step`: arrays that it reads and writes, and its numbers."""

    def step(self, composition: Any) -> Any:
        """Return the fields as the struct that kernels take."""
        step = self.method(composition).Step()
        for name, value in self.fields.items():
            setattr(step, name, value)
        return step


class Solve(NamedTuple):
    """Launches of a method's own between two stages, such as those of a linear solver."""

    launch: Callable[[Any], None]
    """Makes the launches, given the `Dynamics`."""


class StageArrays:
    """Arrays of stages that are read later than they are made: memory stays as long as a recorded launch may."""

    def __init__(self) -> None:
        self._kept: dict[bytes, NDArray[np.uint8]] = {}

    def of_one(self, step: Any, kernel: Any, device: Any) -> wp.array:
        """Return one step as the array that the second argument of a kernel takes."""
        # Warp has one kernel for all that are alike to the letter: its own type of a step may be that of another
        # composition, with the same fields.
        Step: Any = kernel.adj.args[1].type.dtype
        raw = bytes(step.__ctype__())
        if raw not in self._kept:  # not copied by Warp, which would record the copy
            self._kept[raw] = np.frombuffer(2 * raw, dtype=np.uint8).copy()
        return wp.array(ptr=self._kept[raw].ctypes.data, dtype=Step, shape=2, device=device)
