"""Evaluates the connection forces on a device.

A route is a way to do it. It names the struct that its kernels need (`Forces`), the function by which an
integrator reads the force on a particle (`force_at`), and evaluates them for given positions and velocities.
"""

import warp as wp

from .kernels.implicit import add_linearised
from .kernels.scatter import scatter, scattered_force
from .kernels.stability import add_blocks
from .model import Model


class Scatter:
    """The connection-parallel route: atomic adds to both ends (report Algorithm 3)."""

    def __init__(self, model: Model, x_lost: wp.array) -> None:
        self.model, self.x_lost = model, x_lost
        self.Forces, self.force_at = scattered_force(model.dim, model.scalar)
        self.kernel = scatter(model.dim, model.scalar, model.damped, model.compensated)
        self.data = self.Forces()
        self.data.f = wp.zeros(model.particle_count, dtype=model.vector, device=model.device)

    def evaluate(self, x: wp.array, v: wp.array) -> None:
        """Make ready the forces at (x, v), each of which may then be read once."""
        model = self.model
        if model.connection_count:
            wp.launch(
                self.kernel,
                dim=model.connection_count,
                inputs=[
                    model.connections,
                    model.rest_length,
                    model.stiffness,
                    model.damping,
                    x,
                    v,
                    self.x_lost,
                ],
                outputs=[self.data.f],
                device=model.device,
            )

    def add_linearised(
        self, x: wp.array, p: wp.array, z: wp.array, *, spring: float, damper: float, scale: float
    ) -> None:
        """Add scale (spring·K + damper·B) p to z, with K and B the system linearised at x."""
        model = self.model
        if model.connection_count:
            constants = [model.connections, model.rest_length, model.stiffness, model.damping]
            wp.launch(
                add_linearised(model.dim, model.scalar),
                dim=model.connection_count,
                inputs=[*constants, model.inverse_mass, x, p, spring, damper, scale],
                outputs=[z],
                device=model.device,
            )


def write_diagonal_blocks(model: Model, x: wp.array, springs: wp.array, dampers: wp.array) -> None:
    """Write the diagonal blocks of K and B at x, float64 matrices of shape [particle_count]."""
    springs.zero_()
    dampers.zero_()
    if model.connection_count:
        wp.launch(
            add_blocks(model.dim, model.scalar),
            dim=model.connection_count,
            inputs=[model.connections, model.rest_length, model.stiffness, model.damping, x],
            outputs=[springs, dampers],
            device=model.device,
        )
