"""InvertedCells: finds the cells of lattices that are turned inside out, whether or not they resist that."""

import numpy as np
import warp as wp
from numpy.typing import NDArray

from ...bodies import Cells, body_name, cells_of, connection_between
from ...kernels.springs.cell_volumes import inverted_cells
from ..model.model import Model
from .fracture import Fracture

FEW = 10_000
"""Particles up to which the volumes of cells are computed on the host, without a kernel to compile."""


def note_inverted_cells(model: Model) -> None:
    """Note the kernel that finds inverted cells, if large lattices need it."""
    if model.particle_count > FEW and model.system.directions:
        model.kernels.note(inverted_cells(model.dim, model.scalar))


class InvertedCells:
    """The cells of a system's lattice solids, in two dimensions of its sheets.

    A cell is inverted if its volume is not above 0, or not below 0 in a body that is mirrored at the `start`:
    positions [m], shape [particle_count, d]. Cells with a broken spring do not count.
    """

    def __init__(self, model: Model, fracture: Fracture | None, start: NDArray[np.float64]) -> None:
        self._model, self._fracture, system = model, fracture, model.system
        self._corners, self._body = cells_of(system), np.zeros(system.particle_count, dtype=int)
        for k, body in enumerate(system.directions):
            for part in body.values():
                self._body[system.connections[part]] = k
        self._seen = self._mirrored = np.zeros(len(self._corners), dtype=bool)
        self._table = wp.array(self._corners, dtype=int, device=model.device)
        body = self._body[self._corners[:, 0]]
        marked = self._marked(wp.array(start, dtype=model.vector, device=model.device), 1)[0]
        self._mirrored = np.bincount(body, marked - 0.5, 1)[body] > 0

    def _marked(self, x: wp.array, worlds: int) -> NDArray[np.bool_]:
        """Return a mask of the cells whose volume has the wrong sign, shape [worlds, cell_count]."""
        model = self._model
        if model.particle_count <= FEW and len(self._corners):
            cells = Cells(corners=self._corners, rest_volume=1.0, modulus=1.0)
            found = [cells.volumes(one) <= 0.0 for one in x.numpy().reshape(worlds, -1, model.dim)]
            return np.array(found) ^ self._mirrored
        found = wp.zeros((worlds, len(self._corners)), dtype=wp.uint8, device=model.device)
        if len(self._corners):
            inputs = [self._table, model.stride, x]
            wp.launch(inverted_cells(model.dim, model.scalar), found.shape, inputs, [found], device=model.device)
        return found.numpy().astype(bool) ^ self._mirrored

    def find(self, x: wp.array) -> NDArray[np.bool_]:
        """Return a mask of the inverted cells at positions x [m], shape [worlds, cell_count]."""
        found = self._marked(x, self._model.worlds)
        if self._fracture is not None and found.any():
            pairs = np.transpose(np.triu_indices(self._corners.shape[1], 1))
            broken_at = self._fracture.checkpoint()["broken_at"]
            for mask, when in zip(found, np.split(broken_at, len(found)), strict=True):
                springs = connection_between(self._model.system, self._corners[mask][:, pairs])
                mask[mask] = np.isinf(np.append(when, np.inf)[springs]).all(axis=1)
        return found

    def look(self, x: wp.array) -> str | None:
        """Return how many cells of which body are inverted, now and at the last look, in a single world, or None.

        A blow may turn a corner inside out for some frames. `x` are the positions now [m].
        """
        if not len(self._corners):
            return None
        body, before = self._body[self._corners[:, 0]], self._seen
        self._seen = self.find(x)[0]
        count = np.bincount(body[self._seen & before], minlength=1)
        if not count.any():
            return None
        worst = count.argmax()
        name = body_name(self._model.system.groups, np.flatnonzero(self._body == worst))
        return f"{count[worst]} of {np.count_nonzero(body == worst)} cells of {name} are turned inside out"
