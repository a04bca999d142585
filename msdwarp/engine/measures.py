"""Measures: energies, momentum and strain of a state, summed on its device in float64."""

from typing import Any, NamedTuple

import numpy as np
import warp as wp
from numpy.typing import NDArray

from ..kernels.reductions import measure as columns
from ..kernels.reductions import strain_each, sum_connections, sum_particles
from .model import Model
from .state import State


class Measures(NamedTuple):
    """What a state holds. Pinned particles count for nothing."""

    kinetic_energy: float
    """Σ m v²/2 [J]."""
    elastic_energy: float
    """Σ k (l − l0)²/2 [J]."""
    gravitational_energy: float
    """−Σ m g·x [J]."""
    dissipated_power: float
    """Σ b l'² or by another law, what the dampers turn to heat [W]."""
    momentum: NDArray[np.float64]
    """Σ m v [kg m/s], shape [d]."""
    angular_momentum: NDArray[np.float64]
    """Σ m x × v about the origin [kg m²/s], shape [3] in three dimensions, [1] in two, [0] in one."""
    largest_strain: float
    """Largest |l / l0 − 1|."""

    effect_energy: float = 0.0
    """What other effects store, such as loads that have a potential [J]."""

    @property
    def energy(self) -> float:
        """Kinetic, elastic, gravitational and other stored energy together [J]."""
        return self.kinetic_energy + self.elastic_energy + self.gravitational_energy + self.effect_energy


def measure(
    model: Model, state: State, velocity: wp.array | None = None, x_lost: wp.array | None = None
) -> Measures:
    """Return the measures of a state.

    Parameters
    ----------
    model, state
        The system on a device.
    velocity
        Velocities at the instant of the positions; by default the state's own.
    x_lost
        What the positions have lost by rounding, in compensated precision.
    """
    v = state.v if velocity is None else velocity
    particles = particle_sums(model, state.x, v)
    connections = connection_sums(model, state.x, v, x_lost)
    turning = {3: slice(0, 3), 2: slice(2, 3), 1: slice(0, 0)}[model.dim]
    return Measures(
        float(particles[columns.KINETIC]),
        float(connections[columns.ELASTIC]),
        float(particles[columns.POTENTIAL]),
        float(connections[columns.DISSIPATED]) + sum(one.dissipated_power(state.x, v) for one in model.effects),
        particles[columns.MOMENTUM :][: model.dim],
        particles[columns.ANGULAR_MOMENTUM :][turning],
        float(connections[columns.STRAIN]),
        sum(one.energy(state.x) for one in model.effects),
    )


def particle_sums(model: Model, x: wp.array, v: wp.array) -> NDArray[np.float64]:
    """Return the sums over particles in the columns of `msdwarp.kernels.reductions.measure`."""
    shares = _shares(model, model.particle_count, columns.PARTICLE_COLUMNS)
    _launch(sum_particles(model.dim, model.scalar), [model.inverse_mass, model.gravity, x, v], shares, model)
    return shares.numpy().sum(axis=0)


def connection_sums(model: Model, x: wp.array, v: wp.array, x_lost: wp.array | None = None) -> NDArray[np.float64]:
    """Return the sums over connections, and the largest strain, in the columns of the same."""
    if not model.connection_count:
        return np.zeros(columns.CONNECTION_COLUMNS)
    compensated = model.compensated and x_lost is not None
    constants = [model.connections, model.rest_length, model.stiffness, model.damping]
    shares = _shares(model, model.connection_count, columns.CONNECTION_COLUMNS)
    kernel = sum_connections(model.dim, model.scalar, compensated, model.system.damper.law)
    _launch(kernel, [*constants, x, v, x_lost if compensated else x], shares, model)
    parts = shares.numpy()
    return np.append(parts[:, : columns.STRAIN].sum(axis=0), parts[:, columns.STRAIN].max())


def write_strain(model: Model, state: State, place: wp.array | None, strain: wp.array) -> None:
    """Write each connection's strain, length / rest length − 1, computed in float64, shape [connection_count].

    `place` says where that of each connection on the device goes; None where the order is the system's.
    """
    kernel = strain_each(model.dim, model.scalar, model.compensated, place is not None)
    inputs = [model.connections, model.rest_length, place, state.x, state.lost.x]
    wp.launch(kernel, model.connection_count, inputs, [strain], device=model.device)


def _shares(model: Model, count: int, width: int) -> wp.array:
    """Return the place for the shares of a sum over `count` things: enough threads to fill a GPU, or one."""
    threads = min(count, 16384) if model.device.is_cuda else 1
    return wp.zeros((threads, width), dtype=wp.float64, device=model.device)


def _launch(kernel: Any, inputs: list, shares: wp.array, model: Model) -> None:
    wp.launch(kernel, dim=shares.shape[0], inputs=inputs, outputs=[shares], device=model.device)
