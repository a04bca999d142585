"""Loads of all kinds side by side: by every algorithm, their work, and runs that resume."""

from typing import Any

import numpy as np
import pytest
import warp as wp
from problems import drifts

from msdwarp import (
    RK4,
    Actuator,
    Attachment,
    EnclosedGas,
    Force,
    Integrator,
    Leapfrog,
    PrescribedMotion,
    Pressure,
    Simulation,
    Sphere,
    SymplecticEuler,
    Wind,
    at,
    box,
)

CUBE = box((4, 4, 4), 0.1, mass=0.01, stiffness=40.0, damping=0.02).replace(groups={"end": [0, 1, 2]})


@wp.func
def vortex(x: Any, v: Any, t: Any, i: int):
    return type(x)(-x[1], x[0], wp.sin(t)) * type(t)(0.01)


def sway(t):
    return (0.02 * np.sin(9 * t), 0 * t, 0.1 * t), (0 * t, 0.2 * t, 0 * t)


def loads() -> list:
    """Return one load of each kind, with functions of time, whose work is counted but for that of what is kept."""
    arm = Sphere((0, 0, 1), 0.1, motion=sway)
    return [
        PrescribedMotion("end", sway),
        Force((0.01, 0.0, 0.0), on=[3, 5]),
        Force(lambda t: (np.sin(9 * t), 0, 0.3), total=True),
        Force(vortex),
        Actuator(lambda t: 0.1 * np.sin(7 * t), along=["z", "x"]),
        Attachment([60, 61], arm, stiffness=9.0),
        Attachment([33], stiffness=4.0),
        Wind(lambda t: (2.0 + np.sin(t), 0.0, 0.0), drag=0.5),
        Pressure(lambda t: 2.0 * np.sin(5 * t)),
        EnclosedGas(3.0),
    ]


def pulled(device: str, method: Integrator, system=CUBE, **options) -> Simulation:
    options = {
        "gravity": 0.0,
        "precision": "float64",
        "substeps": 20,
        "device": device,
        "loads": loads(),
    } | options
    return Simulation(system, integrator=method, **options)


ROUTES = {"scatter": "auto", "gather": None, "stencil": "auto"}


@pytest.mark.slow
@pytest.mark.parametrize("method", [SymplecticEuler(), RK4()], ids=str)
def test_all_routes_carry_all_loads(plain_device, method):
    # Launched once a frame, and once a stage: how a stage is launched depends on no algorithm.
    frames = []
    for force_algorithm, blocks in ROUTES.items():
        simulation = pulled(plain_device, method, force_algorithm=force_algorithm, blocks=blocks)
        assert simulation.model.force_algorithm == force_algorithm
        simulation.step(20)
        frames.append(simulation.frame().position)
    assert np.abs(frames[0] - CUBE.position).max() > 0.03
    for other in frames[1:]:
        np.testing.assert_allclose(frames[0], other, rtol=0, atol=1e-11)  # other orders of sums, 400 substeps


@pytest.mark.slow
def test_all_precisions_have_all_loads(plain_device):
    exact, *others = (
        pulled(plain_device, SymplecticEuler(), CUBE.translate((0.0, 0.0, 3.0)), precision=precision)
        for precision in ("float64", "float32", "float32-compensated")
    )
    for simulation in (exact, *others):
        simulation.step(20)
    for simulation in others:
        # Places of 3 m, rounded to 2e-7 m in each of 400 substeps, and springs that pull them back.
        np.testing.assert_allclose(simulation.frame().position, exact.frame().position, rtol=0, atol=2e-5)


@pytest.mark.slow
@pytest.mark.parametrize(("method", "order"), [(SymplecticEuler(), 1), (RK4(), 4)], ids=str)
def test_work_is_what_energy_comes_from(plain_device, method, order):
    # Undamped, a body has the energy it had, and the work of the loads: to the order of the method, as Simpson's
    # rule sums work at order 4. Symplectic Euler conserves an energy that differs from this at first order. What
    # pressures do test_skins.py has in closed form.
    def make(substeps: int) -> Simulation:
        how = {"gravity": 1.0, "substeps": substeps, "loads": loads()[:-2]}
        return pulled(plain_device, method, CUBE.replace(damping=0.0), **how)

    coarse, fine = drifts(20, make)
    assert coarse < {1: 0.05, 4: 1e-6}[order]  # RK4: seen 1.4e-8
    assert fine < coarse / {1: 1.4, 4: 8.0}[order]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("count", "first"), [(None, 4), (None, 12), (1, 12)], ids=["before the release", "after it", "of a lone drive"]
)
def test_a_run_resumes_to_the_last_bit(device, count, first):
    # Before and after particles are released, and with substeps chosen on the way.
    def make() -> Simulation:
        schedule = [at(0.1, stiffness=lambda k: 1.2 * k), at(0.15, unpin="end")]
        how = {"schedule": schedule, "substeps": "auto", "force_algorithm": "gather", "loads": loads()[:count]}
        return pulled(device, Leapfrog(), **how)

    whole, parts, rest = make(), make(), make()
    whole.step(16)
    parts.step(first)
    rest.restore(*parts.checkpoint())
    np.testing.assert_array_equal(rest.frame().velocity, parts.frame().velocity)
    rest.step(16 - first)
    for one, other in zip(rest.frame(), whole.frame(), strict=True):
        np.testing.assert_array_equal(one, other)
    assert rest.measure().external_work == whole.measure().external_work
    rest.reset()
    rest.step(16)
    np.testing.assert_array_equal(rest.frame().position, whole.frame().position)
