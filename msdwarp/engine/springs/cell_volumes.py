"""CellVolumes: the cells of a system that resist a change of their volume, on a device."""

from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from ...bodies import CORNERS, NONE
from ...kernels.springs import cell_blocks, cell_energies, cell_forces, cell_table, cell_volumes
from ..device.csr import rows
from ..device.device import upload_fields
from ..device.launcher import Launcher
from ..model.effect import Effect, summed
from ..model.model import Model

SPRINGS = 20
"""Springs that take a CPU about as long as a cell."""


class CellVolumes(Effect):
    """Computes the forces of cells on their corners before those of springs, and sums them for each particle."""

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
        for name in ("rest_volume", "modulus", "damping"):
            model.check_range(getattr(cells, name), f"cells.{name}")
        numbers = {"rest_volume": cells.rest_volume, "modulus": cells.modulus, "damping": cells.damping}
        upload_fields(self._table, model.device, corners=cells.corners, **numbers)
        kind = (model.dim, model.scalar, model.compensated, *self._kind, bool(cells.damping.any()))
        self._forces = cell_forces(*kind)
        corner, cell = np.nonzero(cells.corners[:, :corner_count].T != NONE)
        order, first = rows(cells.corners[cell, corner], model.particle_count)
        self.members = np.diff(first) > 0
        self.piece = cell_volumes(*kind, bool(self.members.all()))
        self.data = self.piece.Data()
        self.data.cells = self._table
        upload_fields(self.data, model.device, first=first, entry=(corner * self._count + cell)[order])
        self.data.force = wp.zeros(
            model.worlds * corner_count * self._count, dtype=model.vector, device=model.device
        )
        self.by_world = ("force",)
        self.shared_points = SPRINGS * self._count
        self._partition: Launcher | None = None

    def use_partition(self, partition: Launcher | None) -> None:
        """Divide the cells among the threads of a launcher."""
        self._partition = partition

    def before_forces(self, x: wp.array, v: wp.array, compensation: Any, begins: bool) -> None:
        """Launch the kernel of the forces on corners, for positions x and velocities v."""

        def launch(part: int, parts: int) -> None:
            begin, end = part * self._count // parts, (part + 1) * self._count // parts
            inputs = [self._table, begin, self._model.stride, compensation, x, v]
            threads = self._model.worlds, end - begin
            wp.launch(self._forces, threads, inputs, [self.data.force], device=self._model.device)

        if self._partition is not None and self._partition.is_recording:
            self._partition.launch_parts(launch)
        else:
            launch(0, 1)

    def add_blocks(self, x: wp.array, stiffness: wp.array, damping: wp.array, world: int = 0) -> None:
        """Add half of a bound of the cells' stiffness and damping: the bound doubles blocks."""
        model = self._model
        table = model.table("inverse_mass")
        inputs = [self._table, table[world % table.shape[0]], x]
        kernel = cell_blocks(model.dim, model.scalar, *self._kind)
        wp.launch(kernel, self._count, inputs, [stiffness, damping], device=model.device)

    def energies_and_powers(self, x: wp.array, v: wp.array) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return Σ V₀ w [J] and Σ c V̇²/V₀ [W]."""
        model = self._model
        kernel = cell_energies(model.dim, model.scalar, *self._kind)
        return summed(model, kernel, self._count, [self._table, model.stride, x, v])
