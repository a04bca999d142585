"""The report's own rule: its Algorithm 1, whatever starts inside an obstacle."""

import numpy as np
import pytest
from problems import EPS64

from msdwarp import Ensemble, Leapfrog, Plane, Simulation, StartWarning, System, box

FPS, SUBSTEPS, G = 60, 60, 9.82
FLOOR = Plane(tangential_factor=0.9, restitution=0.5)
OFF = 600 * 26 * 30 * EPS64
"""Rounding of sums of up to 26 forces of 1e5 N on 1 kg in another order, in 600 substeps: each h a is 30 m/s."""


def inside(shape: tuple[int, ...], depth: float, stiffness: float, damping: float) -> System:
    """Return a body whose lowest particles start so deep in the ground [m]."""
    return box(shape, 1.0, mass=1.0, stiffness=stiffness, damping=damping).translate(
        (0, 0, 0.5 * (shape[2] - 1) - depth)
    )


SNAKE = inside((40, 2, 2), 0.5, 1e5, 20.0)
WAFFLE = inside((10, 8, 2), 0.1, 5000.0, 70.0)


def algorithm_1(system: System, substeps: int) -> tuple[np.ndarray, np.ndarray]:
    """Return positions [m] and velocities [m/s] after symplectic Euler and Algorithm 1 on the plane z = 0."""
    x, v, h = np.array(system.position), np.array(system.velocity), 1.0 / (FPS * SUBSTEPS)
    (i, j), k, b = system.connections.T, system.stiffness[:, None], system.damping[:, None]
    for _ in range(substeps):
        way = x[j] - x[i]
        length = np.linalg.norm(way, axis=1, keepdims=True)
        along = way / length
        speed = ((v[j] - v[i]) * along).sum(axis=1, keepdims=True)
        force = (k * (length - system.rest_length[:, None]) + b * speed) * along
        total = np.zeros_like(x)
        np.add.at(total, i, force)
        np.add.at(total, j, -force)
        v += h * (total / system.mass[:, None] - [0, 0, G])
        x += h * v
        below = x[:, 2] < 0
        x[below, 2] = 0
        v[below] *= [FLOOR.tangential_factor, FLOOR.tangential_factor, -FLOOR.restitution]
    return x, v


def simulated(system: System, *, substeps: int | str = SUBSTEPS, **more) -> Simulation:
    options = {
        "colliders": [FLOOR],
        "collider_rule": "report",
        "precision": "float64",
        "device": "cpu",
        "fps": FPS,
    }
    with pytest.warns(StartWarning, match=r"inside colliders\[\d\].*put onto the surface at once"):
        return Simulation(system, **{"gravity": G, "substeps": substeps} | options | more)


@pytest.mark.parametrize("system", [SNAKE, WAFFLE], ids=["snake", "waffle"])
def test_what_starts_inside_is_put_on_the_surface_at_once(device, system):
    simulation = simulated(system, device=device)
    simulation.step(10)
    x, v = algorithm_1(system, 10 * SUBSTEPS)
    np.testing.assert_allclose(simulation.frame().velocity, v, rtol=0, atol=OFF)
    # Positions are off by that for the 10 frames of the run.
    np.testing.assert_allclose(simulation.frame().position, x, rtol=0, atol=OFF * 10 / FPS)
    assert x[:, 2].min() >= 0


@pytest.mark.parametrize(("system", "method"), [(SNAKE, None), (WAFFLE, Leapfrog())], ids=["snake", "waffle"])
def test_what_that_brings_in_is_no_divergence(system, method):
    # Half of a snake's height in the ground is 0.9 MJ, where its weight over its length is 61 kJ.
    simulation = simulated(system, substeps="auto", integrator=method)
    simulation.step(60)
    assert np.isfinite(simulation.frame().position).all()


@pytest.mark.slow
def test_worlds_of_an_ensemble_do_so_too():
    how = {"collider_rule": "report", "precision": "float64", "substeps": SUBSTEPS, "device": "cpu"}
    ensemble = Ensemble(SNAKE, 2, stiffness=[1e5, 9e4], colliders=[FLOOR], gravity=G, **how)
    ensemble.step(10)
    x, _ = algorithm_1(SNAKE.replace(stiffness=9e4), 10 * SUBSTEPS)
    np.testing.assert_allclose(ensemble.frame().position[1], x, rtol=0, atol=OFF * 10 / FPS)


def test_what_starts_outside_is_told_nothing():
    Simulation(SNAKE.translate((0, 0, 0.5)), colliders=[FLOOR], collider_rule="report", device="cpu")
