"""Forcing: forces on particles, as a scene gives them, on a device."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, cast

import numpy as np
import warp as wp
from numpy.typing import NDArray

from ..kernels.loads import applied_force, function_force
from ..world import Falling, Force, Load
from .effect import Effect

if TYPE_CHECKING:
    from .model import Model


def forcing(model: "Model", loads: Sequence[Load]) -> list[Effect]:
    """Return the effects of the forces among the loads of a scene."""
    named = [(f"loads[{k}].force", one) for k, one in enumerate(loads) if isinstance(one, Force)]
    given = [(name, one) for name, one in named if not one.of_place]
    if model.falling is not None and np.any(model.falling.on):
        given.append(("gravity", model.falling))
    functions = [one for _, one in named if one.of_place]
    effects: list[Effect] = [Applied(model, given)] if given else []
    return effects + [OfPlace(model, one, k) for k, one in enumerate(functions)]


class Applied(Effect):
    """Forces that are given, as numbers or as functions of time."""

    def __init__(self, model: "Model", forces: Sequence[tuple[str, Force]]) -> None:
        self._model, self._forces = model, forces
        self.piece = applied_force(model.dim, model.scalar, model.compensated)
        chosen = [one.particles(model.system) for _, one in forces]
        self.members = np.logical_or.reduce(chosen)
        # The entries, particle by particle; of each particle in the order of the forces.
        particle = np.concatenate([np.flatnonzero(each) for each in chosen])
        number = np.repeat(np.arange(len(forces)), [each.sum() for each in chosen])
        shares = [_shares(model, one, each) for (_, one), each in zip(forces, chosen, strict=True)]
        order = np.argsort(particle, kind="stable")
        first = np.append(0, np.cumsum(np.bincount(particle, minlength=model.particle_count)))
        data = self.data = self.piece.Data()
        data.first = wp.array(first, dtype=int, device=model.device)
        data.number = wp.array(number[order], dtype=int, device=model.device)
        data.share = wp.array(np.concatenate(shares)[order], dtype=model.scalar, device=model.device)
        varies = [one.varies for _, one in forces]
        data.varies = wp.array(np.array(varies, dtype=np.int32), dtype=int, device=model.device)
        self._varies, self._now = any(varies), 0.0
        self._at(np.zeros(1))  # what a function gets wrong is said before anything runs

    def exchange(self, others: Mapping[Load, Load]) -> None:
        """Take other forces on the same particles."""
        before = self._forces
        self._forces = [(name, cast(Force, others.get(one, one))) for name, one in before]
        try:
            self._at(np.array([self._now]))
        except ValueError:
            self._forces = before
            raise

    def begin(self, substeps: int, dt: float) -> None:
        """Make room for the forces of a frame."""
        rows = len(self.steps.times(0.0)) if self._varies else 1
        shape = (rows, len(self._forces))
        self.data.value = wp.zeros(shape, dtype=self._model.vector, device=self._model.device)

    def begin_frame(self, time: float) -> None:
        """Take the forces of the frame that begins at `time` [s]."""
        if self._varies:
            self.data.value.assign(self._at(self.steps.times(time)))

    def hold(self, time: float) -> None:
        """Have all stages see the forces at `time` [s]."""
        self._now = time
        now = self._at(np.array([time]))
        self.data.value.assign(np.broadcast_to(now, (*self.data.value.shape, self._model.dim)))

    def _at(self, times: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return each force at each time [N], shape [time_count, force_count, d]."""
        values = np.empty((len(times), len(self._forces), self._model.dim))
        for k, (name, one) in enumerate(self._forces):
            values[:, k] = one.at(times, self._model.dim, name)
            self._model.check_range(values[:, k], name)
        return values


def _shares(model: "Model", force: Force, chosen: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Return how much of a force each of its particles feels: of gravity as much as it has mass [kg]."""
    if isinstance(force, Falling):
        return model.mass[chosen]
    count = int(chosen.sum())
    return np.full(count, 1.0 / count if force.total else 1.0)


class OfPlace(Effect):
    """A force that is a function of place, speed and time, on the device."""

    def __init__(self, model: "Model", force: Force, number: int) -> None:
        self.piece = function_force(model.dim, model.scalar, model.compensated, force.force, number)
        self.data, self.members = self.piece.Data(), force.particles(model.system)
