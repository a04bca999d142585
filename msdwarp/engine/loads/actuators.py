"""The actuators (muscles) of a scene, on a device."""

from collections.abc import Sequence
from functools import cached_property
from math import lcm
from typing import Any

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
    """Springs whose rest lengths are functions of time; the change of length acts as an extra tension.

    Attributes
    ----------
    connection, column
        The springs, one after the other for each actuator, and the column of each in a row of strains.
    columns
        Number of columns for a row of strains or delays of an ensemble; the table has those of all rows.
    """

    table = "strain"

    def __init__(self, model: Model, named: Sequence[tuple[str, Actuator]]) -> None:
        self._model, self._strains = model, model.rows.get("strain")
        self.named = named if self._strains is None else [("strain", one) for _, one in named]
        self.term = actuated_springs(model.dim, model.scalar, model.compensated)
        model.kernels.note(add_tension(model.dim, model.scalar))
        # The table has a column for each delay of each actuator; in an ensemble so many for each of its rows.
        self._delays: list[NDArray[np.float64]] = []
        """The different delays of each actuator [s], shape [rows, any]."""
        own, connections, columns, self.columns = model.rows.get("delay"), [], [], 0
        for k, (_, one) in enumerate(named):
            chosen = one.connections(model.system)
            delays, which = _different(one.delays(model.system, chosen, None if own is None else own[:, k]))
            self._delays.append(delays)
            connections.append(chosen)
            columns.append(self.columns + which)
            self.columns += delays.shape[1]
        self.connection, self.column = np.concatenate(connections), np.concatenate(columns)
        # Of each column of a row, its actuator; in a scene with `StrainRows` also its delay, among all of them.
        self._actuator = np.repeat(np.arange(len(named)), [each.shape[1] for each in self._delays])
        if self._strains is not None:
            self._all_delays, self._delay = np.unique(np.concatenate(self._delays, axis=1)[0], return_inverse=True)
        springs, lengths = self._row("stiffness"), self._row("rest_length")
        row = np.arange(lcm(len(springs), len(lengths)))
        strength = springs[row % len(springs)] * lengths[row % len(lengths)]
        # Entries are sorted by particle; each spring has an entry for each end.
        ends = model.system.connections[self.connection]
        particle, other = ends.T.ravel(), ends[:, ::-1].T.ravel()
        order, first = rows(particle, model.particle_count)
        self.members = np.diff(first) > 0
        data = self.data = self.term.Data()
        each = np.tile(strength, (1, 2))[:, order]
        if len(each) > 1:
            self.by_world, each = ("strength",), np.tile(each, (model.worlds // len(each), 1))
        column = np.tile(self.column, 2)[order]
        differing = len(self._delays[0] if self._strains is None else self._strains)
        if differing > 1:
            self.by_world = (*self.by_world, "column")
            column = np.add.outer(np.arange(model.worlds) % differing * self.columns, column).ravel()
        upload_fields(data, model.device, first=first, other=other[order], column=column, strength=each.ravel())
        given = [one for _, one in named] if self._strains is None else [self._strains]
        self.set_up(model, differing * self.columns, model.scalar, varies=any(one.varies for one in given))

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
        strain = np.minimum(0.0, self._least[world % len(self._least)])[self.column]
        inputs = [wp.array(system.connections[chosen], dtype=wp.vec2i, device=device)]
        lengths, springs = self._row("rest_length"), self._row("stiffness")
        for values in (lengths[world % len(lengths)], springs[world % len(springs)], strain):
            inputs.append(wp.array(values, dtype=wp.float64, device=device))
        kernel = add_tension(model.dim, model.scalar)
        wp.launch(kernel, len(chosen), [*inputs, x], [stiffness], device=device)

    @cached_property
    def _least(self) -> NDArray[np.float64]:
        """The smallest strain of each column at the times AHEAD, shape [rows, columns].

        Where a function is undefined there, its strain at time 0: it may be defined for a shorter run only.
        """
        each: list[Any] = [one for _, one in self.named] if self._strains is None else [self._strains]
        found = []
        for one in each:
            try:
                found.append(one.at(AHEAD).min(axis=0))
            except ValueError:
                found.append(one.at(np.zeros(1))[0])
        return np.stack(found, axis=-1).reshape(-1, len(self.named))[:, self._actuator]

    def at(self, times: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the strain of each column at each time, shape [time_count, rows · columns]."""
        if self._strains is not None:
            when = np.subtract.outer(times, self._all_delays)
            each = self._strains.at(when.ravel()).reshape(*when.shape, *self._strains.shape)
            return np.moveaxis(each[:, self._delay, :, self._actuator], 0, -1).reshape(len(times), -1)
        found = []
        for (name, one), delays in zip(self.named, self._delays, strict=True):
            when = np.subtract.outer(times, delays)
            found.append(one.at(when.ravel(), name).reshape(when.shape))
        return np.concatenate(found, axis=2).reshape(len(times), -1)


def _different(delays: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.intp]]:
    """Return the different columns of delays, and which of them each column is."""
    if len(delays) == 1:  # much faster than by columns
        found, which = np.unique(delays[0], return_inverse=True)
        return found[None], which
    found, which = np.unique(delays, axis=1, return_inverse=True)
    return found, which.ravel()
