"""Gradients through everything that acts in a scene, against central differences."""

import math
from typing import Any

import numpy as np
import pytest
import warp as wp
from differences import FRAMES, METHODS, NAMES, SOFT, block, check, loss, simulation, soft_floor

import msdwarp as msd
from msdwarp.bodies import LINEAR, LINEAR_SPRING


@wp.func
def taut(strain: Any, rate: Any, damping: Any):
    return damping * (type(strain)(1.0) + type(strain)(3.0) * strain) * rate


@wp.func
def cubic(strain: Any):
    return strain + type(strain)(2.0) * strain * strain * strain


@wp.func
def whirl(x: wp.vec3d, t: wp.float64) -> wp.vec3d:
    return wp.vec3d(-wp.float64(9.0) * x[1], wp.float64(5.0) * x[0], wp.float64(3.0) * wp.cos(x[0] + t))


CARRIER = msd.Plane((0, 0, 1), -9.0, motion=lambda t: (0.1 * math.sin(40 * t), 0.0, 0.0))


# Effects act side by side: a derivative is right to a millionth of all only if each of them is.
EFFECTS = {
    "no dampers": (lambda body: tied(body).replace(damping=0.0), {}),
    "laws": (
        lambda body: body.replace(
            spring=kinds(msd.SpringKinds, msd.ExponentialSpring(8.0), LINEAR_SPRING, msd.LimitedSpring(0.02, 4.0)),
            damper=kinds(msd.DamperKinds, LINEAR, msd.QuadraticDamper(0.5), msd.CoulombDamper(5.0)),
        ),
        {},
    ),
    "laws of one's own": (
        lambda body: body.replace(spring=msd.OwnSpring(cubic), damper=msd.OwnDamper(taut, 4.0)),
        {},
    ),
    "loads on particles": (
        lambda body: body,
        {
            "loads": [
                msd.Actuator(lambda t: 0.1 * math.sin(40 * t)),
                msd.Force((1.0, 0, 0)),
                msd.Force(lambda t: (0.0, 40 * t, 0.0)),
                msd.Wind((3.0, 1.0, -2.0), area=0.01),
                msd.Attachment([5, 9], (0.1, 0.0, 0.3), stiffness=40.0, damping=0.3, rest_length=0.2),
                msd.Attachment([7, 9], (0.0, 0.1, 0.2), carried_by=CARRIER, stiffness=30.0, damping=0.2),
                msd.PrescribedMotion([30, 35], lambda t: (0.02 * math.sin(30 * t), 0.1 * t, 0.0)),
                msd.Force(soft_floor),
            ]
        },
    ),
    "soft obstacles": (
        lambda body: body,
        {
            "colliders": [
                msd.Plane((0.1, 0, 1), -0.1, **SOFT),
                msd.Sphere((0, 0, -0.4), 0.33, **SOFT),
                msd.Box((0.3, 0, -0.25), (0.4, 0.5, 0.32), turn=(0, 0.2, 0), **SOFT),
                msd.Capsule((-0.3, 0.05, -0.1), (-0.12, 0.05, -0.12), 0.06, **SOFT),
                msd.Cone((0.05, 0.1, -0.05), (0.05, 0.1, -0.5), 0.2, **SOFT),
            ]
        },
    ),
    "cells and angles": (
        lambda body: beside(
            elastic(msd.box, (4, 3, 3), 0.4),
            elastic(msd.box, (3, 3, 3), 0.1),  # as cork
            strained(msd.rod(8, 0.1, radius=0.01, material=msd.Material(200.0, 1e5, 0.2))),
        ),
        {},
    ),
    "wind on a sheet": (
        lambda body: beside(elastic(msd.sheet, (4, 4), None), elastic(msd.sheet, (4, 4), 0.45)),
        {"loads": [msd.Wind(lambda t: (2.0 + 40 * t, 0.5, 3.0), drag=1.2, lift=0.7)]},
    ),
    "closed surfaces": (  # one of particles, one that is embedded
        lambda body: beside(
            body, strained(msd.ball(0.1, 0.07, stiffness=300.0, damping=0.3, mass=0.02)).named("ball")
        ),
        {
            "loads": [
                msd.Wind(whirl, drag=1.2, lift=0.7),
                msd.EnclosedGas(60.0, on="block", outside=500.0, exponent=1.4, volume=0.011),
                msd.EnclosedGas(60.0, on="ball", outside=500.0, volume=0.004),
                msd.Pressure(lambda t: 40 * math.sin(50 * t)),
                msd.Pressure(30.0),
            ]
        },
    ),
}


def tied(body: msd.System) -> msd.System:
    """Return a block and another one beside it, joined by springs."""
    return msd.join(body, body.translate((0.45, 0, 0)), pairs=[(35, 0), (32, 4)], stiffness=200.0, damping=0.1)


