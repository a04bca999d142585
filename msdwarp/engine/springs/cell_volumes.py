"""CellVolumes: the cells of a system that resist a change of their volume, on a device."""

from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from ...bodies import CORNERS, NONE
from ...kernels.springs.cell_volumes import (
    cell_blocks,
    cell_energies,
    cell_forces,
    cell_law,
    cell_table,
    cell_volumes,
)
from ...kernels.springs.lattice_cells import lattice_pressures, lattice_volumes
from ..device.csr import rows
from ..device.device import scalar_array, upload_fields
from ..model.effect import Effect, Elements, summed
from ..model.model import Model

FACES_ON_CPU = False
"""Whether CPUs also sum forces of a lattice's cells by faces: more arithmetic, less memory traffic."""
SPRINGS = 20
"""Number of springs that take a CPU as long as one cell."""


class CellVolumes(Effect):
    """Computes pressures or forces of cells before the forces of springs; particles then sum the cells' forces.

    In a lattice each cell's pressure is stored, in other meshes the forces on each cell's corners.
    """

    conserves = True

    def __init__(self, model: Model) -> None:
        cells = model.system.cells
        assert cells is not None
        if model.system.tears:
            raise ValueError(
                "the system has cells, which hold together whatever breaks: with them no connection can break "
                "(break_strain and break_force must be inf), or poissons_ratio of the material must be None"
            )
        self._model, self._count = model, len(cells)
        flat = cells.flat
        corner_count = CORNERS // 2 if flat.all() else CORNERS
        self._kind = not flat.all(), bool(flat.any())
        self._table: Any = cell_table(model.scalar)()
        upload_fields(self._table, model.device, corners=cells.corners)
        for name in ("rest_volume", "modulus", "damping"):
            numbers = getattr(cells, name)
            model.check_range(numbers, f"cells.{name}")
            setattr(self._table, name, scalar_array(numbers, model.scalar, model.device))
        damped = self._damped = bool(cells.damping.any())
        self._corners = cells.corners[:, :corner_count]
        corner, cell = np.nonzero(self._corners.T != NONE)
        order, first = rows(cells.corners[cell, corner], model.particle_count)
        self.members = np.diff(first) > 0
        everywhere = bool(self.members.all())
        on_faces = model.device.is_cuda or FACES_ON_CPU
        steps = lattice_steps(cells.corners) if on_faces and model.dim == 3 else None
        self._size: int | None = None
        """Number of pressure entries of a world; None if the cells form no lattice."""
        if steps is not None:
            margin = sum(steps)
            self._size = model.stride + 2 * margin
            kind = model.scalar, model.compensated, damped
            self._kernel, self.term = lattice_pressures(*kind), lattice_volumes(*kind, everywhere)
            self.data = self.term.Data()
            self.data.table, self.data.steps, self.data.margin = self._table, wp.vec3i(*steps), margin
            upload_fields(self.data, model.device, lower=cells.corners[:, 0])
            self.data.pressure = wp.zeros(model.worlds * self._size, dtype=model.scalar, device=model.device)
            self.by_world = ("pressure",)
        else:
            kind = (model.dim, model.scalar, model.compensated, *self._kind, damped)
            self._kernel, self.term = cell_forces(*kind), cell_volumes(*kind, everywhere)
            self.data = self.term.Data()
            self.data.cells = self._table
            upload_fields(self.data, model.device, first=first, entry=(corner * self._count + cell)[order])
            count = model.worlds * corner_count * self._count
            self.data.force = wp.zeros(count, dtype=model.vector, device=model.device)
            self.by_world = ("force",)
        self.shared_points = SPRINGS * self._count
        kinds = model.dim, model.scalar, *self._kind
        self._blocks, self._energies = cell_blocks(*kinds), cell_energies(*kinds)
        model.kernels.note(self._kernel, self._blocks, self._energies)

    def before_forces(self, x: wp.array, v: wp.array, compensation: Any, begins: bool) -> None:
        """Launch the kernel that computes pressures, or forces on corners, for positions x and velocities v."""

        def launch(part: int, parts: int) -> None:
            begin, end = part * self._count // parts, (part + 1) * self._count // parts
            model, threads = self._model, (self._model.worlds, end - begin)
            if self._size is None:
                inputs = [self._table, begin, model.stride, compensation, x, v]
                wp.launch(self._kernel, threads, inputs, [self.data.force], device=model.device)
            else:
                inputs = [self.data, begin, model.stride, self._size, compensation, x, v]
                wp.launch(self._kernel, threads, inputs, [], device=model.device)

        self.launcher.launch_parts(launch)

    def add_blocks(self, x: wp.array, v: wp.array, stiffness: wp.array, damping: wp.array, world: int = 0) -> None:
        """Add half a bound of cells' stiffness and damping to the blocks, which the stability bound doubles."""
        model = self._model
        table = model.table("inverse_mass")
        inputs = [self._table, table[world % table.shape[0]], x]
        wp.launch(self._blocks, self._count, inputs, [stiffness, damping], device=model.device)

    def elements(self) -> Elements:
        """Return the cells as elements, for gradients."""
        model, (solid, flat) = self._model, self._kind
        law = cell_law(model.dim, model.scalar, solid, flat, self._damped)
        return Elements(self._table, law, self._corners)

    def energies_and_powers(self, x: wp.array, v: wp.array) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the stored energy Σ V₀ w [J] and the dissipated power Σ c V̇²/V₀ [W]."""
        model = self._model
        return summed(model, self._energies, self._count, [self._table, model.stride, x, v])


def lattice_steps(corners: NDArray[np.integer]) -> tuple[int, int, int] | None:
    """Return the index steps from a cell's first corner along three axes, if equal for all cells; else None.

    All steps are positive; sums of them lead to the other corners.
    """
    apart = corners - corners[:, :1]
    if (apart[0, 1:] <= 0).any() or (apart != apart[0]).any():
        return None
    a, b, c = (int(apart[0, k]) for k in (1, 3, 4))
    whole = [0, a, a + b, b, c, a + c, a + b + c, b + c]
    return (a, b, c) if apart[0].tolist() == whole else None
