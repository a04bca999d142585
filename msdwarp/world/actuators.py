"""Actuators: connections (muscles) whose rest length is a function of time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import checks
from ..bodies import TEARING_FIELDS, System, connection_between, mask_of
from .loads import Load, values_at


@dataclass(frozen=True, eq=False, repr=False)
class Actuator(Load):
    """A muscle: connections whose rest length is a function of time.

    At time t a connection has the rest length l0 (1 + s(t − delay)) instead of l0. If several actuators act on a
    connection, their strains add up. The algorithm that sums spring forces stays the same.

    `Measures.external_work` includes the work of muscles on the body, −∮ F dl over a cycle, for tension F and
    length l. `elastic_energy` is computed from the rest lengths l0, as if there were no muscle. The energy stored
    in a muscle of constant strain is, up to a constant, `elastic_energy` minus `external_work`.

    Parameters
    ----------
    strain
        s, the relative change of the rest length, negative for contraction: a number, or a function of time [s],
        above −1 and below 1. The stability bound uses its minimum over the first ten seconds, where defined.
    on
        Particles that contain both ends of each of its connections; see `Load`.
    along
        Lattice directions of its connections, one or several, such as "x" or ("x", "y"), named as in
        `System.directions`. By default all connections.
    delay
        Delay of each particle [s], a number or shape [particle_count]; a connection has the mean delay of its two
        ends. For a wave of speed c it is x/c. The strain is then also evaluated at negative times.
    cells
        Corners of cells, shape [any, k], of which one has both ends: see `voxel_corners`. By default all.

    Raises
    ------
    ValueError
        If the strain is out of range, a delay is not finite, or `along` is not a name. In a scene also if there is
        no such direction or connection, one may yield or break, or delays are not as many as particles.
    """

    strain: Any
    along: Any = None
    delay: ArrayLike = 0.0
    cells: ArrayLike | None = None

    def __post_init__(self) -> None:
        if not self.varies:
            object.__setattr__(self, "strain", float(self.at(np.zeros(1))[0]))
        object.__setattr__(self, "delay", checks.finite("delay", self.delay))
        if self.cells is not None:
            corners = checks.whole_numbers(
                "cells", self.cells, "(cell_count, k)", lambda s: len(s) == 2 and s[0] > 0 and s[1] > 1
            )
            object.__setattr__(self, "cells", checks.as_int32(corners))
        if self.along is not None:
            names = (self.along,) if isinstance(self.along, str) else self.along
            object.__setattr__(self, "along", checks.sequence("along", names, str, "'x'"))

    @property
    def varies(self) -> bool:
        """Whether the strain is a function of time."""
        return callable(self.strain)

    def at(self, times: NDArray[np.float64], name: str = "strain") -> NDArray[np.float64]:
        """Return the strain at these times, shape [time_count]."""
        given = self.strain if self.varies else checks.array(name, self.strain)
        return _strains_at(name, given, times, 1)[:, 0]

    def connections(self, system: System) -> NDArray[np.intp]:
        """Return indices of the muscle's connections; raise ValueError if none, or one may yield or break."""
        chosen = np.ones(system.connection_count, dtype=bool)
        if self.along is not None:
            known = dict.fromkeys(name for body in system.directions for name in body)
            chosen[:] = False
            for name in self.along:
                checks.one_of("along", name, known)
                for body in system.directions:
                    chosen[body.get(name, slice(0))] = True
        if self.on is not None:
            chosen &= self.particles(system)[system.connections].all(axis=1)
        if self.cells is not None:
            corners = np.asarray(self.cells)
            checks.within("cells", corners, checks.index_below(system.particle_count))
            pairs = corners[:, np.stack(np.triu_indices(corners.shape[1], 1), axis=1)]
            between = connection_between(system, pairs)
            chosen &= mask_of(between[between >= 0], system.connection_count)
        found = np.flatnonzero(chosen)
        if not len(found):
            along = "" if self.along is None else f" along {', '.join(self.along)}"
            where = "on" if self.cells is None else "cells"
            given = checks.repr_short(getattr(self, where))
            raise ValueError(
                f"{where} is {given}; there must be one connection at least that joins two of its particles{along}"
            )
        if np.isfinite(system.yield_strain[found]).any():
            raise ValueError(
                "on has connections that may yield; an actuator must be the only one to set rest lengths"
            )
        if any(np.isfinite(getattr(system, name)[found]).any() for name in TEARING_FIELDS):
            raise ValueError("on has connections that may break; an actuator would go on pulling where they did")
        return found

    def delays(
        self, system: System, connections: NDArray[np.intp], rows: NDArray[np.float64] | None = None
    ) -> NDArray[np.float64]:
        """Return the delay of each of these connections [s], rounded to nanoseconds, shape [rows, any].

        `rows` are delays of the particles to take instead of its own, shape [rows, particle_count].
        """
        each = checks.broadcast("delay", self.delay, (system.particle_count,))[None] if rows is None else rows
        return np.round(each[:, system.connections[connections]].mean(axis=2), 9)

    def check(self, system: System) -> None:
        """Raise ValueError if the load cannot act on this system."""
        self.delays(system, self.connections(system))
        self.at(np.zeros(1))


