"""Sensing: what probes measure, summed on the device where a frame ends, or each of its substeps."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from ...kernels.integrators import force_on_each
from ...kernels.reductions import fold, probes, sum_of_group, sum_strain
from ...world import BODY_CONTACT_FORCE, CONTACT_FORCE, FORCE, POSITION, STRAIN, VELOCITY, Probe, probes_by
from ..collision.contact_forces import ContactForces
from ..model.model import Model
from ..model.state import State
from ..stepping.launcher import Dynamics
from .energies import FEW_EACH, MOST_THREADS, ROWS


class Sensors:
    """Measures what probes ask for: a few sums, launched as often as they are read in a frame.

    Parameters
    ----------
    dynamics, state
        The equation of motion of the system on its device, and what moves.
    asked_for
        The probes, by name.
    readings
        How often they are read in a frame.
    seconds
        Length of a frame [s].
    felt
        What sums the contact forces, where any probe asks for such.
    """

    def __init__(
        self,
        dynamics: Dynamics,
        state: State,
        requested: Mapping[str, Probe],
        readings: int,
        seconds: float,
        contact_forces: ContactForces | None,
    ) -> None:
        self._dynamics, self._state, model = dynamics, state, dynamics.model
        self._model, self._readings, self._seconds = model, readings, seconds / readings
        self._sums, first = list[_Sum](), 0
        for name, probe in requested.items():
            self._sums.append(_Sum(model, name, probe, first, dynamics.assembly.fracture is not None))
            first += self._sums[-1].width
        asked = {one.what for one in self._sums}
        self.moves = VELOCITY in asked or FORCE in asked
        """Whether it needs the velocities at the instant of the positions."""
        self._force = model.vectors() if FORCE in asked else None
        self._contact_forces = contact_forces if CONTACT_FORCE in asked or BODY_CONTACT_FORCE in asked else None
        on_gpu = model.device.is_cuda
        self._each = ROWS if on_gpu else 1
        self._rows = wp.zeros((readings * self._each, first), dtype=wp.float64, device=model.device)
        # What the host reads: on a GPU pinned, as what the watch has found is.
        self._found = wp.empty_like(self._rows, device="cpu", pinned=True) if on_gpu else self._rows

    def launch(self, v: wp.array, k: int = 0) -> None:
        """Launch the sums of reading number k of a frame; it may be recorded.

        Parameters
        ----------
        v
            Velocities at the instant of the positions [m/s]; not read unless `moves`.
        k
            Which reading it is, counted from 0.
        """
        now, rows = self._state.state_in, self._rows[k * self._each : (k + 1) * self._each]
        assert isinstance(rows, wp.array)
        if self._force is not None:
            self._dynamics.launch(force_on_each, compensation=now.compensation, x=now.x, v=v, force=self._force)
        pushed = {}
        if self._contact_forces is not None:
            pushed = {
                CONTACT_FORCE: self._contact_forces.by_all(),
                BODY_CONTACT_FORCE: self._contact_forces.by_bodies,
            }
        for one in self._sums:
            if one.what == STRAIN:
                one.launch_strain(now.x, now.compensation.x, rows)
                continue
            compensation = {POSITION: now.compensation.x, VELOCITY: now.compensation.v}.get(one.what)
            values = ({POSITION: now.x, VELOCITY: v, FORCE: self._force} | pushed)[one.what]
            one.launch(values, compensation, rows)
        if k == self._readings - 1 and self._found is not self._rows:
            wp.copy(self._found, self._rows)

    def read(self) -> dict[str, NDArray[np.float64]]:
        """Return the readings of the frame that was waited for, shape [readings, d], by the names of probes."""
        rows: Any = self._found.numpy().reshape(self._readings, self._each, -1)
        return {one.name: one.reading(rows, self._model, self._seconds) for one in self._sums}


class _Sum:
    """The sums of one probe, in columns from `first` on."""

    def __init__(self, model: Model, name: str, probe: Probe, first: int, tears: bool) -> None:
        self._tears, self.name, self.what, self._first, self._model = tears, name, probe.what, first, model
        self.width = probes.STRAIN_COLUMNS if self.what == STRAIN else model.dim
        if self.what == STRAIN:
            chosen = np.zeros(model.connection_count, dtype=bool)
            chosen[probe.connections(model.system)] = True
            member = np.flatnonzero(model.ordered(chosen))
        else:
            member = np.flatnonzero(probe.particles(model.system))
            weight, self._mass = _weights(self.what, model.mass[member])
            self._weight = wp.array(weight, dtype=wp.float64, device=model.device)
        self._member = wp.array(member, dtype=int, device=model.device)
        threads = min(max(len(member) // FEW_EACH, 1), MOST_THREADS) if model.device.is_cuda else 1
        self._shares = wp.zeros((threads, self.width), dtype=wp.float64, device=model.device)

    def launch(self, values: Any, compensation: Any, rows: wp.array) -> None:
        """Launch the sum over the group of what its particles have."""
        model = self._model
        compensated = model.compensated and compensation is not None
        kernel = sum_of_group(model.dim, values.dtype, compensated)
        inputs = [self._member, self._weight, values, compensation if compensated else values]
        wp.launch(kernel, len(self._shares), inputs, [self._shares], device=model.device)
        self._fold(rows, -1)

    def launch_strain(self, x: wp.array, x_lost: wp.array, rows: wp.array) -> None:
        """Launch the sum over the strains of connections."""
        model = self._model
        kernel = sum_strain(model.dim, model.scalar, model.compensated, self._tears)
        inputs = [self._member, model.connections, model.rest_length, model.stiffness, model.damping]
        inputs += [x, x_lost if model.compensated else x]
        wp.launch(kernel, len(self._shares), inputs, [self._shares], device=model.device)
        self._fold(rows, probes.LARGEST)

    def _fold(self, rows: wp.array, largest: int) -> None:
        threads = (rows.shape[0], self.width)
        wp.launch(fold, threads, [self._shares, largest, self._first], [rows], device=self._model.device)

    def reading(self, rows: NDArray[np.float64], model: Model, seconds: float) -> NDArray[np.float64]:
        """Return what the probe tells in each reading, `seconds` apart."""
        own = rows[:, :, self._first : self._first + self.width]
        total = own.sum(axis=1)
        if self.what == STRAIN:
            count = total[:, probes.COUNT]
            known = np.where(count > 0, count, np.nan)  # of nothing that holds still there is none
            largest = np.where(count > 0, own[:, :, probes.LARGEST].max(axis=1), np.nan)
            return np.stack([total[:, probes.SUM] / known, largest], axis=1)
        if self.what in (CONTACT_FORCE, BODY_CONTACT_FORCE):  # impulses are summed since the frame began
            return np.diff(total, axis=0, prepend=0.0) / seconds
        if self.what == FORCE:
            return total + self._mass * np.array(list(model.gravity), dtype=np.float64)
        return total


def _weights(what: str, mass: NDArray[np.float64]) -> tuple[NDArray[np.float64], float]:
    """Return what each particle of a group counts, and the mass of those that are free [kg]."""
    free = np.isfinite(mass)
    own = np.where(free, mass, 0.0)
    total = float(own.sum())
    if what in (FORCE, CONTACT_FORCE, BODY_CONTACT_FORCE):
        return np.ones(len(mass)), total
    return (own / total if free.any() else np.full(len(mass), 1.0 / len(mass))), total


def sensors_of(
    dynamics: Dynamics,
    state: State,
    every: str,
    readings: int,
    seconds: float,
    contact_forces: ContactForces | None,
) -> Sensors | None:
    """Return what measures for the probes of a model that are read every frame, or substep; None if it has none.

    Parameters
    ----------
    dynamics, state, readings, seconds, felt
        See `Sensors`.
    every
        "frame" or "substep".
    """
    requested = probes_by(every, dynamics.assembly.probes)
    return Sensors(dynamics, state, requested, readings, seconds, contact_forces) if requested else None
