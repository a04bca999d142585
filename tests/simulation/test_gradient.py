"""Gradients: against central differences, by parameter, effect, method and algorithm, and against closed forms."""

import cmath
import math
from typing import Any

import numpy as np
import pytest
from differences import FRAMES, METHODS, NAMES, SOFT, STEP, at_end, block, check, loss, simulation, soft_floor
from problems import EPS64
from scipy.integrate import solve_ivp
from test_gradient_effects import EFFECTS

import msdwarp as msd
from msdwarp import (
    RK4,
    RKC2,
    Actuator,
    ExplicitEuler,
    Force,
    Leapfrog,
    Plane,
    Simulation,
    SymplecticEuler,
    System,
    box,
)
from msdwarp.engine import Effect, Model
from msdwarp.engine.adjoint import spring_adjoints
from msdwarp.engine.adjoint.adjoint import DIFFERENTIABLE, WORDS
from msdwarp.simulation import gradient_run

SHORT = {"fps": 180.0, "substeps": 4, "allow_unstable": True}
"""Frames of four substeps, as each launch of a frame is recorded. Explicit Euler is unstable, but not for long."""
TOUCHING = {
    "colliders": [Plane((0.1, 0, 1), -0.1, **SOFT)],
    "loads": [Force(soft_floor), msd.EnclosedGas(60.0, outside=500.0, volume=0.011)],
}
METHODS_AND_EFFECTS = [
    (SymplecticEuler(), {}),
    (Leapfrog(), {}),
    (RK4(), SHORT | EFFECTS["loads on particles"][1]),
    (RKC2(4), SHORT | TOUCHING),
    (ExplicitEuler(), SHORT),
]


@pytest.mark.slow
@pytest.mark.parametrize(("method", "effects"), METHODS_AND_EFFECTS)
def test_derivatives_are_those_of_central_differences(method, effects, plain_device):
    options = {"integrator": method, "device": plain_device, **effects}
    found = simulation(block(), **options).gradient(loss, FRAMES, by=NAMES)
    for name in NAMES:
        check(block(), name, found[name], **options)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("algorithm", "method"),
    [("scatter", SymplecticEuler()), ("stencil", Leapfrog()), ("large stencil", Leapfrog()), ("stencil", RK4())],
)
def test_all_algorithms_have_the_same_derivatives(algorithm, method, plain_device, monkeypatch):
    body = box((4, 3, 3), 0.1, stiffness=300.0, damping=0.3)
    body = body.replace(position=body.position * [1.05, 0.98, 1.0])
    found = []
    monkeypatch.setattr(spring_adjoints, "is_large", lambda model: algorithm.startswith("large"))
    for one in ("gather", algorithm):
        options = {"integrator": method, "force_algorithm": one.split()[-1], "device": plain_device, **SHORT}
        run = simulation(body, **options)
        found.append(run.gradient(loss, FRAMES, by=NAMES))
    for name in NAMES:
        scale = np.abs(found[0][name]).max()
        # The trajectories differ by rounding, 1e-16, which 20 substeps multiply by less than a thousand.
        np.testing.assert_allclose(found[1][name], found[0][name], rtol=0, atol=1e-10 * scale)


@pytest.mark.slow
def test_threads_share_the_way_back(monkeypatch):
    # With a soft obstacle, a force, a gas and muscles, whose adjoints are divided among threads, too.
    body, found = block(), []
    plane, loads = Plane((0.1, 0, 1), -0.1, **SOFT), [Force(soft_floor), msd.EnclosedGas(60.0)]
    loads += [Actuator(lambda t: 0.1 * math.sin(40 * t))]
    names = (*NAMES, "strain", "colliders[0].friction", "loads[1].pressure")
    for threads in (1, 2):
        options = {"integrator": RK4(), "threads": threads, "device": "cpu"}
        run = simulation(body, colliders=[plane], loads=loads, **options)
        found.append(run.gradient(loss, FRAMES, by=names))
    for share in ("MOST_MEMORY", "MOST_FOR_SUBSTEPS"):
        monkeypatch.setattr(gradient_run, share, 0.0)
    again = run.gradient(loss, FRAMES, by=names)  # takes frames again whose states do not fit
    for name in names:  # the threads sum forces in another order
        scale = np.abs(found[0][name]).max()
        np.testing.assert_allclose(found[1][name], found[0][name], rtol=0, atol=1e-10 * scale)
        np.testing.assert_array_equal(again[name], found[1][name])


@pytest.mark.slow
@pytest.mark.parametrize("method", [SymplecticEuler(), Leapfrog(), RK4()], ids=str)
def test_derivatives_by_strain_are_those_at_the_times_of_stages(method, plain_device):
    def run(amplitude: float, by: tuple[str, ...]) -> msd.Gradient:
        muscles = [Actuator(lambda t: amplitude * math.sin(40 * t + 1))]
        options = {"integrator": method, "loads": muscles, "device": plain_device}
        return simulation(block(), **options, **SHORT).gradient(loss, FRAMES, by=by)

    found, substeps = run(0.1, ("strain",))["strain"], 4 * FRAMES
    stages = np.add.outer(np.arange(substeps), method.stage_times).ravel()
    wave = np.sin(40 * np.append(stages, substeps) / 720 + 1)
    assert found.shape == (len(wave), 1)
    difference = (run(0.1 + STEP, ()).value - run(0.1 - STEP, ()).value) / (2 * STEP)
    # Of the terms of the sum, as for other parameters. Leapfrog's last velocity depends on the strain at the end.
    assert found[:, 0] @ wave == pytest.approx(difference, rel=0, abs=1e-6 * np.abs(found).max())
    assert (found[-1, 0] != 0) == (method == Leapfrog())