class StrainRows:
    """The strains of all actuators of an ensemble, in rows: world w has row w mod (number of rows).

    Parameters
    ----------
    given
        Numbers, or a function of time [s] that returns them: shape [rows], for all actuators, or
        [rows, actuator_count]; or one number.
    actuators
        Number of actuators.

    Raises
    ------
    ValueError
        If shapes differ from that, or a function has no value at time 0.
    """

    def __init__(self, given: Any, actuators: int) -> None:
        self.varies = callable(given)
        try:
            first = given(0.0) if self.varies else given
        except Exception as error:
            raise ValueError(f"strain has no value at 0 s: {checks.message(error)}") from error
        first = checks.array("strain", first)
        self._given: Any = given if self.varies else lambda _: first
        self._axes = first.shape
        if first.ndim > 2 or (first.ndim == 2 and first.shape[1] != actuators) or first.size == 0:
            raise ValueError(
                f"strain has shape {first.shape}; it must be of shape [rows] or [rows, {actuators}], a row for "
                "each world, and a number for each actuator"
            )
        self.shape = (first.shape[0] if first.ndim else 1, actuators)
        self.first = self.at(np.zeros(1))[0]
        """The strains at time 0, shape [rows, actuator_count]."""

    def __len__(self) -> int:
        return self.shape[0]

    def at(self, times: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the strains at these times, shape [time_count, rows, actuator_count]."""
        given, width = (self._in_line if self.varies else self._in_line(0.0)), self.shape[0] * self.shape[1]
        return _strains_at("strain", given, times, width).reshape(-1, *self.shape)

    def of(self, row: int, k: int) -> Any:
        """Return the strain of actuator k in a row: a number, or a function of time."""
        place = row * self.shape[1] + k

        def strain(time: Any) -> Any:
            return self._in_line(time)[place]

        return strain if self.varies else float(self.first[row, k])

    def _in_line(self, time: Any) -> NDArray:
        """Return all strains, row after row, shape [rows · actuator_count, ...], at one time or at several.

        Several times have an axis more for each axis of the strains, so that a function can broadcast them.
        """
        times = np.reshape(time, (*np.shape(time), *(1,) * len(self._axes))) if np.ndim(time) else time
        values, lead = np.asarray(self._given(times)), np.shape(time)
        if values.shape != (*lead, *self._axes):
            raise ValueError(f"it returned shape {values.shape}, and {self._axes} at time 0")
        values = values.reshape(*lead, *self._axes, *(1,) * (2 - len(self._axes)))
        return np.broadcast_to(values, (*lead, *self.shape)).reshape(*lead, -1).T


def _strains_at(name: str, given: Any, times: NDArray[np.float64], width: int) -> NDArray[np.float64]:
    """Return strains at these times, shape [time_count, width]; raise ValueError if one is out of range."""
    values = values_at(name, given, times, width)
    wrong = np.abs(values) >= 1
    if wrong.any():
        k, column = np.argwhere(wrong)[0]
        raise ValueError(f"{name} is {values[k, column]:g} at {times[k]:g} s; it must be above -1 and below 1")
    return values
