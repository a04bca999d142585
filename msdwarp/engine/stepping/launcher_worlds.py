"""EnsembleDynamics: launches integrators' stages in all worlds of an ensemble at once."""

from collections.abc import Callable
from typing import Any

import warp as wp

from ... import checks
from ...kernels.ensembles import (
    Differences,
    by_world,
    each_connection_of_worlds,
    each_particle_of_worlds,
    on_chip_worlds,
    persistent_worlds,
)
from ..collision.colliders import Colliders
from ..model.state import State
from ..model.worlds import EnsembleModel
from ..springs.constants_by_world import ensemble_forces
from .launcher import Dynamics
from .shared_memory import Chip, on_chip
from .substeps import power_of_two

MOST_IN_BLOCK = {"float32": 1024, "float32-compensated": 1024, "float64": 512}
"""Threads of a block, and of a multiprocessor, that find registers enough."""
IN_COLUMNS = 512
"""Threads of a multiprocessor that find registers enough for columns of particles."""
FEW_WORLDS_BLOCK, MANY_WORLDS_BLOCK = 1024, 512
"""Threads of the largest block where each world has a multiprocessor for itself, and where they are more."""
MOST_IN_SMALL_WORLD, MOST_IN_WORLD = 512, 4096
"""Worlds of more particles are advanced by a launch for each stage: where there are few worlds, and many."""


class EnsembleDynamics(Dynamics):
    """The equation of motion of all worlds of an ensemble.

    Attributes
    ----------
    frozen
        What has become of each world, shape [worlds]: those that are not RUNNING are advanced no more.
    """

    def __init__(self, model: EnsembleModel) -> None:
        forces = ensemble_forces(model)
        super().__init__(model, forces)
        self.model: EnsembleModel = model
        rows = model.rows
        self.differs = Differences(
            gravity="gravity" in rows,
            mass="mass" in rows,
            friction="friction" in rows,
            storage=forces.storage,
            **forces.how,
        )
        self.frozen = wp.zeros(model.worlds, dtype=wp.int32, device=model.device)
        self._by = by_world(self.composition, self.differs).ByWorld()
        self._by.stride, self._by.frozen = model.stride_in_bytes, self.frozen
        if "gravity" in rows:
            self._by.gravity = model.world_gravity
        if "mass" in rows:
            self._by.inverse_mass = model.world_inverse_mass
        if "friction" in rows:
            self._by.friction = model.upload_rows(rows["friction"])
        for name, array in forces.fields.items():
            setattr(self._by, name, array)
        if model.touching is not None:
            self._by.unit, self._by.body_contact = model.touching.units, model.touching.stride_in_bytes

    def launch_stage(self, method: Any, step: Any, forced: bool) -> None:
        """Launch a stage with a thread for each connection, and one for each particle, of each world."""
        model, kinds = self.model, (self.composition, self.differs, method)
        inputs = [self.scene, self._by, step]
        if forced and self.composition.force_algorithm.evaluate is not None and model.connection_count:
            kernel, threads = each_connection_of_worlds(*kinds), (model.worlds, model.connection_count)
            wp.launch(kernel, threads, inputs, device=model.device, block_dim=1024)
        kernel, threads = each_particle_of_worlds(*kinds), (model.worlds, model.particle_count)
        wp.launch(kernel, threads, inputs, device=model.device, block_dim=self.composition.force_algorithm.block)

    def _take_stage(self, method: Any, step: Any) -> None:
        """Launch a stage of all worlds on the CPU, a thread for each: see `Dynamics`."""
        kernel: Any = persistent_worlds(self.composition, self.differs, method, 1, self.together)
        inputs = [self.scene, self._by, self._as_steps(step, kernel, 2), 1, self.model.connection_count]
        wp.launch(kernel, self.model.worlds, inputs, device=self.model.device)

    @property
    def together(self) -> int:
        """How many threads a multiprocessor shall hold at a time; solid obstacles take more registers."""
        solids = any(isinstance(one, Colliders) and not one.planes_only for one in self.model.effects)
        return MOST_IN_BLOCK[self.model.precision] // (2 if solids else 1)

    def launch_all(self, method: Any, steps: wp.array, stages: int, threads: int) -> None:
        """Launch so many stages of all worlds at once, a block of threads for each world."""
        model = self.model
        kernel = persistent_worlds(self.composition, self.differs, method, threads, self.together)
        inputs = [self.scene, self._by, steps, stages, model.connection_count]
        wp.launch(kernel, model.worlds * threads, inputs, device=model.device, block_dim=threads)

    def launch_all_on_chip(self, method: Any, chip: Chip, stages: int) -> None:
        """Do the same with the state of each world in the shared memory of its block."""
        model, threads = self.model, chip.threads
        together = min(self.together, IN_COLUMNS) if chip.in_columns else self.together
        kinds = (self.composition, self.differs, method, threads, together, chip.room, chip.in_columns)
        inputs = [self.scene, self._by, chip.steps, stages, chip.home, chip.words, chip.each, chip.margin]
        kernel: Any = on_chip_worlds(*kinds)
        wp.launch(kernel, model.worlds * threads, inputs, device=model.device, block_dim=threads)


