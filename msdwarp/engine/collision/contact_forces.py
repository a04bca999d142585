"""ContactForces: contact forces on particles in a frame, for probes, pictures and files."""

import numpy as np
import warp as wp

from ...bodies import uniform_like
from ...kernels.basis import vector
from ...kernels.colliders.contact_forces import mean_forces, sum_impulses
from ..device.device import scalar_array
from ..model.model import Model
from .body_contact import BodyContact
from .colliders import Colliders


class ContactForces:
    """Impulses of obstacles and other bodies on each particle, summed since the start of a frame of `seconds`."""

    def __init__(
        self, model: Model, colliders: Colliders | None, body_contact: BodyContact | None, seconds: float
    ) -> None:
        self._model, self._seconds = model, seconds
        mass = uniform_like(np.where(np.isfinite(model.mass), model.mass, 0.0), model.mass)
        self.mass = scalar_array(mass, wp.float64, model.device)
        """Masses [kg], 0 where obstacles cannot move a particle."""
        nothing, self._summed = self._zeros(), list[wp.array]()
        self.by_obstacles = self.by_bodies = nothing
        """The impulses of obstacles per mass [m/s]; and, where `by_bodies` is set, those of other bodies [N s]."""
        if colliders is not None and colliders.contact_forces:
            self.by_obstacles = colliders.data.impulse
            self._summed.append(self.by_obstacles)
        if body_contact is not None and body_contact.impulse is not None:
            self.by_bodies = body_contact.impulse
            """The impulses of other bodies [N s], float64, shape [particle_count]."""
            self._summed.append(self.by_bodies)
        self._sum = self._zeros()

    def _zeros(self) -> wp.array:
        wide = vector(self._model.dim, wp.float64)
        return wp.zeros(self._model.particle_count, dtype=wide, device=self._model.device)

    def begin(self) -> None:
        """Launch the reset of the sums at a frame's start. A graph may record it."""
        for impulse in self._summed:
            impulse.zero_()

    def by_all(self) -> wp.array:
        """Launch the sum of the impulses of obstacles and bodies; return the sum [N s]. A graph may record it."""
        model = self._model
        inputs = [self.mass, self.by_obstacles, self.by_bodies]
        wp.launch(sum_impulses(model.dim), model.particle_count, inputs, [self._sum], device=model.device)
        return self._sum

    def write_force(self, force: wp.array) -> None:
        """Launch a kernel that writes the mean of all contact forces on each particle over the last frame [N]."""
        model = self._model
        inputs = [self.by_all(), self._seconds]
        kernel = mean_forces(model.dim, model.scalar)
        wp.launch(kernel, model.particle_count, inputs, [force], device=model.device)