def kinds(of: Any, *laws: Any) -> Any:
    """Return laws that take turns among the springs or dampers of a block."""
    return of(laws, np.arange(block().connection_count) % len(laws))


def beside(*bodies: msd.System) -> msd.System:
    """Return bodies that stand beside each other."""
    placed = [body.translate((float(k), 0, 0)) for k, body in enumerate(bodies)]
    return sum(placed[1:], placed[0])


def elastic(shape: Any, size: tuple[int, ...], poissons_ratio: float | None) -> msd.System:
    """Return a body of a material."""
    thickness = {"thickness": 0.02} if shape is msd.sheet else {}
    return strained(shape(size, 0.1, material=msd.Material(20.0, 2e3, 0.2, poissons_ratio), **thickness))


def strained(body: msd.System) -> msd.System:
    """Return a body pinned at two particles, a little strained, with a velocity of each particle."""
    noise = np.random.default_rng(0).normal(size=(2, body.particle_count, 3))
    return body.replace(position=body.position + 0.004 * noise[0], velocity=0.1 * noise[1]).pin([0, 1])


KINKS = [
    (msd.TensionOnlySpring(), LINEAR),
    (msd.TensionOnlySpring(), msd.CoulombDamper(0.1)),
    (msd.LimitedSpring(0.05, 4.0), LINEAR),
    (LINEAR_SPRING, msd.QuadraticDamper(0.5)),
    (LINEAR_SPRING, msd.CoulombDamper(0.2)),
]
"""Laws of springs and dampers with a kink, each of a pair of particles; the motion below crosses each of them."""


def in_turn(of: Any, laws: tuple) -> Any:
    """Return a law for each pair."""
    different = list(dict.fromkeys(laws))
    return of(different, [different.index(one) for one in laws])


@pytest.mark.parametrize("own", [False, True], ids=["built in", "slack, with a damper of one's own"])
def test_derivatives_across_a_kink_are_those_of_differences(own, plain_device):
    springs, dampers = zip(*KINKS, strict=True)
    laws = {"spring": in_turn(msd.SpringKinds, springs), "damper": in_turn(msd.DamperKinds, dampers)}
    if own:
        laws = {"spring": msd.TensionOnlySpring(), "damper": msd.OwnDamper(taut, 4.0)}
    start = {"velocity": -1.0, "stiffness": 100.0, "damping": 3.0, "rest_length": 1.0}
    pairs = len(KINKS)
    position = np.array([[0.0, k, 0.0] for k in range(pairs)] + [[1.05, k, 0.0] for k in range(pairs)])
    still = position[:, :1] == 0.0

    def run(**given) -> msd.Simulation:
        now = start | given
        ends = {"position": position, "mass": np.where(still[:, 0], np.inf, 1.0), **laws}
        ends |= {"connections": [(k, k + pairs) for k in range(pairs)]}
        ends |= {"velocity": np.where(still, 0.0, (now.pop("velocity"), 0.0, 0.0))}
        how = {"substeps": 50, "precision": "float64", "fps": 100.0, "device": plain_device}
        return msd.Simulation(msd.System(**ends, **now), gravity=(3.0, 0, 0), **how)

    def end(frames: msd.Frames) -> tuple[float, np.ndarray, None]:
        by_x = np.zeros(frames.position.shape)
        by_x[-1, pairs:, 0] = 1.0
        return frames.position[-1, pairs:, 0].sum(), by_x, None

    found = run().gradient(end, 70, by=list(start))
    for name, value in start.items():
        values = []
        for sign in (1, -1):
            moved = run(**{name: value * (1 + 1e-3 * sign)})
            moved.step(70)
            values.append(moved.frame().position[pairs:, 0])
        each = found[name][pairs:, 0] if name == "velocity" else found[name]
        # A kink moves the derivative by its jump, times a step of 2e-4 s, and the differences by their own, 1e-3.
        # A jump of the force would put it off by half and more.
        np.testing.assert_allclose(each, (values[0] - values[1]) / (2e-3 * value), rtol=0.01)


def method_for(effect: str) -> msd.Integrator:
    """Return a method: what an effect adds to a gradient does not depend on it, and leapfrog has more kernels."""
    return METHODS["leapfrog" if effect in ("no dampers", "loads on particles") else "symplectic Euler"]


@pytest.mark.slow
@pytest.mark.parametrize("effect", EFFECTS)
def test_derivatives_with_effects(effect, plain_device):
    change, options = EFFECTS[effect]
    body = change(block())
    options = options | {"integrator": method_for(effect), "device": plain_device}
    names = [name for name in NAMES if name != "damping" or body.damping.any()]
    found = simulation(body, **options).gradient(loss, FRAMES, by=names)
    for name in names:
        check(body, name, found[name], **options)
