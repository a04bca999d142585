"""Every argument of `Simulation` and field of `Scene`: its gradient is that of the run, or is refused by name."""

import dataclasses
import inspect
import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from differences import CHAIN, SOFT, STEP
from problems import EPS64

import msdwarp as msd
from msdwarp import Leapfrog, Look, Plane, Probe, Scene, Simulation, TrackedPoints, at, fit_field
from msdwarp.world import MouseSpring

FRAMES = 4
HOW = {"integrator": Leapfrog(), "precision": "float64", "substeps": 8, "device": "cpu"}
LATER = at((FRAMES - 0.5) / 60, stiffness=200.0)  # it comes with the frame after the last
RIGHT: dict[str, dict[str, Any]] = {
    "system": {"system": CHAIN.pin([0])},
    "gravity": {"gravity": lambda t: 9.8 * math.cos(30 * t)},
    "colliders": {"colliders": [Plane(offset=0.99, **SOFT)]},
    "collider_rule": {"collider_rule": "report", "colliders": [Plane(offset=0.99, **SOFT)]},
    "loads": {"loads": [msd.Wind((3.0, 1.0, -2.0), area=0.01)]},
    "integrator": {"integrator": msd.RK4()},
    "fps": {"fps": 90.0},
    "substeps": {"substeps": "auto"},
    "safety": {"safety": 0.3, "substeps": "auto"},
    "refresh": {"refresh": True, "substeps": "auto"},
    "allow_unstable": {"allow_unstable": True, "substeps": 1},
    "energy_limit": {"energy_limit": math.inf},
    "device": {"device": "cpu"},
    "precision": {"precision": "float32"},
    "force_algorithm": {"force_algorithm": "scatter"},
    "blocks": {"blocks": None},
    "threads": {"threads": 2},
    "schedule": {"schedule": [LATER]},
    "probes": {"probes": {"end": Probe([2], "position")}},
    "contact_forces": {"contact_forces": True},
    "shape": {"shape": CHAIN.position},
    # Those of a scene alone:
    "duration": {"duration": 0.1},
    "look": {"look": Look(color="#d9603b")},
    "looks": {"looks": {"chain": Look(color="#d9603b")}, "system": CHAIN.named("chain")},
    "observe": {"observe": {"height": lambda x, v: x[:, -1, 2]}},
    "settled": {"settled": True, "system": CHAIN.pin([0])},
}
BODY = msd.box((3, 3, 3), 0.1)
REFUSED: dict[str, tuple[dict[str, Any], str]] = {
    "colliders": ({"colliders": [Plane()]}, "obstacles without a stiffness"),
    "loads": ({"loads": [MouseSpring()]}, "mouse springs"),
    "system": ({"system": CHAIN.replace(break_strain=0.5)}, "connections that break"),
    # In a precision whose kernels other tests of contact have.
    "contact": ({"contact": msd.Contact(), "system": BODY, "precision": "float32"}, "contact between bodies"),
    "integrator": ({"integrator": msd.LinearlyImplicitEuler()}, "integrator is LinearlyImplicitEuler"),
    "precision": ({"precision": "float32-compensated"}, "precision is 'float32-compensated'"),
    "schedule": (
        {"schedule": [at(9.0, mass=1.0), at(0.05, stiffness=200.0)]},
        r"schedule has a change at 0\.05 s; gradients through it are not possible, so the 4 frames from 0 s",
    ),
}
ARGUMENTS = inspect.signature(Simulation).parameters.keys()
FIELDS = {one.name for one in dataclasses.fields(Scene)}
QUICK = {"system", "schedule", "probes", "settled"}


def test_every_argument_is_tried():
    assert RIGHT.keys() | REFUSED.keys() == ARGUMENTS | FIELDS


def made(given: dict[str, Any], from_scene: bool) -> Callable[[], Simulation]:
    """Return a function that makes the same simulation, from a scene or not."""
    given = HOW | {"system": CHAIN} | given

    def make() -> Simulation:
        if not from_scene:
            return Simulation(given["system"], **{name: one for name, one in given.items() if name != "system"})
        scene = Scene(**{name: one for name, one in given.items() if name in FIELDS})
        return Simulation.from_scene(scene, **{name: one for name, one in given.items() if name not in FIELDS})

    return make


