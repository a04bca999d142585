"""Measures: energies, momentum and strain of a state, summed on its device in float64."""

from typing import Any, NamedTuple

import numpy as np
import warp as wp
from numpy.typing import NDArray

from ..kernels.forces import leave_out_broken
from ..kernels.reductions import (
    fold,
    put_in_order,
    strain_each,
    sum_connections,
    sum_difference,
    sum_particles,
    take,
)
from ..kernels.reductions import measure as columns
from ..quiet import in_turn
from .model import Model
from .state import State

MOST_THREADS = 65536
"""Threads that sum on a GPU: enough to keep it busy, few enough to be added up soon."""
FEW_EACH = 8
"""What each sums of a small system: more threads would take longer to be added up than to sum."""
ROWS = 64
"""Rows of sums that the host adds up."""
WIDTHS = (columns.PARTICLE_COLUMNS, columns.CONNECTION_COLUMNS, 1)
"""Columns of the sums over particles and connections, and of a difference of velocities."""


class Measures(NamedTuple):
    """What a state holds. Pinned particles count for nothing."""

    kinetic_energy: float
    """Σ m v²/2 [J]."""
    elastic_energy: float
    """Σ k (l − l0)²/2 [J]."""
    gravitational_energy: float
    """−Σ m g·x [J]."""
    dissipated_power: float
    """Σ b l'² or by another law, what the dampers turn to heat [W]."""
    momentum: NDArray[np.float64]
    """Σ m v [kg m/s], shape [d]."""
    angular_momentum: NDArray[np.float64]
    """Σ m x × v about the origin [kg m²/s], shape [3] in three dimensions, [1] in two, [0] in one."""
    largest_strain: float
    """Largest |l / l0 − 1|."""

    effect_energy: float = 0.0
    """What other effects store, such as attachments [J]."""
    external_work: float = 0.0
    """What loads, drives and moving obstacles have done on the system so far [J]."""

    @property
    def energy(self) -> float:
        """Kinetic, elastic, gravitational and other stored energy together [J]."""
        return self.kinetic_energy + self.elastic_energy + self.gravitational_energy + self.effect_energy


@in_turn
def measure(
    model: Model, state: State, velocity: wp.array | None = None, x_lost: wp.array | None = None
) -> Measures:
    """Return the measures of a state.

    Parameters
    ----------
    model, state
        The system on a device.
    velocity
        Velocities at the instant of the positions; by default the state's own.
    x_lost
        What the positions have lost by rounding, in compensated precision.
    """
    v, sums = state.v if velocity is None else velocity, Sums(model)
    others = [one.energy_and_power(state.x, v) for one in model.effects]
    sums.launch(state.x, v, x_lost)
    particles, connections, _ = sums.totals()
    turning = {3: slice(0, 3), 2: slice(2, 3), 1: slice(0, 0)}[model.dim]
    return Measures(
        float(particles[columns.KINETIC]),
        float(connections[columns.ELASTIC]),
        float(particles[columns.POTENTIAL]),
        float(connections[columns.DISSIPATED]) + sum(power for _, power in others),
        particles[columns.MOMENTUM :][: model.dim],
        particles[columns.ANGULAR_MOMENTUM :][turning],
        float(connections[columns.STRAIN]),
        sum(energy for energy, _ in others),
        0.0 if model.work is None else model.work.total(state.x, state.v),
    )


