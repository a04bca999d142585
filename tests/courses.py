"""Scenes just before their first contact, and how they go on by each algorithm and method."""

import functools
import importlib

import numpy as np

from msdwarp import Integrator, Plane, Scene, Simulation, stability_limit

SCENES = {"cube": {"size": 4}, "cloth": {"size": 7}, "worm": {"length": 6}}
"""What makes each scene small."""


@functools.cache
def moment(name: str) -> Scene:
    """Return a scene as it is just before its first contact, small.

    What has just met the ground has not yet forgotten how: the first body to buckle or tumble does so long after.
    The cloth, which hangs free, has the ground put under its lowest edge.
    """
    scene = importlib.import_module(f"msdwarp.scenes.{name}").build(**SCENES[name])
    colliders = scene.colliders or [Plane(offset=scene.system.position[:, 2].min() - 1e-3, friction=0.3)]
    options = {
        "colliders": colliders,
        "fps": 240,
        "device": "cpu",
        "precision": "float64",
        "force_algorithm": "scatter",
    }
    simulation = Simulation(scene.system, **options)
    before = scene.system
    for _ in range(240):
        if simulation.frame().position[:, 2].min() <= colliders[0].offset:
            return Scene(system=before, colliders=colliders)
        before = simulation.snapshot()
        simulation.step()
    raise AssertionError(f"the {name} meets no ground within a second")


def course(
    scene: Scene, method: Integrator, device: str, *, precision: str = "float64", force_algorithm: str, **options
) -> tuple[np.ndarray, np.ndarray]:
    """Return (positions, velocities) after each of four frames, by default of 25 substeps at half the limit."""
    simulation = Simulation(
        scene.system,
        colliders=scene.colliders,
        integrator=method,
        device=device,
        precision=precision,
        force_algorithm=force_algorithm,
        **({"fps": 1 / (25 * half_the_limit(scene, method)), "substeps": 25} | options),
    )
    position, velocity = [], []
    for _ in range(4):
        simulation.step()
        _, x, v = simulation.frame()
        position.append(x)
        velocity.append(v)
    assert simulation.model.force_algorithm == force_algorithm
    return np.array(position), np.array(velocity)


def half_the_limit(scene: Scene, method: Integrator) -> float:
    """Return half of the longest substep that is stable [s]."""
    return stability_limit(scene.system, method) / 2


def assert_same(a: tuple, b: tuple) -> None:
    """Compare courses bit for bit."""
    for one, other in zip(a, b, strict=True):
        np.testing.assert_array_equal(one, other)


def assert_alike(a: tuple, b: tuple, scene: Scene, method: Integrator) -> None:
    """Compare courses in float64 by two kernels of the same pieces, to roundings in 32 substeps at most.

    Compiled apart, one may round a product and a sum at once where the other does not. Room as for algorithms.
    """
    atol = 1e-12 * np.ptp(scene.system.position, axis=0).max()
    for one, other, bound in zip(a, b, (atol, atol / half_the_limit(scene, method)), strict=True):
        np.testing.assert_allclose(one, other, rtol=0, atol=bound)


@functools.cache
def plain_course(name: str, method: Integrator) -> tuple[np.ndarray, np.ndarray]:
    """Return the course of a scene by scattering on the CPU in float64."""
    return course(moment(name), method, "cpu", force_algorithm="scatter")


def assert_course_is_plain(name: str, method: Integrator, found: tuple, share: float) -> None:
    """Compare positions with the plain course's to a share of the body's size, velocities to it in a substep."""
    (x, v), (plain_x, plain_v), scene = found, plain_course(name, method), moment(name)
    atol = share * np.ptp(scene.system.position, axis=0).max()
    np.testing.assert_allclose(x, plain_x, rtol=0, atol=atol)
    np.testing.assert_allclose(v, plain_v, rtol=0, atol=atol / half_the_limit(scene, method))
    # Contact puts what it stops onto the plane; by explicit Euler what bounces stays where its substep began.
    assert plain_x[..., 2].min() < scene.colliders[0].offset + 0.02 * np.ptp(scene.system.position, axis=0).max()
    assert np.abs(plain_x[-1] - scene.system.position).max() > 1000 * atol  # far more than they may differ by
