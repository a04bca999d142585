"""Worlds of an ensemble beside simulations of each alone."""

from unittest import mock

import numpy as np

from msdwarp import Ensemble, Simulation
from msdwarp.engine.springs import force_algorithms as forces


def one_lane():
    """Have simulations that are made or restored meanwhile use one thread to a particle, as worlds do.

    On a GPU small bodies have several, and so another order of sums.
    """
    return mock.patch.object(forces, "lanes", return_value=1)


def simulation_alone(ensemble: Ensemble, world: int, **how) -> Simulation:
    """Return `ensemble.simulation_of(world)` with one thread to a particle."""
    with one_lane():
        return ensemble.simulation_of(world, **how)


def assert_each_is_as_alone(ensemble: Ensemble, frames: int = 20) -> None:
    """Compare positions and velocities with those of simulations of each world, to the last bit.

    On a GPU the compiler may round sums of a lattice otherwise where worlds have numbers of their
    own: by one unit in each substep, of which there are some hundred, and the motion makes that a few times more.
    """
    by_rounding = ensemble.model.device.is_cuda and ensemble.model.force_algorithm == "stencil"
    atol = 1000 * float(np.finfo(ensemble.model.dtype).eps) if by_rounding else 0.0
    ensemble.step(frames)
    _, position, velocity = ensemble.frame()
    assert (ensemble.status == "running").all()
    for world in range(ensemble.worlds):
        alone = simulation_alone(ensemble, world)
        alone.step(frames)
        frame = alone.frame()
        assert np.isfinite(frame.position).all()
        np.testing.assert_allclose(position[world], frame.position, rtol=0, atol=atol)
        np.testing.assert_allclose(velocity[world], frame.velocity, rtol=0, atol=10 * atol)
