"""Gradients by methods of several stages, whose adjoint follows from their tableau."""

import cmath
import math

import numpy as np
import pytest
from differences import FRAMES, NAMES, SOFT, STEP, block, check, loss, simulation, soft_floor

import msdwarp as msd
from msdwarp import RK4, RKC2, Actuator, ExplicitEuler, Force, Plane, PrescribedMotion, Simulation, System

CARRIER = Plane((0, 0, 1), -9.0, motion=lambda t: (0.1 * math.sin(40 * t), 0.0, 0.0))
TIMED = {
    "loads": [
        Force(lambda t: (0.0, 40 * t, 0.0)),
        Actuator(lambda t: 0.1 * math.sin(40 * t)),
        PrescribedMotion([30, 35], lambda t: (0.02 * math.sin(30 * t), 0.1 * t, 0.0)),
        msd.Attachment([7, 9], (0.0, 0.1, 0.2), carried_by=CARRIER, stiffness=30.0, damping=0.2),
    ]
}
TOUCHING = {
    "colliders": [Plane((0.1, 0, 1), -0.1, **SOFT)],
    "loads": [
        Force(soft_floor),
        msd.EnclosedGas(60.0, outside=500.0, volume=0.011),
        msd.Wind((3.0, 1.0, -2.0), area=0.01),
    ],
}
SHORT = {"fps": 180.0, "substeps": 4, "allow_unstable": True}
"""Frames of four substeps, as each launch of a frame is recorded. Explicit Euler is unstable, but not for long."""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("method", "effects"),
    [
        (RK4(), TIMED),
        pytest.param(RKC2(4), TOUCHING, marks=pytest.mark.slow),
        (ExplicitEuler(), {}),
    ],
)
def test_derivatives_are_those_of_central_differences(method, effects, plain_device):
    options = {"integrator": method, "device": plain_device, **SHORT, **effects}
    found = simulation(block(), **options).gradient(loss, FRAMES, by=NAMES)
    for name in NAMES:
        check(block(), name, found[name], **options)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("method", "algorithm"), [(RK4(), "stencil"), pytest.param(RKC2(4), "scatter", marks=pytest.mark.slow)]
)
def test_all_algorithms_have_the_same_derivatives(method, algorithm, plain_device):
    body = msd.box((4, 3, 3), 0.1, stiffness=300.0, damping=0.3)
    body, found = body.replace(position=body.position * [1.05, 0.98, 1.0]), []
    for one in ("gather", algorithm):
        run = simulation(body, integrator=method, force_algorithm=one, device=plain_device, **SHORT)
        found.append(run.gradient(loss, FRAMES, by=NAMES))
    for name in NAMES:
        scale = np.abs(found[0][name]).max()
        # The trajectories differ by rounding, 1e-16, which 20 substeps multiply by less than a thousand.
        np.testing.assert_allclose(found[1][name], found[0][name], rtol=0, atol=1e-10 * scale)


def test_derivatives_by_strain_are_those_at_the_times_of_stages(plain_device):
    def run(amplitude: float, by: tuple[str, ...]) -> msd.Gradient:
        muscles = [Actuator(lambda t: amplitude * math.sin(40 * t + 1))]
        options = {"integrator": RK4(), "loads": muscles, "device": plain_device}
        return simulation(block(), **options, **SHORT).gradient(loss, FRAMES, by=by)

    found, substeps = run(0.1, ("strain",))["strain"], 4 * FRAMES
    stages = np.add.outer(np.arange(substeps), RK4().stage_times).ravel()
    wave = np.sin(40 * np.append(stages, substeps) / 720 + 1)
    assert found.shape == (len(wave), 1)
    difference = (run(0.1 + STEP, ()).value - run(0.1 - STEP, ()).value) / (2 * STEP)
    # Of the terms of the sum, as for other parameters.
    assert found[:, 0] @ wave == pytest.approx(difference, rel=0, abs=1e-6 * np.abs(found).max())


def swing(stiffness: complex) -> complex:
    """Return the stretch after 0.5 s of a spring of 2 kg with a damper of 3 N s/m, from 0.1 m and at rest."""
    rate, away = 3.0 / 4.0, 0.1
    turning = cmath.sqrt(stiffness / 2.0 - rate**2)
    waves = cmath.cos(0.5 * turning) + rate / turning * cmath.sin(0.5 * turning)
    return away * math.exp(-0.5 * rate) * waves


@pytest.mark.parametrize(("method", "order"), [(RK4(), 4), (RKC2(3), 2)])
def test_the_derivative_by_stiffness_has_the_order_of_the_method(method, order, plain_device):
    body = System(
        position=[[0.0, 0, 0], [1.1, 0, 0]], mass=2.0, rest_length=1.0, connections=[[0, 1]], damping=3.0
    )
    body = body.replace(stiffness=80.0).pin([0])

    def end(frames: msd.Frames) -> tuple[float, np.ndarray, None]:
        by_x = np.zeros(frames.position.shape)
        by_x[-1, 1, 0] = 1.0
        return frames.position[-1, 1, 0], by_x, None

    wanted, errors = swing(80.0 + 1e-30j).imag / 1e-30, []
    for substeps in (8, 16):
        how = {"gravity": 0.0, "fps": 4.0, "precision": "float64", "substeps": substeps, "device": plain_device}
        run = Simulation(body, integrator=method, allow_unstable=True, **how)
        errors.append(abs(run.gradient(end, 2, by=("stiffness",))["stiffness"][0] - wanted))
    # ωh is 0.2 and 0.1: the next order changes the ratio of errors by a tenth, at most by a quarter.
    assert errors[0] / errors[1] == pytest.approx(2**order, rel=0.25)
