"""Dynamics: the equation of motion x'' = f(x, x')/m + g with contact, as integrators see it."""

from collections.abc import Callable, Iterator
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
    each_column,
    each_connection,
    each_masked,
    each_particle,
    force_on_each,
    persistent,
    scene,
)
from ...kernels.springs import COLUMN, NO_SUBSTEP
from ..model.effect import Effect, Steps
from ..model.model import Model
from ..model.state import State
from ..springs.constants_by_world import ensemble_forces
from ..springs.force_algorithms import forces_of
from ..springs.fracture import Fracture
from .assemble import Assembly
from .cpu_partition import CpuPartition
from .worlds import differences, fill_world_data, threads_at_a_time

MOST_MARKS = 8
"""Bits that say which selective effects act on a particle."""
LEAST_IN_COLUMNS = 100_000
"""Fewer particles are too few columns to keep a GPU busy."""
MOST_IN_SECOND_PASS = 0.25
"""Share of particles with marks up to which these are advanced apart."""


class Dynamics:
    """Joins a model, an algorithm for its forces, and its effects, and launches integrators' stages.

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
        self._columns = columns(model) if forces.force_algorithm.column_forces and not model.in_worlds else 0
        effect_mask = self._effect_mask()
        self._preceding = [one for one in assembly.all if one.precedes]
        precedes = bool(self._preceding)
        few = 0 < np.count_nonzero(effect_mask) <= MOST_IN_SECOND_PASS * model.particle_count
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
                bool(self._columns and few and any(one.works for one in others))
                or (bool(effect_mask.any()) and precedes)
            ),
            differs=differs,
        )
        self._side = wp.Stream(model.device, priority=-1) if precedes and self.composition.second_pass else None
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
        self._recorded: list[tuple[Any, Any]] | None = None
        self.threads = threads
        self.partition = CpuPartition(model, self.composition, threads) if threads > 1 else None
        """What has threads share the stages of a frame that is recorded; None where one thread takes them."""
        for effect in assembly.all:
            effect.use_partition(self.partition)
        self._in_stages = not assembly.begins_substeps
        self._by_one_thread = not model.device.is_cuda and bool(self._preceding) and self._in_stages
        self._kept: dict[bytes, NDArray[np.uint8]] = {}

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
            wp.launch(kernel, self._of_each_world(self.model.connection_count), inputs, device=self.model.device)
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

    def launch(self, method: Any, **fields: Any) -> None:
        """Launch a stage of a method: evaluate the forces that it asks for at its x and v, advance all particles.

        In the first one of a substep connections break.

        Parameters
        ----------
        method
            One of the functions of `msdwarp.kernels.integrators`.
        fields
            The fields of its `Step`.
        """
        Step, _, forced = method(self.composition)
        step = Step()
        for name, value in fields.items():
            setattr(step, name, value)
        if self._recorded is not None:
            self._recorded.append((method, step))
            return
        if forced and self._preceding:
            with self._beside():
                self._precede(step)
        if forced and (self._by_one_thread or self._is_shared):
            self._take_stage(method, step)
        else:
            self.launch_stage(method, step, forced)
        if self.composition.timed and not self._looking and self.scene.stage < self._last_stage:
            self.scene.stage += 1
        if not self._looking:
            self._stage += 1
        self.have_begun()

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
    def _is_shared(self) -> bool:
        """Whether threads share the stage that is launched."""
        return self.partition is not None and self.partition.is_recording and self._in_stages and not self._looking

    @contextmanager
    def _beside(self) -> Iterator[None]:
        """Have what is launched meanwhile run beside what is launched next, up to `each_masked`, if it may."""
        if self._side is None:
            yield
            return
        self._side.wait_event(wp.get_stream(self.model.device).record_event())
        with wp.ScopedStream(self._side, sync_enter=False):
            yield

    def _take_stage(self, method: Any, step: Any) -> None:
        """Launch a stage on one thread of the CPU, as where all stages of a frame are one launch.

        With a thread for each particle and connection, each would begin with a copy of its arguments.
        """
        if self.partition is not None and self._is_shared:
            self.partition.launch(method, self.scene, self._as_steps(step, self.partition.kernel(method), 1), 1)
            return
        kernel: Any = self.persistent(method, 1, 1)
        inputs = [self.scene, self._as_steps(step, kernel, 1), 1, self.model.connection_count, 1]
        wp.launch(kernel, self.model.worlds, inputs, device=self.model.device)

    def persistent(self, method: Any, blocks: int, threads: int) -> Any:
        """Return the kernel that takes many steps by so many blocks of threads; a world takes one block."""
        if self.model.in_worlds:
            return persistent(self.composition, method, 1, threads, threads_at_a_time(self.assembly))
        return persistent(self.composition, method, blocks)

    def _of_each_world(self, count: int) -> int | tuple[int, int]:
        """Return the threads of a launch: so many, in an ensemble for each world."""
        return (self.model.worlds, count) if self.model.in_worlds else count

    def _as_steps(self, step: Any, kernel: Any, argument: int) -> wp.array:
        """Return a step as the array that an argument of a kernel takes."""
        # Warp has one kernel for all that are alike to the letter: its own type of a step may be that of another
        # composition, with the same fields.
        Step: Any = kernel.adj.args[argument].type.dtype
        raw = bytes(step.__ctype__())
        if raw not in self._kept:  # not copied by Warp, which would record that; and kept, as it is read again
            self._kept[raw] = np.frombuffer(2 * raw, dtype=np.uint8).copy()
        return wp.array(ptr=self._kept[raw].ctypes.data, dtype=Step, shape=2, device=self.model.device)

    def launch_stage(self, method: Any, step: Any, forced: bool) -> None:
        """Launch a stage with a thread for each connection, and one for each particle or column of such."""
        model = self.model
        if forced and self.composition.force_algorithm.evaluate is not None and model.connection_count:
            threads = self._of_each_world(model.connection_count)
            if model.in_worlds:
                inputs, kernel = [self.scene, step], each_connection(self.composition, method)
            else:
                inputs = [self.scene.forces, step.compensation, step.x, step.v]
                kernel = each_connection(self.composition)
            wp.launch(kernel, threads, inputs, device=model.device, block_dim=1024)
        if forced and self._columns:
            kernel, threads = each_column(self.composition, method), self._columns
        else:
            lanes = self.composition.force_algorithm.lanes
            kernel = each_particle(self.composition, method)
            threads = self._of_each_world(model.particle_count * lanes)
        wp.launch(
            kernel,
            threads,
            [self.scene, step],
            device=model.device,
            block_dim=self.composition.force_algorithm.block,
        )
        if forced and self.composition.second_pass:
            if self._side is not None:
                wp.get_stream(model.device).wait_event(self._side.record_event())
            kernel, threads = each_masked(self.composition, method), len(self.scene.masked_particles)
            wp.launch(kernel, threads, [self.scene, step], device=model.device)

    @property
    def drives(self) -> bool:
        """Whether any particle is driven."""
        return any(piece.drive is not None for piece in self.composition.pieces)

    @property
    def launches_before_forces(self) -> bool:
        """Whether anything is launched before the forces of a stage are taken."""
        return bool(self._preceding)

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
