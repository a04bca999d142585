"""Stepping: the worlds on a device, and how they are advanced by one frame after the other."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from functools import partial
from typing import Any, Self

import numpy as np
import warp as wp
from numpy.typing import ArrayLike, NDArray

from ..bodies import Frame
from ..engine import (
    Backup,
    Baseline,
    Blocks,
    ContactForces,
    DivergenceMonitor,
    Dynamics,
    EnergyBalance,
    EnergySums,
    FrozenWorlds,
    Rates,
    State,
    Stepper,
    Steps,
    Velocities,
    is_told_by_frames,
    potential,
    sensors_of,
    size,
    weight,
)
from ..integrators import Integrator, StepChoice
from ..runtime import in_turn
from ..world import FRAME, SUBSTEP, Load, MouseSpring
from .divergence import Divergence
from .pinned_staging import CAPTURE_LOCK, PinnedStaging, to_host
from .track import Track, Tracks, tells_all


class Stepping:
    """The worlds on a device, and how they are advanced: by which method, with how many substeps a frame.

    It is replaced as a whole when anything of that changes: who holds one never sees half of a change. In an
    ensemble worlds that diverge are frozen, and the others go on.

    Parameters
    ----------
    dynamics, method
        The equation of motion, and how it is integrated.
    state
        What moves, with velocities at the instant of the positions.
    choices
        The substeps of a frame that worlds ask for, of those that differ: all take the most of them.
    energy_limit, blocks
        See `Simulation`; in place of blocks an ensemble has `threads`.
    paced
        Whether the balance is asked for behind frames.
    baseline
        What the energy is compared with; by default the present state's.
    time
        When it begins [s].

    Attributes
    ----------
    assembly, model, state, dynamics, stepper, watch, frozen
        The parts of `msdwarp.engine` that it is made of; what freezes worlds is None outside of ensembles.
    choice
        The substeps of all.
    integrator
        The method as it is best used with these substeps.
    contact_forces
        What contacts have pushed particles with in the last frame; None where nobody asks for it.
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
        paced: bool = False,
        baseline: Baseline | None = None,
        time: float = 0.0,
    ) -> None:
        self.dynamics, self.assembly, self.model = dynamics, dynamics.assembly, dynamics.model
        self.state, self.choices = state, choices
        choice = self.choice = max(choices, key=lambda one: (one.substeps, one.rates.stiffness))
        self._how = {"method": method, "energy_limit": energy_limit, "blocks": blocks, "paced": paced}
        self.integrator = method.fitted(Rates.all_within([one.rates for one in choices]), choice.step)
        self._time, self._begun, own = time, time, self.integrator
        dynamics.begin(Steps(choice.fps, choice.substeps, own.stage_times, own.weights, own.lag, own.lagging))
        dynamics.hold(time)
        self._landing = PinnedStaging()
        swings = np.array([replace(one, substeps=choice.substeps).energy_swing for one in choices])
        limit = energy_limit * self.model.of_each(swings)
        self.watch = DivergenceMonitor(self.assembly, state, limit, baseline)
        self.frozen = FrozenWorlds(self.assembly, self.watch, dynamics.frozen) if self.model.in_worlds else None
        self._tracks = Tracks(self.assembly, state, self.frozen.changing if self.frozen is not None else ())
        self._velocities = Velocities(dynamics, state, own.lag * choice.step, own.staggered)
        pushed_by, seconds = (self.assembly.colliders, self.assembly.body_contact), 1.0 / choice.fps
        summed = self.assembly.sums_contact_forces
        self.contact_forces = ContactForces(self.model, *pushed_by, seconds) if summed else None
        self._sensors = sensors_of(dynamics, state, FRAME, 1, seconds, self.contact_forces)
        self._by_substep = sensors_of(dynamics, state, SUBSTEP, choice.substeps, seconds, self.contact_forces)
        self.stepper = Stepper(
            dynamics,
            state,
            partial(own.substep, state, own.workspace(state), choice.step),
            behind_each=None if self._by_substep is None else self._look_behind,
            blocks=blocks,
        )
        self._sums: Any = None
        self._generation = self.model.generation
        self._unrecorded = self._unsummed = 0
        """How often a frame, and a balance, are launched before they are recorded."""
        small = is_told_by_frames(dynamics)
        self._tells, self.telling = paced and small, True
        """Whether frames can tell their balance; whether the next ones do, else it is summed when asked for."""
        self._runs_ahead = small and tells_all(self.assembly, self.contact_forces, self._sensors, self._by_substep)
        """Whether a frame can be judged while the next one is under way."""
        self._open_ledger = partial(EnergySums, dynamics, state, own.lag * choice.step)
        self._ledger = self._open_ledger() if self._tells else None
        self._velocities.start()

    @property
    def backup(self) -> Backup:
        """The state where the frame began that was advanced by last."""
        return self._tracks.now.backup

    @property
    def graph(self) -> Any:
        """A frame as it was recorded with the first one; None before."""
        return next(iter(self._tracks.first.graphs.values()), None)

    def with_choice(self, choice: StepChoice) -> Self:
        """Return what goes on from the present state with other substeps; this one is not used any longer."""
        own = self.integrator
        if own.staggered or not self.at_start:
            self._velocities.hand_over(own.lag * choice.step)
        how = self._how | {"baseline": self.watch.baseline, "time": self._time}
        return type(self)(self.dynamics, self.state, choices=[choice], **how)

    @property
    def at_start(self) -> bool:
        """Whether velocities are as they were given, and not yet those of substeps of some length."""
        return self._time == 0.0

    def fall(self, gravity: ArrayLike) -> None:
        """Go on under another constant gravity [m/s²]: only what was recorded with the old one is made anew."""
        heavy, before = weight(self.model), potential(self.model, self.state)
        with self._between():
            self.model.fall(gravity)
            self.dynamics.scene.gravity = self.model.gravity
        # Recording costs more than a launch: it is for what comes again before the next change.
        self._unrecorded, self._unsummed = 1, 4
        # All that energies are compared with is as much higher as the present one.
        added = potential(self.model, self.state) - before
        energy, scale = self.watch.baseline
        scale += max(0.0, weight(self.model) - heavy) * size(self.state)
        self.watch.compare_with(Baseline(energy + added, scale))

    def throw(self, velocity: NDArray[np.float64], chosen: NDArray[np.bool_]) -> None:
        """Go on with other velocities of chosen particles [m/s], shape [particle_count, d]; all else stays."""
        if self.assembly.external_work is not None:
            self.assembly.external_work.settle(self.state.x, self.state.v)
        with self._between():
            before = self.state.v.numpy()[chosen].astype(np.float64)
            self.state.throw(velocity, chosen)
        mass = np.broadcast_to(self.model.mass, len(chosen))[chosen]  # of free ones
        added = 0.5 * float(mass @ (velocity[chosen] ** 2 - before**2).sum(axis=1))
        energy, scale = self.watch.baseline
        self.watch.compare_with(Baseline(energy + added, scale + max(0.0, added)))

    def exchange(self, others: Mapping[Load, Load]) -> None:
        """Go on with other values of the same loads, in place of each key what stands for it."""
        work, x = self.assembly.external_work, self.state.x
        with self._between():
            done = 0.0 if work is None else work.totals(x, self.state.v)
            for effect in self.assembly.all:
                effect.exchange(others)
            self.dynamics.hold(self._time)
            if work is not None:  # what has been done stays so
                work.before += done - work.totals(x, self.state.v)
        hands = [one for one in others.values() if isinstance(one, MouseSpring)]
        if hands:  # a pull brings in what its springs store, again and again
            energy, scale = Baseline.of(self.assembly, self.state)
            here = x.numpy()
            self.watch.compare_with(Baseline(energy, scale + sum(one.stored(here) for one in hands)))

    @contextmanager
    def _between(self) -> Iterator[None]:
        """Bring velocities to the instant of the positions and, when forces have changed, back to the method's."""
        v = self.velocity()
        if v is not self.state.v:
            wp.copy(self.state.v, v)
        try:
            yield
        finally:
            self._velocities.start()

    def advance(self, time: float, then: float | None = None) -> bool:
        """Advance by the frame that begins at `time` [s]; return whether all went well.

        Where another one follows at once, at `then` [s], the host prepares it while the device is at work, and
        launches it if it can before it judges the present one. Where the caller comes in between, what functions
        of time read may change first: then there is none.
        """
        if not self._tracks.go_on():
            self._take_frame(time, self._tracks.now)
        fps, track = self.choice.fps, self._tracks.now
        self._begun, self._time = time, (round(time * fps) + 1) / fps
        if then is not None:
            self.dynamics.prepare(then)
            if self._runs_ahead and not self._unrecorded:
                ahead = self._tracks.other()
                with suppress(Exception):  # it is raised again when that frame begins, if it ever does
                    self._take_frame(then, ahead)
                    self._tracks.ahead = ahead
        fine = self._is_fine(track)
        while self._is_void():
            self.go_back()
            self._take_frame(time, track)
            fine = self._is_fine(track)
        if self.frozen is not None:
            self.frozen.tell_contact()
        return fine

    def _is_fine(self, track: Track) -> bool:
        """Wait for a frame, and tell whether all went well; in an ensemble wait only if its effects are asked."""
        if self.frozen is None:
            return not self.watch.finds_trouble(track.found)
        if self.assembly.body_contact is not None:
            track.found.wait()
        return True

    def land(self) -> None:
        """Undo a frame that was launched ahead: the state is that where the one before it ends."""
        if self._tracks.ahead is not None:
            self._tracks.ahead.backup.restore()
            self._tracks.ahead = None
            self.dynamics.hold(self._time)

    def _take_frame(self, time: float, track: Track) -> None:
        """Launch the frame that begins at `time` [s]."""
        self._forget_stale()
        partition, graphs = self.dynamics.partition, track.graphs
        tells = track.tells = self._tells and self.telling
        if tells not in graphs and (partition is not None or not self._unrecorded):
            graphs[tells] = self._recorded_frame(track)
        self.dynamics.begin_frame(time)
        if tells not in graphs:
            self._unrecorded -= 1
            self._launch_frame(track)
        elif partition is not None:
            graphs[tells].replay()
        else:
            wp.capture_launch(graphs[tells])
        track.found.mark()

    def _forget_stale(self) -> None:
        """Forget what was recorded with arrays, numbers or kernels that have been replaced since."""
        if self._generation != self.model.generation:
            self._tracks.forget_graphs()
            self._sums, self._generation = None, self.model.generation

    def _is_void(self) -> bool:
        """Tell whether the frame just waited for must be repeated: effects have made room for it."""
        void = [effect.is_void() for effect in self.assembly.all]  # each of them is asked
        return any(void)

    def begin_at(self, time: float) -> None:
        """Begin at `time` [s] from a state that is written next."""
        self._time = self._begun = time
        self.dynamics.hold(time)

    def begin_anew(self) -> None:
        """Compare energies with those of the present state from now on."""
        self.watch.compare_with(Baseline.of(self.assembly, self.state))

    def go_back(self) -> None:
        """Go back to the start of the frame that was advanced by last."""
        self._tracks.ahead = None
        self.backup.restore()
        self.begin_at(self._begun)

    def _recorded_frame(self, track: Track) -> Any:
        """Record the substeps of a frame, and the watch after them, as one graph."""
        launch, partition = partial(self._launch_frame, track), self.dynamics.partition
        if partition is None:
            return self._recorded(launch)
        with CAPTURE_LOCK:
            return partition.record(launch)

    def _recorded(self, launch: Callable[[], None]) -> Any:
        """Record what is launched as a graph."""
        with CAPTURE_LOCK, wp.ScopedCapture(device=self.model.device) as capture:
            launch()
        return capture.graph

    def _launch_frame(self, track: Track) -> None:
        """Launch the substeps of a frame, and what looks at the state behind them."""
        track.backup.save()
        if self.contact_forces is not None:
            self.contact_forces.begin()
        self.stepper.take(self.choice.substeps)
        for effect in self.assembly.all:
            effect.look()
        if track.tells and self._ledger is not None:
            self._ledger.launch(track.found)
        else:
            self.watch.look(track.found)
        if self.frozen is not None:
            self.frozen.launch(track.found, track.backup)
        if self._sensors is not None:
            self._sensors.launch(self.velocity() if self._sensors.moves else self.state.v)

    def _look_behind(self, substep: int) -> None:
        """Launch what probes measure where a substep ends."""
        assert self._by_substep is not None
        with self.dynamics.looking(substep):
            self._by_substep.launch(self.velocity() if self._by_substep.moves else self.state.v, substep)

    def balance(self) -> EnergyBalance:
        """Return the energies of the present state, summed by a graph of its own."""
        if self._ledger is None:
            self._ledger = self._open_ledger()
        self._forget_stale()
        found = self._tracks.first.found
        if self._unsummed:
            self._unsummed -= 1
            self._ledger.launch(found)
        else:
            self._sums = self._sums or self._recorded(partial(self._ledger.launch, found))
            wp.capture_launch(self._sums)
        found.mark()
        return self._ledger.balance(found.read())

    def balance_of_frame(self) -> EnergyBalance:
        """Return the balance of the frame just advanced by: as that tells it, or summed now."""
        if self._tracks.now.tells and self._ledger is not None:
            return self._ledger.balance(self.watch.told)
        self.land()
        return self.balance()

    def readings(self) -> dict[str, NDArray[np.float64]]:
        """Return what probes have told of the frame that was advanced by last, by their names.

        A row for each reading, so many seconds apart that the last one is where the frame ends.
        """
        found = {}
        for sensors in filter(None, (self._sensors, self._by_substep)):
            found |= sensors.read()
        return found

    def find_trouble(self) -> Divergence:
        """Find out what went wrong in the frame just simulated, and go back to its start.

        The frame is simulated once more, looking after every substep.
        """
        self.go_back()
        self.dynamics.begin_frame(self._begun)
        found, good, substep = self._tracks.now.found, to_host(self.state.x), 0
        for substep in range(self.choice.substeps):
            good = to_host(self.state.x)
            self.stepper.take(1, substep)
            self.watch.look(found)
            found.mark()
            if self.watch.finds_trouble(found):
                break
        trouble = Divergence(good, substep + 1, self.watch.worst_particle())
        self.go_back()
        return trouble

    def velocity(self) -> wp.array:
        """Return the velocities at the instant of the positions [m/s], on the device."""
        return self._velocities.read()

    def frame(self, time: float) -> Frame:
        """Return the present positions and velocities, in an ensemble of shape [worlds, particle_count, d]."""
        position, velocity = self._landing.host_copies(self.state.x, self.velocity())
        if self.model.compensated:  # what sums have lost belongs to them
            position = position.astype(np.float64) - self.state.compensation.x.numpy()
            velocity = velocity.astype(np.float64) - self.state.compensation.v.numpy()
        return Frame(time, *(self.model.of_each(self.model.by_world(one)) for one in (position, velocity)))

    def warnings(self) -> str | None:
        """Return words about what may have gone wrong in the last frame; None where nothing did."""
        return next(filter(None, (effect.warnings() for effect in self.assembly.all)), None)

    @in_turn
    def changed_fields(self) -> dict[str, NDArray]:
        """Return the fields of the system that substeps have changed, but for positions and velocities."""
        return {name: array for effect in self.assembly.all for name, array in effect.changed_fields().items()}
