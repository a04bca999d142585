"""Simulation: a system in its surroundings, advanced frame by frame on a device."""

import math
import threading
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import ArrayLike, NDArray

from .. import checks
from ..bodies import CONNECTION_FIELDS, PARTICLE_FIELDS, Frame, System, stored
from ..engine import Backup, Dynamics, Measures, Model, Rates, State, Stepper, Watch, measure, rate_bounds
from ..integrators import (
    MOST_SUBSTEPS,
    SAFETY,
    Integrator,
    StepChoice,
    SymplecticEuler,
    UnstableStep,
    choose_forced,
    choose_substeps,
)
from ..world import Change, Collider
from .divergence import SimulationDiverged, describe

RECORDING = threading.Lock()
"""Held while a graph is recorded: no thread may wait for a device meanwhile."""
MOST_FRAMES = 10**9
"""Frames of the longest run."""


def frame_count(duration: float, fps: float) -> int:
    """Return how many frames of 1/fps s a duration [s] has, rounded; raise ValueError if there is none."""
    frames = checks.positive("duration", duration) * checks.positive("fps", fps)
    count = round(min(frames, 2.0 * MOST_FRAMES))
    if count > MOST_FRAMES:
        raise ValueError(
            f"duration is {duration:g}; it must be at most {MOST_FRAMES} frames, {MOST_FRAMES / fps:g} s"
        )
    if count == 0:
        raise ValueError(f"duration is {duration:g}; it must be at least one frame, {1 / fps:g} s")
    return count


