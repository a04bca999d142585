"""Fracture: springs that break for good; which of them are broken becomes state."""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from ...bodies import break_stretch
from ...kernels.springs import NO_SUBSTEP, breaking
from ..device.device import scalar_array, upload_fields
from ..model.effect import Effect
from ..model.model import Model

JOINED = {"scatter": "connections", "gather": "other", "stencil": "mask"}
"""The array of an algorithm that says who is joined with whom."""


class Fracture(Effect):
    """Lets springs of a model break at the start of each substep; see `msdwarp.kernels.springs.fracture`.

    The algorithms look for springs that are too long, since they compute all lengths. Each has an array of who is
    joined with whom, and removes broken springs from it.
    """

    piece = None

    def __init__(self, model: Model) -> None:
        self._model = model
        self.breaking = breaking(model.scalar)
        """What the algorithms are composed with."""
        system, device = model.system, model.device
        # Rounded so that what is broken stays so.
        rounded = np.minimum(system.broken_at, np.finfo(np.float32).max)
        broken_at = np.where(system.broken, rounded, np.inf).astype(np.float32)
        self.broken_at = wp.array(model.of_each_world(broken_at[None]), dtype=wp.float32, device=device)
        """When springs broke [s], in the device's order, world after world; inf where they are whole."""
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
        # What energies and bounds are summed of.
        self._summed = [data.stiffness, data.damping]
        if data.steepest is not data.damping:
            self._summed.append(data.steepest)
        self._joined: list[wp.array] = []
        self.joined_field = JOINED[model.force_algorithm]
        """Name of the algorithm's array from which broken springs are removed."""
        self._strike_out: Callable[[], None] = lambda: None

    def _give_each_world_its_own(self) -> None:
        """Upload, for each world, the constants that breaking changes."""
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
        """Give each world its own copy of the array from which broken springs are removed."""
        one = getattr(forces, self.joined_field)
        each = np.tile(one.numpy(), (self._model.worlds, *[1] * (one.numpy().ndim - 1)))
        joined = wp.array(each, dtype=one.dtype, device=one.device)
        setattr(forces, self.joined_field, joined)
        self._joined = [joined]

    def carry_out(self, joined: wp.array, strike_out: Callable[[], None]) -> None:
        """Keep an algorithm's array of who is joined, and remove the springs that are broken already."""
        self._joined.append(joined)
        self._strike_out = strike_out
        strike_out()

    @property
    def broken(self) -> NDArray[np.bool_]:
        """Which springs are broken, in the device's order, shape [connection_count]; of the first world."""
        return np.isfinite(self.broken_at.numpy()[: self._model.connection_count])

    def begin(self, substeps: int, dt: float) -> None:
        """Prepare for frames of this many substeps of `dt` seconds."""
        self.data.h, self.data.substep = dt, NO_SUBSTEP

    def begin_frame(self, time: float) -> None:
        """Note when the frame begins [s]."""
        self.data.start.assign(np.array([time]))

    def begin_substep(self, substep: int) -> bool:
        """Make the next launch begin a substep."""
        self.data.substep = substep
        return True

    @property
    def changing(self) -> list[wp.array]:
        """When springs broke, and the arrays that follow from it."""
        return [self.broken_at, *self._summed, *self._joined]

    def checkpoint(self) -> dict[str, NDArray]:
        """Return the time at which each spring of the system broke [s], inf if it is whole."""
        return {"broken_at": self._model.in_system_order(np.array(self.broken_at.numpy()))}

    def restore(self, arrays: Mapping[str, NDArray]) -> None:
        """Restore the state that `checkpoint` returned; the same springs or more are broken in it."""
        self.broken_at.assign(self._model.ordered(arrays["broken_at"]))
        broken = self.broken
        for constants in self._summed:
            constants.assign(np.where(broken, 0, constants.numpy()))
        self._strike_out()

    def changed_fields(self) -> dict[str, NDArray]:
        """Return when the system's springs broke."""
        return self.checkpoint()


def _least_ratio(model: Model, rest_length: NDArray[np.float64], stretch: NDArray[np.float64]) -> float:
    """Return a length over the rest length up to which no spring breaks, however far it yields."""
    system, whole = model.system, ~model.system.broken
    if not whole.any():
        return np.inf
    rest = rest_length
    if system.yields:
        original = rest_length if "rest_length" in model.rows else system.original_length
        rest = np.maximum(rest_length, original * (1 + system.largest_plastic_strain))
    return 1 + float(np.minimum(system.break_strain, stretch / rest)[whole].min())
