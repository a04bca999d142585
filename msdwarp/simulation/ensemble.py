"""Ensemble: many worlds of one scene at once, each with parameters and a start of its own."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields, replace
from functools import partial
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import ArrayLike, NDArray

from .. import checks
from ..bodies import System
from ..engine import WorldStatus, assemble_worlds
from ..integrators import SAFETY, Integrator
from ..runtime import calling, exclusive, in_turn
from ..world import POSITION, VELOCITY, Actuator, Collider, Contact, Gravity, Load, Probe, Problem, Scene
from .arguments import frame_count, parameter_rows, problem_of
from .checkpoint import saved_drives, saved_system, saved_worlds
from .divergence_error import SimulationDiverged
from .ensemble_results import dataset, import_xarray, observations, single_numbers
from .frames import advance
from .properties import Present
from .run import Run, check_supports
from .simulation import Simulation
from .substep_chooser import SubstepChooser

STATUS = ("running", "not finite", "energy")
"""Names of the values 0, 1 and 2 of `WorldStatus.status`."""
SYSTEM_FIELDS = ("stiffness", "damping", "rest_length", "mass", "position", "velocity")


class Ensemble(Present):
    """Simulates many worlds at once: copies of a scene with different parameters or starting states.

    World w equals a `Simulation` of the scene with the w-th entry of each parameter and the same number of
    substeps: to the last bit with the algorithm gather, and on the CPU with every algorithm; to rounding with the
    stencil on a GPU. An entry is a value that `System.replace` accepts: for stiffness, damping, rest_length and
    mass one number for all, or one for each connection or particle. To scale the scene's values, multiply:
    `factors[:, None] * system.stiffness`. An array may have fewer entries than there are worlds, if their number
    divides the number of worlds: world w uses entry w mod (number of entries).

    A world that diverges stops at the end of its last good frame, with the reason in `status`; others continue.

    Parameters
    ----------
    scene
        A `Scene`, or a `System`. The look, duration and probes of a scene are not used.
    worlds
        Number of worlds.
    stiffness, damping, rest_length
        [N/m], [N s/m] (or in the units of the law), [m]; shape [entries] or [entries, connection_count].
        Cells and angles have none of their own.
    mass
        [kg], shape [entries] or [entries, particle_count]; inf pins a particle.
    position
        Initial positions [m], shape [entries, particle_count, d].
    velocity
        Initial velocities [m/s], shape [entries, d] (all free particles) or [entries, particle_count, d].
    gravity
        [m/s²], shape [entries] (downwards along the last coordinate) or [entries, d]; or a single number.
    friction
        Friction of the obstacles, shape [entries] (the same for all) or [entries, collider_count].
    strain
        Strain of the actuators, in place of their own, in the order of the loads: shape [entries] (the same for
        all) or [entries, actuator_count]; or a function of time [s] that returns such an array.
    delay
        Delay of the actuators [s], in place of their own, where no strain is given: shape [entries],
        [entries, actuator_count], or [entries, actuator_count, particle_count] for that of each particle.
    colliders, loads
        With a `System`: obstacles, loads, and contact between bodies, the same in all worlds.
    contact, integrator, fps, substeps, safety, allow_unstable, energy_limit, device, precision
        As for `Simulation`. All worlds have the same number of substeps; "auto" is the largest that a world needs.
        It follows functions of one's own, and of time, but no energies.
    force_algorithm
        As for `Simulation`; "auto" is the stencil or gather on a GPU, and scatter on the CPU: with these, results
        repeat bit for bit.
    threads
        Number of threads that compute all substeps of a frame of a world in one launch: a power of 2, on the CPU
        1; None for a launch for each stage of each substep; or "auto". This affects speed only.

    Attributes
    ----------
    worlds
        Number of worlds.
    frame_index
        Frames since the start.

    Raises
    ------
    ValueError
        If an argument is out of range, or the scene has features that are not supported yet: changes at set times,
        contact of surfaces with obstacles, or loads that start from positions which differ between worlds.
    UnstableStep
        If `substeps` is too small for the stability of a world.

    Warns
    -----
    StartWarning
        If stiffness or damping differs from the scene's between particles of `Cells`, which keep theirs.
    """

    @in_turn
    def __init__(
        self,
        scene: Scene | System,
        worlds: int,
        *,
        stiffness: ArrayLike | None = None,
        damping: ArrayLike | None = None,
        rest_length: ArrayLike | None = None,
        mass: ArrayLike | None = None,
        position: ArrayLike | None = None,
        velocity: ArrayLike | None = None,
        gravity: Gravity | ArrayLike | None = None,
        friction: ArrayLike | None = None,
        strain: Any = None,
        delay: ArrayLike | None = None,
        colliders: Sequence[Collider] = (),
        loads: Sequence[Load] = (),
        contact: Contact | Sequence[Contact] | None = None,
        collider_rule: str = "coulomb",
        integrator: Integrator | None = None,
        fps: float = 60.0,
        substeps: int | str = "auto",
        safety: float = SAFETY,
        allow_unstable: bool = False,
        energy_limit: float = 10.0,
        device: str | None = None,
        precision: str = "float32",
        force_algorithm: str = "auto",
        threads: int | str | None = "auto",
    ) -> None:
        self.worlds = int(checks.count("worlds", worlds, 1))
        chooser = SubstepChooser(integrator, fps, substeps, safety, allow_unstable)
        same = ", the same for all worlds"
        problem = problem_of("scene", scene, same, colliders=colliders, loads=loads, contact=contact)
        if problem.schedule:
            raise ValueError("the scene has a schedule, which worlds of an ensemble cannot have yet")
        if chooser.method.solves:
            raise ValueError(
                f"integrator is {chooser.method}; in an ensemble it must be an explicit one, such as RK4()"
            )
        check_supports(chooser.method, problem)
        self._observe = problem.observe if isinstance(problem, Scene) else {}
        if isinstance(problem, Scene) and problem.settled:
            raise ValueError("scene has settled=True, which an ensemble cannot do yet; it must be False")
        values = zip(SYSTEM_FIELDS, (stiffness, damping, rest_length, mass, position, velocity), strict=True)
        given = {name: None if value is None else checks.array(name, value) for name, value in values}
        alike = {name: value for name, value in given.items() if value is not None and value.ndim == 0}
        base = problem.system.replace(**alike)
        by_world: dict[str, Any] = {name: value for name, value in given.items() if name not in alike}
        by_world |= {"friction": friction, "strain": strain, "delay": delay}
        shared: Any = problem.gravity
        if gravity is None or np.ndim(gravity) == 0:  # a function also has ndim 0
            shared = shared if gravity is None else gravity
        else:
            by_world["gravity"] = gravity
            shared = 0.0 if callable(shared) else shared  # else both gravities would act
        self._rows = parameter_rows(problem, base, self.worlds, by_world)
        upload = partial(
            assemble_worlds,
            worlds=self.worlds,
            rows=self._rows,
            collider_rule=collider_rule,
            device=device,
            precision=precision,
            force_algorithm=force_algorithm,
        )
        self._collider_rule = collider_rule
        start = problem.replace(system=base, gravity=shared, probes={})
        self._run = Run(
            start.begun(), chooser, upload, energy_limit=energy_limit, blocks=threads, watches_energy=False
        )
        self.reset()

    def __repr__(self) -> str:
        differ = f", which differ in {', '.join(self._rows)}" if self._rows else ""
        return (
            f"<Ensemble of {self.worlds} worlds of {self.model.particle_count} particles{differ}\n"
            f"  {self.substeps} substeps a frame at {self.fps:g} frames a second, on {self.device}\n"
            f"  at {self.time:.4g} s, frame {self.frame_index}>"
        )

    @exclusive
    def reset(self) -> None:
        """Go back to the start."""
        self._run.begin()

    def _parameter_of(self, name: str, world: int) -> NDArray[np.float64]:
        """Return a world's entry of a parameter."""
        rows = self._rows[name]
        return rows[world % len(rows)]

    def _loads_of(self, world: int) -> list[Load]:
        """Return the loads, their actuators with a world's strains or delays."""
        loads = list[Load](self._run.start.loads)
        for k, place in enumerate(k for k, one in enumerate(loads) if isinstance(one, Actuator)):
            if "strain" in self._rows:
                own = {"strain": self._rows["strain"].of(world % len(self._rows["strain"]), k)}
            else:
                own = {"delay": self._parameter_of("delay", world)[k]}
            loads[place] = replace(loads[place], **own)
        return loads

    @property
    def threads(self) -> int | None:
        """Number of threads that compute all substeps of a world in one launch; None if each stage is a launch."""
        blocks = self.stepping.stepper.blocks
        return None if blocks is None else blocks[1]

    @exclusive
    def step(self, frames: int = 1) -> None:
        """Advance all worlds that have not diverged by a number of frames, each of 1 / fps seconds."""
        advance(self._run, checks.count("frames", frames, 1))

    def run(self, duration: float, *, observe: Mapping[str, Any] | None = None, every: int = 1) -> Any:
        """Advance by a duration [s] and return the observed quantities of each world as an `xarray.Dataset`.

        Dimensions: world, frame and the dimensions of the observed quantities. Coordinates: the time of each
        frame, the parameters that are one number per world, `status` and `diverged_at`. With h5netcdf installed
        `to_netcdf` saves it.

        Parameters
        ----------
        duration
            Simulated time [s].
        observe
            Quantities to observe, by name: a `Probe` of positions, velocities, forces, strains, tensions or
            stresses, or a `GroupMean` of a `wp.func`, summed on the device; "energy", "kinetic energy", "elastic
            energy" or "gravitational energy" [J]; "positions" [m] or "velocities" [m/s] of all particles; or a
            function of positions and velocities, of shape [worlds, particle_count, d] each, that returns an array
            with the worlds along its first axis. By default the scene's `observe`, else position and velocity of
            the centre of mass.
        every
            Observe at the start, and then every Nth frame.

        Raises
        ------
        ValueError
            If the duration is shorter than `every` frames, something cannot be observed, or xarray is not
            installed.
        """
        frames, every = frame_count(duration, self.fps), int(checks.count("every", every, 1))
        if frames < every:
            raise ValueError(f"every is {every}; it must be at most the {frames} frames of the duration")
        import_xarray()  # raise before anything runs
        everyone = np.ones(self.model.particle_count, dtype=bool)
        centre = {what: Probe(everyone, what) for what in (POSITION, VELOCITY)}
        observed, times = observations(self, (self._observe or centre) if observe is None else observe), []
        for frame in range(frames + 1):
            if frame:
                self.step()
            if frame % every == 0:
                times.append(self.time)
                for one in observed:
                    calling(self, "run", one.look)
        return dataset(self, observed, times)

    @property
    def numbers(self) -> dict[str, NDArray[np.float64]]:
        """Parameters that are one number per world, such as stiffness, shape [worlds]."""
        return single_numbers(self._rows, self.worlds)

    @in_turn
    def velocity(self) -> wp.array:
        """Return the velocities at the same time as the positions [m/s], on the device."""
        return self.stepping.velocity()

    @in_turn
    def _world_status(self) -> WorldStatus:
        """Return the status of the worlds."""
        assert self.stepping.frozen is not None
        return self.stepping.frozen.found()

    @property
    def status(self) -> NDArray[np.str_]:
        """Status of each world: "running", "not finite" or "energy" (above its limit plus external work)."""
        return np.array(STATUS)[self._world_status().status]

    @property
    def held_back(self) -> NDArray[np.float64]:
        """Largest distance by which contact held a particle back in a substep of the last frame, by world [m]."""
        return self._run.held_back().copy()

    @property
    @in_turn
    def inverted(self) -> NDArray[np.integer]:
        """Number of cells that are turned inside out, by world; no warning says so, as no energies are watched."""
        return self._run.inverted()

    @property
    def diverged_at(self) -> NDArray[np.float64]:
        """Time at which each diverged world stopped, the end of its last good frame [s]; NaN for the others."""
        frames = self._world_status().good_frames
        return np.where(frames >= 0, frames / self.fps, np.nan)

    @property
    def diverged_particle(self) -> NDArray[np.int32]:
        """The first non-finite particle of each world; −1 if there is none."""
        return self._world_status().particle

    @in_turn
    def system_of(self, world: int, *, start: bool = False) -> System:
        """Return a world's system with its parameters, in its current or initial state."""
        world = self._checked_index(world)
        fields = {name: self._parameter_of(name, world) for name in SYSTEM_FIELDS if name in self._rows}
        if not start:
            frame = self.frame()
            fields |= {"position": frame.position[world], "velocity": frame.velocity[world]}
            changed = self.assembly.checkpoints()[world]
            if "rest_length" in changed:
                fields["original_length"] = fields.get("rest_length", self._run.start.system.original_length)
            fields |= {name: changed[name] for name in ("rest_length", "broken_at") if name in changed}
        return self._run.start.system.replace(**fields)

    @in_turn
    def simulation_of(self, world: int, *, start: bool = True, **options: Any) -> Simulation:
        """Return a single world as a `Simulation`, in its current or initial state.

        `options` are further arguments of `Simulation`.
        """
        world = self._checked_index(world)
        start_now: Any = self._run.start
        around: dict[str, Any] = {"system": self.system_of(world, start=start)}
        if "gravity" in self._rows:
            around["gravity"] = self._parameter_of("gravity", world)
        if "friction" in self._rows:
            each, obstacles = self._parameter_of("friction", world).tolist(), list[Any](start_now.colliders)
            around["colliders"] = [replace(one, friction=mu) for one, mu in zip(obstacles, each, strict=True)]
        if "strain" in self._rows or "delay" in self._rows:
            around["loads"] = self._loads_of(world)
        around |= {name: options.pop(name) for name in options.keys() & {one.name for one in fields(Problem)}}
        own: dict[str, Any] = {
            "collider_rule": self._collider_rule,
            "precision": self.model.precision,
            "integrator": self.integrator,
            "fps": self.fps,
            "substeps": self.substeps,
            "allow_unstable": True,
            "energy_limit": self._run.energy_limit,
            "device": self.device,
            "force_algorithm": self.model.force_algorithm,
        }
        alone = Simulation(start_now.replace(**around), **(own | options))
        if self.assembly.body_contact is not None and not start:
            alone._run.restore_contact(self.assembly.body_contact.checkpoints()[world])
        return alone

    @in_turn
    def checkpoints(self) -> list[tuple[dict[str, NDArray], dict[str, Any]]]:
        """Return the state of each world, from which `Simulation.restore` continues the world bit for bit.

        The simulation must have the world's parameters and the ensemble's `integrator`, `fps`, `substeps`,
        precision and algorithm, as from `simulation_of`. A diverged world has the state in which it stopped.
        """
        frames = self._world_status().good_frames
        shared = {"fps": self.fps, "integrator": repr(self.integrator), "changes": 0}
        found = []
        for world, (arrays, numbers) in enumerate(saved_worlds(self.stepping)):
            arrays |= saved_drives(self._run.start.loads, self.model) | saved_system(
                self.system_of(world, start=True)
            )
            frame = int(frames[world])
            numbers |= shared | {"frame_index": self.frame_index if frame < 0 else frame}
            if "gravity" in self._rows:
                numbers["gravity"] = self._parameter_of("gravity", world).tolist()
            found.append((arrays, numbers))
        return found

    def _checked_index(self, world: int) -> int:
        """Return the index of a world as an int; raise ValueError if there is no such world."""
        if checks.count("world", world, 0) >= self.worlds:
            raise ValueError(f"world is {world}; it must be below {self.worlds}, the number of worlds")
        return int(world)

    @in_turn
    def diagnose(self, world: int) -> SimulationDiverged:
        """Return why a world diverged, as `Simulation` would report it: substep, particle and connection.

        The frame that diverged is simulated again for that world alone.

        Raises
        ------
        ValueError
            If the world has not diverged.
        """
        world = self._checked_index(world)
        if self.status[world] == STATUS[0]:
            raise ValueError(f"world {world} has not diverged")
        alone = self.simulation_of(world)
        alone.restore(*self.checkpoints()[world])
        try:
            alone.step(2)
        except SimulationDiverged as error:
            error.args = (f"world {world}: {error}",)
            return error
        raise RuntimeError(f"world {world} does not diverge when it is simulated alone from {alone.time:.4g} s on")