def heights(frames: msd.Frames) -> tuple[float, np.ndarray, None]:
    """Return the sum of the last coordinates at the end, and its derivatives."""
    by_x = np.zeros(frames.position.shape)
    by_x[-1] = np.arange(9.0).reshape(3, 3)
    return float((by_x[-1] * frames.position[-1]).sum()), by_x, None


def value_of(simulation: Simulation, **changed: Any) -> float:
    """Return what `heights` does, of the simulation itself, after a change."""
    if changed:
        simulation.change(**changed)
    simulation.step(FRAMES)
    return float((np.arange(9.0).reshape(3, 3) * simulation.frame().position).sum())


@pytest.mark.parametrize(
    "name", [one if one in QUICK else pytest.param(one, marks=pytest.mark.slow) for one in RIGHT]
)
@pytest.mark.filterwarnings("ignore::msdwarp.SettleWarning")
def test_a_gradient_is_that_of_the_run(name):
    make = made(RIGHT[name], from_scene=name in FIELDS)
    simulation = make()
    found, start = simulation.gradient(heights, FRAMES, by=("stiffness", "velocity")), simulation.frame().velocity
    eps = 2.0**-23 if name == "precision" else EPS64
    assert found.value == pytest.approx(value_of(make()), rel=100 * eps)  # of 32 substeps' roundings
    step = STEP if name != "precision" else 1e-2
    way, free = np.random.default_rng(1).normal(size=(3, 3)), np.isfinite(simulation.system.mass)[:, None]
    for parameter, value, change in (
        ("stiffness", np.array(simulation.system.stiffness), np.array([20.0, -30.0])),
        ("velocity", start, way * free),
    ):
        values = [value_of(make(), **{parameter: value + sign * step * change}) for sign in (1, -1)]
        terms = found[parameter] * change
        # Cut off at step², and rounded as the sum of some ten terms of 10 is.
        tolerance = (1e-6 if name != "precision" else 1e-2) * np.abs(terms).max() + 100 * eps / step
        assert terms.sum() == pytest.approx((values[0] - values[1]) / (2 * step), rel=0, abs=tolerance)


@pytest.mark.parametrize(
    "name", [one if one != "contact" else pytest.param(one, marks=pytest.mark.slow) for one in REFUSED]
)
def test_what_a_gradient_leaves_out_is_refused_by_name(name):
    given, message = REFUSED[name]
    with pytest.raises(ValueError, match=message):
        made(given, name in FIELDS)().gradient(heights, FRAMES)


def test_a_gradient_may_begin_after_a_change():
    simulation = made({"schedule": [at(0.05, stiffness=200.0)]}, from_scene=False)()
    simulation.step(4)  # the change comes with the fourth frame
    found, value = simulation.gradient(heights, FRAMES, by=()), value_of(simulation)
    assert found.value == pytest.approx(value, rel=100 * EPS64)


def test_a_field_is_not_fitted_through_changes_or_from_a_rest_that_moves():
    measured = TrackedPoints(np.arange(1, 9) / 60, np.full(8, 2), np.tile(CHAIN.position[2], (8, 1)))
    scene = Scene(system=CHAIN.pin([0]))
    late = scene.replace(schedule=[at(0.11, stiffness=200.0)])  # in the last frame alone
    for wrong, message in (
        (late, "schedule has a change at 0.11 s"),
        (scene.replace(settled=True), "scene has settled=True, and where it rests"),
    ):
        with pytest.raises(ValueError, match=message):
            fit_field(wrong, measured, noise=1e-4, device="cpu")


@pytest.mark.slow
def test_jax_is_told_of_a_schedule():
    jax = pytest.importorskip("jax")
    with pytest.raises(ValueError, match=r"schedule has a change at 0\.05 s"):
        msd.simulate_jax(CHAIN, FRAMES, stiffness=jax.numpy.array(50.0), schedule=[at(0.05, mass=2.0)], **HOW)
