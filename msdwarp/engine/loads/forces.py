"""The forces of a scene on particles, on a device."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from ...bodies import check_types
from ...kernels.loads.forces import (
    add_function_slopes,
    function_force,
    function_values,
    given_force,
    weight_force,
)
from ...world import Falling, Force, Load
from ..device.device import upload_fields
from ..model.effect import Effect, Elements, Parameter
from ..model.model import Model
from ..model.stage_tables import MOST_LOOKED_AT, StageTables, exchanged

MOST_AHEAD = 64.0
"""Largest rate of a function where a particle goes next that is believed, times a frame: it may not get there."""
Named = Sequence[tuple[str, Force]]
"""Forces, each with its name in messages."""


def forces_of_loads(model: Model, loads: Sequence[Load]) -> list[Effect]:
    """Return the effects of the forces among the loads of a scene."""
    named = [(f"loads[{k}].force", one) for k, one in enumerate(loads) if isinstance(one, Force)]
    steady = [(name, one) for name, one in named if not one.varies and not one.of_place]
    varying = [(name, one) for name, one in named if one.varies]
    functions = [(name, one) for name, one in named if one.of_place]
    effects: list[Effect] = [Steady(model, steady)] if steady else []
    effects += [Varying(model, varying)] if varying else []
    effects += [Weight(model, model.falling)] if model.falling is not None and not model.driven.all() else []
    return effects + [ForceField(model, name, one, k) for k, (name, one) in enumerate(functions)]


def combinations(model: Model, forces: Named) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return the distinct combinations of forces on particles, and the index of each particle's combination.

    A combination is a fraction of each force, shape [combination_count, force_count]; the first is all zeros.
    """
    chosen = np.stack([one.particles(model.system) for _, one in forces], axis=1)
    sharing = [int(each.sum()) if one.total else 1 for (_, one), each in zip(forces, chosen.T, strict=True)]
    kinds, combination = np.unique(chosen, axis=0, return_inverse=True)
    nobody = np.zeros((1, len(forces)), dtype=bool)
    if kinds[0].any():  # rows are sorted: the combination without forces comes first
        kinds, combination = np.concatenate([nobody, kinds]), combination + 1
    return kinds / np.array(sharing, dtype=np.float64), combination.ravel()


class GivenForces(Effect):
    """Common base of constant forces and forces that are functions of time."""

    def __init__(self, model: Model, forces: Named, varies: bool) -> None:
        term, self._law = given_force(model.dim, model.scalar, model.compensated, varies)
        self.term, self.data, self._model, self.named = term, term.Data(), model, forces
        self._weights, self._combination = combinations(model, forces)
        self.members = self._combination > 0
        upload_fields(self.data, model.device, combination=self._combination)

    def elements(self) -> Elements:
        """Return the particles that the forces act on, as elements for gradients, grouped by combination."""
        particle = np.flatnonzero(self._combination)
        group = self._combination[particle]
        return Elements(self.data, self._law, particle[:, None], group=group, of_motion=False)

    def parameters(self) -> dict[str, Parameter]:
        """Return the forces as parameters, for gradients, which convert derivatives by those of combinations."""
        return {
            name: Parameter(lambda sums, weights=weights: weights @ sums, one.varies)
            for (name, one), weights in zip(self.named, self._weights.T, strict=True)
        }


class Steady(GivenForces):
    """Constant forces."""

    def __init__(self, model: Model, forces: Named) -> None:
        super().__init__(model, forces, varies=False)
        self.sums = self._of(forces)
        """The force on the particles of each combination [N], shape [combination_count, d]."""
        upload_fields(self.data, model.device, value=self.sums[None])

    def _of(self, forces: Named) -> NDArray[np.float64]:
        """Return the force of each combination [N]."""
        return self._weights @ np.array([one.at(np.zeros(1), self._model.dim, name)[0] for name, one in forces])

    def exchange(self, others: Mapping[Load, Load]) -> None:
        """Replace forces by other forces on the same particles."""
        forces = exchanged(self.named, others)
        self.sums, self.named = self._of(forces), forces
        self.data.value.assign(self.sums[None])


