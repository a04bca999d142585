"""Detect divergence of a run or of a world, and keep a copy of the state to return to.

`energy_balance.py` measures slow growth of energy, and `simulation/substep_controller.py` reacts to it.
`kernels/reductions/frozen_worlds.py` tests worlds of an ensemble; `simulation/divergence_error.py` has the error.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple, Self

import numpy as np
import warp as wp
from numpy.typing import NDArray

from ...kernels.reductions import columns
from ...kernels.reductions.frozen_worlds import RUNNING, judge, put_back
from ..device.device import view_of
from ..model.state import State, copy_vectors, moving
from ..stepping.assemble import Assembly
from .energies import Sums, measure
from .energy_balance import rounding_energy, size, weight
from .readout import Found

LEAST_THREADS, MOST_THREADS = 8, 2**20
"""Minimal threads per world, and maximal threads in all, to restore worlds on a GPU: few worlds diverge."""


class Baseline(NamedTuple):
    """Reference for the energy of a run: numbers, or arrays of shape [worlds] in an ensemble."""

    energy: Any
    """Energy at the start: kinetic, elastic, gravitational, and stored by effects, minus the work of loads [J]."""
    scale: Any
    """Kinetic, elastic and other stored energy at the start, plus the weight times the system's size [J]."""

    @classmethod
    def of(cls, assembly: Assembly, state: State) -> Self:
        """Return the baseline of a run that starts in this state."""
        start, model = measure(assembly, state), assembly.model
        scale = start.kinetic_energy + start.elastic_energy + weight(model) * size(state)
        scale += np.maximum(start.effect_energy, 0.0)  # cells of negative modulus store less than nothing
        # Moving a body out of an obstacle adds energy.
        if assembly.colliders is not None:
            scale += model.of_each(assembly.colliders.brings_in(model))
        return cls(start.energy - start.external_work, scale + rounding_energy(assembly, state))


class DivergenceMonitor:
    """Checks a state on the device, by one pass over the particles.

    The kinetic, elastic and gravitational energy at the start can only change form or turn to heat. So kinetic
    plus gravitational energy never exceeds the energy at the start plus the work of loads, drives and moving
    obstacles. A run has diverged if it exceeds this bound by more than `energy_limit` times the scale: the
    kinetic, elastic and other stored energy at the start plus the weight times the system's size.
    """

    def __init__(
        self, assembly: Assembly, state: State, energy_limit: Any, baseline: Baseline | None = None
    ) -> None:
        self._model, self._state, self._energy_limit = assembly.model, state, energy_limit
        self.energy = 0.0
        """Kinetic and gravitational energy of the state read last, minus the work of loads [J]."""
        self.told = list[float]()
        """The sums read last."""
        self._sums = Sums(assembly, everything=False)
        self._work, self._most_work = assembly.external_work, 0.0  # work of loads is subtracted
        self.compare_with(baseline or Baseline.of(assembly, state))

    def compare_with(self, baseline: Baseline) -> None:
        """Compare energies with a baseline from now on."""
        self.baseline = baseline
        """Energy and scale at the start of the run; a change of the number of substeps keeps them."""
        energy, scale = self.baseline
        with np.errstate(invalid="ignore"):  # 0 · inf, if there is no limit
            most = np.where(scale > 0, energy + self._energy_limit * scale, np.inf)
        self.most = most if self._model.in_worlds else float(most)
        """Largest allowed kinetic plus gravitational energy minus work, of each world [J]."""

    def look(self, found: Found) -> None:
        """Launch the sums over the present state; a graph may record it."""
        state = self._state
        self._sums.launch(state.x, state.v, state.v, None, found.state_out)

    def finds_trouble(self, found: Found) -> bool:
        """Wait for the sums over the state of a single world, and return whether it has diverged."""
        self.told = told = found.read()
        self.energy, most = told[columns.KINETIC] + told[columns.POTENTIAL], self.most
        if self._work is not None:
            work = float(self._work.before[0]) + told[columns.WORK]
            self.energy -= work
            self.allow_for_work(work)
            most += self._most_work
        return self._first < self._model.particle_count or not self.energy <= most

    def allow_for_work(self, work: float) -> None:
        """Allow for errors of so much work [J], which are O(h) and remain when it falls."""
        if np.isfinite(work):
            self._most_work = max(self._most_work, abs(work))

    @property
    def _first(self) -> int:
        """The index of the first non-finite particle; if all are finite, a number above all indices."""
        return -int(self.told[columns.FIRST])

    def worst_particle(self) -> int:
        """Return the first non-finite particle of the state read last; if all are finite, the fastest."""
        if self._first < self._model.particle_count:
            return self._first
        return int(np.argmax(np.abs(self._state.v.numpy()).max(axis=1)))


