"""Forcing: forces on particles, as a scene gives them, on a device."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import warp as wp
from numpy.typing import NDArray

from ..kernels.loads import function_force, steady_force, varying_force
from ..world import Force, Load
from .by_stage import ByStage
from .effect import Effect

if TYPE_CHECKING:
    from .model import Model


Named = Sequence[tuple[str, Force]]
"""Forces, and what they are called."""


def forcing(model: "Model", loads: Sequence[Load]) -> list[Effect]:
    """Return the effects of the forces among the loads of a scene."""
    named = [(f"loads[{k}]", one) for k, one in enumerate(loads) if isinstance(one, Force)]
    steady = [(name, one) for name, one in named if not one.varies]
    varying = [(name, one) for name, one in named if one.varies and not one.of_place]
    functions = [one for _, one in named if one.of_place]
    effects: list[Effect] = [Steady(model, steady)] if steady else []
    effects += [Varying(model, varying)] if varying else []
    return effects + [OfPlace(model, one, k) for k, one in enumerate(functions)]


def combinations(model: "Model", forces: Named) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return the different sums of forces that particles feel, and which of them each does.

    Returns
    -------
    shares, combination
        How much of each force is in each combination, shape [combination_count, force_count], the first one having
        none of any; and the combination of each particle, shape [particle_count].
    """
    chosen = np.stack([one.particles(model.system) for _, one in forces], axis=1)
    sharing = [int(each.sum()) if one.total else 1 for (_, one), each in zip(forces, chosen.T, strict=True)]
    kinds, combination = np.unique(chosen, axis=0, return_inverse=True)
    nobody = np.zeros((1, len(forces)), dtype=bool)
    if kinds[0].any():  # rows are sorted: nobody comes first
        kinds, combination = np.concatenate([nobody, kinds]), combination + 1
    return kinds / np.array(sharing, dtype=np.float64), combination.ravel()


class Steady(Effect):
    """Forces that are constant."""

    def __init__(self, model: "Model", forces: Named) -> None:
        self.piece = steady_force(model.dim, model.scalar, model.compensated)
        self.data = self.piece.Data()
        shares, combination = combinations(model, forces)
        self.members = combination > 0
        values = [one.at(np.zeros(1), model.dim, f"{name}.force")[0] for name, one in forces]
        for value, (name, _) in zip(values, forces, strict=True):
            model.check_range(value, f"{name}.force")
        self.sums = shares @ np.array(values)
        """The force on the particles of each combination [N], shape [combination_count, d]."""
        self.data.value = wp.array(self.sums, dtype=model.vector, device=model.device)
        self.data.combination = wp.array(combination, dtype=int, device=model.device)


class Varying(ByStage):
    """Forces that are functions of time."""

    def __init__(self, model: "Model", forces: Named) -> None:
        self._model, self._forces = model, forces
        self.piece = varying_force(model.dim, model.scalar, model.compensated)
        self.data = self.piece.Data()
        self._shares, combination = combinations(model, forces)
        self.members = combination > 0
        self.data.combination = wp.array(combination, dtype=int, device=model.device)
        self.set_up(model, len(self._shares), model.vector, varies=True)

    def place_table(self, table: wp.array) -> None:
        """Have kernels find the table of forces."""
        self.data.value = table

    def at(self, times: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the force of each combination at each time [N], shape [time_count, combination_count, d]."""
        values = np.empty((len(times), len(self._forces), self._model.dim))
        for k, (name, one) in enumerate(self._forces):
            values[:, k] = one.at(times, self._model.dim, f"{name}.force")
            self._model.check_range(values[:, k], f"{name}.force")
        return self._shares @ values


class OfPlace(Effect):
    """A force that is a function of place, speed and time, on the device."""

    def __init__(self, model: "Model", force: Force, number: int) -> None:
        self.piece = function_force(model.dim, model.scalar, model.compensated, force.force, number)
        self.data, self.members = self.piece.Data(), force.particles(model.system)
