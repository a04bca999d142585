"""Simulation: a system in its surroundings, advanced frame by frame on a device."""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from .. import checks
from ..bodies import Frame, System
from ..engine import (
    Blocks,
    Dynamics,
    assemble,
    check_blocks,
    starting_state,
    warn_of_start,
)
from ..integrators import SAFETY, Integrator, StepChoice
from ..runtime import completing, exclusive, in_turn
from ..world import (
    Change,
    Collider,
    Contact,
    Gravity,
    Load,
    Probe,
    Scene,
    bound,
    checked_probes,
    gravity_at,
    with_contact,
)
from . import checkpoint
from .arguments import frame_count, in_order
from .changing import Changing, check_supports, check_supports_contact
from .divergence_error import divergence_of
from .gradient import Differentiable
from .readings import Readings
from .settling import Settled
from .stepping import Stepping
from .substep_controller import StepControlFailed, StepController
from .undoing import undoing


class Simulation(Changing, Differentiable):
    """Simulates a system frame by frame on a device. `Simulation.from_scene(scene)` makes one from a scene.

    Parameters
    ----------
    system
        The bodies to simulate.
    gravity
        Acceleration of free fall [m/s²]: a number of at least 0 (downwards along the last coordinate), a vector,
        or a function of time [s] that returns one of these, where a number may change sign. Gravity that depends
        on time has no potential energy; it counts as external work.
    colliders
        Obstacles.
    collider_rule
        Rule for contact with obstacles: "coulomb", or "report" for the rule of the 2014 report; see
        `msdwarp.kernels.colliders`.
    loads
        Loads on the bodies, such as `Force` or `Wind`.
    contact
        Contact between bodies: a `Contact`, or several. By default bodies pass through each other.
    integrator
        Time-stepping method, such as `Leapfrog()`. By default `SymplecticEuler()`.
    fps
        Frames per second of simulated time.
    substeps
        Integrator steps per frame. "auto" uses as few as `safety` allows (see `msdwarp.integrators.stability`),
        and more if the energy would grow without a cause (see `msdwarp.simulation.substep_controller`). `choice`
        has the current number and the reason, `substep_history` pairs of a time [s] and the number from then on.
    safety
        Fraction of the stability limit that automatic substeps may use, 0 … 1.
    refresh
        Recompute the stability limit before every frame. By default only after a large change of the largest
        strain, or of the slopes of forces that are functions of one's own.
    allow_unstable
        Accept a step beyond the stability limit.
    energy_limit
        The run counts as diverged if its energy has grown by this multiple of a scale, times
        `choice.energy_swing`. The scale is the initial energy plus the energy of a fall by the system's size.
        With inf a run ends only if a number is not finite, and automatic substeps are not adapted.
    device
        Name of a Warp device. By default the first CUDA device, or the CPU if there is none.
    precision
        "float32", "float32-compensated" (corrects rounding errors of sums) or "float64".
    force_algorithm
        How forces are summed: "scatter", "gather", "stencil" (lattices only) or "auto"; see
        `msdwarp.kernels.springs`. This affects speed only. On a GPU, results with scatter do not repeat bit for
        bit.
    blocks
        Number of thread blocks and threads per block that compute all substeps of a frame in one launch: a pair,
        or "auto". None: each stage of each substep is a launch. This affects speed only.
    threads
        Number of CPU threads; "auto" uses one for each core, or fewer for small bodies, and while other programs
        need the cores. The environment variable MSDWARP_THREADS sets the maximum. This affects speed only:
        results are the same to the last bit.
    schedule
        Changes at set times, made by `msdwarp.at`.
    probes
        Sensors by name; see `msdwarp.Probe`. The measured values are in `readings`.
    contact_forces
        Compute the contact force on each particle, for `contact_force`, pictures and files.

    Raises
    ------
    ValueError
        If an argument is out of range or there is no such device.
    UnstableStep
        If `substeps` is too small for stability (a ValueError; it says how many are needed).

    Warns
    -----
    StartWarning
        If a particle starts deep in an obstacle, or so far from the origin that float32 rounds strains.
    """

    start: Settled | None = None
    """Result of settling the scene before the start; None if the scene is not settled."""

    @in_turn
    def __init__(
        self,
        system: System,
        *,
        gravity: Gravity = 9.82,
        colliders: Sequence[Collider] = (),
        collider_rule: str = "coulomb",
        loads: Sequence[Load] = (),
        contact: Contact | Sequence[Contact] | None = None,
        integrator: Integrator | None = None,
        fps: float = 60.0,
        substeps: int | str = "auto",
        safety: float = SAFETY,
        refresh: bool = False,
        allow_unstable: bool = False,
        energy_limit: float = 10.0,
        device: str | None = None,
        precision: str = "float32",
        force_algorithm: str = "auto",
        blocks: Blocks = "auto",
        threads: int | str = "auto",
        schedule: Sequence[Change] = (),
        probes: Mapping[str, Probe] | None = None,
        contact_forces: bool = False,
    ) -> None:
        checks.instance("system", system, System, "chain(5); of a scene use Simulation.from_scene(scene)")
        self._set_up_steps(integrator, fps, substeps, safety, allow_unstable, energy_limit)
        for name, choice in {"refresh": refresh, "contact_forces": contact_forces}.items():
            checks.one_of(name, choice, (False, True))
        self._refresh = refresh and self._forced is None
        self._given = with_contact(checks.sequence("loads", loads, Load, "Force((0, 0, 1))"), contact)
        self._loads, self._gravity = bound(self._given, system), checks.as_now(gravity)
        check_supports_contact(self._method, self._given)
        check_supports(self._method, system)
        self._schedule = in_order(schedule, system, self._loads)
        colliders = checks.sequence("colliders", colliders, Collider, "Plane()")
        self._surroundings: dict[str, Any] = {
            "gravity": self._gravity,
            "colliders": colliders,
            "collider_rule": collider_rule,
            "probes": checked_probes({} if probes is None else probes, system, colliders, self._given),
            "device": device,
            "precision": precision,
            "force_algorithm": force_algorithm,
            "contact_forces": contact_forces,
            "shape": system.position,
        }
        self._colliders = self._surroundings["colliders"]
        self._blocks: Blocks = blocks
        self._threads, self._initial = threads, system
        self.reset()
        self._inside = warn_of_start(self.assembly, self._surroundings["colliders"])

    @classmethod
    def from_scene(cls, scene: Scene, **options: Any) -> Self:
        """Return the simulation of a scene; if this is `settled`, the attribute `start` says how well.

        Parameters
        ----------
        scene
            The scene. Its look is not used.
        options
            Other arguments of `Simulation`.
        """
        checks.instance("scene", scene, Scene, "Scene(system=chain(5))")
        names = ("gravity", "colliders", "loads", "contact", "schedule", "probes")
        simulation = cls(scene.system, **{name: getattr(scene, name) for name in names}, **options)
        if scene.settled:
            simulation.start = simulation.settle()
            simulation._initial, simulation._pressed = simulation.system, simulation.assembly.contacts()
            simulation.reset()
        return simulation

    def __repr__(self) -> str:
        parts = f"{self.system.particle_count} particles, {self.system.connection_count} connections"
        around = "".join(f", {type(one).__name__}" for one in self.colliders[:4])
        threads = f" with {self.threads} threads" if self.threads > 1 else ""
        return (
            f"<Simulation of {parts}{around}\n"
            f"  {self._method!r}, {self.substeps} substeps a frame at {self.fps:g} frames a second\n"
            f"  {self.model.precision} by {self.model.force_algorithm} on {self.device}{threads}\n"
            f"  at {self.time:.4g} s, frame {self.frame_index}>"
        )

    @exclusive
    def reset(self) -> None:
        """Go back to time 0, with the initial state and parameters."""
        with undoing(self):
            self.frame_index = 0
            self.readings = Readings(self._surroundings["probes"], self._initial.dim)
            self._due, self._warned = list(self._schedule), set[type[Warning]]()
            given = {"loads": self._loads, "gravity": self._gravity, "colliders": self._colliders}
            self._surroundings, self._active_loads = {**self._surroundings, **given}, self._given
            automatic = self._forced is None and math.isfinite(self._energy_limit)
            self._step_controller = StepController() if automatic else None
            self._load(self._initial)
            self._press(self._pressed)
            self.substep_history: list[tuple[float, int]] = [(0.0, self.substeps)]
            """Pairs of a time [s] and the substeps per frame from this time on."""

    def _load(self, system: System, choice: StepChoice | None = None, arrays: Any = None) -> None:
        """Upload a system, with a checkpoint's `arrays`, if any; advance by given or newly chosen substeps."""
        assembly, controller = assemble(system, **self._surroundings), self._step_controller
        if self.time > 0.0:
            assembly.take_over(self.assembly, self.state.x, self.state.v, arrays)
        check_blocks(self._blocks, on_gpu=assembly.model.device.is_cuda)
        state = starting_state(system, assembly, self._method.method_state, self.time, self.fps)
        refinement, above = 1.0, 0.0
        if controller is not None and controller.scale > 0:
            refinement, above = controller.refinement, controller.above_floor(self.stepping)
        choice = choice or self._stable_choice(assembly, state).refined(refinement)
        self.stepping = Stepping(
            Dynamics(assembly, self._threads),
            state,
            self._method,
            [choice],
            energy_limit=self._energy_limit,
            blocks=self._blocks,
            watch_energy=controller is not None,
            time=self.time,
        )
        if controller is not None:
            controller.begin(self.stepping, above)

    @exclusive
    def step(self, frames: int = 1) -> None:
        """Advance by one or more frames.

        Raises
        ------
        SimulationDiverged
            If numbers are no longer finite, or the energy has grown without a cause (and more automatic substeps
            did not help). The simulation is then back at the end of the last good frame.
        UnstableStep
            If a function of one's own has become too steep for any number of substeps.

        Warns
        -----
        StepWarning, EnergyDriftWarning, InvertedWarning, StrainWarning
            Once per run each: if given substeps, or for noise any, are too long for a function of time; with
            automatic ones if the energy has risen by rounding errors, if cells of a body stay inside out, or
            if a body with a Poisson's ratio below that of springs is strained so much that it may stay distorted.
        """
        count = checks.count("frames", frames, 1)
        with completing() as interrupted:
            try:
                for left in reversed(range(count)):
                    self._step(left > 0)
                    if interrupted:
                        break
            finally:  # after an exception or an interrupt, the next frame may have been launched
                self.stepping.discard_ahead()
                if self.stepping.end > self.time:  # of a signal, before the frame was counted
                    self._count_frame()

    def _step(self, continues: bool) -> None:
        """Advance by a frame; `continues`: another frame follows immediately."""
        while self._due and self._due[0].is_due(self.frame_index, self.fps):
            self._apply_scheduled_change()
        if self._refresh or self._functions_changed():
            self._update_choice()
        due = self._due and self._due[0].is_due(self.frame_index + 1, self.fps)
        interrupted = due or self._refresh or self._looks_at(self.frame_index + 1)
        self._advance((self.frame_index + 1) / self.fps if continues and not interrupted else None)
        self._count_frame()

    def _count_frame(self) -> None:
        """Count the frame that has been taken."""
        if self.substeps != self.substep_history[-1][1]:
            self.substep_history.append((self.time, self.substeps))
        self.frame_index += 1
        if self.readings:
            self.readings.add(self.time, 1.0 / self.fps, self.stepping.readings())
        found = {} if self._step_controller is None else self._step_controller.warnings
        for kind in found.keys() - self._warned:
            self._warned.add(kind)
            warnings.warn(f"up to {self.time:.4g} s {found[kind]}", kind, stacklevel=7)

    def _advance(self, next_time: float | None) -> None:
        """Advance by a frame; `next_time` [s] is as for `Stepping.advance`."""
        if self._step_controller is None:
            if not self.stepping.advance(self.time, next_time):
                raise divergence_of(self, self._method, self._inside)
            return
        try:
            self.stepping = self._step_controller.advance(self.stepping, self.time, self._stable_choice, next_time)
        except StepControlFailed as failure:
            raise divergence_of(self, self._method, self._inside, failure) from None

    def _stable_choice(self, *of: Any) -> StepChoice:
        """Return the substeps for an assembly and a state, by default the current ones; or raise UnstableStep."""
        assembly, state = of or (self.assembly, self.state)
        return self._choose(self._rates(assembly, state)[0], assembly, state)

    def _update_choice(self) -> None:
        """Choose the substeps for the current state."""
        choice = self._stable_choice()
        if self._step_controller is not None:
            self.stepping = self._step_controller.follow(self.stepping, choice)
        elif choice.substeps != self.substeps:
            self.stepping = self.stepping.with_choice(choice)

    def frames(self, duration: float) -> Iterator[Frame]:
        """Return an iterator over the current frame and every frame of the next `duration` seconds.

        Raises
        ------
        ValueError
            If the duration, rounded to whole frames, has none.
        SimulationDiverged
            While iterating; see `step`.
        """
        count = frame_count(duration, self.fps)  # checked here, not at the first next()
        return self._frames(count)

    def _frames(self, count: int) -> Iterator[Frame]:
        yield self.frame()
        for _ in range(count):
            self.step()
            yield self.frame()

    @in_turn
    def checkpoint(self) -> tuple[dict[str, NDArray], dict[str, Any]]:
        """Return arrays, and values, from which `restore` continues this frame bit for bit."""
        arrays, numbers = checkpoint.saved(self.stepping)
        arrays |= checkpoint.saved_drives(self._loads, self.model)
        own = {"frame_index": self.frame_index, "changes": len(self._schedule) - len(self._due), "fps": self.fps}
        gravity = self._surroundings["gravity"]
        if gravity is not self._gravity and not callable(gravity):
            own["gravity"] = np.asarray(gravity, dtype=float).tolist()
        own |= {"integrator": repr(self._method), "chosen": [list(one) for one in self.substep_history]}
        return arrays, own | numbers | (self._step_controller.saved() if self._step_controller is not None else {})

    @exclusive
    def restore(self, arrays: Mapping[str, NDArray], numbers: Mapping[str, Any]) -> None:
        """Go to a checkpoint of a simulation made with the same arguments.

        Raises
        ------
        ValueError
            If the checkpoint is of another system, precision, frame rate or integrator. Nothing changes then.
        """
        checkpoint.check_same(numbers, fps=self.fps, integrator=repr(self._method))
        frame_index, changes, chosen = checkpoint.restored_progress(numbers)
        system = checkpoint.restored_system(self._initial, arrays)
        choice = checkpoint.restored_choice(numbers, self.fps)
        controller = self._step_controller and StepController.restored(numbers)
        baseline = checkpoint.restored_baseline(numbers)
        gravity = checkpoint.restored_gravity(numbers, self._gravity, self._schedule[:changes], system.dim)
        gravity_at(gravity, np.zeros(1), system.dim, "gravity of the checkpoint")
        loads = checkpoint.restored_loads(self._loads, system, arrays)
        reusable = self._step_controller is None and self.frame_index == 0
        reusable = reusable and system is self.system and choice == self.choice
        reusable = reusable and loads is self._surroundings["loads"] and gravity is self._surroundings["gravity"]
        with undoing(self):
            self._surroundings = self._surroundings | {"loads": loads, "gravity": gravity}
            self._active_loads = self._given
            self._step_controller = self._step_controller and StepController()
            self.frame_index = frame_index
            self.readings = Readings(self._surroundings["probes"], system.dim)
            if not reusable:  # in a sweep, an upload for each world would take as long as a new simulation
                self._load(system, choice, arrays)
            checkpoint.check_arrays(self.stepping, arrays)
            self.stepping.begin_at(self.time)
            self._due = self._schedule[changes:]
            checkpoint.restore_arrays(self.stepping, arrays)
            for effect in self.assembly.all:
                effect.make_room(self.state.x, self.state.v)
            self.substep_history = chosen or [(0.0, self.substeps)]
            if baseline is not None:
                self.stepping.watch.compare_with(baseline)
            if controller is not None:  # older checkpoints have no controller: it starts here
                self._step_controller = controller
