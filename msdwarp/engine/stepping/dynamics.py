"""Dynamics: the equation of motion x'' = f(x, x')/m + g with contact, as integrators see it."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from ...kernels.colliders import NO_COLLIDERS, ColliderTerm
from ...kernels.effect import ForceTerm
from ...kernels.integrators import (
    Composition,
    Differences,
    begin_each_connection,
    beginning,
    force_on_each,
    scene,
)
from ...kernels.springs import NO_SUBSTEP
from ..model.effect import Effect, Steps
from ..model.state import State
from ..springs.constants_by_world import ensemble_forces
from ..springs.force_algorithms import forces_of
from ..springs.fracture import Fracture
from .assemble import Assembly
from .cpu_partition import CpuPartition
from .per_stage import PerStage, column_count, of_each_world
from .persistent import launch_persistent, persistent_kernel
from .stages import Solve, Stage, StageArrays
from .worlds import differences, fill_world_data

MOST_MARKS = 8
"""Bits that say which selective effects act on a particle."""
MOST_IN_SECOND_PASS = 0.25
"""Share of particles with marks up to which these are advanced apart."""


class Dynamics:
    """Joins a model, an algorithm for its forces, and its effects, and runs the stages of methods.

    Parameters
    ----------
    assembly
        The model and its effects.
    threads
        Threads of the CPU that share the particles.

    Attributes
    ----------
    frozen
        What has become of each world, shape [worlds]: those that are not 0 are advanced no more; None outside of
        ensembles.
    """

    frozen: Any = None

    def __init__(self, assembly: Assembly, threads: int = 1) -> None:
        self.assembly = assembly
        model = self.model = assembly.model
        forces, differs = self._forces()
        pieces = [effect.piece for effect in assembly.all]
        in_columns = column_count(model, forces.force_algorithm) > 0
        effect_mask = self._effect_mask()
        self._preceding = [one for one in assembly.all if one.precedes]
        precedes = bool(self._preceding)
        few = 0 < int(np.count_nonzero(effect_mask)) <= MOST_IN_SECOND_PASS * model.particle_count
        others = [one for one in pieces if isinstance(one, ForceTerm) and one.force is not None]
        self.composition = Composition(
            dim=model.dim,
            scalar=model.scalar,
            force_algorithm=forces.force_algorithm,
            compensated=model.compensated,
            pinned=model.pinned,
            collider_term=next((piece for piece in pieces if isinstance(piece, ColliderTerm)), NO_COLLIDERS),
            pieces=tuple(piece for piece in pieces if isinstance(piece, ForceTerm)),
            # Another launch costs about 7 µs behind so large a one: less than sums of work in each column do. It
            # also lets what is launched before forces run beside those of connections.
            second_pass=model.device.is_cuda
            and not model.in_worlds
            and all(one.selective for one in others)
            and (
                (in_columns and few and any(one.works for one in others)) or (bool(effect_mask.any()) and precedes)
            ),
            differs=differs,
        )
        self._per_stage = PerStage(model, self.composition, precedes)
        self.scene = scene(self.composition)()
        self.scene.forces, self.scene.inverse_mass = forces.data, model.inverse_mass
        self.scene.gravity = model.gravity
        if differs is not None:
            self.frozen = wp.zeros(model.worlds, dtype=wp.int32, device=model.device)
            fill_world_data(self.scene.worlds, assembly, forces, self.frozen)
        for effect in assembly.all:
            self._place(effect)
        if self.composition.selective:
            self.scene.effect_mask = wp.array(effect_mask, dtype=wp.uint8, device=model.device)
        if self.composition.second_pass:
            self.scene.masked_particles = wp.array(np.flatnonzero(effect_mask), dtype=int, device=model.device)
            self.scene.spring_force = model.vectors()
        self._steps, self._last_stage, self._looking = Steps(1.0, 1), 0, False
        self._searching = [one for one in assembly.all if type(one).search is not Effect.search]
        self._summing = [one for one in self._preceding if type(one).add_up is not Effect.add_up]
        self._in_frame = self._begins = self._within = False
        self._due: list[Effect] = []
        self._stage = 0
        self.threads = threads
        self.partition = CpuPartition(model, self.composition, threads) if threads > 1 else None
        """What has threads share the stages of a frame that is recorded; None where one thread takes them."""
        for effect in assembly.all:
            effect.use_partition(self.partition)
        self._in_stages = not assembly.begins_substeps
        self._by_one_thread = not model.device.is_cuda and bool(self._preceding) and self._in_stages
        self._arrays = StageArrays()

    def _forces(self) -> tuple[Any, Differences | None]:
        """Return the algorithm as kernels read it, and what differs between worlds, if there are many."""
        model, fracture = self.model, self.assembly.fracture
        if not model.in_worlds:
            return forces_of(model, fracture), None
        plasticity = self.assembly.plasticity
        rest_length = None if plasticity is None else plasticity.rest_length
        forces = ensemble_forces(model, fracture, rest_length)
        return forces, differences(self.assembly, forces)

    def _place(self, effect: Effect) -> None:
        """Have kernels find an effect's data as they are now."""
        if isinstance(effect, Fracture):
            self.scene.forces.breaking = effect.data
            return
        field = effect.piece.field if isinstance(effect.piece, ForceTerm) else "colliders"
        setattr(self.scene, field, effect.data)

    def _effect_mask(self) -> NDArray[np.uint8]:
        """Return which selective effects act on each particle, as bits."""
        effect_mask = np.zeros(self.model.particle_count, dtype=np.uint8)
        selective = [one for one in self.assembly.all if isinstance(one.piece, ForceTerm) and one.piece.selective]
        if len(selective) > MOST_MARKS:
            raise ValueError(
                f"{len(selective)} loads of different kinds act on particles; at most {MOST_MARKS} can"
            )
        for k, effect in enumerate(selective):
            assert effect.members is not None
            effect_mask[effect.members] |= np.uint8(1 << k)
        return effect_mask

    def begin(self, steps: Steps) -> None:
        """Prepare for frames of these substeps."""
        self._steps, self._last_stage = steps, steps.substeps * len(steps.stage_times)
        self.model.generation += 1  # tables are other ones
        if self.composition.timed:
            self.scene.time = wp.zeros(self._last_stage + 1, dtype=self.model.scalar, device=self.model.device)
        for effect in self.assembly.all:
            effect.steps = steps
            effect.begin(steps.substeps, steps.dt)
            self._place(effect)

    def begin_frame(self, time: float) -> None:
        """Prepare for the frame that begins at `time` [s]: on the host, before the frame's graph is launched."""
        if self.composition.timed:
            self.scene.time.assign(self._steps.times(time).astype(self.model.dtype))
        for effect in self.assembly.all:
            effect.begin_frame(time)

    def prepare(self, time: float) -> None:
        """Do on the host what can be done early for the frame that begins at `time` [s], while another runs."""
        for effect in self.assembly.all:
            effect.prepare(time)

    def hold(self, time: float) -> None:
        """Have what is launched between frames find effects as they are at `time` [s]."""
        if self.composition.timed:
            self.scene.time.fill_(time)
        for effect in self.assembly.all:
            effect.hold(time)
        self.rest()

    def rest(self) -> None:
        """Have what is launched next find effects as they are where a frame ends."""
        self._in_frame = self._begins = False
        if self.composition.timed:
            self.scene.stage = self._last_stage

    @contextmanager
    def looking(self, substep: int) -> Iterator[None]:
        """Have what is launched meanwhile find effects as they are where substep number `substep` ends.

        Forces are looked at only: they do no work, and no stage of the next substep has been taken.
        """
        if self.composition.timed:  # which is where the next one begins
            self.scene.stage = (substep + 1) * len(self._steps.stage_times)
        work = self.assembly.external_work
        if work is not None:
            setattr(self.scene, work.field, work.idle)
        self._looking = True
        try:
            yield
        finally:
            self._looking = False
            if work is not None:
                self._place(work)

    def begin_substep(self, state: State, substep: int) -> None:
        """Begin substep number `substep` of a frame: launch what effects do to each connection then."""
        if beginning(self.composition) is not None:
            now, kernel = state.state_in, begin_each_connection(self.composition)
            inputs = [self.scene, now.compensation, now.x]
            if self.model.in_worlds:
                step = force_on_each(self.composition).Step()
                step.compensation, step.x = now.compensation, now.x
                inputs = [self.scene, step]
            wp.launch(
                kernel, of_each_world(self.model, self.model.connection_count), inputs, device=self.model.device
            )
        self._due = [effect for effect in self._searching if substep % effect.rebuild_interval == 0]
        self._within = substep > 0
        self._in_frame = self._begins = True
        self._stage = 0
        self.go_to(substep)

    def go_to(self, substep: int) -> None:
        """Have what is launched next find effects as they are in this substep of a frame."""
        for effect in self.assembly.all:
            if effect.begin_substep(substep):
                self._place(effect)
        if self.composition.timed:
            self.scene.stage = substep * len(self._steps.stage_times)

    def have_begun(self) -> None:
        """Have what is launched next begin no substep: nothing breaks then."""
        if self.composition.force_algorithm.tears:
            self.scene.forces.breaking.substep = NO_SUBSTEP

    def run(self, stage: Stage | Solve) -> None:
        """Run a stage: launch what effects need before forces, then advance all particles.

        Particles are advanced by a launch with a thread for each (`PerStage`), by threads of the CPU that share
        them (`CpuPartition`), or by one thread of the CPU (`launch_persistent`). In the first stage of a substep
        connections break.
        """
        if isinstance(stage, Solve):
            stage.launch(self)
            return
        method, step = stage.method, stage.step(self.composition)
        forced = method(self.composition).forced
        if forced and self._preceding:
            with self._per_stage.beside():
                self._precede(step)
        partition, looking = self.partition, self._looking
        if forced and partition is not None and partition.is_recording and self._in_stages and not looking:
            steps = self._arrays.of_one(step, partition.kernel(method), self.model.device)
            partition.launch(method, self.scene, steps, 1)
        elif forced and self._by_one_thread:
            kernel = self.persistent(method, 1, 1)  # a thread for each particle would copy its arguments first
            steps = self._arrays.of_one(step, kernel, self.model.device)
            launch_persistent(kernel, self.model, self.scene, steps, 1, self.model.worlds, 1)
        else:
            self._per_stage.launch(self.scene, method, step)
        if self.composition.timed and not looking and self.scene.stage < self._last_stage:
            self.scene.stage += 1
        if not looking:
            self._stage += 1
        self.have_begun()

    def persistent(self, method: Any, blocks: int, threads: int) -> Any:
        """Return the kernel that takes many stages by blocks of threads; a world takes one block."""
        return persistent_kernel(self.assembly, self.composition, method, blocks, threads)

    def _precede(self, step: Any) -> None:
        """Launch what effects need before the forces of a stage are taken."""
        for effect in self._due if self._in_frame else self._searching:
            effect.search(step.x, step.v, step.compensation, self._in_frame and self._within)
        self._due = []
        for effect in self._preceding:
            effect.before_forces(step.x, step.v, step.compensation, self._begins and not self._looking)
        if self._in_frame and not self._looking:
            for effect in self._summing:
                effect.add_up(self._steps.dt * self._steps.weights[self._stage])
        self._begins = self._begins and self._looking

    @property
    def drives(self) -> bool:
        """Whether any particle is driven."""
        return any(piece.drive is not None for piece in self.composition.pieces)

    @property
    def launches_before_forces(self) -> bool:
        """Whether anything is launched before the forces of a stage are taken."""
        return bool(self._preceding)