@pytest.mark.slow
def test_derivatives_by_forces_are_those_of_forces_that_are_added(plain_device):
    options = {"integrator": Leapfrog(), "device": plain_device}
    found = simulation(block(), **options).gradient(loss, FRAMES, by=("force",))["force"]
    assert not found[:2].any()  # these are pinned
    way = np.random.default_rng(1).normal(size=(4, 3))
    values = []
    for sign in (1, -1):
        loads = [Force(sign * STEP * one, on=[9 * k + 3]) for k, one in enumerate(way)]
        values.append(simulation(block(), loads=loads, **options).gradient(loss, FRAMES, by=()).value)
    terms = found[3::9] * way  # the differences are rounded as in `check`
    tolerance = 1e-6 * np.abs(terms).max() + 4 * EPS64 * abs(values[0]) / STEP
    assert terms.sum() == pytest.approx((values[0] - values[1]) / (2 * STEP), rel=0, abs=tolerance)


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
    wanted, errors = swing(80.0 + 1e-30j).imag / 1e-30, []
    for substeps in (8, 16):
        how = {"gravity": 0.0, "fps": 4.0, "precision": "float64", "substeps": substeps, "device": plain_device}
        run = Simulation(body, integrator=method, allow_unstable=True, **how)
        errors.append(abs(run.gradient(at_end(0), 2, by=("stiffness",))["stiffness"][0] - wanted))
    # ωh is 0.2 and 0.1: the next order changes the ratio of errors by a tenth, at most by a quarter.
    assert errors[0] / errors[1] == pytest.approx(2**order, rel=0.25)


@pytest.mark.parametrize("method", [*METHODS.values(), RK4()])
def test_a_fall_has_the_derivatives_of_its_closed_form(method, plain_device):
    # After t, a particle is at x + v t - g t (t ± h)/2 and by other methods without ±h; so d/dv = t, and d/dx = 1.
    body = System(position=[[0.0, 0, 1.0]], velocity=[[1.0, 0, 0]], mass=2.0)
    run = Simulation(body, integrator=method, precision="float64", substeps=10, device=plain_device)

    found = run.gradient(at_end(2), 30, by=("position", "velocity", "mass", "gravity"))
    t, h = 0.5, 1 / 600
    late = h if method == msd.SymplecticEuler() else 0.0
    # 300 sums of h are rounded to 300 times 1e-16.
    np.testing.assert_allclose(found["position"], [[0, 0, 1]], rtol=0, atol=1e-15)
    np.testing.assert_allclose(found["velocity"], [[0, 0, t]], rtol=0, atol=1e-13)
    np.testing.assert_allclose(found["gravity"], [0, 0, t * (t + late) / 2], rtol=0, atol=1e-13)
    np.testing.assert_allclose(found["mass"], [0.0], rtol=0, atol=1e-13)


@pytest.mark.slow
def test_the_derivative_through_a_bounce_converges_to_the_truth(plain_device):
    def height(drop: float) -> float:
        """Return the height after 0.45 s, by another method."""

        def rates(_t: float, y: np.ndarray) -> list[float]:
            depth = max(-y[0], 0.0)
            pressing = 4e4 * (depth**2 / 0.02 if depth < 0.01 else depth - 0.005)
            return [y[1], -9.82 + pressing * max(1 - 0.2 * y[1], 0.0)]

        how = {"rtol": 1e-11, "atol": 1e-13, "max_step": 1e-3, "method": "DOP853"}
        return solve_ivp(rates, (0, 0.45), [drop, 0.0], **how).y[0, -1]

    wanted, errors = (height(0.2001) - height(0.1999)) / 2e-4, []  # 1.03: it bounces higher, and later
    for substeps in (200, 400):
        body = System(position=[[0.0, 0, 0.2]], mass=1.0)
        how = {"integrator": Leapfrog(), "fps": 20.0, "precision": "float64", "device": plain_device}
        plane = Plane(stiffness=4e4, dissipation=0.2)
        run = Simulation(body, colliders=[plane], substeps=substeps, **how)
        errors.append(abs(run.gradient(at_end(2), 9, by=("position",))["position"][0, 2] - wanted))
    # The contact of 22 ms has 87 and 174 substeps. Leapfrog is of order 2, and so is its derivative where forces
    # are differentiable; the second derivative jumps, so the order may be a little less.
    assert errors[0] < 0.01 * wanted
    assert errors[1] < errors[0] / 2


