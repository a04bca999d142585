"""The adjoint of spring forces on a device: neighbours are in a table, or at constant offsets in a lattice."""

from collections.abc import Callable
from contextlib import suppress
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from ...kernels.adjoint.springs import Neighbours, Wanted, in_lattice, in_table, springs_adjoint
from ...kernels.adjoint.stencil import BLOCK, stencil_adjoint
from ...kernels.springs.constants import CONSTANTS
from ...kernels.springs.stencil import stencil_rows
from ..device.device import upload_fields
from ..loads.actuators import ActuatedSprings
from ..model.lattice import Lattice, NotALattice, find_lattice
from ..model.model import Model
from ..springs.force_algorithms import Stencil, neighbour_table, records_of_three

MOST_LANES, MOST_THREADS = 16, 80_000
"""Most threads that share a particle on a GPU, and most in such a launch: more would wait (on an H100)."""


class OverParticles:
    """An adjoint whose kernel runs over particles; few particles have several threads (lanes) each.

    `neighbours` finds the springs of a particle.
    """

    def __init__(self, model: Model, neighbours: Neighbours) -> None:
        self._model, self._neighbours, self._actuated = model, neighbours, None
        self._count = model.worlds * model.stride
        self._lanes = MOST_LANES if model.device.is_cuda else 1
        while self._lanes > 1 and self._lanes * self._count > MOST_THREADS:
            self._lanes //= 2

    def kernel(self, wanted: Wanted) -> Any:
        """Compose the kernel of the adjoint."""
        model, actuated = self._model, self._actuated is not None
        kinds = model.dim, model.scalar, model.laws, wanted
        return springs_adjoint(*kinds, self._neighbours, self._lanes, actuated)

    def launch(self, kernel: Any, inputs: list[Any], over: Callable[..., None]) -> None:
        """Launch the kernel by `over`, which launches over particles."""
        over(kernel, self._count, inputs, self._lanes)


class InTable(OverParticles):
    """The springs of each particle in a table, for every system, in one world or many."""

    def __init__(self, model: Model, actuated: ActuatedSprings | None) -> None:
        super().__init__(model, in_table(model.scalar, model.laws, model.in_worlds))
        self._actuated = actuated
        self.entries = model.worlds * model.connection_count
        """Number of entries of the derivatives by a constant."""
        column = np.full(model.connection_count if actuated is not None else 1, -1, dtype=np.int32)
        if actuated is not None:
            column[actuated.connection] = actuated.column
        self.column = model.ordered(column)
        """The column of each connection's strain, -1 without an actuator, in the model's order."""
        table = self._table = model.with_law(self._neighbours.Table())
        table.first, table.other, table.connection = neighbour_table(model)
        table.connections = model.connections
        for name in CONSTANTS:
            values = getattr(model, name)
            if name in model.rows:
                values = wp.array(model.of_each_world(model.rows[name]), dtype=model.scalar, device=model.device)
            setattr(table, name, values)
        table.column = wp.array(self.column, dtype=int, device=model.device)
        table.columns = 0 if actuated is None else actuated.columns
        table.strain = wp.zeros((1, 1), dtype=model.scalar, device=model.device)
        table.particle_count, table.stride = model.particle_count, model.stride
        table.differs = wp.vec3i(*(int(name in model.rows) for name in CONSTANTS))

    @property
    def table(self) -> Any:
        """The struct that kernels read."""
        if self._actuated is not None:
            self._table.strain = self._actuated.data.strain
        return self._table

    def by_connection(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return derivatives by the constants of connections, in the system's order."""
        model = self._model
        return model.of_each(model.in_system_order(values.reshape(model.worlds, -1).T).T)


class InLattice(OverParticles):
    """The springs of a uniform lattice without ties and actuators: neighbours are at constant offsets."""

    def __init__(self, model: Model, lattice: Lattice) -> None:
        super().__init__(model, in_lattice(model.scalar, model.laws))
        self._lattice = lattice
        self.entries = len(lattice.steps) * model.particle_count
        self.table = self._table(model, lattice)

    def _table(self, model: Model, lattice: Lattice) -> Any:
        """Return the struct that the kernel reads."""
        bits = [one.bit.bit_length() - 1 for row in stencil_rows(lattice.steps)[1] for one in row]
        order, (offset, constants) = np.argsort(bits), lattice.neighbours()
        table = model.with_law(self._neighbours.Table())
        upload_fields(table, model.device, mask=lattice.mask, offset=offset[order])
        table.constants = records_of_three(model, constants[0, order])
        return table

    def by_connection(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return derivatives by the constants of connections, in the system's order."""
        result, numbers = np.zeros(self._model.connection_count), self._lattice.numbers(self._model.system).ravel()
        result[numbers[numbers >= 0]] = values[numbers >= 0]
        return result


class InStencil(InLattice):
    """The springs of a large uniform lattice on a GPU, with the loop over neighbours unrolled."""

    def _table(self, model: Model, lattice: Lattice) -> Any:
        """Return the struct that the kernel reads, which is that of the stencil."""
        return Stencil(model).data

    def kernel(self, wanted: Wanted) -> Any:
        """Compose the kernel of the adjoint."""
        model = self._model
        damped = model.laws.damper is not None
        return stencil_adjoint(model.dim, model.scalar, damped, wanted, self._lattice.steps, self.table._cls)

    def launch(self, kernel: Any, inputs: list[Any], over: Callable[..., None]) -> None:
        """Launch the kernel with a thread for each particle."""
        wp.launch(kernel, self._count, inputs, device=self._model.device, block_dim=BLOCK)


def is_large(model: Model) -> bool:
    """Tell whether a GPU has enough particles for one thread each."""
    return model.device.is_cuda and 2 * model.stride > MOST_THREADS


def springs_of_particles(model: Model, actuated: ActuatedSprings | None) -> InTable | InLattice:
    """Return the fastest way to find the springs of each particle."""
    if actuated is None and not model.in_worlds:
        with suppress(NotALattice):
            lattice = model.lattice or find_lattice(model.system)
            if lattice.uniform and not len(lattice.ties):
                # Only a model with a lattice has arrays with the margins that a stencil reads.
                unrolled = model.lattice is not None and model.laws.linear and is_large(model)
                return InStencil(model, lattice) if unrolled else InLattice(model, lattice)
    return InTable(model, actuated)
