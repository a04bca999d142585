"""Detect divergence of a run, and keep a state to return to.

Slow growth of energy is found by `energy_balance.py` and judged by `simulation/substep_controller.py`.
`kernels/reductions/frozen_worlds.py` judges worlds of an ensemble, `simulation/divergence_error.py` has the error.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple, Self

import numpy as np
import warp as wp

from ...kernels.reductions import columns
from ..model.state import State, copy_vectors, moving
from ..stepping.assemble import Assembly
from .energies import Sums, measure
from .energy_balance import rounding_energy, size, weight
from .readout import Found


class Baseline(NamedTuple):
    """Reference for the energy of a run: numbers, or arrays of shape [worlds] in an ensemble."""

    energy: Any
    """Energy at the start: kinetic, elastic, gravitational, and stored by effects, minus the work of loads [J]."""
    scale: Any
    """Kinetic and elastic energy at the start, plus the weight times the system's size [J]."""

    @classmethod
    def of(cls, assembly: Assembly, state: State) -> Self:
        """Return the baseline of a run that starts in this state."""
        start, model = measure(assembly, state), assembly.model
        scale = start.kinetic_energy + start.elastic_energy + weight(model) * size(state)
        # Moving a body out of an obstacle adds energy.
        if assembly.colliders is not None:
            scale += model.of_each(assembly.colliders.brings_in(model))
        return cls(start.energy - start.external_work, scale + rounding_energy(model, state))


class DivergenceMonitor:
    """Checks a state on the device, by one pass over the particles.

    The kinetic, elastic and gravitational energy of the start can only change form or turn to heat. So kinetic
    plus gravitational energy can never exceed that sum plus the work of loads, drives and moving obstacles. If it
    does by more than `energy_limit` times the scale, the run has diverged. The scale is the kinetic and elastic
    energy at the start plus the weight times the system's size.
    """

    def __init__(
        self, assembly: Assembly, state: State, energy_limit: Any, baseline: Baseline | None = None
    ) -> None:
        self._model, self._state, self._energy_limit = assembly.model, state, energy_limit
        self.energy = 0.0
        """Kinetic and gravitational energy of the state read last, minus the work of loads [J]."""
        self.told = list[float]()
        """The latest numbers that were read."""
        self._sums = Sums(assembly, everything=False)
        self._work, self._most_work = assembly.external_work, 0.0  # work of loads is subtracted
        self.compare_with(baseline or Baseline.of(assembly, state))

    def compare_with(self, baseline: Baseline) -> None:
        """Compare energies with a baseline from now on."""
        self.baseline = baseline
        """The start of the run, which stays the reference when the number of substeps changes."""
        energy, scale = self.baseline
        with np.errstate(invalid="ignore"):  # 0 · inf, if there is no limit
            most = np.where(scale > 0, energy + self._energy_limit * scale, np.inf)
        self.most = most if self._model.in_worlds else float(most)
        """Kinetic and gravitational energy, less work, beyond which a world has diverged [J]."""

    def look(self, found: Found) -> None:
        """Launch the sums over the present state; it may be recorded."""
        state = self._state
        self._sums.launch(state.x, state.v, state.v, None, found.state_out)

    def finds_trouble(self, found: Found) -> bool:
        """Wait for the sums over the state of a single world, and return whether it has diverged."""
        self.told = told = found.read()
        self.energy, most = told[columns.KINETIC] + told[columns.POTENTIAL], self.most
        if self._work is not None:
            work = float(self._work.before[0]) + told[columns.WORK]
            self.energy -= work
            self._most_work = max(self._most_work, abs(work))
            most += self._most_work  # work is known only to first order in the step, even if it has returned
        return self._first < self._model.particle_count or not self.energy <= most

    @property
    def _first(self) -> int:
        """The first particle that is not finite; a larger number than any particle's if all are finite."""
        return -int(self.told[columns.FIRST])

    def worst_particle(self) -> int:
        """Return the first non-finite particle of the state read last, else the fastest."""
        if self._first < self._model.particle_count:
            return self._first
        return int(np.argmax(np.abs(self._state.v.numpy()).max(axis=1)))


class Backup:
    """Copies of the state at the start of a frame: all arrays of the state, those that effects change, and others.

    `kept` are vectors of particles, in the order of `live`. `changing` has pairs of an array and its copy, for the
    arrays that effects change and for `others`.
    """

    def __init__(self, assembly: Assembly, state: State, others: Sequence[wp.array] = ()) -> None:
        self._state = state
        here, live = state.state_in, self.live()
        together = state.empty_vectors(2 + len(here.method_state))
        self.kept = together + tuple(state.model.vectors() for _ in live[len(together) :])
        changing = [array for effect in assembly.all for array in effect.changing]
        self.changing = [(live, wp.clone(live)) for live in (*changing, *others)]

    def live(self) -> list[wp.array]:
        """Return the state's arrays, in the order of `kept`."""
        compensation = self._state.compensation.v
        return moving(self._state.state_in) + ([compensation] if compensation.size else [])

    def save(self) -> None:
        """Keep the present state."""
        copy_vectors(self.kept, self.live())
        for live, kept in self.changing:
            wp.copy(kept, live)

    def restore(self) -> None:
        """Go back to the state kept."""
        copy_vectors(self.live(), self.kept)
        for live, kept in self.changing:
            wp.copy(live, kept)
