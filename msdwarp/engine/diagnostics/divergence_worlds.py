"""Watches all worlds of an ensemble: what has diverged is put back to the frame's start, and stays there."""

from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from ...kernels.reductions import judge, look_over_worlds, next_frame, put_back, put_parts_back
from ..model.state import State
from ..stepping.launcher import Dynamics
from .divergence import Backup
from .world_sums import WorldEnergies, lanes

ROUNDED = 1e3
"""Energy that rounding may make of nothing, over that of one substep: errors of many add up."""


class EnsembleDivergenceMonitor:
    """Looks at all worlds where a frame ends, from the device alone.

    What counts as diverged is what `DivergenceMonitor` says of a single run, for each world by its own energy at
    the start.

    Parameters
    ----------
    dynamics, state
        What it watches; velocities are still at the instant of the positions.
    energy_limit
        Multiples of the scale by which the energy of each world may grow, shape [worlds].
    """

    def __init__(self, dynamics: Dynamics, state: State, energy_limit: NDArray[np.float64]) -> None:
        model, contact = dynamics.model, dynamics.assembly.body_contact
        self._model = model
        self._dynamics, self._state, self.backup = dynamics, state, Backup(dynamics.assembly, state)
        shape = (model.worlds, lanes(model))
        self._first = wp.empty(shape, dtype=int, device=model.device)
        wide: Any = wp.float64
        self._energies = wp.empty((*shape, 2), dtype=wide, device=model.device)
        self._constants = [model.upload_inverse_mass(), model.upload_gravity()]
        self._work = dynamics.assembly.external_work
        self._shares = wp.zeros(0, dtype=wp.float64, device=model.device)
        if self._work is not None:
            self._shares = self._work.shares()
        before = np.zeros(model.worlds) if self._work is None else self._work.before
        self._before = wp.array(before, dtype=wp.float64, device=model.device)
        self._most_work = wp.zeros(model.worlds, dtype=wp.float64, device=model.device)
        self._frame = wp.zeros(1, dtype=int, device=model.device)
        self._found = wp.full((2, model.worlds), -1, dtype=int, device=model.device)
        # What a frame that must be repeated takes back, beside the state.
        own = [dynamics.frozen, self._found, self._frame, self._most_work] if contact is not None else []
        self._kept = [(array, wp.clone(array)) for array in own]
        # What effects change in frozen worlds is put back; contact between bodies is one world's alone.
        each = (one for one in dynamics.assembly.all if one.by_world and one is not contact)
        changing = {id(array) for one in each for array in one.changing}
        self._parts = [
            (_bytes_of(live), _bytes_of(kept)) for live, kept in self.backup.changing if id(live) in changing
        ]
        self.energy, self.scale = baselines(dynamics, state)
        """Of each world at its start; see `Baseline`."""
        with np.errstate(invalid="ignore"):  # 0 · inf, where nothing is to be limited
            most = np.where(self.scale > 0, self.energy + energy_limit * self.scale, np.inf)
        self._most = wp.array(
            np.nan_to_num(most, nan=np.inf, posinf=np.inf), dtype=wp.float64, device=model.device
        )

    def begin(self) -> None:
        """Launch what is done where a frame begins."""
        self.backup.save()
        for live, kept in self._kept:
            wp.copy(kept, live)

    def go_back(self) -> None:
        """Bring all worlds back to where the last frame began, to repeat it."""
        self.backup.restore()
        for live, kept in self._kept:
            wp.copy(live, kept)

    def end(self) -> None:
        """Launch what is done where a frame ends."""
        model, state, frozen = self._model, self._state, self._dynamics.frozen
        if self._work is not None:
            self._work.launch(state.x, state.v, self._shares)
        inputs = [*self._constants, state.x, state.v, model.stride]
        outputs = [self._first, self._energies]
        wp.launch(
            look_over_worlds(model.dim, model.scalar), self._first.shape, inputs, outputs, device=model.device
        )
        inputs = [self._first, self._energies, self._shares, self._before, self._most, model.particle_count]
        inputs += [self._frame, frozen, self._found, self._most_work]
        wp.launch(judge, model.worlds, inputs, device=model.device)
        for live, kept in zip(self.backup.live(), self.backup.kept, strict=True):
            shape = (model.worlds, model.particle_count)
            inputs = [frozen, model.stride, kept]
            wp.launch(put_back(model.dim, model.scalar), shape, inputs, [live], device=model.device)
        for live, kept in self._parts:
            wp.launch(put_parts_back, len(live), [frozen, kept], [live], device=model.device)
        wp.launch(next_frame, 1, [self._frame], device=model.device)

    def found(self) -> tuple[NDArray[np.int32], NDArray[np.int32], NDArray[np.int32]]:
        """Return what has become of each world, in which frame (−1: none), and first at which particle.

        The particle is −1 where all numbers are finite.
        """
        frame, particle = self._found.numpy().astype(np.int32)
        status = self._dynamics.frozen.numpy().astype(np.int32)
        return status, frame, np.where(particle < self._model.particle_count, particle, -1)


def baselines(dynamics: Dynamics, state: State) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the energy of each world, and the scale of its growth, as `Baseline.of` does [J]."""
    model = dynamics.model
    kinetic, elastic, gravitational = (
        WorldEnergies(dynamics.assembly).read(state.x, state.v, state.compensation.x).T
    )
    mass = model.row_of("mass")
    free = np.where(np.isfinite(mass), mass, 0.0).sum(axis=1)
    weight = _each(free, model.worlds) * _each(np.linalg.norm(model.row_of("gravity"), axis=1), model.worlds)
    places = model.row_of("position")
    size = np.ptp(places, axis=1).max(axis=1)
    off = np.finfo(model.dtype).eps * np.abs(places).max(axis=(1, 2))
    stiffness = _each(model.row_of("stiffness").sum(axis=1), model.worlds)
    rounding = ROUNDED * stiffness * _each(off, model.worlds) ** 2
    scale = kinetic + elastic + weight * _each(np.where(size > 0, size, 1.0), model.worlds) + rounding
    if dynamics.assembly.colliders is not None:
        scale += _each(dynamics.assembly.colliders.brings_in(model), model.worlds)
    energy = kinetic + elastic + gravitational
    for effect in dynamics.assembly.all:
        energy = energy + effect.energies(state.x, state.v)
    if dynamics.assembly.external_work is not None:
        energy = energy - dynamics.assembly.external_work.totals(state.x, state.v)
    return energy, scale


def _each(rows: NDArray[np.float64], worlds: int) -> NDArray[np.float64]:
    """Return the number of each world."""
    return rows[np.arange(worlds) % len(rows)]


def _bytes_of(array: wp.array) -> wp.array:
    """Return a view of an array's bytes."""
    count = array.size * wp.types.type_size_in_bytes(array.dtype)
    view = wp.array(ptr=array.ptr, dtype=wp.uint8, shape=count, device=array.device)
    view._ref = array  # a view does not own its memory
    return view
