"""AngleSprings: the angles of a system that resist bending, on a device."""

import numpy as np
import warp as wp
from numpy.typing import NDArray

from ...kernels.springs.angles import angle_blocks, angle_energies, angle_forces, angle_law
from ..device.csr import rows
from ..device.device import upload_fields
from ..model.effect import Effect, Elements, summed
from ..model.model import Model


class AngleSprings(Effect):
    """The forces of angles."""

    conserves = True

    def __init__(self, model: Model) -> None:
        angles = model.system.angles
        assert angles is not None
        self._model, self._count, self._particles = model, len(angles), angles.particles
        for name in ("stiffness", "damping"):
            model.check_range(getattr(angles, name), f"angles.{name}")
        damped = bool(angles.damping.any())
        term = self.term = angle_forces(model.dim, model.scalar, model.compensated, damped)
        self.data = term.Data()
        self._kinds = model.dim, model.scalar, term.Data
        self._blocks, self._energies = angle_blocks(*self._kinds), angle_energies(*self._kinds)
        model.kernels.note(self._blocks, self._energies)
        order, first = rows(angles.particles.ravel(), model.particle_count)
        self.members = np.diff(first) > 0
        upload_fields(
            self.data,
            model.device,
            first=first,
            entry=order,
            particles=angles.particles,
            stiffness=angles.stiffness,
            damping=angles.damping,
        )

    def add_blocks(self, x: wp.array, v: wp.array, stiffness: wp.array, damping: wp.array, world: int = 0) -> None:
        """Add half a bound of angles' stiffness and damping to the blocks, which the stability bound doubles."""
        outputs = [stiffness, damping]
        wp.launch(self._blocks, self._count, [self.data, x], outputs, device=self._model.device)

    def elements(self) -> Elements:
        """Return the angles as elements, for gradients."""
        return Elements(self.data, angle_law(*self._kinds), self._particles)

    def energies_and_powers(self, x: wp.array, v: wp.array) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the stored energy Σ 2 K tan²(θ/2) [J] and the dissipated power Σ D θ'² [W]."""
        inputs = [self.data, self._model.stride, x, v]
        return summed(self._model, self._energies, self._count, inputs)
