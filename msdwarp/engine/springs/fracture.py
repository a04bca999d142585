"""Fracture: springs that break permanently; the times of breaking are part of the state."""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from ...bodies import break_stretch
from ...kernels.springs.fracture import NO_SUBSTEP, breaking
from ..device.device import scalar_array, upload_fields
from ..model.effect import Effect
from ..model.model import Model

JOINED = {"scatter": "connections", "gather": "other", "stencil": "mask"}
"""The array of each algorithm that has the pairs of connected particles."""


class Fracture(Effect):
    """Lets springs of a model break at the start of each substep; see `msdwarp.kernels.springs.fracture`.

    The force algorithms compute all lengths, so they also find overstretched springs. Each algorithm has an array
    of connected particles, from which it removes broken springs.
    """

    term = None
    numbers_substeps = True

    conserves = True

    def __init__(self, model: Model) -> None:
        self._model = model
        self.breaking = breaking(model.scalar)
        """Device functions of breaking, with which the force algorithms are composed."""
        system, device = model.system, model.device
        # Clipped to finite values, since inf in float32 would mean an unbroken spring.
        rounded = np.minimum(system.broken_at, np.finfo(np.float32).max)
        broken_at = np.where(system.broken, rounded, np.inf).astype(np.float32)
        self.broken_at = wp.array(model.of_each_world(broken_at[None]), dtype=wp.float32, device=device)
        """Time of breaking of each spring [s], inf if unbroken; in the device's order, concatenated by world."""
        data = self.data = self.breaking.Data()
        data.substep, data.start = NO_SUBSTEP, wp.zeros(1, dtype=wp.float64, device=device)
        data.number = wp.zeros(0, dtype=int, device=device)
        stretches = [break_stretch(system.break_force, stiffness) for stiffness in model.row_of("stiffness")]
        least = min(_least_ratio(model, rest, one) for rest in model.row_of("rest_length") for one in stretches)
        data.least = model.scalar(least**2 * (1 - 16 * float(np.finfo(model.dtype).eps)))
        for name, values in (("strain", system.break_strain), ("stretch", stretches[0])):
            setattr(data, name, scalar_array(model.ordered(values), model.scalar, device))
        data.broken_at, data.steepest = self.broken_at, model.steepest_damping
        data.stiffness, data.damping = model.stiffness, model.damping
        if model.in_worlds:
            self._give_each_world_its_own()
        if "stiffness" in model.rows:
            self.by_world = (*self.by_world, "stretch")
            upload_fields(data, device, stretch=model.of_each_world(np.array(stretches)))
        # The constants from which energies and bounds are computed.
        self._summed = [data.stiffness, data.damping]
        if data.steepest is not data.damping:
            self._summed.append(data.steepest)
        self._joined: list[wp.array] = []
        self.joined_field = JOINED[model.force_algorithm]
        """Name of the algorithm's array of connected particles, from which broken springs are removed."""
        self._strike_out: Callable[[], None] = lambda: None

    def _give_each_world_its_own(self) -> None:
        """Upload separate arrays of constants for each world, since breaking springs change them."""
        model, data, whole = self._model, self.data, ~self._model.system.broken
        self.by_world = ("broken_at", "stiffness", "damping", "steepest")
        rows = {name: model.row_of(name) for name in ("stiffness", "damping")}
        rows["steepest_damping"] = model.system.damper.steepest * rows["damping"]
        for name, values in rows.items():
            each = model.of_each_world(np.where(whole, values, 0.0))
            array = wp.array(each, dtype=model.scalar, device=model.device)
            setattr(data, name.removesuffix("_damping"), array)
            model.tables[name] = array.reshape((model.worlds, model.connection_count))

    def repeat_for_worlds(self, forces: Any) -> None:
        """Give each world its own copy of the array of connected particles."""
        one = getattr(forces, self.joined_field)
        each = np.tile(one.numpy(), (self._model.worlds, *[1] * (one.numpy().ndim - 1)))
        joined = wp.array(each, dtype=one.dtype, device=one.device)
        setattr(forces, self.joined_field, joined)
        self._joined = [joined]

    def carry_out(self, joined: wp.array, strike_out: Callable[[], None]) -> None:
        """Register a force algorithm's array of connected particles; remove springs that are already broken."""
        self._joined.append(joined)
        self._strike_out = strike_out
        strike_out()

    @property
    def broken(self) -> NDArray[np.bool_]:
        """Mask of the broken springs of the first world, in the device's order, shape [connection_count]."""
        return np.isfinite(self.broken_at.numpy()[: self._model.connection_count])

    def begin(self, substeps: int, dt: float) -> None:
        """Prepare for frames of this many substeps of `dt` seconds."""
        self.data.h, self.data.substep = dt, NO_SUBSTEP

    def begin_frame(self, time: float) -> None:
        """Set the frame's start time [s]."""
        self.data.start.assign(np.array([time]))

    def begin_substep(self, substep: int) -> bool:
        """Set the number of the substep that the next launch begins."""
        self.data.substep = substep
        return True

    @property
    def changing(self) -> list[wp.array]:
        """The times at which springs broke, and the arrays that depend on them."""
        return [self.broken_at, *self._summed, *self._joined]

    def checkpoint(self) -> dict[str, NDArray]:
        """Return the time of breaking of each spring of the system [s], inf if unbroken."""
        return {"broken_at": self._model.in_system_order(np.array(self.broken_at.numpy()))}

    def restore(self, arrays: Mapping[str, NDArray]) -> None:
        """Restore the state from `checkpoint`; springs that are broken now must be broken in that state."""
        self.broken_at.assign(self._model.ordered(arrays["broken_at"]))
        broken = self.broken
        for constants in self._summed:
            constants.assign(np.where(broken, 0, constants.numpy()))
        self._strike_out()

    def changed_fields(self) -> dict[str, NDArray]:
        """Return the times at which the system's springs broke."""
        return self.checkpoint()


def _least_ratio(model: Model, rest_length: NDArray[np.float64], stretch: NDArray[np.float64]) -> float:
    """Return a ratio of length to rest length below which no spring breaks, even after plastic deformation."""
    system, whole = model.system, ~model.system.broken
    if not whole.any():
        return np.inf
    rest = rest_length
    if system.yields:
        original = rest_length if "rest_length" in model.rows else system.original_length
        rest = np.maximum(rest_length, original * (1 + system.largest_plastic_strain))
    return 1 + float(np.minimum(system.break_strain, stretch / rest)[whole].min())
