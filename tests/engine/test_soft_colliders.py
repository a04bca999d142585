"""Soft obstacles: bounces, friction, energy and stable steps by closed forms; and what is refused."""

import math
import re

import numpy as np
import pytest
from problems import EPS64
from scipy.optimize import brentq

from msdwarp import (
    Box,
    Capsule,
    Cone,
    Ensemble,
    Leapfrog,
    Plane,
    Probe,
    Simulation,
    Sphere,
    System,
    box,
)
from msdwarp.world import Collider

K, RAMP = 2e4, 0.01
SHAPES = {
    "Plane": Plane((0.2, 0.1, 1.0), stiffness=K, friction=0.0),
    "Sphere": Sphere((0.1, 0, -0.5), 0.5, stiffness=K, friction=0.0),
    "Box": Box((0, 0, -0.25), (1, 1, 0.5), turn=(0.1, 0.2, 0), stiffness=K, friction=0.0),
    "Capsule": Capsule((-0.5, 0.05, -0.3), (0.5, 0, -0.3), 0.3, stiffness=K, friction=0.0),
    "Cone": Cone((0, 0, -1.0), (0.03, 0, 0), 0.8, stiffness=K, friction=0.0),
}


AWAY = [
    Plane(offset=-99.0, stiffness=K),
    Sphere((0, 0, -99), stiffness=K),
    Box((0, 0, -99), stiffness=K),
    Capsule((0, 0, -99), (1, 0, -99), 0.1, stiffness=K),
    Cone((0, 0, -98), (0, 0, -99), 0.5, stiffness=K),
]
"""Far off: with all kinds in each scene, the same kernels serve all of them."""


def thrown(collider: Collider, device: str, velocity=(0.3, 0.0, -2.0), **options) -> Simulation:
    """Return a particle of 1 kg that flies to an obstacle below it, without gravity."""
    body = System(position=[[0.0, 0.02, 0.1]], velocity=[velocity], mass=1.0)
    options = {"integrator": Leapfrog(), "precision": "float64", "gravity": 0.0, "substeps": 64} | options
    return Simulation(body, colliders=[collider, *AWAY], device=device, **options)


def largest_change_of_energy(simulation: Simulation) -> float:
    first, worst = simulation.measure().energy, 0.0
    for _ in range(20):
        simulation.step()
        worst = max(worst, abs(simulation.measure().energy / first - 1))
    return worst


@pytest.mark.slow
@pytest.mark.parametrize("shape", SHAPES)
def test_a_bounce_keeps_the_energy(shape, plain_device):
    coarse, fine = (largest_change_of_energy(thrown(SHAPES[shape], plain_device, substeps=n)) for n in (64, 256))
    assert coarse < 0.01
    assert fine < coarse / 8  # of second order: 16 times; the law's second derivative jumps
    simulation = thrown(SHAPES[shape], plain_device)
    simulation.step(20)
    assert simulation.frame().velocity[0, 2] > 1.0  # it has bounced


@pytest.mark.parametrize("dissipation", [0.1, 0.4])
def test_restitution_follows_from_dissipation(dissipation, plain_device):
    # m v dv = −f(d) (1 − c v) dd has the same right side inwards and outwards, whatever f is. So the integral of
    # v/(1 − c v) from −u to e u is 0: (1 + e) c u = ln((1 + c u)/(1 − c e u)).
    u, c = 2.0, dissipation
    e = brentq(
        lambda e: (1 + e) * c * u - math.log((1 + c * u) / (1 - c * e * u)), 1e-3, min(1.0, 0.999 / (c * u))
    )
    errors = []
    for substeps in (32, 128):
        plane = Plane(stiffness=K, dissipation=c, friction=0.0)
        simulation = thrown(plane, plain_device, (0.0, 0.0, -u), substeps=substeps)
        simulation.step(20)
        errors.append(abs(simulation.frame().velocity[0, 2] / u - e))
    assert errors[0] < 0.02
    assert errors[1] < errors[0] / 2.5  # of first order, as dampers in leapfrog are


def test_friction_brakes_a_slide(plain_device):
    # On a plane μ g, from 1 m/s, as long as that is far above the rest speed.
    body = System(position=[[0.0, 0, -math.sqrt(2 * RAMP * 9.82 / K)]], velocity=[[1.0, 0, 0]], mass=1.0)
    plane = Plane(stiffness=K, friction=0.3, rest_speed=1e-3)
    how = {"integrator": Leapfrog(), "substeps": 64, "precision": "float64", "device": plain_device}
    simulation = Simulation(body, colliders=[plane], **how)
    simulation.step(15)
    # Velocities in a force lag by half a substep, 1e-4 s.
    assert simulation.frame().velocity[0, 0] == pytest.approx(1 - 0.3 * 9.82 * 0.25, rel=2e-3)
    simulation.step(60)
    assert abs(simulation.frame().velocity[0, 0]) < 1e-3  # and then it lies, however stiff friction is at rest


