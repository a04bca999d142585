"""Stepping: advances the worlds on a device frame by frame."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from functools import partial
from time import perf_counter
from typing import Any, Self

import numpy as np
import warp as wp
from numpy.typing import ArrayLike, NDArray

from ..bodies import Frame
from ..engine import (
    Baseline,
    Blocks,
    ContactForces,
    DivergenceMonitor,
    Dynamics,
    EnergyBalance,
    EnergySums,
    Found,
    FrozenWorlds,
    Rates,
    State,
    Stepper,
    Steps,
    Velocities,
    is_told_by_frames,
    measure_substep,
    potential,
    sensors_of,
    size,
    weight,
)
from ..integrators import Integrator, StepChoice
from ..runtime import record, stop_if_asked
from ..world import FRAME, SUBSTEP, Load, MouseSpring
from .pinned_staging import PinnedStaging
from .track import LONG, Track, Tracks, can_judge_late


class Stepping:
    """The worlds on a device, the method that advances them, and the substeps of a frame.

    A change of any of these creates a new `Stepping`, so callers never see a partial change. In an ensemble
    diverged worlds are frozen, and the others continue.

    `state` has velocities at the time of the positions. `choices` has the substeps that each world needs, or one
    entry for equal worlds; all worlds use the largest number, `choice`, to which `integrator` is fitted. For
    `energy_limit` and `blocks` see `Simulation`; in an ensemble `blocks` is the number of threads per world. With
    `watch_energy` a `StepController` reads the energy balance of frames. `baseline` is the reference for energies,
    by default the energy of `state`, at `time` [s]. With `still`, functions of time keep their values at a frame's
    start. `frozen` are the worlds that have stopped before; None outside of ensembles. `contact_forces` sums the
    contact forces of a frame; None if no probe or caller needs them.
    """

    def __init__(
        self,
        dynamics: Dynamics,
        state: State,
        method: Integrator,
        choices: Sequence[StepChoice],
        *,
        energy_limit: float,
        blocks: Blocks | int | str,
        watch_energy: bool = False,
        still: bool = False,
        baseline: Baseline | None = None,
        time: float = 0.0,
        frozen: FrozenWorlds | None = None,
    ) -> None:
        self.dynamics, self.assembly, self.model = dynamics, dynamics.assembly, dynamics.model
        self.state, self.choices = state, choices
        choice = self.choice = max(choices, key=lambda one: (one.substeps, one.rates.stiffness))
        how = {"energy_limit": energy_limit, "blocks": blocks, "watch_energy": watch_energy, "still": still}
        self._again = partial(type(self), dynamics, state, method, **how)
        self.integrator = method.fitted(Rates.all_within([one.rates for one in choices]), choice.step)
        self._time, self.frame_start, own = time, time, self.integrator
        self._steps = Steps(choice.fps, choice.substeps, own.stage_times, own.weights, own.lag, own.lagging, still)
        dynamics.begin(self._steps)
        dynamics.hold(time)
        self._staging = PinnedStaging()
        swings = np.array([replace(one, substeps=choice.substeps).energy_swing for one in choices])
        limit = energy_limit * self.model.of_each(swings)
        contacts, seconds = (self.assembly.colliders, self.assembly.body_contact), 1.0 / choice.fps
        summed = self.assembly.sums_contact_forces
        forces = self.contact_forces = ContactForces(self.model, *contacts, seconds) if summed else None
        self._frame_sensors = sensors_of(dynamics, state, FRAME, 1, seconds, forces)
        sensors = self._substep_sensors = sensors_of(dynamics, state, SUBSTEP, choice.substeps, seconds, forces)
        velocities = self.velocities = Velocities(dynamics, state, own.lag * choice.step, own.staggered)
        self.stepper = Stepper(
            dynamics,
            state,
            partial(own.substep, state, own.workspace(state), choice.step),
            after_substep=sensors and partial(measure_substep, sensors, dynamics, state, velocities),
            blocks=blocks,
        )
        self.watch = DivergenceMonitor(self.assembly, state, limit, baseline)
        several = (self.assembly, self.watch, dynamics.frozen, frozen)
        self.frozen = FrozenWorlds(*several) if self.model.in_worlds else None
        self.model.kernels.compile()
        others = () if self.frozen is None else self.frozen.changing
        self._tracks = Tracks(self.assembly, state, self.velocities, others=others)
        self._launch_substeps: Callable[[int, int], None] = self.stepper.take
        self._balance_graph: Any = None
        self._generation = self.model.generation
        self.too_far = 0.0
        """The longest path in a substep of the last frame [m], if contact may have missed bodies there; else 0."""
        self._unrecorded = self._unsummed = 0
        """Numbers of frames, and of balances, to launch directly before later ones are recorded."""
        small = is_told_by_frames(dynamics)
        self._can_sum_balance, self.sum_balance = watch_energy and small, True
        """Whether frames can sum the energy balance; whether the next ones do, instead of `balance_of_frame`."""
        measured = forces, self._frame_sensors, self._substep_sensors
        self.runs_ahead = small and can_judge_late(self.assembly, *measured)
        """Whether a frame can be tested for divergence while the next one runs."""
        self._new_energy_sums = partial(EnergySums, dynamics, state, own.lag * choice.step)
        self._energy_sums = self._new_energy_sums() if self._can_sum_balance else None
        self.velocities.start()

    @property
    def graph(self) -> Any:
        """Function that replays the first recorded graph; None if there is none yet."""
        return next(iter(self._tracks.first.graphs.values()), None)

    def with_choice(self, *choices: StepChoice) -> Self:
        """Return a `Stepping` with other substeps, which replaces this one and continues from its state."""
        own, choice = self.integrator, max(choices, key=lambda one: one.substeps)
        with self.undoing():
            if own.staggered or not self.at_start:
                most = own.lag * choice.limit if choice.limit > 0 else math.inf
                self.velocities.change_lag(own.lag * choice.step, most)
            return self._again(choices, baseline=self.watch.baseline, time=self._time, frozen=self.frozen)

    @contextmanager
    def undoing(self) -> Iterator[None]:
        """Go back to the present state and baseline if a block that writes to the arrays fails."""
        self._tracks.current.keep()
        baseline, self.frame_start = self.watch.baseline, self._time
        try:
            yield
        except BaseException:  # of a function of time, or of a signal's handler
            self.watch.compare_with(baseline)
            self.go_back()
            raise

    @property
    def at_start(self) -> bool:
        """Whether velocities are still those given by the user, before any substep."""
        return self._time == 0.0

    @property
    def end(self) -> float:
        """The time of the state [s]; that of the caller, unless a signal kept it from counting the last frame."""
        return self._time

    def launch_substeps_by(self, launch: Callable[[int, int], None]) -> None:
        """Have `launch`, a function of their number and of the first one, launch the substeps of later frames."""
        self._tracks.forget_graphs()
        self._launch_substeps = launch

    def set_gravity(self, gravity: ArrayLike) -> None:
        """Set a constant gravity [m/s²]. Graphs that contain the old gravity are recorded again."""
        weight_before, energy_before = weight(self.model), potential(self.model, self.state)
        with self._synchronized_velocities():
            self.model.fall(gravity)
            self.dynamics.scene.gravity = self.model.gravity
        self._unrecorded, self._unsummed = 1, 4  # recording takes longer, and pays only if no change follows soon
        added_energy = potential(self.model, self.state) - energy_before
        self._shift_baseline(added_energy, max(0.0, weight(self.model) - weight_before) * size(self.state))

    def set_velocity(self, velocity: NDArray[np.float64], chosen: NDArray[np.bool_]) -> None:
        """Set the velocities of chosen particles [m/s], shape [particle_count, d]."""
        if self.assembly.external_work is not None:
            self.assembly.external_work.settle(self.state.x, self.state.v)
        with self._synchronized_velocities():
            before = self.state.v.numpy()[chosen].astype(np.float64)
            self.state.throw(velocity, chosen)
        mass = np.broadcast_to(self.model.mass, len(chosen))[chosen]  # finite: none is pinned
        added_energy = 0.5 * float(mass @ (velocity[chosen] ** 2 - before**2).sum(axis=1))
        self._shift_baseline(added_energy, max(0.0, added_energy))

    def _shift_baseline(self, energy: float, scale: float) -> None:
        """Add `energy` [J] to the baseline's energy, and `scale` [J] to its scale."""
        baseline = self.watch.baseline
        self.watch.compare_with(Baseline(baseline.energy + energy, baseline.scale + scale))

    def exchange(self, replacements: Mapping[Load, Load]) -> None:
        """Replace loads (keys) by loads that differ only in values (values)."""
        work, x = self.assembly.external_work, self.state.x
        with self._synchronized_velocities():
            done = 0.0 if work is None else work.totals(x, self.state.v)
            for effect in self.assembly.all:
                effect.exchange(replacements)
            self.dynamics.hold(self._time)
            if work is not None:  # the work done so far stays the same
                work.before += done - work.totals(x, self.state.v)
        if any(isinstance(one, MouseSpring) for one in replacements.values()):
            self.reset_baseline()  # each move of the mouse adds the energy stored by its springs

    @contextmanager
    def _synchronized_velocities(self) -> Iterator[None]:
        """Shift velocities to the time of the positions; on exit shift them back, by the forces at that moment."""
        v = self.velocity()
        if v is not self.state.v:
            wp.copy(self.state.v, v)
        try:
            yield
        finally:
            self.velocities.start()

    def advance(self, time: float, next_time: float | None = None) -> bool:
        """Advance by the frame that begins at `time` [s]; return False if it diverged (or was `too_far`).

        If another frame follows immediately, at `next_time` [s], the host prepares it while the device works and
        may launch it before testing the current frame. Omit `next_time` if the caller acts between the two
        frames, since functions of time may then return other values.
        """
        try:
            if not self._tracks.advance():
                self._take_frame(time, self._tracks.current)
            self.frame_start, self._time = time, (round(time * self.choice.fps) + 1) / self.choice.fps
            return self._judge(time, next_time, self._tracks.current)
        except BaseException:  # of a function of time or a signal's handler: the caller does not count this frame
            if self._tracks.current.time == time:
                self.frame_start = time
                self.go_back()
            raise

    def _judge(self, time: float, next_time: float | None, track: Track) -> bool:
        """Launch the next frame ahead, and return whether the frame that begins at `time` [s] is fine."""
        if next_time is not None:
            self.dynamics.prepare(next_time)
            if self.runs_ahead and not self._unrecorded and self.dynamics.pace.launches == 1:
                ahead = self._tracks.other()
                with suppress(Exception):  # raised again when that frame begins, if it does
                    self._take_frame(next_time, ahead)
                    self._tracks.ahead = ahead
        fine = self._is_fine(track)
        self.dynamics.pace.learn(self.choice.substeps)
        # Every effect is asked. If a neighbour list was too short or too old, the frame is repeated.
        repeats, began = 0, perf_counter()
        while void := [effect for effect in self.assembly.all if effect.is_void()]:
            self.go_back()
            stop_if_asked()
            repeats += 1
            if perf_counter() - began > LONG:
                void[0].tell_repeats(time, repeats)
                began = math.inf  # once
            self._take_frame(time, track)
            fine = self._is_fine(track)
        if self.frozen is not None:
            self.frozen.tell_contact()
        elif self.assembly.body_contact is not None:
            self.too_far = self.assembly.body_contact.neighbors.too_far if fine else 0.0
        return fine and not self.too_far

    def _will_be_void(self) -> bool:
        """Return whether the frame must be repeated, though only part of it has been taken."""
        void = any(effect.will_be_void() for effect in self.assembly.all)
        for effect in self.assembly.all if void else ():
            effect.look()
        return void

    def _is_fine(self, track: Track) -> bool:
        """Wait for a frame; return False if it diverged. An ensemble must wait only if bodies may touch."""
        if self.frozen is None:
            return not self.watch.finds_trouble(track.found)
        if self.assembly.body_contact is not None:
            track.found.wait()
        return True

    def discard_ahead(self) -> None:
        """Undo a frame that was launched ahead."""
        if self._tracks.ahead is not None:
            self._tracks.ahead.restore()
            self._tracks.ahead = None
            self.dynamics.hold(self._time)

    def _take_frame(self, time: float, track: Track) -> None:
        """Launch the frame that begins at `time` [s]; if it takes long, in several launches."""
        self._forget_outdated()
        track.leave()
        track.sums_balance = self._can_sum_balance and self.sum_balance
        self.stepper.takes_contact_along = not self._unrecorded and self.stepper.may_take_contact_along
        part, launch = self._launch_from(track, 0)
        self.dynamics.begin_frame(time)
        try:
            self.dynamics.pace.take(
                self.choice.substeps, part, launch, partial(self._launch_from, track), self._will_be_void
            )
            track.found.mark()
            track.time = time
        except BaseException:  # of a signal meanwhile
            track.restore()
            self.dynamics.hold(self._time)
            raise
        self._unrecorded = max(0, self._unrecorded - 1)

    def _launch_from(self, track: Track, first: int) -> tuple[range, Callable[[], None]]:
        """Return the substeps of a frame's next launch, from number `first` on, and the function that launches."""
        dynamics, contact = self.dynamics, self.assembly.body_contact
        part, threads = dynamics.pace.part(first, self.choice.substeps), dynamics.pace.threads()
        dynamics.share_among(threads)
        kind = track.sums_balance, self.stepper.takes_contact_along, contact and contact.recorded_for
        kind = *kind, threads, first, part.stop
        launch = track.graphs.get(kind) or partial(self._launch_part, part, track)
        if kind not in track.graphs and (dynamics.partition is not None or not self._unrecorded):
            launch = track.graphs[kind] = dynamics.recorded(launch)
        return part, launch

    def _forget_outdated(self) -> None:
        """Drop graphs with replaced arrays, arguments or kernels."""
        if self._generation != self.model.generation:
            self._tracks.forget_graphs()
            self._balance_graph, self._generation = None, self.model.generation

    def begin_at(self, time: float) -> None:
        """Set the time [s] of the state that the caller writes next."""
        self._time = self.frame_start = time
        self.dynamics.hold(time)

    def reset_baseline(self) -> None:
        """From now on compare energies with the energies of the current state."""
        self.watch.compare_with(Baseline.of(self.assembly, self.state))

    def go_back(self) -> None:
        """Go back to the start of the last frame, even if a `Stepping` with other substeps has gone on from it."""
        if self.dynamics.steps is not self._steps:
            self.dynamics.begin(self._steps)
        self._tracks.ahead = None
        self._tracks.current.restore()
        self.begin_at(self.frame_start)

    def _launch_part(self, part: range, track: Track) -> None:
        """Launch some substeps of a frame; after the last also the checks and sensors at the frame's end."""
        if part.start == 0:
            track.backup.save()
            if self.contact_forces is not None:
                self.contact_forces.begin()
        self._launch_substeps(len(part), part.start)
        if part.stop < self.choice.substeps:
            return
        for effect in self.assembly.all:
            effect.look()
        if track.sums_balance and self._energy_sums is not None:
            self._energy_sums.launch(track.found)
        else:
            self.watch.look(track.found)
        if self.frozen is not None:
            self.frozen.launch(track.found, track.backup)
        if self._frame_sensors is not None:
            self._frame_sensors.launch(self.velocity() if self._frame_sensors.moves else self.state.v)

    def balance(self) -> EnergyBalance:
        """Return the energy balance of the current state, computed by separate launches."""
        sums = self._energy_sums = self._energy_sums or self._new_energy_sums()
        self._forget_outdated()
        found = self._tracks.first.found
        if self._unsummed:
            self._unsummed -= 1
            sums.launch(found)
        else:
            self._balance_graph = self._balance_graph or record(partial(sums.launch, found), self.model.device)
            wp.capture_launch(self._balance_graph)
        found.mark()
        return sums.balance(found.read())

    def balance_of_frame(self) -> EnergyBalance:
        """Return the energy balance at the end of the last frame; compute it if the frame's launches did not."""
        if self._tracks.current.sums_balance and self._energy_sums is not None:
            return self._energy_sums.balance(self.watch.told)
        self.discard_ahead()
        return self.balance()

    def readings(self) -> dict[str, NDArray[np.float64]]:
        """Return the last frame's readings by probe name: evenly spaced rows, the last row at the frame's end."""
        both = filter(None, (self._frame_sensors, self._substep_sensors))
        return {name: rows for sensors in both for name, rows in sensors.read().items()}

    @property
    def found(self) -> Found:
        """What the checks at the end of the last frame found."""
        return self._tracks.current.found

    def velocity(self) -> wp.array:
        """Return the velocities at the time of the positions [m/s], on the device."""
        return self.velocities.read()

    def frame(self, time: float) -> Frame:
        """Return the current positions and velocities, in an ensemble of shape [worlds, particle_count, d]."""
        position, velocity = self._staging.host_copies(self.state.x, self.velocity())
        if self.model.compensated:  # subtract the rounding errors of sums
            position = position.astype(np.float64) - self.state.compensation.x.numpy()
            velocity = velocity.astype(np.float64) - self.state.compensation.v.numpy()
        return Frame(time, *(self.model.of_each(self.model.by_world(one)) for one in (position, velocity)))
