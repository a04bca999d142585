"""Sensors: the sums of probes in each world, on the device at the end of each frame or substep."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from ...bodies import CORNERS, connection_shares, mask_of, von_mises
from ...kernels.integrators import force_on_each
from ...kernels.reductions import (
    fold,
    mean_of_function,
    probes,
    sum_cell_stress,
    sum_of_group,
    sum_strain,
    sum_virial,
)
from ...world import (
    BODY_CONTACT_FORCE,
    CONTACT_FORCE,
    FORCE,
    POSITION,
    STRAIN,
    STRESS,
    VELOCITY,
    Probe,
    probes_by,
)
from ..collision.contact_forces import ContactForces
from ..model.model import CONSTANTS, Model
from ..model.state import State
from ..stepping.dynamics import Dynamics
from ..stepping.stages import Stage

MOST_THREADS = 65536
"""Maximal number of summing threads on a GPU: enough to occupy it, few enough to combine quickly."""
FEW_EACH = 8
"""Members per thread in a small group: more threads would spend longer on combining their sums."""
ROWS = 64
"""Rows of partial sums that the host adds, for a single world on a GPU."""


class Sensors:
    """Measures the quantities of probes by sums on the device, `readings` times in a frame of `seconds`.

    `contact_forces` sums the contact forces, if a probe measures them.
    """

    def __init__(
        self,
        dynamics: Dynamics,
        state: State,
        requested: Mapping[str, Probe],
        readings: int,
        seconds: float,
        contact_forces: ContactForces | None,
    ) -> None:
        self._dynamics, self._state, model = dynamics, state, dynamics.model
        self._model, self._seconds = model, seconds / readings
        self._sums, first = list[_Sum | _StressSum](), 0
        for name, probe in requested.items():
            if probe.what == STRESS:
                self._sums.append(_StressSum(model, name, probe, first))
            else:
                self._sums.append(_Sum(model, name, probe, first, dynamics.assembly.fracture is not None))
            first += self._sums[-1].width
        asked = {one.what for one in self._sums}
        self.moves = VELOCITY in asked or FORCE in asked
        """Whether probes need velocities at the time of the positions."""
        self._force = model.vectors() if FORCE in asked else None
        self._contact_forces = contact_forces if CONTACT_FORCE in asked or BODY_CONTACT_FORCE in asked else None
        on_gpu = model.device.is_cuda
        shape = (readings, model.worlds, ROWS if on_gpu and not model.in_worlds else 1, first)
        self._rows = wp.zeros(shape, dtype=wp.float64, device=model.device)
        # The copy that the host reads: on a GPU in pinned memory.
        self._found = wp.empty_like(self._rows, device="cpu", pinned=True) if on_gpu else self._rows

    def launch(self, v: wp.array, k: int = 0) -> None:
        """Launch the sums of reading k of a frame; a graph may record it.

        v are velocities at the time of the positions [m/s]; they are read only if `moves` is true.
        """
        now, rows = self._state.state_in, self._rows[k]
        assert isinstance(rows, wp.array)
        if self._force is not None:
            fields = {"compensation": now.compensation, "x": now.x, "v": v, "force": self._force}
            self._dynamics.run(Stage(force_on_each, fields))
        values = {POSITION: now.x, STRAIN: now.x, STRESS: now.x, VELOCITY: v, FORCE: self._force}
        lost = dict.fromkeys((POSITION, STRAIN, STRESS), now.compensation.x) | {VELOCITY: now.compensation.v}
        if self._contact_forces is not None:
            values[CONTACT_FORCE] = self._contact_forces.by_all()
            values[BODY_CONTACT_FORCE] = self._contact_forces.by_bodies
        for one in self._sums:
            one.launch(values[one.what], lost.get(one.what), rows)
        if k == len(self._rows) - 1 and self._found is not self._rows:
            wp.copy(self._found, self._rows)

    def read(self) -> dict[str, NDArray[np.float64]]:
        """Wait for the device, and return the readings of the last launched frame, by the names of probes.

        Their shape is [readings, d], in an ensemble [readings, worlds, d].
        """
        if self._model.device.is_cuda:
            wp.synchronize_stream(self._model.device.stream)
        rows: Any = self._found.numpy()
        return {one.name: one.reading(rows, self._seconds) for one in self._sums}


class _Sum:
    """The sums for one probe: columns of the table of all probes' sums, starting at `first`."""

    def __init__(self, model: Model, name: str, probe: Probe, first: int, tears: bool) -> None:
        self._tears, self.name, self.what, self._first, self._model = tears, name, probe.what, first, model
        self.width = probes.STRAIN_COLUMNS if self.what == STRAIN else model.dim
        if self.what == STRAIN:
            chosen = mask_of(probe.connections(model.system), model.connection_count)
            member = np.flatnonzero(model.ordered(chosen))
            self._constants = [*map(model.table, CONSTANTS), model.connections]
        else:
            member = np.flatnonzero(probe.particles(model.system))
            weight, self._mass = _weights(self.what, model.row_of("mass")[:, member])
            self._constants = [wp.array(weight, dtype=wp.float64, device=model.device)]
        self._member = wp.array(member, dtype=int, device=model.device)
        self._shares = _shares(model, len(member), self.width)

    def launch(self, values: Any, lost: Any, rows: wp.array) -> None:
        """Launch the sum of `values` over the group's particles, or of the strains of its connections."""
        model, compensated, largest = self._model, self._model.compensated and lost is not None, -1
        kernel = sum_of_group(model.dim, values.dtype, compensated)
        if self.what == STRAIN:
            kernel, largest = sum_strain(model.dim, model.scalar, compensated, self._tears), probes.LARGEST
        inputs = [*self._constants, self._member, values, lost if compensated else values, model.stride]
        wp.launch(kernel, self._shares.shape[:2], inputs, [self._shares], device=model.device)
        _fold(self._shares, rows, self._first, largest)

    def reading(self, rows: NDArray[np.float64], seconds: float) -> NDArray[np.float64]:
        """Return the probe's values by reading, `seconds` apart; `rows`: [readings, worlds, rows, columns]."""
        own = rows[..., self._first : self._first + self.width]
        result = total = own.sum(axis=2)
        if self.what == STRAIN:
            count = total[..., probes.COUNT]
            known = np.where(count > 0, count, np.nan)  # NaN if all connections are broken
            largest = np.where(count > 0, own[..., probes.LARGEST].max(axis=2), np.nan)
            result = np.stack([total[..., probes.SUM] / known, largest], axis=-1)
        elif self.what in (CONTACT_FORCE, BODY_CONTACT_FORCE):  # impulses are summed since the frame's start
            result = np.diff(total, axis=0, prepend=0.0) / seconds
        elif self.what == FORCE:
            each, gravity = np.arange(self._model.worlds), self._model.row_of("gravity")
            result = total + self._mass[each % len(self._mass), None] * gravity[each % len(gravity)]
        return result if self._model.in_worlds else result[:, 0]