class Sums:
    """Sums over particles and connections, in the columns of `msdwarp.kernels.reductions.measure`.

    Every thread sums a share of its own, and fewer threads sum these to a few rows, which come to the host at
    once. The order of sums is fixed, so that a state has the same sums each time.
    """

    def __init__(self, model: Model) -> None:
        self._model, on_gpu = model, model.device.is_cuda
        counts = (model.particle_count, model.connection_count, model.particle_count)
        threads = [min(max(count // FEW_EACH, 1), MOST_THREADS) if on_gpu else 1 for count in counts]
        self._shares = [self._zeros(n, width) for n, width in zip(threads, WIDTHS, strict=True)]
        self._rows = self._zeros(ROWS if on_gpu else 1, sum(WIDTHS))
        # Springs to second neighbours are strained in a flat sheet: the others alone say how far it is stretched.
        between = None if model.lengths_change else model.system.between_neighbours
        self._between = None
        if between is not None:
            chosen = np.flatnonzero(model.ordered(between)).astype(np.int32)
            self._index = wp.array(chosen, dtype=int, device=model.device)
            arrays = (model.connections, model.rest_length, model.stiffness, model.damping)
            self._between = [wp.clone(one[self._index].contiguous()) for one in arrays]
            self._strains = self._zeros(threads[1], columns.CONNECTION_COLUMNS)
            self._strain_rows = self._zeros(self._rows.shape[0], columns.CONNECTION_COLUMNS)

    def _zeros(self, rows: int, columns: int) -> Any:
        return wp.zeros((rows, columns), dtype=wp.float64, device=self._model.device)

    def launch(self, x: wp.array, v: wp.array, x_lost: wp.array | None = None) -> None:
        """Launch the sums for particles at x that move at v; x_lost is what x lost by rounding."""
        model = self._model
        compensated = model.compensated and x_lost is not None
        self._sum(0, sum_particles(model.dim, model.scalar), [model.inverse_mass, model.gravity, x, v])
        constants = [model.connections, model.rest_length, model.stiffness, model.damping]
        law, tears = model.system.damper.law, model.tearing is not None
        kernel = sum_connections(model.dim, model.scalar, compensated, law, tears)
        self._sum(1, kernel, [*constants, x, v, x_lost if compensated else x], largest=columns.STRAIN)
        if self._between is not None:
            if tears:  # what has broken since has no stiffness
                for own, now in zip(self._between[2:], constants[2:], strict=True):
                    wp.launch(take(model.scalar), len(own), [now, self._index], [own], device=model.device)
            inputs = [*self._between, x, v, x_lost if compensated else x]
            wp.launch(kernel, len(self._strains), inputs, [self._strains], device=model.device)
            rows = self._strain_rows
            wp.launch(fold, rows.shape, [self._strains, columns.STRAIN, 0], [rows], device=model.device)

    def launch_difference(self, v: wp.array, u: wp.array) -> None:
        """Launch the sum of ½ m |v − u|²."""
        model = self._model
        self._sum(2, sum_difference(model.dim, model.scalar), [model.inverse_mass, v, u])

    def _sum(self, number: int, kernel: Any, inputs: list[Any], largest: int = -1) -> None:
        """Launch sum `number`, of whose columns one may be the largest instead."""
        shares, rows, device = self._shares[number], self._rows, self._model.device
        wp.launch(kernel, shares.shape[0], inputs, [shares], device=device)
        threads = (rows.shape[0], WIDTHS[number])
        wp.launch(fold, threads, [shares, largest, sum(WIDTHS[:number])], [rows], device=device)

    def totals(self) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
        """Return what was launched last: over particles, over connections (a largest strain), a difference."""
        rows = self._rows.numpy()
        sums = rows.sum(axis=0)
        particles, connections = sums[: WIDTHS[0]], sums[WIDTHS[0] : -WIDTHS[2]]
        strains = rows[:, WIDTHS[0] :] if self._between is None else self._strain_rows.numpy()
        connections[columns.STRAIN] = strains[:, columns.STRAIN].max()
        return particles, connections, float(sums[-1])


def write_in_order(values: wp.array, place: wp.array | None, result: wp.array) -> None:
    """Write numbers of float32 that connections on the device have in the order of the system's.

    `place` says where that of each goes; None where the order is the same.
    """
    if place is None:
        wp.copy(result, values)
    else:
        wp.launch(put_in_order, len(values), [values, place], [result], device=values.device)


def write_strain(model: Model, state: State, place: wp.array | None, strain: wp.array) -> None:
    """Write each connection's strain, length / rest length − 1, computed in float64, shape [connection_count].

    That of a broken one is NaN.

    `place` says where that of each connection on the device goes; None where the order is the system's.
    """
    kernel = strain_each(model.dim, model.scalar, model.compensated, place is not None)
    inputs = [model.connections, model.rest_length, place, state.x, state.lost.x]
    wp.launch(kernel, model.connection_count, inputs, [strain], device=model.device)
    if model.tearing is not None:
        inputs = [model.tearing.broken_at, place]
        wp.launch(leave_out_broken(model.scalar), model.connection_count, inputs, [strain], device=model.device)