@pytest.mark.parametrize("shape", SHAPES)
def test_what_is_lost_is_the_power_of_dissipation_and_friction(shape, plain_device):
    given = SHAPES[shape]
    names = {name: getattr(given, name) for name in (*given.places, *given.lengths)}
    names |= {name: getattr(given, name) for name in ("normal", "size", "turn") if hasattr(given, name)}
    collider = type(given)(**names, stiffness=K, friction=0.4, dissipation=0.2)
    simulation = thrown(collider, plain_device, substeps=32, fps=2000.0)
    energies, powers = [simulation.measure().energy], [simulation.measure().dissipated_power]
    for _ in range(300):
        simulation.step()
        measured = simulation.measure()
        energies.append(measured.energy)
        powers.append(measured.dissipated_power)
    lost = (np.sum(powers) - (powers[0] + powers[-1]) / 2) / 2000  # by the trapezoidal rule
    assert lost > 0.2 * energies[0]
    assert energies[0] - energies[-1] == pytest.approx(lost, rel=5e-3)  # the contact of 15 ms has 30 frames


def test_the_bound_of_the_step_counts_it():
    block = box((3, 3, 3), 0.1, mass=0.01, stiffness=50.0)
    soft = Plane(offset=-1.0, stiffness=3e3, dissipation=0.2)
    bounds = [Simulation(block, colliders=one, device="cpu").choice.rates for one in ([], [soft])]
    assert bounds[1].stiffness - bounds[0].stiffness == pytest.approx(3e3 / 0.01, rel=1e-12)
    assert bounds[1].damping == pytest.approx(math.sqrt(3e3 / 0.01), rel=1e-6)  # constants are of float32


def test_a_block_lies_where_its_weight_is_borne(plain_device):
    block = box((3, 3, 3), 0.1, mass=0.1, stiffness=2e3, damping=3.0).translate((0, 0, 0.1))
    simulation = Simulation(block, colliders=[Plane(stiffness=1e3)], device=plain_device)
    simulation.settle(1e-5)
    bottom = simulation.frame().position[block.position[:, 2] < 0.01, 2]
    borne = 1e3 * np.where(-bottom < RAMP, bottom**2 / (2 * RAMP), -bottom - RAMP / 2).sum()
    assert borne == pytest.approx(27 * 0.1 * 9.82, rel=1e-3)  # float32


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: Plane(stiffness=0.0), "stiffness is 0"),
        (lambda: Plane(stiffness=1e3, ramp=0.0), "ramp is 0"),
        (lambda: Plane(dissipation=0.5), "dissipation is 0.5; only an obstacle with a stiffness has it"),
        (lambda: Plane(stiffness=1e3, friction=math.inf), "friction is inf"),
        (lambda: Plane(stiffness=1e3, rest_speed=0.0), "rest_speed is 0"),
        (lambda: Plane(stiffness=1e3, motion=lambda t: (0, 0, t)), "a soft obstacle is fixed"),
        (lambda: thrown(Plane((0.0, 1.0), stiffness=1e3), "cpu"), "normal is (0.0, 1.0)"),
        (
            lambda: thrown(SHAPES["Plane"], "cpu", probes={"force": Probe([0], "contact force")}),
            "contact forces are asked for",
        ),
        (
            lambda: Ensemble(
                box((2, 2, 2), 0.1), 2, colliders=[SHAPES["Plane"]], friction=[0.1, 0.2], device="cpu"
            ),
            "friction differs between worlds, and colliders[0] has a stiffness",
        ),
    ],
)
def test_what_is_wrong_is_said(make, said):
    with pytest.raises(ValueError, match=re.escape(said)):
        make()


def test_it_may_be_entered_at_the_start(plain_device):
    body = System(position=[[0.0, 0, -0.005]], mass=1.0)
    simulation = Simulation(body, colliders=[Plane(stiffness=K)], precision="float64", device=plain_device)
    stored = K * 0.005**3 / (6 * RAMP)
    assert simulation.measure().energy == pytest.approx(stored - 9.82 * 0.005, rel=10 * EPS64)


@pytest.mark.slow
def test_messages_about_hard_obstacles_count_all():
    soft = Plane(offset=-1.0, stiffness=100.0)
    body = System(position=[[3.0, 0, 0], [4.0, 0, 0]], mass=1.0)
    short = Capsule((0.0, 0.0, 0.0), (0.0, 0.0, 1e-25), 0.1)
    with pytest.raises(ValueError, match=r"colliders\[1\]\.end is"):
        Simulation(body, colliders=[soft, short], precision="float32", device="cpu")
    late = Plane(offset=-2.0, motion=lambda t: (0.0, 0.0, 0.0 if t < 0.05 else math.nan))
    with pytest.raises(ValueError, match=r"colliders\[1\]"):
        Simulation(body, colliders=[soft, late], device="cpu").step(10)