def test_a_gradient_from_the_middle_leaves_the_run_as_it_is(plain_device):
    # The sums of a gather are repeatable.
    how = {"integrator": Leapfrog(), "force_algorithm": "gather", "device": plain_device}
    first, second = (simulation(block(), **how) for _ in range(2))
    for one in (first, second):
        one.change(velocity=(0.0, 0.0, 1.0))
        one.step(2)
    found = first.gradient(loss, FRAMES, by=("stiffness",))
    np.testing.assert_allclose(found.frames.time, first.time + np.arange(FRAMES + 1) / 60, rtol=1e-14)
    for one in (first, second):
        one.step(FRAMES)
    np.testing.assert_array_equal(first.frame().position, second.frame().position)
    # Another kernel may round a product and a sum at once: 1e-16, which 60 substeps multiply by less than 1e3.
    np.testing.assert_allclose(found.frames.position[-1], first.frame().position, rtol=0, atol=1e-13)


@pytest.mark.parametrize(("share", "states"), [(1.0, 100 - 25), (0.0, 19 - 9)])
def test_memory_grows_with_the_root_of_frames_that_do_not_fit(share, states, monkeypatch):
    made, make = [0], Model.vectors_together

    def counting(model: Model, count: int) -> Any:
        made[0] += 1
        return make(model, count)

    monkeypatch.setattr(gradient_run, "MOST_MEMORY", share)
    monkeypatch.setattr(gradient_run, "MOST_FOR_SUBSTEPS", 0.0)
    monkeypatch.setattr(Model, "vectors_together", counting)
    body, found = simulation(block(), substeps=8, device="cpu"), []
    for frames in (24, 99):
        made[0] = 0
        body.differentiated(frames, ())
        found.append(made[0])
    assert found[1] - found[0] == states  # 10 checkpoints and 9 states between two, 5 and 4


def test_frames_that_memory_cannot_hold_are_refused(monkeypatch):
    monkeypatch.setattr(gradient_run.checks, "free_memory", lambda: 10**9)
    with pytest.raises(ValueError, match="frames is 1000000; their positions and velocities take"):
        simulation(block(), device="cpu").gradient(loss, 10**6)


def effects(kind: type = Effect) -> set[type]:
    """Return the kinds of effects of msdwarp that are not the base of others."""
    below = {one for one in kind.__subclasses__() if one.__module__.startswith("msdwarp.")}
    return set().union(*map(effects, below)) if below else {kind}


def test_every_effect_has_an_adjoint_or_a_name_to_refuse_it_by():
    without = {one for one in effects() if one.elements is Effect.elements}
    named = {one.__name__ for one in without if not issubclass(one, DIFFERENTIABLE)}
    assert named | {"AttachmentSprings"} == WORDS.keys()  # which have elements unless a mouse may hold them


def test_a_run_that_diverges_is_told():
    # A floor of 4e6 N/m is too stiff for 12 substeps a frame and particles of some 20 g.
    run = simulation(block(), colliders=[Plane(offset=-0.11, stiffness=4e6)], allow_unstable=True, device="cpu")
    with pytest.raises(ValueError, match="the run diverged in frame"):
        run.gradient(loss, 30, by=("position",))


@pytest.mark.parametrize(
    ("by", "message"),
    [
        (("position", "color"), r"by\[1\] is 'color'; it must be one of 'position'"),
        (("strain",), "there must be an Actuator"),
        (("damping",), "no connection has a damper"),
        (("mass",), "by has 'mass', and gravity is a function of time here"),
    ],
)
def test_unknown_parameters_are_told(by, message):
    run = simulation(block().replace(damping=0.0), gravity=lambda t: 9.8, device="cpu")
    with pytest.raises(ValueError, match=message):
        run.gradient(loss, 2, by)


@pytest.mark.parametrize(
    ("found", "message"),
    [
        (lambda frames: (0.0, frames.position[-1], None), "∂/∂position of the loss has shape"),
        (lambda frames: 1.0, r"loss returned 1\.0; it must return a tuple of its value, and its deriv"),
        (lambda frames: (1.0, None, None), "loss returned None for both of its derivatives; one of them"),
        (lambda frames: (np.nan, None, None), "the value of loss is nan; it must be finite"),
        (lambda frames: ([1.0, 2.0], None, None), r"of shape \(2,\); it must be a number"),
        (lambda frames: ("x", None, None), "must be .* not 'x'"),
        (
            lambda frames: (0.0, None, frames.velocity * np.nan),
            r"∂/∂velocity of the loss\[0, 0, 0\] is nan; it must be finite",
        ),
    ],
)
def test_what_a_loss_returns_is_checked(found, message):
    with pytest.raises(ValueError, match=message):
        simulation(block(), device="cpu").gradient(found, 2)


def test_a_gradient_has_what_was_asked_for():
    run = simulation(block(), device="cpu")
    with pytest.raises(ValueError, match="frames is 0"):
        run.gradient(loss, 0)
    assert run.gradient(loss, 2, by=iter(["position"]))["position"].shape == (len(block().position), 3)
    with pytest.raises(KeyError, match="was not asked for"):
        run.gradient(loss, 2, by=())["mass"]
