"""The adjoint of spring forces on a device: by a table of neighbours, or for a uniform lattice without one."""

from contextlib import suppress
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from ...kernels.adjoint import Wanted, gather_adjoint, stencil_adjoint
from ...kernels.springs import CONSTANTS, stencil_rows
from ..loads.actuators import ActuatedSprings
from ..model.lattice import Lattice, NotALattice, find_lattice
from ..model.model import Model
from ..springs.force_algorithms import neighbour_table, records_of_three


class GatherAdjoint:
    """Sums over the neighbours of each particle, found in a table; for every system."""

    def __init__(self, model: Model, wanted: Wanted, actuated: ActuatedSprings | None) -> None:
        self._model, self._actuated = model, actuated
        self.kernel = gather_adjoint(model.dim, model.scalar, model.laws, wanted, actuated is not None)
        column = np.full(model.connection_count if actuated is not None else 1, -1, dtype=np.int32)
        if actuated is not None:
            column[actuated.connection] = actuated.column
        self.entries = model.connection_count
        """Entries of the derivatives by a constant."""
        self._table = [*neighbour_table(model), model.connections, *(getattr(model, name) for name in CONSTANTS)]
        self._table.append(wp.array(model.ordered(column), dtype=int, device=model.device))
        self._no_strain = wp.zeros((1, 1), dtype=model.scalar, device=model.device)
        self._by_strain = self._no_strain
        if actuated is not None:
            self._by_strain = wp.zeros(actuated.data.strain.shape, dtype=model.scalar, device=model.device)

    def inputs(self, stage: int) -> list[Any]:
        """Return the first arguments of `kernel` for forces at a stage of a frame."""
        strain = self._no_strain if self._actuated is None else self._actuated.data.strain
        return [*self._table, strain, stage, self._by_strain]

    def take_strains(self) -> NDArray[np.float64]:
        """Return what has been added to the derivatives by strains, shape [stages, columns], and set them to 0."""
        found = self._by_strain.numpy().astype(np.float64)
        self._by_strain.zero_()
        return found

    def by_connection(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return derivatives by the constants of connections, in the system's order."""
        return self._model.in_system_order(values)


class StencilAdjoint:
    """The same for a uniform lattice without ties and actuators: neighbours are at constant offsets."""

    def __init__(self, model: Model, wanted: Wanted, lattice: Lattice) -> None:
        self._lattice, self._model = lattice, model
        self.kernel = stencil_adjoint(model.dim, model.scalar, model.laws, wanted)
        self.entries = len(lattice.steps) * model.particle_count
        bits = [one.bit.bit_length() - 1 for row in stencil_rows(lattice.steps)[1] for one in row]
        offset, constants = (one[np.argsort(bits)] for one in lattice.neighbours())
        mask = wp.array(lattice.mask, dtype=wp.uint32, device=model.device)
        offsets = wp.array(offset, dtype=int, device=model.device)
        self._table = [mask, offsets, records_of_three(model, constants)]

    def inputs(self, _stage: int) -> list[Any]:
        """Return the first arguments of `kernel`."""
        return self._table

    def by_connection(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return derivatives by the constants of connections, in the system's order."""
        result, numbers = np.zeros(self._model.connection_count), self._lattice.numbers(self._model.system).ravel()
        result[numbers[numbers >= 0]] = values[numbers >= 0]
        return result


def spring_adjoint(
    model: Model, wanted: Wanted, actuated: ActuatedSprings | None
) -> GatherAdjoint | StencilAdjoint:
    """Return the adjoint of a system's springs in its fastest form."""
    if actuated is None:
        with suppress(NotALattice):
            lattice = model.lattice or find_lattice(model.system)
            if lattice.uniform and not len(lattice.ties):
                return StencilAdjoint(model, wanted, lattice)
    return GatherAdjoint(model, wanted, actuated)
