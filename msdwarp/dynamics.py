"""Dynamics: the equation of motion x'' = f(x, x')/m + g with contact, as integrators see it."""

from collections.abc import Callable
from typing import Any

import warp as wp

from .forces import ROUTE_CLASSES
from .kernels.integrate import each_column, each_connection, each_particle
from .kernels.motion import Motion, world
from .kernels.plasticity import flow_each, plastic_flow
from .kernels.stay import MOST_THREADS, stay
from .kernels.stencil import COLUMN
from .model import Model, State

LEAST_IN_COLUMNS = 30_000
"""Fewer particles are too few columns to keep a GPU busy."""
MOST_IN_ONE_BLOCK = 350
"""More particles, or connections, are faster in a cluster of blocks that wait for each other."""
CLUSTER = 8
"""Blocks in a cluster: as many as every GPU that has clusters allows."""
MOST_IN_CLUSTER = {"scatter": 12_000, "gather": 2_048, "stencil": 2_048}
"""More connections, or particles, are faster with a launch for each stage."""


class Dynamics:
    """Joins a model and a route to its forces, and launches integrators' stages composed for the two."""

    def __init__(self, model: Model) -> None:
        self.model = model
        forces = ROUTE_CLASSES[model.route](model)
        around = model.surroundings
        self.motion = Motion(
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
            One of the functions of `msdwarp.kernels.integrate`.
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


class Stepper:
    """Takes substeps: by a launch for each stage or, where launches would be most of the time, by one for all.

    Parameters
    ----------
    dynamics
        What launches.
    state
        What it moves.
    take_substep
        A method's `step`, for this state.
    one_kernel
        Whether all that a substep launches is stages of one method.
    """

    def __init__(
        self, dynamics: Dynamics, state: State, take_substep: Callable[[], None], *, one_kernel: bool = True
    ) -> None:
        self._dynamics, self._state, self._take_substep = dynamics, state, take_substep
        blocks = staying_blocks(dynamics.model) if one_kernel else None
        self._stays = blocks is not None
        if blocks is None:
            return
        # Each substep flips the state: the third is the first again.
        stages = dynamics.record(lambda: (take_substep(), take_substep()))
        (method, _), device = stages[0], dynamics.model.device
        self._per_substep = len(stages) // 2
        self._kernel, self._blocks = stay(dynamics.motion, method, blocks[0]), blocks
        self._kept = [step for _, step in stages]
        self._steps = wp.array(self._kept, dtype=method(dynamics.motion).Step, device=device)

    def take(self, substeps: int, first: int = 0) -> None:
        """Take substeps, from number `first` of a frame on; the state then lies where it lay before."""
        if not self._stays:
            for k in range(substeps):
                self._dynamics.begin_substep(self._state, first + k)
                self._take_substep()
        else:
            self._stay(substeps * self._per_substep, first)
            if substeps % 2:
                self._state.flip()
        self._state.settle()

    def _stay(self, stages: int, first: int) -> None:
        model, (blocks, threads) = self._dynamics.model, self._blocks
        everyone = blocks * threads
        self._dynamics.move_colliders(first)
        wp.launch(
            self._kernel,
            dim=everyone,
            inputs=[self._dynamics.world, self._steps, stages, model.connection_count, everyone],
            device=model.device,
            block_dim=threads,
        )


def staying_blocks(model: Model) -> tuple[int, int] | None:
    """Return (blocks, threads in each) with which a body is best advanced in one launch; None where it is not."""
    device = model.device
    if not device.is_cuda:
        return 1, 1
    work = model.connection_count if model.route == "scatter" else model.particle_count
    if work <= MOST_IN_ONE_BLOCK:
        return 1, _power_of_two(work)
    if device.arch < 90 or work > MOST_IN_CLUSTER[model.route]:
        return None
    return CLUSTER, min(MOST_THREADS, _power_of_two(-(-work // CLUSTER)))


def _power_of_two(threads: int) -> int:
    """Return so many threads or more, of few different numbers: a kernel is compiled for each."""
    return max(32, 1 << (threads - 1).bit_length())
