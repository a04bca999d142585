"""Dynamics: the equation of motion x'' = f(x, x')/m + g with contact, as integrators see it."""

from collections.abc import Callable
from typing import Any

import warp as wp

from ..kernels.forces import COLUMN, flow_each, plastic_flow
from ..kernels.integrators import Composition, each_column, each_connection, each_particle, world
from .forces import ROUTE_CLASSES
from .model import Model
from .state import State

LEAST_IN_COLUMNS = 30_000
"""Fewer particles are too few columns to keep a GPU busy."""


class Dynamics:
    """Joins a model and a route to its forces, and launches integrators' stages composed for the two."""

    def __init__(self, model: Model) -> None:
        self.model = model
        forces = ROUTE_CLASSES[model.route](model)
        around = model.surroundings
        self.motion = Composition(
            model.dim,
            model.scalar,
            forces.route,
            model.pinned,
            around.Colliders,
            around.collide,
            model.compensated,
            around.moving,
            model.yields,
        )
        self.world = world(self.motion)()
        self.world.forces, self.world.inverse_mass = forces.data, model.inverse_mass
        self.world.gravity, self.world.colliders = model.gravity, around.data
        if model.yields:
            self._flow = plastic_flow(model.dim, model.scalar, model.compensated)[0]()
            self._flow.connections, self._flow.rest_length = model.connections, model.rest_length
            for name in ("original_length", "yield_strain", "relaxation_time", "largest_plastic_strain"):
                setattr(self._flow, name, model.per_connection(name))
        self._columns = columns(model) if forces.route.column_forces else 0
        self._recorded: list[tuple[Any, Any]] | None = None

    def begin(self, substeps: int, dt: float) -> None:
        """Prepare for frames of so many substeps of `dt` seconds."""
        model = self.model
        model.surroundings.begin(model.inverse_mass, substeps, dt)
        self.world.colliders = model.surroundings.data
        if model.yields:
            self._flow.h = dt
            self.world.flow = self._flow

    def begin_substep(self, state: State, substep: int) -> None:
        """Begin substep number `substep`: connections yield, and colliders move."""
        model = self.model
        if model.yields:
            inputs = [self.world.flow, state.here.lost, state.here.x]
            wp.launch(flow_each(self.motion), model.connection_count, inputs, device=model.device)
        self.move_colliders(substep)

    def move_colliders(self, substep: int) -> None:
        """Have what is launched next find colliders where they are in this substep of a frame, where any move."""
        around = self.model.surroundings
        if around.moving:
            around.data.substep = substep
            self.world.colliders = around.data

    def launch(self, method: Any, **fields: Any) -> None:
        """Launch a stage of a method: evaluate the forces that it asks for at its x and v, advance all particles.

        Parameters
        ----------
        method
            One of the functions of `msdwarp.kernels.integrators`.
        fields
            The fields of its `Step`.
        """
        Step, _, forced = method(self.motion)
        step = Step()
        for name, value in fields.items():
            setattr(step, name, value)
        if self._recorded is not None:
            self._recorded.append((method, step))
            return
        model = self.model
        if forced and self.motion.route.evaluate is not None and model.connection_count:
            inputs = [self.world.forces, step.lost, step.x, step.v]
            kernel, threads = each_connection(self.motion), model.connection_count
            wp.launch(kernel, threads, inputs, device=model.device, block_dim=1024)
        if forced and self._columns:
            kernel, threads = each_column(self.motion, method), self._columns
        else:
            kernel, threads = each_particle(self.motion, method), model.particle_count
        wp.launch(kernel, threads, [self.world, step], device=model.device, block_dim=self.motion.route.block)

    def record(self, take_substeps: Callable[[], Any]) -> list[tuple[Any, Any]]:
        """Return the stages (method, step) that `take_substeps` would launch, without launching them."""
        self._recorded = []
        try:
            take_substeps()
            return self._recorded
        finally:
            self._recorded = None


def columns(model: Model) -> int:
    """Return how many columns of particles are advanced at a time; 0 where particles are, one by one."""
    stride = model.lattice.stride if model.lattice else 0
    if stride <= 0 or not model.device.is_cuda or model.particle_count < LEAST_IN_COLUMNS:
        return 0
    return -(-model.particle_count // (COLUMN * stride)) * stride