class Simulation:
    """A system in its surroundings, advanced frame by frame on a device.

    Parameters
    ----------
    system
        What is simulated.
    gravity
        Acceleration of free fall [m/s²]: its size, downwards along the last coordinate, or a vector.
    colliders
        Obstacles.
    contact
        The contact rule, "coulomb" or "report"; see `msdwarp.kernels.contact`.
    integrator
        The time-stepping method.
    fps
        Frames per second of simulated time.
    substeps
        Integrator steps per frame; "auto" takes the least that stay within `safety` of the stability limit
        of the system at the start (see `msdwarp.integrators.stability`). What was chosen, and why, is in `choice`.
    safety
        Share of the stability limit that automatic substeps may use, 0 … 1.
    refresh
        Choose automatic substeps anew before every frame, from the system as it is then: for bodies that are
        stretched to several times their length.
    allow_unstable
        Accept substeps beyond the stability limit.
    energy_limit
        The run has diverged when its energy has grown by this multiple of its scale, the energy at the start
        and what falling by the system's own size would give, and of the swing that a step near the limit
        gives a stable method's energy (`StepChoice.energy_swing`). Nothing in a scene is a source of energy.
    device
        A Warp device's name; by default the first CUDA device, else the CPU.
    precision
        "float32", "float32-compensated" (keeps what rounding takes away) or "float64".
    route
        How forces are summed, which is a matter of speed alone: "scatter", "gather", "stencil" (of lattices) or
        "auto"; see `msdwarp.kernels.forces`. Scattered sums on the GPU are not repeatable to the last bit.
    schedule
        Changes of parameters at set times, made by `msdwarp.at`.

    Raises
    ------
    ValueError
        If an argument is out of its range or there is no such device.
    UnstableStep
        If `substeps` is beyond the stability limit (a ValueError; it says how many would do).
    """

    def __init__(
        self,
        system: System,
        *,
        gravity: ArrayLike = 9.82,
        colliders: Sequence[Collider] = (),
        contact: str = "coulomb",
        integrator: Integrator | None = None,
        fps: float = 60.0,
        substeps: int | str = "auto",
        safety: float = SAFETY,
        refresh: bool = False,
        allow_unstable: bool = False,
        energy_limit: float = 10.0,
        device: str | None = None,
        precision: str = "float32",
        route: str = "auto",
        schedule: Sequence[Change] = (),
    ) -> None:
        self.fps = checks.positive("fps", fps)
        integrator = SymplecticEuler() if integrator is None else integrator
        if not isinstance(integrator, Integrator):
            raise ValueError(f"integrator is {integrator!r}; it must be an instance of one, such as RK4()")
        if not isinstance(colliders, Iterable):
            raise ValueError(f"colliders is {colliders!r}; it must be a sequence of colliders")
        if isinstance(substeps, str) and substeps != "auto":
            raise ValueError(f"substeps is {substeps!r}; it must be a whole number or 'auto'")
        self._forced = None if isinstance(substeps, str) else checks.count("substeps", substeps, 1)
        if self._forced is not None and self._forced > MOST_SUBSTEPS:
            raise ValueError(f"substeps is {substeps}; it must be at most {MOST_SUBSTEPS}")
        self._safety = checks.between("safety", safety, 1e-3, 1)
        self._refresh, self._allow_unstable = refresh and self._forced is None, allow_unstable
        self._energy_limit = checks.non_negative("energy_limit", energy_limit, infinite=True)
        if not isinstance(schedule, Iterable):
            raise ValueError(f"schedule is {schedule!r}; it must be a sequence of changes made by at(...)")
        for k, change in enumerate(schedule):
            if not isinstance(change, Change):
                raise ValueError(f"schedule[{k}] is {change!r}; it must be made by at(...)")
            change.applied_to(system)  # what is wrong with it is said before anything runs
        self._schedule = sorted(schedule, key=lambda change: change.time)
        self._method = integrator
        self._surroundings: dict[str, Any] = {
            "gravity": gravity,
            "colliders": tuple(colliders),
            "contact": contact,
            "device": device,
            "precision": precision,
            "route": route,
        }
        self._initial = system
        self.reset()

    def reset(self) -> None:
        """Go back to the system as it was given, at time 0, with the parameters it was given."""
        self.frame_index = 0
        self._due = list(self._schedule)
        self._load(self._initial)

    def _load(self, system: System, choice: StepChoice | None = None) -> None:
        """Upload a system and prepare to advance it, with substeps chosen anew unless they are given."""
        model = Model(system, **self._surroundings)
        state = State.of(system, model, self._method.carried)
        choice = choice or self._choose(rate_bounds(system, model, state))
        self.model, self.state, self.system = model, state, system
        self._dynamics = Dynamics(model)
        self._start(choice)

    def _choose(self, rates: Rates) -> StepChoice:
        """Return the substeps for these rates; raise UnstableStep if those asked for are too few."""
        if self._forced is not None and self._allow_unstable:
            return choose_forced(rates, self._method, self.fps, self._forced)
        choice = choose_substeps(rates, self._method, self.fps, self._forced, self._safety)
        if choice.substeps < choice.least:
            raise UnstableStep(
                f"substeps is {choice.substeps}; at least {choice.least} a frame are stable here, "
                f"{math.ceil(choice.least / self._safety)} with a margin"
            )
        return choice

    def _start(self, choice: StepChoice) -> None:
        """Begin to step with these substeps, from velocities at the instant of the positions."""
        self.choice = choice
        self.integrator = self._method.fitted(choice.rates, self.dt)
        self._dynamics.begin(self.substeps, self.dt)
        self._work = self.integrator.workspace(self.state)
        self._backup = Backup(self.state)
        self._watch = Watch(self.model, self.state, self._energy_limit * choice.energy_swing)
        self._graph: Any = None
        substep = partial(self.integrator.step, self._dynamics, self.state, self._work, self.dt)
        self._stepper = Stepper(self._dynamics, self.state, substep, one_kernel=self.integrator.one_kernel)
        self.integrator.start(self._dynamics, self.state, self._work, self.dt)

    @property
    def substeps(self) -> int:
        """Integrator steps per frame."""
        return self.choice.substeps

    @property
    def dt(self) -> float:
        """Length of a substep [s]."""
        return self.choice.step

    @property
    def time(self) -> float:
        """Simulated time since the start [s]."""
        return self.frame_index / self.fps

    @property
    def device(self) -> str:
        """The device that simulates, by Warp's name for it."""
        return self.model.device.alias

    def step(self, frames: int = 1) -> None:
        """Advance by one frame or more.

        Raises
        ------
        SimulationDiverged
            If a position or velocity is no longer finite, or energy has grown from nowhere. The simulation
            is then back at the last good frame.
        """
        for _ in range(checks.count("frames", frames, 1)):
            while self._due and self._due[0].time * self.fps < self.frame_index + 1e-6:  # times may be rounded up
                self._change_as_due()
            if self._refresh:
                self._choose_anew()
            if self._graph is None:
                self._graph = self._record_frame()
            self.model.surroundings.place(self.time)
            wp.capture_launch(self._graph)
            if self._watch.finds_trouble():
                raise self._divergence()
            self.frame_index += 1

    def _change_as_due(self) -> None:
        """Apply the next change of the schedule."""
        try:
            self._load(self._due[0].applied_to(self.snapshot()))
        except UnstableStep as error:
            raise UnstableStep(f"after the change at {self._due[0].time:g} s {error}") from error
        del self._due[0]  # now that it has been possible

    def _choose_anew(self) -> None:
        """Change the number of substeps if the system as it is now asks for another one."""
        choice = self._choose(rate_bounds(self.system, self.model, self.state))
        if choice.substeps != self.substeps:
            wp.copy(self.state.v, self._velocity())
            self._start(choice)

    def _record_frame(self) -> Any:
        """Record the substeps of a frame, and the watch after them, as one graph."""
        with RECORDING, wp.ScopedCapture(device=self.model.device) as capture:
            self._backup.save()
            self._stepper.take(self.substeps)
            self._watch.look()
        return capture.graph

    def _divergence(self) -> SimulationDiverged:
        """Find out what went wrong in the frame just simulated, and go back to its start.

        The frame is simulated once more, looking after every substep.
        """
        self._backup.restore()
        good = _to_host(self.state.x)
        substep = 0
        while True:
            substep += 1
            self._stepper.take(1, substep - 1)
            self._watch.look()
            if self._watch.finds_trouble() or substep == self.substeps:
                break
            good = _to_host(self.state.x)
        particle = self._watch.culprit()
        self._backup.restore()
        rates = rate_bounds(self.system, self.model, self.state)
        needed = max(self.choice.least, choose_forced(rates, self._method, self.fps, 1).least)
        system = self.system.replace(**self._yielded())
        return describe(system, good, self.time, self.dt, substep, self.substeps, particle, needed)

    def measure(self) -> Measures:
        """Return energies, momentum and strain of the present state."""
        return measure(self.model, self.state, self._velocity(), self.state.lost.x)

    def _velocity(self) -> wp.array:
        """Return the velocities at the instant of the positions, on the device."""
        return self.integrator.velocity(self._dynamics, self.state, self._work, self.dt)

    @property
    def rest_length(self) -> NDArray:
        """Present rest lengths of the connections [m]: of the system, or where they yield what it has come to."""
        if not self.model.yields:
            return self.system.rest_length
        return self.model.in_system_order(_to_host(self.model.rest_length))

    def frame(self) -> Frame:
        """Return the present positions and velocities."""
        position, velocity = _to_host(self.state.x), _to_host(self._velocity())
        if self.model.compensated:  # what sums have lost belongs to them
            position = position.astype(np.float64) - self.state.lost.x.numpy()
            velocity = velocity.astype(np.float64) - self.state.lost.v.numpy()
        return Frame(self.time, position, velocity)

    def frames(self, duration: float) -> Iterator[Frame]:
        """Return an iterator over the present frame and every frame of the next `duration` seconds.

        Raises
        ------
        ValueError
            If the duration is not positive or shorter than a frame.
        SimulationDiverged
            While iterating, if a position or velocity is no longer finite.
        """
        count = frame_count(duration, self.fps)  # checked here, not at the first next()
        return self._frames(count)

    def _frames(self, count: int) -> Iterator[Frame]:
        yield self.frame()
        for _ in range(count):
            self.step()
            yield self.frame()

    def snapshot(self) -> System:
        """Return the system as it is now: present positions and velocities, present parameters."""
        _, position, velocity = self.frame()
        return self.system.replace(position=position, velocity=velocity, **self._yielded())

    def _yielded(self) -> dict[str, Any]:
        """Return the fields of the system that yielding has changed."""
        if not self.model.yields:
            return {}
        return {"rest_length": self.rest_length, "original_length": self.system.original_length}

    def checkpoint(self) -> tuple[dict[str, NDArray], dict[str, Any]]:
        """Return what `restore` needs to go on from this frame, to the last bit: arrays, and numbers and names."""
        arrays = {name: np.array(array.numpy()) for name, array in self._moving().items()}
        if self.model.yields:  # in an order that is the same on any device
            arrays["rest_length"] = self.rest_length
        for name in (*PARTICLE_FIELDS, *CONNECTION_FIELDS):
            values = getattr(self.system, name)
            arrays[f"system.{name}"] = np.array(stored(values))
        choice = self.choice
        numbers = {"frame_index": self.frame_index, "changes": len(self._schedule) - len(self._due)}
        numbers |= {"fps": self.fps, "integrator": repr(self._method)}
        numbers |= {f"rates.{name}": value for name, value in choice.rates._asdict().items()}
        numbers |= {"limit": choice.limit, "least": choice.least, "substeps": choice.substeps}
        return arrays, numbers

    def restore(self, arrays: Mapping[str, NDArray], numbers: Mapping[str, Any]) -> None:
        """Go back, or forward, to a checkpoint of a simulation made with the same arguments.

        Raises
        ------
        ValueError
            If the checkpoint is of another system, precision, frame rate or integrator; nothing has changed then.
        """
        for name, own in {"fps": self.fps, "integrator": repr(self._method)}.items():
            if checks.member("checkpoint", numbers, name) != own:
                raise ValueError(f"checkpoint is of another {name}: {numbers[name]}; here it is {own}")
        frame_index = checks.count("frame_index", checks.member("checkpoint", numbers, "frame_index"), 0)
        changes = checks.count("changes", checks.member("checkpoint", numbers, "changes"), 0)
        particles, connections = self._initial.particle_count, self._initial.connection_count
        fields = {}
        for names, count in ((PARTICLE_FIELDS, particles), (CONNECTION_FIELDS, connections)):
            for name in names:
                values = checks.member("checkpoint", arrays, f"system.{name}")
                if len(values) not in (1, count):
                    raise ValueError(f"checkpoint is of another system: its {name} has {len(values)} entries")
                fields[name] = values[0] if len(values) < count else values
        rates = Rates(*(float(checks.member("checkpoint", numbers, f"rates.{name}")) for name in Rates._fields))
        limit, least, substeps = (checks.member("checkpoint", numbers, n) for n in ("limit", "least", "substeps"))
        choice = StepChoice(rates, float(limit), int(least), int(substeps), self.fps)
        moving = self._moving()
        for name, array in moving.items():
            found = checks.member("checkpoint", arrays, name)
            if (found.shape, found.dtype) != (array.numpy().shape, array.numpy().dtype):
                raise ValueError(f"checkpoint holds {name} of shape {found.shape} and type {found.dtype}")
        self._load(self._initial.replace(**fields), choice)
        self.frame_index = frame_index
        self._due = self._schedule[changes:]
        for name, array in self._moving().items():
            array.assign(self.model.ordered(arrays[name]) if name == "rest_length" else arrays[name])

    def _moving(self) -> dict[str, wp.array]:
        """Return what a substep leaves to the next, by name."""
        now, model = self.state.here, self.model
        arrays = {"x": now.x, "v": now.v} | {f"carried.{k}": array for k, array in enumerate(now.carried)}
        if model.compensated:
            arrays |= {"lost.x": now.lost.x, "lost.v": now.lost.v}
        return arrays | ({"rest_length": model.rest_length} if model.yields else {})

    def change(self, *, group: str | ArrayLike | None = None, freeze: bool = False, **parameters: Any) -> None:
        """Change mass, stiffness, damping or rest_length between frames; positions and velocities stay.

        A mass of inf pins a particle where it is.
        Kernels are composed for what a scene has, so another one is only needed for a first damper, a first
        pinned particle, or connections that come in many more kinds than before. The route is chosen anew where
        that was left open, and so are the substeps.

        Parameters
        ----------
        group, freeze, parameters
            What changes, and to what; see `msdwarp.at`.

        Raises
        ------
        ValueError
            If a name is none of these, or a value is out of its range; nothing has changed then.
        """
        change = Change(self.time, group, freeze, parameters)
        self._load(change.applied_to(self.snapshot()))


def _to_host(array: wp.array) -> NDArray:
    """Copy to the host; on the CPU `numpy()` alone would show the array as it goes on changing."""
    return np.array(array.numpy())