class _StressSum:
    """The sums of a stress probe: virials of connections, virials of cells, then volumes."""

    def __init__(self, model: Model, name: str, probe: Probe, first: int) -> None:
        self.name, self.what, self._first, self._model = name, probe.what, first, model
        self._components = probes.COMPONENTS[model.dim]
        self.width = 2 * len(self._components) + 1
        system, device = model.system, model.device
        cells, inside = system.cells, probe.cells(system)
        assert cells is not None
        share = model.ordered(connection_shares(system, inside))
        chosen = np.flatnonzero(share)
        self._weight = wp.array(share[chosen], dtype=wp.float64, device=device)
        self._chosen = wp.array(chosen, dtype=int, device=device)
        self._cells: Any = [wp.array(cells.corners[inside], dtype=int, device=device)]
        for numbers in (cells.rest_volume, cells.modulus):
            self._cells.append(wp.array(numbers[inside], dtype=wp.float64, device=device))
        kind = model.dim, model.scalar, model.compensated
        self._virial, flat = sum_virial(*kind), cells.flat
        self._stress = sum_cell_stress(*kind, not flat.all(), bool(flat.any()))
        self._shares = _shares(model, len(chosen), len(self._components))
        self._cell_shares = _shares(model, int(inside.sum()) * CORNERS, len(self._components) + 1)

    def launch(self, values: Any, lost: Any, rows: wp.array) -> None:
        """Launch the sums at positions `values`."""
        model, device = self._model, self._model.device
        state = [values, lost if model.compensated else values, model.stride]
        constants = [
            *map(model.table, ("rest_length", "stiffness")),
            model.connections,
            self._weight,
            self._chosen,
        ]
        wp.launch(self._virial, self._shares.shape[:2], [*constants, *state], [self._shares], device=device)
        _fold(self._shares, rows, self._first)
        inputs = [*self._cells, *state]
        wp.launch(self._stress, self._cell_shares.shape[:2], inputs, [self._cell_shares], device=device)
        _fold(self._cell_shares, rows, self._first + len(self._components))

    def reading(self, rows: NDArray[np.float64], _seconds: float) -> NDArray[np.float64]:
        """Return stress components and von Mises stress by reading; `rows`: [readings, worlds, rows, columns]."""
        total, count = rows[..., self._first : self._first + self.width].sum(axis=2), len(self._components)
        mean = (total[..., :count] + total[..., count:-1]) / total[..., -1:]
        tensor = np.empty((*mean.shape[:-1], self._model.dim, self._model.dim))
        for k, (a, b) in enumerate(self._components):
            tensor[..., a, b] = tensor[..., b, a] = mean[..., k]
        result = np.concatenate([mean, von_mises(tensor)[..., None]], axis=-1)
        return result if self._model.in_worlds else result[:, 0]


