"""Watches a run: has it diverged, and if so where, when and why."""

import numpy as np
import warp as wp
from numpy.typing import NDArray

from .kernels.watch import look_over
from .measure import measure
from .model import Model, State, copy_vectors, moving
from .system import System

MOST_SHARES = 16384
"""Threads that look over the particles on a GPU: enough to be done soon, few enough to be added up soon."""


class SimulationDiverged(RuntimeError):
    """The run cannot go on: a number is no longer finite, or energy has grown that has no source."""

    def __init__(
        self,
        message: str,
        *,
        time: float,
        substep: int,
        particle: int,
        connection: int | None,
        strain: float,
        substeps_needed: int,
    ) -> None:
        super().__init__(message)
        self.time = time
        """When it happened [s]."""
        self.substep = substep
        """The substep of its frame, from 1."""
        self.particle = particle
        """The first particle concerned."""
        self.connection = connection
        """Its most strained connection just before, if it has any."""
        self.strain = strain
        """The strain of that connection."""
        self.substeps_needed = substeps_needed
        """Substeps per frame that are stable for the last good frame; 0 where none are."""


class Watch:
    """Looks at a state from the device, and costs one pass over the particles.

    Energy can only go from the start's kinetic, elastic and gravitational energy to others or to heat: kinetic
    and gravitational energy together may never exceed their sum. They are taken to have a source in the
    stepping if they do by `energy_limit` times the scale: kinetic and elastic energy at the start, and the
    weight times the system's size.
    """

    def __init__(self, model: Model, state: State, energy_limit: float) -> None:
        self._model, self._state = model, state
        self._look_over = look_over(model.dim, model.scalar)
        self._first = wp.empty(1, dtype=int, device=model.device)
        threads = min(model.particle_count, MOST_SHARES) if model.device.is_cuda else 1
        self._energies = wp.zeros((threads, 2), dtype=wp.float64, device=model.device)
        # What the host reads: on a GPU pinned, so that reading waits for nothing but the look itself.
        self._found = [self._first, self._energies]
        if model.device.is_cuda:
            self._found = [wp.empty_like(array, device="cpu", pinned=True) for array in self._found]
        start = measure(model, state)
        scale = start.kinetic_energy + start.elastic_energy + _weight(model) * _size(state)
        scale += _rounding_energy(model, state)
        self._most = start.energy + energy_limit * scale if scale > 0 else np.inf
        if model.surroundings.moving:  # what moves works on what it touches
            self._most = np.inf

    def look(self) -> None:
        """Launch what finds out about the present state."""
        model, state = self._model, self._state
        self._first.fill_(model.particle_count)
        inputs = [model.inverse_mass, model.gravity, state.x, state.v]
        threads, outputs = len(self._energies), [self._first, self._energies]
        wp.launch(self._look_over, threads, inputs, outputs, device=model.device)
        if model.device.is_cuda:
            for there, here in zip(self._found, outputs, strict=True):
                wp.copy(there, here)

    def finds_trouble(self) -> bool:
        """Tell whether the state last looked at has diverged."""
        if self._model.device.is_cuda:
            wp.synchronize_stream(self._model.device.stream)
        first, energies = (array.numpy() for array in self._found)
        return int(first[0]) < self._model.particle_count or not energies.sum() <= self._most

    def culprit(self) -> int:
        """Return the first particle that is not finite, else the fastest."""
        first = int(self._first.numpy()[0])
        if first < self._model.particle_count:
            return first
        return int(np.argmax(np.abs(self._state.v.numpy()).max(axis=1)))


class Backup:
    """The state at the start of a frame, with all that substeps leave to the next."""

    def __init__(self, state: State) -> None:
        self._state = state
        self._kept = state.empty_vectors(len(self._live()))
        model = state.model
        self._yielded = [(model.rest_length, wp.clone(model.rest_length))] if model.yields else []

    def _live(self) -> list[wp.array]:
        lost = self._state.lost.v
        return moving(self._state.here) + ([lost] if lost.size else [])

    def save(self) -> None:
        """Keep the present state."""
        for live, kept in zip(self._live(), self._kept, strict=True):
            copy_vectors(kept, live)
        for live, kept in self._yielded:
            wp.copy(kept, live)

    def restore(self) -> None:
        """Go back to the state kept."""
        for live, kept in zip(self._live(), self._kept, strict=True):
            copy_vectors(live, kept)
        for live, kept in self._yielded:
            wp.copy(live, kept)


def describe(
    system: System,
    position: NDArray,
    time: float,
    dt: float,
    substep: int,
    substeps: int,
    particle: int,
    needed: int,
) -> SimulationDiverged:
    """Return the exception for a frame that began at `time` and was last good at `position`."""
    connection, strain, stretched = None, float("nan"), ""
    mine = np.flatnonzero((system.connections == particle).any(axis=1))
    if len(mine):
        i, j = system.connections[mine].T
        with np.errstate(over="ignore", invalid="ignore"):  # what diverges may be large beyond all numbers
            length = np.linalg.norm(position[i].astype(np.float64) - position[j], axis=1)
            strains = length / system.rest_length[mine] - 1
        worst = int(np.argmax(np.abs(strains)))
        connection, strain = int(mine[worst]), float(strains[worst])
        stretched = f", whose connection {connection} was at strain {strain:.3g} before"
    advice = f"at least {needed} substeps a frame are stable there" if needed else "no step is stable here"
    if 0 < needed <= substeps:
        advice += f", so strong stretching must have come on within the frame: try {2 * substeps}"
    when = time + substep * dt
    return SimulationDiverged(
        f"diverged at {when:.4g} s, in substep {substep} of {substeps}, first at particle {particle}{stretched}; "
        f"{advice}. The last good frame, at {time:.4g} s, is kept",
        time=when,
        substep=substep,
        particle=particle,
        connection=connection,
        strain=strain,
        substeps_needed=needed,
    )


def _weight(model: Model) -> float:
    """Return the weight of all that is not pinned [N]."""
    mass = model.system.mass
    one = mass[:1] if mass.strides == (0,) else mass
    share = len(mass) / len(one)  # how often a mass stands for itself
    g = np.linalg.norm(np.array(list(model.gravity), dtype=np.float64))
    return float(one[np.isfinite(one)].sum() * share * g)


def _size(state: State) -> float:
    """Return the largest extent of a system [m], at least a metre for a single particle."""
    return float(np.ptp(state.x.numpy(), axis=0).max()) or 1.0


def _rounding_energy(model: Model, state: State) -> float:
    """Return what rounding may make of nothing [J]: every spring stretched by the rounding of its ends' places.

    A thousand times that, since rounding errors of many substeps add up.
    """
    off = float(np.finfo(model.dtype).eps) * float(np.abs(state.x.numpy()).max())
    stiffness = model.system.stiffness
    constant = len(stiffness) and stiffness.strides == (0,)
    total = len(stiffness) * float(stiffness[0]) if constant else float(stiffness.sum())
    return 1e3 * total * off**2
