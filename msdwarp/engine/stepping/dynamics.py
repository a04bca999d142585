"""Dynamics: evaluates the equation of motion x'' = f(x, x')/m + g, with contact, for integrators."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from ...kernels.colliders.collide import NO_COLLIDERS, ColliderTerm
from ...kernels.effect import ForceTerm
from ...kernels.integrators.composition import Composition, beginning, scene
from ...kernels.integrators.differences import Differences
from ...kernels.integrators.persistent import persistent
from ...kernels.integrators.stages import begin_each_connection, force_on_each
from ...kernels.springs.fracture import NO_SUBSTEP
from ...kernels.threads import count_down, wait_for_all
from ...runtime import record
from ..model.effect import Effect, Steps
from ..model.state import Instant
from ..springs.force_algorithms import forces_of
from ..springs.fracture import Fracture
from ..springs.spring_constants_by_world import ensemble_forces
from .assemble import Assembly
from .cpu_partition import CpuPartition, threads_for
from .pace import Pace
from .per_stage import PerStage, column_count, of_each_world
from .persistent import launch_persistent
from .repetition import ON_CPU, ON_GPU, repeat
from .stages import Stage, StageArrays
from .world_differences import differences, fill_world_data, threads_at_a_time

MOST_SELECTIVE = 8
"""Number of bits in the mask of the selective effects that act on a particle."""
MOST_IN_SECOND_PASS = 0.25
"""Largest fraction of masked particles for which a second launch advances them."""


class Dynamics:
    """Joins a model, a force algorithm and effects: the parts of a substep, as `take_substep` launches them.

    Attributes
    ----------
    threads
        CPU threads that share the particles in the frames recorded next.
    partition
        Divides the stages of recorded frames among the threads; None if there is one thread.
    frozen
        Status of each world, shape [worlds]: worlds stop when it is not 0. None outside of ensembles.
    """

    frozen: Any = None
    threads = 1
    partition: CpuPartition | None = None

    def __init__(self, assembly: Assembly, threads: int | str = 1) -> None:
        self.assembly, self.model, most = assembly, assembly.model, threads_for(assembly, threads)
        self.pace = Pace(assembly, 1 if threads == "auto" else most, most)
        self._preceding = [one for one in assembly.all if one.precedes]
        self._searching = [one for one in assembly.all if one.overrides("search")]
        self._ending = [one for one in assembly.all if one.overrides("end_substep")]
        self._summing = [one for one in self._preceding if one.overrides("add_up")]
        forces, differs = self._forces()
        effect_mask = self._effect_mask()
        self.composition = self._compose(forces.force_algorithm, differs, effect_mask)
        self.scene = scene(self.composition)()
        self._fill_scene(forces, effect_mask)
        self._per_stage = PerStage(self.model, self.composition, self.launches_before_forces)
        self._left = wp.zeros(1, dtype=int, device=self.model.device)
        """How many repetitions of launches are left."""
        self.share_among(most)
        self._single_launch = not assembly.begins_substeps
        """Whether one launch can do all that a stage does to particles and springs."""
        slow = self.launches_before_forces or self.model.in_worlds  # if launches have a thread per particle
        self._one_thread = not self.model.device.is_cuda and slow and self._single_launch
        self._stage_arrays = StageArrays()
        self.steps = Steps(1.0, 1)
        """The substeps of the coming frames."""
        self._substep: int | None = None
        """The substep of a frame that is launched; None between frames."""
        self._stage = 0
        """The next stage of the substep. After the last one, forces are measured."""

    def share_among(self, threads: int) -> None:
        """Let so many CPU threads share the particles in the frames recorded from now on."""
        if threads != self.threads:
            self.threads, self.partition = threads, CpuPartition(self.model, self.composition, threads)
            for effect in self.assembly.all:
                effect.use_launcher(self.partition)

    def recorded(self, launch: Callable[[], None]) -> Callable[[], None]:
        """Return a function that replays the launches of `launch`, recorded as a graph of each thread."""
        if self.partition is not None:
            return self.partition.record(launch).replay
        graph = record(launch, self.model.device)
        return lambda: wp.capture_launch(graph)

    def _forces(self) -> tuple[Any, Differences | None]:
        """Return the force algorithm with its data, and for an ensemble the differences between worlds."""
        model, fracture, plasticity = self.model, self.assembly.fracture, self.assembly.plasticity
        if not model.in_worlds:
            return forces_of(model, fracture), None
        forces = ensemble_forces(model, fracture, None if plasticity is None else plasticity.rest_length)
        return forces, differences(self.assembly, forces)

    def _compose(self, algorithm: Any, differs: Differences | None, effect_mask: NDArray[np.uint8]) -> Composition:
        """Return the `Composition` from which the kernels of this scene are composed."""
        model, terms = self.model, [effect.term for effect in self.assembly.all]
        force_terms = tuple(one for one in terms if isinstance(one, ForceTerm))
        return Composition(
            dim=model.dim,
            scalar=model.scalar,
            force_algorithm=algorithm,
            compensated=model.compensated,
            pinned=model.pinned,
            collider_term=next((one for one in terms if isinstance(one, ColliderTerm)), NO_COLLIDERS),
            terms=force_terms,
            second_pass=self._needs_second_pass(algorithm, force_terms, effect_mask),
            differs=differs,
        )

    def _needs_second_pass(
        self, algorithm: Any, terms: Sequence[ForceTerm], effect_mask: NDArray[np.uint8]
    ) -> bool:
        """Return whether a second launch advances the particles on which selective effects act.

        A second launch costs about 7 µs, less than sums of work in each column would. It also lets launches before
        forces run in parallel with the forces of springs.
        """
        model, terms = self.model, [one for one in terms if one.force is not None]
        if not model.device.is_cuda or model.in_worlds or not all(one.selective for one in terms):
            return False
        masked = int(np.count_nonzero(effect_mask))
        few = 0 < masked <= MOST_IN_SECOND_PASS * model.particle_count
        if few and column_count(model, algorithm) > 0 and any(one.works for one in terms):
            return True
        return masked > 0 and self.launches_before_forces

    def _fill_scene(self, forces: Any, effect_mask: NDArray[np.uint8]) -> None:
        """Fill the struct that kernels take."""
        model, composition, data = self.model, self.composition, self.scene
        data.forces, data.inverse_mass, data.gravity = forces.data, model.inverse_mass, model.gravity
        if composition.differs is not None:
            self.frozen = wp.zeros(model.worlds, dtype=wp.int32, device=model.device)
            fill_world_data(data.worlds, self.assembly, forces, self.frozen)
        for effect in self.assembly.all:
            self._bind(effect)
        if composition.selective:
            data.effect_mask = wp.array(effect_mask, dtype=wp.uint8, device=model.device)
        if composition.second_pass:
            data.masked_particles = wp.array(np.flatnonzero(effect_mask), dtype=int, device=model.device)
            data.spring_force = model.vectors()

    def _bind(self, effect: Effect) -> None:
        """Copy the current data of an effect into the struct that kernels take."""
        if isinstance(effect, Fracture):
            self.scene.forces.breaking = effect.data
            return
        if effect.term is None:
            return
        field = effect.term.field if isinstance(effect.term, ForceTerm) else "colliders"
        setattr(self.scene, field, effect.data)

    def _effect_mask(self) -> NDArray[np.uint8]:
        """Return for each particle a bit for each selective effect that acts on it."""
        effect_mask = np.zeros(self.model.particle_count, dtype=np.uint8)
        selective = [one for one in self.assembly.all if isinstance(one.term, ForceTerm) and one.term.selective]
        if len(selective) > MOST_SELECTIVE:
            raise ValueError(
                f"{len(selective)} loads of different kinds act on particles; at most {MOST_SELECTIVE} can"
            )
        for k, effect in enumerate(selective):
            assert effect.members is not None
            effect_mask[effect.members] |= np.uint8(1 << k)
        return effect_mask

    def begin(self, steps: Steps) -> None:
        """Prepare for frames with the substeps `steps`."""
        self.steps = steps
        self.model.generation += 1  # graphs must be recorded with the new tables
        if self.composition.timed:
            times = steps.substeps * len(steps.stage_times) + 1
            self.scene.time = wp.zeros(times, dtype=self.model.scalar, device=self.model.device)
        for effect in self.assembly.all:
            effect.steps = steps
            effect.begin(steps.substeps, steps.dt)
            self._bind(effect)

    def begin_frame(self, time: float) -> None:
        """Prepare on the host for the frame that begins at `time` [s], before its graph is launched."""
        if self.composition.timed:
            self.scene.time.assign(self.steps.times(time).astype(self.model.dtype))
        for effect in self.assembly.all:
            effect.begin_frame(time)

    def prepare(self, time: float) -> None:
        """Do early work on the host for the frame that begins at `time` [s], while another frame runs."""
        for effect in self.assembly.all:
            effect.prepare(time)

    def hold(self, time: float) -> None:
        """Set the time-dependent data of effects to `time` [s], for launches between frames."""
        if self.composition.timed:
            self.scene.time.fill_(time)
        for effect in self.assembly.all:
            effect.hold(time)
        self.go_to_frame_end()

    def go_to_frame_end(self) -> None:
        """Set the time-dependent data of effects to the end of a frame, for the next launches."""
        self._go_to(None, 0)

    def _go_to(self, substep: int | None, stage: int) -> None:
        """Set the moment of the next forces, and their row in tables of functions of time."""
        self._substep, self._stage, stages = substep, stage, len(self.steps.stage_times)
        if self.composition.timed:
            now = self.steps.substeps if substep is None else substep
            self.scene.stage = min(now * stages + stage, self.steps.substeps * stages)

    @property
    def _advances(self) -> bool:
        """Whether the next forces advance a substep; else they are of a moment between frames, or measured."""
        return self._substep is not None and self._stage < len(self.steps.stage_times)

    @property
    def _begins_substep(self) -> bool:
        """Whether the next forces are the first of a substep."""
        return self._substep is not None and self._stage == 0

    @contextmanager
    def measuring(self) -> Iterator[None]:
        """Let forces do no work, which are only measured, at a substep's end."""
        work = self.assembly.external_work
        if work is not None:
            setattr(self.scene, work.field, work.idle)
        try:
            yield
        finally:
            if work is not None:
                self._bind(work)

    def begin_substep(self, start: Instant, substep: int) -> None:
        """Begin substep number `substep` of a frame: launch the changes of springs by effects."""
        if beginning(self.composition) is not None:
            kernel = begin_each_connection(self.composition)
            inputs = [self.scene, start.compensation, start.x]
            if self.model.in_worlds:
                step = force_on_each(self.composition).Step()
                step.compensation, step.x = start.compensation, start.x
                inputs = [self.scene, step]
            wp.launch(
                kernel, of_each_world(self.model, self.model.connection_count), inputs, device=self.model.device
            )
        self.go_to_substep(substep)

    def keep_apart(self, before: Instant, after: Instant) -> None:
        """Launch effects' changes of a substep's result, `after`, such as shorter displacements in contact."""
        for effect in self._ending:
            assert self._substep is not None
            effect.end_substep(before, after, self._substep)

    def go_to_substep(self, substep: int) -> None:
        """Set the time-dependent data of effects to the start of a substep of a frame, for the next launches."""
        for effect in self.assembly.all:
            if effect.begin_substep(substep):
                self._bind(effect)
        self._go_to(substep, 0)

    def stop_fracture(self) -> None:
        """Prevent breaking until the next substep, since springs break in the first stage only."""
        if self.composition.force_algorithm.tears:
            self.scene.forces.breaking.substep = NO_SUBSTEP

    def note(self, *methods: Any, in_frames: bool = True) -> None:
        """Note the kernels that `advance` launches for stages of methods, in recorded frames or between them."""
        note, partition = self.model.kernels.note, self.partition if in_frames else None
        if beginning(self.composition) is not None:
            note(begin_each_connection(self.composition))
        for method in dict.fromkeys(methods):
            forced = method(self.composition).forced
            if forced and partition is not None and self._single_launch:
                note(partition.kernel(method))
            elif forced and self._one_thread:
                note(self.persistent(method, 1, 1))
            else:
                self._per_stage.note(method)
        if partition is not None:
            note(wait_for_all)
        if in_frames and self.repeated:
            note(count_down)

    def has_parts_before(self, stage: Stage) -> bool:
        """Return whether a stage evaluates forces, and effects launch something before these."""
        return bool(self._preceding) and stage.method(self.composition).forced

    def find_neighbors(self, step: Any) -> None:
        """Launch effects' searches for a stage; not on the side stream, where launches cannot be conditional."""
        begins, after = self._begins_substep, 0.0
        frame_begins = self._substep is None or (begins and self._substep == 0)
        if self._advances and not begins:
            after = (self.steps.stage_times[self._stage] - 1.0) * self.steps.dt
        for effect in self._searching:
            effect.search(step.x, step.v, step.compensation, after, begins, frame_begins)

    def evaluate_contact(self, step: Any) -> None:
        """Launch what effects need before the forces of a stage."""
        begins, within = self._begins_substep, self._evaluated_within() if self._one_thread else []
        summing = self._summing if self._advances else []
        with self._per_stage.side_stream():
            for effect in self._preceding:
                if effect not in within:
                    effect.before_forces(step.x, step.v, step.compensation, begins)
                if effect in summing:
                    effect.add_up(self.steps.dt * self.steps.weights[self._stage])
        if begins:
            for effect in self._ending:
                effect.watch()

    def advance(self, stage: Stage, step: Any) -> None:
        """Launch the forces of a stage, and the advance of all particles by them.

        By a GPU thread per particle (`PerStage`), by several CPU threads (`CpuPartition`), or by one CPU thread
        (`launch_persistent`).
        """
        method, partition, measures = (
            stage.method,
            self.partition,
            self._substep is not None and not self._advances,
        )
        forced = method(self.composition).forced
        if forced and partition is not None and partition.is_recording and self._single_launch and not measures:
            steps = self._stage_arrays.array_of(step, partition.kernel(method), self.model.device)
            partition.launch(method, self.scene, steps, 1)
        elif forced and self._one_thread:
            kernel = self.persistent(method, 1, 1)  # with a thread per particle each would copy the arguments
            steps = self._stage_arrays.array_of(step, kernel, self.model.device)
            launch_persistent(kernel, self.model, self.scene, steps, 1, self.model.worlds, 1)
        else:
            self._per_stage.launch(self.scene, method, step)
        if self._advances:
            self._go_to(self._substep, self._stage + 1)
        self.stop_fracture()

    def persistent(self, method: Any, blocks: int, threads: int) -> Any:
        """Return the kernel that runs many stages by blocks of threads, one block per world."""
        if self.model.in_worlds:
            return persistent(self.composition, method, 1, threads, threads_at_a_time(self.assembly))
        return persistent(self.composition, method, blocks)

    @property
    def repeated(self) -> int:
        """How many substeps, all of the same launches, are recorded once and repeated by the device; 0: none.

        On a GPU only those of bodies in contact are, since others have one or two launches.
        """
        if self.composition.timed or any(one.numbers_substeps for one in self.assembly.all):
            return 0
        if self.model.device.is_cuda and self.assembly.body_contact is None:
            return 0
        return ON_GPU if self.model.device.is_cuda else ON_CPU

    def repeat(self, times: int, launch: Callable[[], None]) -> None:
        """Call `launch`; the device repeats its launches this many times, at least once."""
        if self.partition is not None and self.partition.is_recording:
            self.partition.repeat(times, launch)
        else:
            repeat(self._left, times, launch)

    @property
    def drives(self) -> bool:
        """Whether any particle is driven."""
        return any(term.drive is not None for term in self.composition.terms)

    @property
    def only_contact_precedes(self) -> bool:
        """Whether contact between bodies, without sums of forces, is the only effect with its own launches."""
        effect = self.assembly.body_contact
        if effect is None or self._preceding != [effect] or effect.impulse is not None:
            return False
        return all(one is effect.planes for one in self._ending)

    @property
    def launches_between(self) -> bool:
        """Whether an effect needs its own launch before forces, so that each stage must be a separate launch."""
        return len(self._evaluated_within()) < len(self._preceding)

    def _evaluated_within(self) -> list[Effect]:
        """Return the effects that are evaluated within a single launch of many stages, or of one CPU thread."""
        if self.partition is not None:
            return []
        return [one for one in self._preceding if isinstance(one.term, ForceTerm) and one.term.before_forces]

    @property
    def launches_before_forces(self) -> bool:
        """Whether any effect launches something before forces."""
        return bool(self._preceding)
