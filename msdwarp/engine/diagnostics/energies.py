"""Sums over the state of each world, computed on the device in float64: energies, momentum and strain."""

from typing import Any, NamedTuple

import numpy as np
import warp as wp
from numpy.typing import NDArray

from ...kernels.reductions import columns
from ...kernels.reductions.measure import put_in_order, strain_each, sum_up
from ...kernels.springs.spring_laws import Laws
from ...runtime import in_turn
from ..model.state import State
from ..stepping.assemble import Assembly
from .readout import Sweep


class Measures(NamedTuple):
    """Sums over a state, in an ensemble arrays of shape [worlds, ...]. Pinned particles are excluded.

    Attributes
    ----------
    kinetic_energy
        Σ m v²/2 [J].
    elastic_energy
        Σ k (l − l0)²/2 [J].
    gravitational_energy
        −Σ m g·x [J].
    dissipated_power
        Power that dampers dissipate [W]: Σ b l'² for linear dampers.
    momentum
        Σ m v [kg m/s], shape [d].
    angular_momentum
        Σ m x × v about the origin [kg m²/s], shape [3] in three dimensions, [1] in two, [0] in one.
    largest_strain
        Largest |l / l0 − 1| of a connection.
    effect_energy
        Energy stored by other effects, such as contact and attachments [J].
    external_work
        Work of loads, drives and moving obstacles on the system so far [J].
    inverted
        Number of cells of lattices that are turned inside out; see `InvertedWarning`.
    """

    kinetic_energy: float
    elastic_energy: float
    gravitational_energy: float
    dissipated_power: float
    momentum: NDArray[np.float64]
    angular_momentum: NDArray[np.float64]
    largest_strain: float
    effect_energy: float = 0.0
    external_work: float = 0.0
    inverted: int = 0

    @property
    def energy(self) -> float:
        """Sum of kinetic, elastic, gravitational and other stored energy [J]."""
        return self.kinetic_energy + self.elastic_energy + self.gravitational_energy + self.effect_energy


@in_turn
def measure(
    assembly: Assembly, state: State, velocity: wp.array | None = None, x_lost: wp.array | None = None
) -> Measures:
    """Return the measures of a state.

    `velocity` are the velocities at the time of the positions, by default `state.v`. `x_lost` are the
    rounding errors of positions, in compensated precision.
    """
    model, work = assembly.model, assembly.external_work
    sums = Sums(assembly, with_work=False)
    model.kernels.compile()
    v = state.v if velocity is None else velocity
    stored = power = np.zeros(model.worlds)
    for effect in assembly.all:
        energies, powers = effect.energies_and_powers(state.x, v)
        stored, power = stored + energies, power + powers
    there = wp.zeros((model.worlds, columns.COLUMNS), dtype=wp.float64, device=model.device)
    sums.launch(state.x, v, v, x_lost, there)
    found = np.array(there.numpy())
    turning = {3: slice(0, 3), 2: slice(2, 3), 1: slice(0, 0)}[model.dim]
    return Measures(
        model.of_each(found[:, columns.MEAN_KINETIC]),
        model.of_each(found[:, columns.ELASTIC]),
        model.of_each(found[:, columns.POTENTIAL]),
        model.of_each(found[:, columns.DISSIPATED] + power),
        model.of_each(found[:, columns.MOMENTUM :][:, : model.dim]),
        model.of_each(found[:, columns.ANGULAR_MOMENTUM :][:, turning]),
        model.of_each(found[:, columns.STRAIN]),
        model.of_each(stored),
        0.0 if work is None else model.of_each(work.totals(state.x, state.v)),
    )


class Sums:
    """Launches sums over particles and connections; `msdwarp.kernels.reductions.columns` lists the sums.

    If `everything` is false, only the columns that detect divergence are computed, in one pass over the particles.
    The work of loads is also summed, unless `with_work` is false; `more` is work that an array adds to it [J].
    """

    def __init__(
        self, assembly: Assembly, *, everything: bool = True, with_work: bool = True, more: Any = None
    ) -> None:
        model = assembly.model
        self._model, self._work = model, assembly.external_work if with_work else None
        self._more = more
        self._partial = None if self._work is None else self._work.partial_sums()
        count = max(model.particle_count, model.connection_count if everything else 0)
        self._sweep = Sweep(model, count, columns.COLUMNS if everything else columns.LOOKED)
        # Springs to second neighbours are compressed even in a flat sheet, so only the others show its strain.
        plain = model.system.yields or not everything
        between = None if plain else model.system.between_neighbors
        self._tears = int(assembly.fracture is not None)
        # A pass over particles alone uses one kernel for all spring laws.
        self._laws = model.law_forms if everything else Laws()
        kernel = sum_up(model.dim, model.scalar, everything, self._laws, self._sweep.block)
        self._kernel = model.kernels.note(kernel, block=self._sweep.block)
        counts = np.zeros(0, dtype=np.uint8) if between is None else model.ordered(between).astype(np.uint8)
        self._counts = wp.array(counts, dtype=wp.uint8, device=model.device)

    def launch(self, x: wp.array, u: wp.array, v: wp.array, x_lost: wp.array | None, found: wp.array) -> None:
        """Launch the sums for positions x, velocities v and the method's velocities u; a graph may record it.

        `x_lost` are the rounding errors of x.
        """
        model = self._model
        if self._work is not None and self._partial is not None:
            self._work.launch(x, u, self._partial, self._more)
        inputs = [model.table("inverse_mass"), model.table("gravity"), model.connection_table(self._laws)]
        inputs += [self._counts, self._tears, x, x_lost, u, v, self._partial]
        self._sweep.launch(self._kernel, inputs, found)


def write_in_order(values: wp.array, place: wp.array | None, result: wp.array) -> None:
    """Write float32 values of connections, given in the device's order, in the system's order.

    `place` has the index in the system of each connection on the device; None if both orders are equal.
    """
    if place is None:
        wp.copy(result, values)
    else:
        wp.launch(put_in_order, len(values), [values, place], [result], device=values.device)


def write_strain(assembly: Assembly, state: State, place: wp.array | None, strain: wp.array) -> None:
    """Write each connection's strain, length / rest length − 1, computed in float64, shape [connection_count].

    The strain of a broken connection is NaN.

    `place` has the index in the system of each connection on the device; None if both orders are equal.
    """
    model, fracture = assembly.model, assembly.fracture
    broken_at = None if fracture is None else fracture.broken_at
    inputs = [model.connections, model.rest_length, broken_at, place, state.x, state.compensation.x]
    wp.launch(strain_each(model.dim, model.scalar), model.connection_count, inputs, [strain], device=model.device)
