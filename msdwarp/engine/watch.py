"""Watches a run: has it diverged? And keeps the state that it can go back to."""

from typing import NamedTuple, Self

import numpy as np
import warp as wp

from ..kernels.reductions import LOOKING_BLOCK, look_over, look_over_in_blocks
from .balance import rounding_energy, size, weight
from .contact import Contact
from .measures import measure
from .model import Model
from .state import State, copy_vectors, moving

MOST_BLOCKS = 512
"""Blocks of threads that look over the particles on a GPU: some for each multiprocessor."""


class Baseline(NamedTuple):
    """What the energy of a run is compared with."""

    energy: float
    """Energy at the start: kinetic, elastic, gravitational, and what effects store, less the work of loads [J]."""
    scale: float
    """Kinetic and elastic energy at the start, and the weight times the system's size [J]."""

    @classmethod
    def of(cls, model: Model, state: State) -> Self:
        """Return the baseline of a run that starts in this state."""
        start = measure(model, state)
        scale = start.kinetic_energy + start.elastic_energy + weight(model) * size(state)
        # What starts in an obstacle drags along what it is connected to.
        scale += sum(float(one.brings_in(model)[0]) for one in model.effects if isinstance(one, Contact))
        return cls(start.energy - start.external_work, scale + rounding_energy(model, state))


class Watch:
    """Looks at a state from the device, and costs one pass over the particles.

    Energy can only go from the start's kinetic, elastic and gravitational energy to others or to heat: kinetic
    and gravitational energy together may never exceed their sum, and the work of what acts from outside: loads,
    drives, obstacles that move. They are taken to have a source in the
    stepping if they do by `energy_limit` times the scale: kinetic and elastic energy at the start, and the
    weight times the system's size.
    """

    def __init__(self, model: Model, state: State, energy_limit: float, baseline: Baseline | None = None) -> None:
        self._model, self._state = model, state
        self._energy_limit = energy_limit
        self.energy = 0.0
        """Kinetic and gravitational energy of the state last found out about, less the work of loads [J]."""
        if model.device.is_cuda:
            blocks = min(-(-model.particle_count // LOOKING_BLOCK), MOST_BLOCKS)
            self._blocks = wp.zeros((blocks, 3), dtype=wp.float64, device=model.device)
            self._done = wp.zeros(1, dtype=int, device=model.device)
            # The GPU writes where the host reads: nothing needs to be copied.
            self._found = wp.zeros(3, dtype=wp.float64, device="cpu", pinned=True)
            self._seen = self._found.numpy()
            self._there = wp.array(ptr=self._found.ptr, dtype=wp.float64, shape=3, device=model.device)
        else:
            self._first = wp.empty(1, dtype=int, device=model.device)
            self._energies = wp.zeros((1, 2), dtype=wp.float64, device=model.device)
        self._work, self._most_work = model.work, 0.0
        if self._work is not None:  # what loads have done is no sign of divergence
            self._shares = self._work.shares()
            self._found_work = self._shares
            if model.device.is_cuda:
                self._found_work = wp.empty_like(self._shares, device="cpu", pinned=True)
        self.compare_with(baseline or Baseline.of(model, state))

    def compare_with(self, baseline: Baseline) -> None:
        """Compare energies with a baseline from now on."""
        self.baseline = baseline
        """The start of the run: it stays, though the number of substeps changes on the way."""
        energy, scale = self.baseline
        self._most = energy + self._energy_limit * scale if scale > 0 else np.inf

    def look(self) -> None:
        """Launch what finds out about the present state."""
        model, state = self._model, self._state
        inputs = [model.inverse_mass, model.gravity, state.x, state.v]
        if model.device.is_cuda:
            threads, inputs = LOOKING_BLOCK * len(self._blocks), [*inputs, self._blocks, self._done]
            kernel = look_over_in_blocks(model.dim, model.scalar)
            wp.launch(kernel, threads, inputs, [self._there], device=model.device, block_dim=LOOKING_BLOCK)
        else:
            self._first.fill_(model.particle_count)
            kernel, outputs = look_over(model.dim, model.scalar), [self._first, self._energies]
            wp.launch(kernel, 1, inputs, outputs, device=model.device)
        if self._work is not None:
            self._work.launch(state.x, state.v, self._shares)
            if model.device.is_cuda:
                wp.copy(self._found_work, self._shares)

    def finds_trouble(self) -> bool:
        """Tell whether the state last looked at has diverged."""
        kinetic, potential, first = self._look_up()
        self.energy = kinetic + potential
        most = self._most
        if self._work is not None:
            work = self._work.found(self._found_work)
            self.energy -= work
            self._most_work = max(self._most_work, abs(work))
            most += self._most_work  # work is known to first order in the step only, also what has come back
        return first < self._model.particle_count or not self.energy <= most

    def _look_up(self) -> tuple[float, float, int]:
        """Wait for what was launched last: kinetic and potential energy [J], the first particle not finite."""
        if self._model.device.is_cuda:
            wp.synchronize_stream(self._model.device.stream)
            kinetic, potential, first = self._seen
            return float(kinetic), float(potential), int(first)
        kinetic, potential = self._energies.numpy()[0]
        return float(kinetic), float(potential), int(self._first.numpy()[0])

    def culprit(self) -> int:
        """Return the first particle that is not finite, else the fastest."""
        _, _, first = self._look_up()
        if first < self._model.particle_count:
            return first
        return int(np.argmax(np.abs(self._state.v.numpy()).max(axis=1)))


class Backup:
    """The state at the start of a frame, with all that substeps leave to the next."""

    def __init__(self, state: State) -> None:
        self._state = state
        here, live = state.here, self.live()
        together = state.empty_vectors(2 + len(here.carried))
        self.kept = together + tuple(state.model.vectors() for _ in live[len(together) :])
        changing = (array for effect in state.model.effects for array in effect.changing)
        self._changing = [(live, wp.clone(live)) for live in changing]

    def live(self) -> list[wp.array]:
        """Return the arrays that are kept, in the order of `kept`."""
        lost = self._state.lost.v
        return moving(self._state.here) + ([lost] if lost.size else [])

    def save(self) -> None:
        """Keep the present state."""
        copy_vectors(self.kept, self.live())
        for live, kept in self._changing:
            wp.copy(kept, live)

    def restore(self) -> None:
        """Go back to the state kept."""
        copy_vectors(self.live(), self.kept)
        for live, kept in self._changing:
            wp.copy(live, kept)
