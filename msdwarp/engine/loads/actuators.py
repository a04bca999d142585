"""The actuators (muscles) of a scene, on a device."""

from collections.abc import Sequence
from math import lcm

import numpy as np
import warp as wp
from numpy.typing import NDArray

from ...kernels.loads.actuators import actuated_springs, add_tension
from ...world import Actuator, Load
from ..device.csr import rows
from ..device.device import upload_fields
from ..model.effect import Parameter
from ..model.model import Model
from ..model.stage_tables import StageTables

AHEAD = np.arange(600) / 60.0
"""Times at which the stability bound evaluates actuators' strains [s]."""


def actuators_of(model: Model, loads: Sequence[Load]) -> "ActuatedSprings | None":
    """Return the effect of the scene's actuators; None if it has none."""
    named = [(f"loads[{k}].strain", one) for k, one in enumerate(loads) if isinstance(one, Actuator)]
    return ActuatedSprings(model, named) if named else None


class ActuatedSprings(StageTables):
    """Springs whose rest lengths are functions of time; the change of length acts as an extra tension."""

    table = "strain"

    def __init__(self, model: Model, named: Sequence[tuple[str, Actuator]]) -> None:
        self._model, self.named = model, named
        self.piece = actuated_springs(model.dim, model.scalar, model.compensated)
        model.kernels.note(add_tension(model.dim, model.scalar))
        # The table has a column for each delay of each actuator.
        self._delays: list[NDArray[np.float64]] = []
        connections, columns, column_count = [], [], 0
        for _, one in named:
            chosen = one.connections(model.system)
            delays, which = np.unique(one.delays(model.system, chosen), return_inverse=True)
            self._delays.append(delays)
            connections.append(chosen)
            columns.append(column_count + which)
            column_count += len(delays)
        self.connection, self.column = np.concatenate(connections), np.concatenate(columns)
        springs, lengths = self._row("stiffness"), self._row("rest_length")
        row = np.arange(lcm(len(springs), len(lengths)))
        strength = springs[row % len(springs)] * lengths[row % len(lengths)]
        # Entries are sorted by particle; each spring has an entry for each end.
        ends = model.system.connections[self.connection]
        particle, other = ends.T.ravel(), ends[:, ::-1].T.ravel()
        order, first = rows(particle, model.particle_count)
        self.members = np.diff(first) > 0
        data = self.data = self.piece.Data()
        each = np.tile(strength, (1, 2))[:, order]
        if len(each) > 1:
            self.by_world, each = ("strength",), np.tile(each, (model.worlds // len(each), 1))
        column = np.tile(self.column, 2)[order]
        upload_fields(data, model.device, first=first, other=other[order], column=column, strength=each.ravel())
        self.set_up(model, column_count, model.scalar, varies=any(one.varies for _, one in named))

    def _row(self, name: str) -> NDArray[np.float64]:
        """Return a parameter of actuated springs, shape [rows, actuated_count]; world w has row w mod rows."""
        return self._model.row_of(name)[:, self.connection]

    def parameters(self) -> dict[str, Parameter]:
        """Return the actuators' strains, for gradients."""
        return {"strain": Parameter(lambda sums: sums[..., 0], varies=True)}

    def add_blocks(self, x: wp.array, v: wp.array, stiffness: wp.array, damping: wp.array, world: int = 0) -> None:
        """Add the transverse stiffness of actuators that contract, at their smallest strain (`_least`)."""
        model, system = self._model, self._model.system
        device, chosen = model.device, self.connection
        least = np.repeat([self._least(one) for _, one in self.named], [len(each) for each in self._delays])
        strain = np.minimum(0.0, least)[self.column]
        inputs = [wp.array(system.connections[chosen], dtype=wp.vec2i, device=device)]
        lengths, springs = self._row("rest_length"), self._row("stiffness")
        for values in (lengths[world % len(lengths)], springs[world % len(springs)], strain):
            inputs.append(wp.array(values, dtype=wp.float64, device=device))
        kernel = add_tension(model.dim, model.scalar)
        wp.launch(kernel, len(chosen), [*inputs, x], [stiffness], device=device)

    def _least(self, one: Actuator) -> float:
        """Return an actuator's smallest strain at the times AHEAD; where undefined there, the strain at time 0."""
        try:
            return float(one.at(AHEAD).min())
        except ValueError:  # the strain may be defined for a shorter run only
            return float(one.at(np.zeros(1))[0])

    def at(self, times: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the strain of each column at each time, shape [time_count, column_count]."""
        found = []
        for (name, one), delays in zip(self.named, self._delays, strict=True):
            when = np.subtract.outer(times, delays)
            found.append(one.at(when.ravel(), name).reshape(when.shape))
        return np.concatenate(found, axis=1)
