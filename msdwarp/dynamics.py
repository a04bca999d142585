"""Dynamics: the equation of motion x'' = f(x, x')/m + g with contact, as integrators see it."""

from typing import Any

import warp as wp

from .forces import Scatter
from .kernels.motion import Motion, particle_acceleration
from .model import Model


class Dynamics:
    """Joins a model and a route to its forces, and launches integrator kernels composed for the two."""

    def __init__(self, model: Model) -> None:
        forces = Scatter(model)
        self.model = model
        self.evaluate = forces.evaluate
        self.motion = Motion(
            model.dim,
            model.scalar,
            forces.Forces,
            particle_acceleration(model.dim, model.scalar, forces.Forces, forces.force_at, model.pinned),
            model.Colliders,
            model.collide,
        )
        self._arguments = (forces.data, model.inverse_mass, model.gravity, model.colliders)

    def launch(self, compose: Any, *arguments: Any) -> None:
        """Launch, over the particles, the kernel that `compose` makes for this motion.

        The arguments that say what the motion is come first in every integrator kernel; `arguments`
        follow them.
        """
        wp.launch(
            compose(self.motion),
            dim=self.model.particle_count,
            inputs=[*self._arguments, *arguments],
            device=self.model.device,
        )