class EnsembleStepper:
    """Takes substeps of all worlds: by a launch for each stage, or by one for all of a frame.

    Parameters
    ----------
    dynamics, state
        What launches, and what it moves.
    take_substep
        A method's `step`, for this state.
    threads
        Threads that take all substeps of a world; None for a launch for each stage; "auto" for what seems best.
    """

    def __init__(
        self, dynamics: EnsembleDynamics, state: State, take_substep: Callable[[], None], threads: int | str | None
    ) -> None:
        self._dynamics, self._state, self._take_substep = dynamics, state, take_substep
        self._chip: Chip | None = None
        self.threads = _asked_for(threads, dynamics)
        """Threads that take all substeps of a world; None where each stage is a launch."""
        if dynamics.launches_before_forces or threads is None:
            return
        # Each substep flips the state: the third is the first again.
        stages = dynamics.record(lambda: (take_substep(), take_substep()))
        self._method, self._per_substep = stages[0][0], len(stages) // 2
        self._kept = [step for _, step in stages]
        Step = self._method(dynamics.composition).Step
        if threads == "auto":
            kept = self._kept[: self._per_substep]
            self._chip = on_chip(dynamics.model, state, dynamics.composition.force_algorithm, Step, kept)
        if self._chip is not None:
            self.threads = self._chip.threads
        elif self.threads is not None:
            self._steps = wp.array(self._kept, dtype=Step, device=dynamics.model.device)

    def take(self, substeps: int) -> None:
        """Take substeps; the state then lies where it lay before."""
        if self._chip is not None:
            self._dynamics.launch_all_on_chip(self._method, self._chip, substeps * self._per_substep)
        elif self.threads is None:
            for k in range(substeps):
                self._dynamics.begin_substep(self._state, k)
                self._take_substep()
        else:
            self._dynamics.launch_all(self._method, self._steps, substeps * self._per_substep, self.threads)
            if substeps % 2:
                self._state.flip()
        self._dynamics.rest()
        self._state.settle()


def _asked_for(threads: Any, dynamics: EnsembleDynamics) -> int | None:
    """Return how many threads take all substeps of a world; raise ValueError if so many cannot."""
    if threads is None:
        return None
    if isinstance(threads, str):
        checks.one_of("threads", threads, ("auto",))
        return best_threads(dynamics)
    if dynamics.launches_before_forces:
        raise ValueError(f"threads is {threads}; it must be 'auto' or None where bodies touch")
    most = MOST_IN_BLOCK[dynamics.model.precision] if dynamics.model.device.is_cuda else 1
    if checks.count("threads", threads, 1) > most or threads != 1 << (threads - 1).bit_length():
        raise ValueError(f"threads is {threads}; it must be 'auto', None, or a power of 2 up to {most} here")
    return threads


def best_threads(dynamics: EnsembleDynamics) -> int | None:
    """Return how many threads are to take all substeps of a world; None for a launch for each stage.

    A block has a multiprocessor's caches to itself, or shares them with few others. On a GPU these are estimates,
    of what a multiprocessor holds.
    """
    model = dynamics.model
    if dynamics.launches_before_forces:
        return None
    if not model.device.is_cuda:
        return 1
    worlds_at_a_time = model.device.sm_count
    many = 2 * model.worlds >= worlds_at_a_time
    if model.particle_count > (MOST_IN_WORLD if many else MOST_IN_SMALL_WORLD):
        return None
    most = FEW_WORLDS_BLOCK if model.worlds <= worlds_at_a_time else MANY_WORLDS_BLOCK
    return min(power_of_two(model.particle_count), most, dynamics.together)