class Varying(GivenForces, StageTables):
    """Forces that are functions of time."""

    def __init__(self, model: Model, forces: Named) -> None:
        super().__init__(model, forces, varies=True)
        self.set_up(model, len(self._weights), model.vector, varies=True)

    def at(self, times: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the force of each combination at each time [N], shape [time_count, combination_count, d]."""
        return self._weights @ super().at(times)


class Weight(StageTables):
    """The weight of particles under time-dependent gravity."""

    table = "gravity"

    def __init__(self, model: Model, falling: Falling) -> None:
        self.named = [("gravity", falling)]
        self.term = weight_force(model.dim, model.scalar, model.compensated)
        self.data, self.members = self.term.Data(), np.isfinite(model.mass)
        self.set_up(model, 1, model.vector, varies=True)


class ForceField(Effect):
    """A force that is a function of position, velocity and time, on the device."""

    def __init__(self, model: Model, name: str, force: Force, number: int) -> None:
        kinds = {"x": model.vector, "v": model.vector, "t": model.scalar, "i": wp.int32}
        used = check_types(name, force.force, kinds, model.vector)
        own = force.force, number, "v" in used
        term, self._law = function_force(model.dim, model.scalar, model.compensated, *own)
        self._name, self.timed = name, "t" in used
        self._values = function_values(model.dim, model.scalar, force.force)
        self.term, self.data, self.members = term, term.Data(), force.particles(model.system)
        self._model, self._time, self._on = model, 0.0, np.flatnonzero(self.members)
        self._slopes = add_function_slopes(model.dim, model.scalar, force.force)
        model.kernels.note(self._slopes, *([self._values] if self.timed else []))
        self._member = wp.array(self._on, dtype=int, device=model.device)
        self._size = float(np.ptp(model.system.position, axis=0).max()) or 1.0

    def hold(self, time: float) -> None:
        """Have the next bound begin at `time` [s]."""
        self._time = time

    def look_ahead(self, times: NDArray[np.float64], x: Any, v: Any) -> dict[str, NDArray[np.float64]]:
        """Return the force on some of the particles at their present places."""
        model, member = self._model, self._member[:: -(-len(self._on) // MOST_LOOKED_AT)]
        found = wp.zeros((len(times), len(member)), dtype=model.vector, device=model.device)
        inputs = [member, x, v, wp.array(times, dtype=model.scalar, device=model.device)]
        wp.launch(self._values, found.shape, inputs, [found], device=model.device)
        return {self._name: found.numpy().astype(np.float64)}

    def add_blocks(self, x: wp.array, v: wp.array, stiffness: wp.array, damping: wp.array, world: int = 0) -> None:
        """Add half of |∂F/∂x| and |∂F/∂v| of each particle."""
        self.add_slopes(x, v, stiffness.reshape((1, -1)), damping.reshape((1, -1)), world)

    def add_slopes(
        self, x: wp.array, v: wp.array, stiffness: wp.array, damping: wp.array, first: int = 0, places: int = 1
    ) -> None:
        """Do so in worlds from the `first` on, shape [worlds, ...]; with 3 places the largest in a frame's way."""
        masses, fps, stride = self._model.table("inverse_mass"), self.steps.fps, self._model.stride
        numbers = [first, stride, self._time, 1.0 / fps, self._size, MOST_AHEAD * fps, places]
        inputs, shape = [self._member, masses, x, v, *numbers], (len(stiffness), len(self._on))
        wp.launch(self._slopes, shape, inputs, [stiffness, damping], device=self._model.device)

    def elements(self) -> Elements:
        """Return the particles that the force acts on, as elements for gradients."""
        return Elements(self.data, self._law, self._on[:, None])
