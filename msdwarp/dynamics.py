"""Dynamics: the equation of motion x'' = f(x, x')/m + g with contact, as integrators see it."""

from typing import Any

import warp as wp

from .forces import Scatter
from .kernels.compensation import compensation
from .kernels.motion import Motion, particle_acceleration
from .model import Model


class Dynamics:
    """Joins a model and a route to its forces, and launches integrator kernels composed for the two."""

    def __init__(self, model: Model) -> None:
        Lost, add = compensation(model.dim, model.scalar, model.compensated)
        lost = Lost()
        kept = model.particle_count if model.compensated else 0
        lost.x, lost.v = (wp.zeros(kept, dtype=model.vector, device=model.device) for _ in range(2))
        self.lost = lost
        forces = self.forces = Scatter(model, lost.x)
        self.model = model
        self.evaluate = forces.evaluate
        self.motion = Motion(
            model.dim,
            model.scalar,
            forces.Forces,
            particle_acceleration(model.dim, model.scalar, forces.Forces, forces.force_at, model.pinned),
            model.Colliders,
            model.collide,
            Lost,
            add,
            model.compensated,
        )
        self._arguments = (forces.data, model.inverse_mass, model.gravity, model.colliders, lost)

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
