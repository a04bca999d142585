"""Sums over each world of an ensemble, on the device: means over groups, energies, and how fast it can move."""

from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from ...kernels.reductions import (
    ENERGY_COLUMNS,
    Weighed,
    add_blocks_of_worlds,
    mean_over_group,
    moving,
    raise_bounds_of_worlds,
    sum_energies,
    sum_lanes,
)
from ..model.model import Model
from ..model.state import State
from ..stepping.assemble import Assembly
from ..stepping.start_checks import starting_state
from .rate_bounds import acts_on_rates, add_effects

LANES = 32
"""Threads that share the sums of a world on a GPU."""


def lanes(model: Model) -> int:
    """Return how many threads share the sums of a world."""
    return LANES if model.device.is_cuda else 1


class WorldEnergies:
    """Sums the energies of all worlds."""

    def __init__(self, assembly: Assembly) -> None:
        model = self._model = assembly.model
        self._constants = [model.upload_rows(model.row_of(name)) for name in ("rest_length", "stiffness")]
        shape = model.worlds, model.connection_count
        if assembly.plasticity is not None:
            self._constants[0] = assembly.plasticity.rest_length.reshape(shape)
        if assembly.fracture is not None:
            self._constants[1] = assembly.fracture.data.stiffness.reshape(shape)

    def read(self, x: wp.array, v: wp.array, x_lost: wp.array) -> NDArray[np.float64]:
        """Return kinetic, elastic and gravitational energies [J], shape [worlds, 3]."""
        model = self._model
        kernel = sum_energies(model.dim, model.scalar, model.compensated)
        constants = [
            model.upload_inverse_mass(),
            model.upload_gravity(),
            model.connections,
            *self._constants,
        ]
        if model.order is not None:  # that of the device is another order
            constants[2] = wp.array(model.system.connections, dtype=wp.vec2i, device=model.device)
        return _summed(model, kernel, [*constants, x, v, x_lost, model.stride], ENERGY_COLUMNS)


class GroupMeans:
    """The mean of something over a group of particles, in each world.

    Parameters
    ----------
    model
        The worlds.
    what
        "position" [m] or "velocity" [m/s], weighted by the mass of what is free as `Probe` says; or a wp.func
        (x, v, i) of a particle's position, velocity (vectors of float64) and number, all particles counting alike.
    chosen
        The particles of the group, shape [particle_count].
    width
        How many numbers the function returns as a vector of float64; 0 where it returns one number.
    """

    def __init__(self, model: Model, what: Any, chosen: NDArray[np.bool_], width: int = 0) -> None:
        self._model = model
        member = np.flatnonzero(chosen)
        if isinstance(what, str):
            self._weighed, weight = moving(model.dim, what), _shares_of_mass(model.row_of("mass")[:, member])
        else:
            self._weighed, weight = Weighed(what, width), np.full((1, len(member)), 1.0 / len(member))
        self._member = wp.array(member, dtype=int, device=model.device)
        self._weight = wp.array(weight, dtype=wp.float64, device=model.device)

    def read(self, state: State, v: wp.array) -> NDArray[np.float64]:
        """Return the means, shape [worlds, columns]; v are velocities at the instant of the positions [m/s]."""
        model, compensation = self._model, state.compensation
        kernel = mean_over_group(model.dim, model.scalar, model.compensated, self._weighed)
        inputs = [self._member, self._weight, state.x, v, compensation.x, compensation.v, model.stride]
        return _summed(model, kernel, inputs, max(self._weighed.width, 1))


def _shares_of_mass(mass: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return what each particle of a group counts; pinned ones count where there are no others."""
    free = np.where(np.isfinite(mass), mass, 0.0)
    total = free.sum(axis=1, keepdims=True)
    return np.where(total > 0, free / np.where(total > 0, total, 1.0), 1.0 / mass.shape[1])


def _summed(model: Model, kernel: Any, inputs: list, columns: int) -> NDArray[np.float64]:
    """Return what a kernel sums by lanes, shape [worlds, columns]."""
    wide: Any = wp.float64
    shares = wp.empty((model.worlds, lanes(model), columns), dtype=wide, device=model.device)
    sums = wp.empty((model.worlds, columns), dtype=wide, device=model.device)
    wp.launch(kernel, shares.shape[:2], inputs, [shares], device=model.device)
    wp.launch(sum_lanes, sums.shape, [shares], [sums], device=model.device)
    return sums.numpy().astype(np.float64)


def _add_effects(assembly: Assembly, state: State, blocks: list[wp.array]) -> None:
    """Add what effects hold particles with in each world, but for contact between bodies."""
    model = assembly.model
    others = [one for one in assembly.all if one is not assembly.body_contact]
    if not acts_on_rates(others):
        return
    for world in range(model.different):
        here = slice(world * model.stride, world * model.stride + model.particle_count)
        x: Any = state.x[here]
        v: Any = state.v[here]
        own: list[Any] = [one[world] for one in blocks]
        add_effects(model, others, x, v, own, world)


def world_rates(assembly: Assembly) -> NDArray[np.float64]:
    """Return the bounds of M⁻¹K [1/s²] and M⁻¹B [1/s] of the worlds that differ, shape [model.different, 2].

    They are those of `rate_bounds` for each alone, as it starts.
    """
    model, contact = assembly.model, assembly.body_contact
    if not model.connection_count and not assembly.all:
        return np.zeros((model.different, 2))
    rows = {name: model.row_of(name) for name in ("rest_length", "stiffness", "damping")}
    rows["damping"] = model.system.damper.steepest * rows["damping"]
    if model.system.tears:
        whole = ~model.system.broken
        rows |= {name: np.where(whole, rows[name], 0.0) for name in ("stiffness", "damping")}
    arrays = [model.upload_rows(values) for values in rows.values()]
    connections = wp.array(model.system.connections, dtype=wp.vec2i, device=model.device)
    kinds, count = (model.dim, model.scalar), model.particle_count
    Block = wp.types.matrix((model.dim, model.dim), wp.float64)
    shape = (model.different, count)
    blocks = [wp.zeros(shape, dtype=Block, device=model.device) for _ in range(2)]
    threads = (model.different, model.connection_count)
    inputs, start = [connections, *arrays], starting_state(model.system, assembly, 0, 0.0, 60.0)
    kernel = add_blocks_of_worlds(*kinds)
    wp.launch(kernel, threads, [*inputs, start.x, model.stride], blocks, device=model.device)
    _add_effects(assembly, start, blocks)
    if contact is not None:
        for block, each in zip(blocks, contact.blocks_of(model.different), strict=True):
            block.assign(block.numpy() + each[..., None, None] * np.eye(model.dim))
    bounds = wp.zeros((model.different, 2), dtype=wp.float64, device=model.device)
    wp.launch(
        raise_bounds_of_worlds(*kinds),
        shape,
        [model.upload_inverse_mass(), *blocks],
        [bounds],
        device=model.device,
    )
    return bounds.numpy().astype(np.float64)
