"""Simulation: a system in its surroundings, advanced frame by frame on a device."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from typing import Any, Self

from numpy.typing import NDArray

from .. import checks
from ..bodies import Frame, System
from ..engine import Blocks, Measures, assemble, measure, warn_of_start
from ..integrators import SAFETY, Integrator
from ..runtime import exclusive, in_turn
from ..world import Change, Collider, Contact, Gravity, Load, Probe, Scene
from . import checkpoint
from .arguments import GRAVITY, frame_count, problem_of
from .frames import advance, change, settle
from .properties import Present
from .readings import Readings
from .run import Run, check_supports
from .settling import MOST_SUBSTEPS, Settled
from .substep_chooser import SubstepChooser


class Simulation(Present):
    """Simulates a system frame by frame on a device. `Simulation.from_scene(scene)` makes one from a scene.

    Parameters
    ----------
    system
        The bodies to simulate; or a `Scene`, as by `from_scene`, which has surroundings of its own.
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
    UnitWarning
        If a body is longer than 1 km or shorter than 1 µm, as one in millimetres might be.
    """

    start: Settled | None = None
    """Result of settling the scene before the start; None if the scene is not settled."""

    @in_turn
    def __init__(
        self,
        system: System | Scene,
        *,
        gravity: Gravity = GRAVITY,
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
        given = {"gravity": gravity, "colliders": colliders, "loads": loads, "contact": contact}
        problem = problem_of("system", system, **given, schedule=schedule, probes=probes)
        chooser = SubstepChooser(integrator, fps, substeps, safety, allow_unstable, refresh)
        checks.one_of("contact_forces", contact_forces, (False, True))
        check_supports(chooser.method, problem)
        upload = partial(
            assemble,
            collider_rule=collider_rule,
            contact_forces=contact_forces,
            device=device,
            precision=precision,
            force_algorithm=force_algorithm,
        )
        self._run = Run(
            problem.begun(), chooser, upload, energy_limit=energy_limit, blocks=blocks, threads=threads
        )
        self.reset()
        self._run.inside = warn_of_start(self.assembly, self.colliders)
        if isinstance(problem, Scene) and problem.settled:
            self.start = self.settle()
            self._run.start_here()

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
        return cls(scene, **options)

    def __repr__(self) -> str:
        parts = f"{self.system.particle_count} particles, {self.system.connection_count} connections"
        around = "".join(f", {type(one).__name__}" for one in self.colliders[:4])
        threads = f" with {self.threads} threads" if self.threads > 1 else ""
        return (
            f"<Simulation of {parts}{around}\n"
            f"  {self._run.chooser.method!r}, {self.substeps} substeps a frame at {self.fps:g} frames a second\n"
            f"  {self.model.precision} by {self.model.force_algorithm} on {self.device}{threads}\n"
            f"  at {self.time:.4g} s, frame {self.frame_index}>"
        )

    @exclusive
    def reset(self) -> None:
        """Go back to time 0, with the initial state and parameters."""
        self._run.begin()

    @exclusive
    def step(self, frames: int = 1) -> None:
        """Advance by a number of frames, each of 1 / fps seconds; `frames` takes seconds.

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
        advance(self._run, checks.count("frames", frames, 1))

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
        return checkpoint.saved_run(self._run)

    @exclusive
    def restore(self, arrays: Mapping[str, NDArray], numbers: Mapping[str, Any]) -> None:
        """Go to a checkpoint of a simulation made with the same arguments.

        Raises
        ------
        ValueError
            If the checkpoint is of another system, precision, frame rate or integrator. Nothing changes then.
        """
        checkpoint.restore_run(self._run, arrays, numbers)

    @exclusive
    def change(
        self,
        *,
        group: Any = None,
        set_rest_shape: bool = False,
        unpin: Any = None,
        gravity: Gravity | None = None,
        loads: Sequence[Load] | None = None,
        contact: Contact | Sequence[Contact] | None = None,
        colliders: Sequence[Collider] | None = None,
        **parameters: Any,
    ) -> None:
        """Change gravity, loads, contact, colliders, velocities, mass, stiffness, damping or rest_length.

        Cells and angles keep their stiffness. A mass of inf pins a particle. A new velocity may add energy, which
        does not count as divergence. Automatic substeps and the automatic algorithm are chosen again.

        *Cost.* A new constant gravity takes about a millisecond, and so do loads if only their values change (the
        vector of a `Force`, the velocity and coefficients of `Wind`). New velocities are copied; with `Wind` the
        stability limit is also recomputed. The first damper, the first pinned particle and many more kinds of
        connections each need a new kernel, which is compiled when first used.

        Parameters
        ----------
        loads
            All loads from now on. Previous loads among them continue unchanged. New loads start from the
            current state. Contact between bodies stays the same, unless `loads` has a `Contact`. Checkpoints do
            not include loads.
        contact
            Contact between bodies from now on; () turns it off. Checkpoints do not include it.
        colliders
            All obstacles from now on, such as the same obstacles with another friction. Checkpoints do not include
            them.
        group, set_rest_shape, unpin, gravity, parameters
            See `msdwarp.at`.

        Raises
        ------
        ValueError
            If a name is unknown, or a value is out of range. Nothing changes then.

        Warns
        -----
        StartWarning
            If one of `colliders` is in the middle of a body, which would leave it on opposite sides.
        """
        made = Change(self.time, group, set_rest_shape, parameters, unpin, gravity)
        change(self._run, made, colliders, loads, contact)

    @exclusive
    def settle(self, tolerance: float | None = None, *, substeps: int = MOST_SUBSTEPS) -> Settled:
        """Move the system to static equilibrium, where it stays at rest; the time does not change.

        Fast inertial relaxation (FIRE; see `msdwarp.kernels.integrators.fire`) finds a minimum of the energy under
        the current loads, contact and obstacles, many times faster than damping stops motion. Functions of time
        keep their current values. What overlaps is moved apart first. Velocities are 0 afterwards. If friction or
        several minima allow several equilibria, the result is the first that is reached. Automatic substeps are
        chosen again.

        Parameters
        ----------
        tolerance
            Largest force that may remain on a free particle [N]. By default a thousandth of the mean weight of a
            particle, or without gravity 1e-4 of the largest force at the start.
        substeps
            Maximal number of substeps. What overlaps is moved apart in any case.

        Returns
        -------
        found
            The remaining force, the tolerance, the number of substeps, and whether the result has `converged`.

        Warns
        -----
        SettleWarning
            If the remaining force is above the tolerance.

        Raises
        ------
        ValueError
            If an argument is out of range, the system has no springs, or a part of it falls freely.
        SimulationDiverged
            If a number is no longer finite. Nothing changes then, as for a ValueError.
        """
        return settle(self._run, tolerance, substeps)

    @property
    def loads(self) -> tuple[Load, ...]:
        """The loads on the system, as given."""
        return self._run.problem.loads_as_given

    @property
    def colliders(self) -> tuple[Collider, ...]:
        """The obstacles."""
        return tuple(self._run.problem.colliders)

    @property
    def gravity(self) -> Gravity:
        """Acceleration of free fall [m/s²], as given."""
        return self._run.problem.gravity

    @property
    def readings(self) -> Readings:
        """Readings of the probes so far, by name: `times, values = simulation.readings["foot"]`."""
        return self._run.readings

    @property
    def substep_history(self) -> list[tuple[float, int]]:
        """Pairs of a time [s] and the substeps per frame from this time on."""
        return self._run.substep_history

    @property
    def system(self) -> System:
        """The system as last uploaded, at the start or at the last change."""
        return self.stepping.model.system

    @property
    def threads(self) -> int:
        """Number of CPU threads; 1 on a GPU."""
        return self.stepping.dynamics.threads

    @in_turn
    def measure(self) -> Measures:
        """Return energies, momentum, strain and the number of inverted cells of the current state."""
        found = measure(self.assembly, self.state, self.stepping.velocity(), self.state.compensation.x)
        return found._replace(inverted=int(self._run.inverted()[0]))

    @property
    def rest_length(self) -> NDArray:
        """Current rest lengths of the connections [m], including plastic deformation."""
        return self.assembly.changed_fields().get("rest_length", self.system.rest_length)

    @property
    def held_back(self) -> float:
        """Largest distance by which contact held a particle back in a substep of the last frame, or 0 [m].

        If impulses between bodies do not suffice, displacements are shortened; velocities are only if any particle
        is pinned.
        """
        return float(self._run.held_back()[0])

    @in_turn
    def contact_force(self) -> NDArray:
        """Return the force of obstacles and other bodies on each particle [N], shape [particle_count, d].

        The mean over the last frame: the sum of contact impulses, divided by the frame's duration. It is 0 before
        the first frame, and after `settle` or another change that uploads the system again. Obstacles do not push
        pinned or driven particles.

        Raises
        ------
        ValueError
            If the simulation was made without `contact_forces=True` and without a probe of contact forces.
        """
        return self._run.contact_force()

    @in_turn
    def snapshot(self) -> System:
        """Return the system with its current positions, velocities and parameters."""
        return self._run.snapshot()
