"""Evaluates the connection forces on a device.

A route is a way to do it. It names the struct that its kernels need (`Forces`), the function by which an
integrator reads the force on a particle (`force_at`), and evaluates them for given positions and velocities.
"""

import warp as wp

from .kernels.scatter import scatter, scattered_force
from .model import Model


class Scatter:
    """The connection-parallel route: atomic adds to both ends (report Algorithm 3)."""

    def __init__(self, model: Model) -> None:
        self.model = model
        self.Forces, self.force_at = scattered_force(model.dim, model.scalar)
        self.kernel = scatter(model.dim, model.scalar, model.damped)
        self.data = self.Forces()
        self.data.f = wp.zeros(model.particle_count, dtype=model.vector, device=model.device)

    def evaluate(self, x: wp.array, v: wp.array) -> None:
        """Make ready the forces at (x, v), each of which may then be read once."""
        model = self.model
        if model.connection_count:
            wp.launch(
                self.kernel,
                dim=model.connection_count,
                inputs=[model.connections, model.rest_length, model.stiffness, model.damping, x, v],
                outputs=[self.data.f],
                device=model.device,
            )