class Backup:
    """Copies of arrays at the start of a frame: arrays of the state, arrays that effects change, and `others`.

    `kept` are copies of the state's arrays, in the order of `live`. `changing` has pairs (array, copy) of all
    other arrays.
    """

    def __init__(self, assembly: Assembly, state: State, others: Sequence[wp.array] = ()) -> None:
        self._state = state
        here, live = state.state_in, self.live()
        together = state.model.vectors_together(2 + len(here.method_state))
        self.kept = together + tuple(state.model.vectors() for _ in live[len(together) :])
        changing = [array for effect in assembly.all for array in effect.changing]
        self.changing = [(live, wp.clone(live)) for live in (*changing, *others)]

    def live(self) -> list[wp.array]:
        """Return the state's arrays, in the order of their copies in `kept`."""
        compensation = self._state.compensation.v
        return moving(self._state.state_in) + ([compensation] if compensation.size else [])

    def save(self) -> None:
        """Copy the current arrays, so that `restore` can return to them."""
        copy_vectors(self.kept, self.live())
        for live, kept in self.changing:
            wp.copy(kept, live)

    def restore(self) -> None:
        """Copy the kept values back into the arrays of the state and of effects."""
        copy_vectors(self.live(), self.kept)
        for live, kept in self.changing:
            wp.copy(live, kept)


class WorldStatus(NamedTuple):
    """The status of each world, arrays of shape [worlds]."""

    status: NDArray[np.int32]
    """0: running; 1: a number is not finite; 2: the energy exceeds `DivergenceMonitor.most` plus the work."""
    good_frames: NDArray[np.int32]
    """Frames before the world diverged; −1 while it runs."""
    particle: NDArray[np.int32]
    """The first non-finite particle; −1 if all are finite."""


class FrozenWorlds:
    """Tests each world for divergence at a frame's end, on the device, from the sums of a `DivergenceMonitor`.

    The array `frozen` has the status of each world (`Dynamics.frozen`). What `earlier` has found stays.
    """

    def __init__(
        self, assembly: Assembly, watch: DivergenceMonitor, frozen: wp.array, earlier: Self | None = None
    ) -> None:
        model = assembly.model
        self._model, self._contact, self._frozen = model, assembly.body_contact, frozen
        before = np.zeros(model.worlds) if assembly.external_work is None else assembly.external_work.before
        limits: Any = (before, watch.most)
        self._limits = [wp.array(one, dtype=wp.float64, device=model.device) for one in limits]
        self._good_frames, self._particle = (wp.zeros_like(frozen) for _ in range(2))
        most_work = wp.zeros(model.worlds, dtype=wp.float64, device=model.device)
        self._own = [frozen, self._good_frames, self._particle, most_work]
        if earlier is not None:
            _, self._good_frames, self._particle, _ = self._own = earlier._own
        # Arrays of effects are restored in frozen worlds, except the arrays of contact between bodies.
        each = (one for one in assembly.all if one.by_world and one is not self._contact)
        model.kernels.note(judge, put_back)
        self._put_back = {id(array) for one in each for array in one.changing}

    @property
    def changing(self) -> list[wp.array]:
        """Arrays to restore if a frame must be repeated, which happens only for contact between bodies."""
        return self._own if self._contact is not None else []

    def launch(self, found: Found, backup: Backup) -> None:
        """Launch the test of each world's sums, then restore worlds that have diverged."""
        device, worlds = self._model.device, self._model.worlds
        wp.launch(judge, worlds, [found.state_out, *self._limits], self._own, device=device)
        arrays = [*zip(backup.live(), backup.kept, strict=True)]
        arrays += [(live, kept) for live, kept in backup.changing if id(live) in self._put_back]
        most = max(MOST_THREADS // worlds, LEAST_THREADS) if device.is_cuda else 1
        for live, kept in arrays:
            if live.size:
                words = _words(live, worlds)
                threads = min(words.shape[1], most)
                inputs = [self._frozen, threads, _words(kept, worlds)]
                wp.launch(put_back, (worlds, threads), inputs, [words], device=device)

    def found(self) -> WorldStatus:
        """Wait for the device, and return the status of each world."""
        status: Any
        status, frames, particle = (one.numpy() for one in (self._frozen, self._good_frames, self._particle))
        lost = particle < self._model.particle_count
        return WorldStatus(
            np.array(status),
            np.where(status != RUNNING, frames, -1),
            np.where((status != RUNNING) & lost, particle, -1),
        )

    def tell_contact(self) -> None:
        """Pass the worlds' status to contact between bodies: neighbor lists of frozen worlds may be invalid."""
        if self._contact is not None:
            self._contact.frozen = self._frozen.numpy() != RUNNING


def _words(array: Any, worlds: int) -> wp.array:
    """Return a view of an array's memory as words of four bytes, shape [worlds, word_count]."""
    shape = (worlds, len(array) * array.strides[0] // (4 * worlds))
    return view_of(array, shape, dtype=wp.uint32)