class GroupMeans:
    """Unweighted mean of a function over chosen particles, in each world; see `mean_of_function`."""

    def __init__(self, model: Model, function: Any, chosen: NDArray[np.bool_], width: int) -> None:
        self._model = model
        self._kernel = mean_of_function(model.dim, model.scalar, model.compensated, function, width)
        self._member = wp.array(np.flatnonzero(chosen), dtype=int, device=model.device)
        self._shares = _shares(model, len(self._member), max(width, 1))
        self._means = wp.zeros((model.worlds, 1, max(width, 1)), dtype=wp.float64, device=model.device)

    def read(self, state: State, v: wp.array) -> NDArray[np.float64]:
        """Return the means, shape [worlds, columns]; v are velocities at the time of the positions [m/s]."""
        model, lost = self._model, state.compensation
        inputs = [self._member, state.x, v, lost.x, lost.v, model.stride]
        wp.launch(self._kernel, self._shares.shape[:2], inputs, [self._shares], device=model.device)
        _fold(self._shares, self._means)
        return self._means.numpy()[:, 0].astype(np.float64)


def _shares(model: Model, count: int, width: int) -> wp.array:
    """Return zeros for partial sums of threads: `width` numbers by world and thread, over `count` particles."""
    most = max(MOST_THREADS // model.worlds, 1)
    threads = min(max(count // FEW_EACH, 1), most) if model.device.is_cuda else 1
    return wp.zeros((model.worlds, threads, width), dtype=wp.float64, device=model.device)


def _fold(shares: wp.array, rows: wp.array, first: int = 0, largest: int = -1) -> None:
    """Launch the addition of partial sums of threads into a few rows."""
    threads = (*rows.shape[:2], shares.shape[2])
    wp.launch(fold, threads, [shares, largest, first], [rows], device=shares.device)


def _weights(what: str, mass: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return weights of a group's particles, and the free particles' total mass [kg], for each row of masses."""
    free = np.where(np.isfinite(mass), mass, 0.0)
    total = free.sum(axis=1)
    if what in (FORCE, CONTACT_FORCE, BODY_CONTACT_FORCE):
        return np.ones((1, mass.shape[1])), total
    each = free / np.where(total > 0, total, 1.0)[:, None]
    return np.where(total[:, None] > 0, each, 1.0 / mass.shape[1]), total


def sensors_of(
    dynamics: Dynamics,
    state: State,
    every: str,
    readings: int,
    seconds: float,
    contact_forces: ContactForces | None,
) -> Sensors | None:
    """Return the sensors that are read every "frame" or every "substep"; None if there are none."""
    requested = probes_by(every, dynamics.assembly.probes)
    return Sensors(dynamics, state, requested, readings, seconds, contact_forces) if requested else None
