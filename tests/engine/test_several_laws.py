"""Connections of one system that follow different laws: beside single laws, in statics, and what is refused."""

import math
import re
from typing import Any

import numpy as np
import pytest
import warp as wp
from tangles import evaluate, moving, tangle

from msdwarp import (
    CoulombDamper,
    Damper,
    DamperKinds,
    Ensemble,
    ExponentialSpring,
    Frame,
    LimitedSpring,
    LinearlyImplicitEuler,
    OwnSpring,
    QuadraticDamper,
    Scene,
    Simulation,
    Spring,
    SpringKinds,
    System,
    TensionOnlySpring,
    Trajectory,
    TrajectoryWriter,
    box,
    chain,
    join,
    sheet,
)
from msdwarp.cli.provenance import digest
from msdwarp.engine.diagnostics.rate_bounds import rate_bounds
from msdwarp.engine.springs import force_algorithms as forces
from msdwarp.kernels.springs.gather import gather

SPRINGS = (Spring(), TensionOnlySpring(), LimitedSpring(0.05, 10.0), ExponentialSpring(0.5))
DAMPERS = (Damper(), QuadraticDamper(0.5), CoulombDamper(0.3))
CONSTANTS = ("rest_length", "stiffness", "damping")
BODIES = {
    "kinds": moving(sheet((4, 4), 1.2, stiffness=30.0, damping=2.0)),
    "own": tangle(3, 200, CONSTANTS, damped=True),  # more connections than a byte can number
    "undamped": moving(sheet((4, 4), 1.2, stiffness=30.0)),
}


def stress(law: int, e: np.ndarray) -> np.ndarray:
    """Return s(ε) of one of SPRINGS."""
    return (
        e,
        np.maximum(e, 0.0),
        e + 9.0 * np.maximum(e - 0.05, 0.0),
        np.expm1(0.5 * e) / 0.5,
    )[law]


def energy_over(law: int, e: np.ndarray) -> np.ndarray:
    """Return the integral of s of one of SPRINGS."""
    tensile = np.maximum(e, 0.0)
    return (
        e * e / 2,
        tensile * tensile / 2,
        e * e / 2 + 4.5 * np.maximum(e - 0.05, 0.0) ** 2,
        np.expm1(0.5 * e) / 0.25 - e / 0.5,
    )[law]


def resistance(law: int, rate: np.ndarray) -> np.ndarray:
    """Return the force over b of one of DAMPERS."""
    return (rate, np.minimum(np.abs(rate), 0.5) * rate, np.clip(rate / 0.3, -1.0, 1.0))[law]


@pytest.mark.parametrize("lanes", [False, True], ids=["", "lanes"])
@pytest.mark.parametrize("force_algorithm", ["scatter", "gather"])
@pytest.mark.parametrize("body", BODIES)
@pytest.mark.each_value
def test_forces_are_those_of_each_law(body, force_algorithm, lanes, monkeypatch):
    if lanes:
        monkeypatch.setattr(forces, "gather", lambda *kinds: gather(*kinds[:-1], 1))
    system, random = BODIES[body], np.random.default_rng(5)
    spring, damper = (random.integers(len(laws), size=system.connection_count) for laws in (SPRINGS, DAMPERS))
    mixed = system.replace(spring=SpringKinds(SPRINGS, spring), damper=DamperKinds(DAMPERS, damper))
    i, j = system.connections.T
    dx, dv = (one[i] - one[j] for one in (system.position, system.velocity))
    axis = dx / system.length[:, None]
    rate, size = (dv * axis).sum(axis=1), system.stiffness * system.rest_length
    each = range(len(SPRINGS))
    pull = size * np.choose(spring, [stress(law, system.strain) for law in each])
    resisting = system.damping * np.choose(damper, [resistance(law, rate) for law in range(len(DAMPERS))])
    resisting = np.where(spring == 1, np.clip(resisting, -pull, pull), resisting)  # what only pulls limits it
    stored = size * system.rest_length * np.choose(spring, [energy_over(law, system.strain) for law in each])
    expected = np.zeros_like(system.position)
    np.add.at(expected, i, -(pull + resisting)[:, None] * axis)
    np.add.at(expected, j, (pull + resisting)[:, None] * axis)
    found = evaluate(mixed, "cpu", "float64", force_algorithm)
    # Sums of up to 100 terms in another order.
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-13 * np.abs(expected).max())
    simulation = Simulation(mixed, device="cpu", precision="float64", substeps=1, allow_unstable=True)
    measures = simulation.measure()
    assert measures.elastic_energy == pytest.approx(stored.sum(), rel=1e-9)  # of Gauss's rule, for the exponential
    assert measures.dissipated_power == pytest.approx((resisting * rate).sum(), rel=1e-12)


NET = moving(sheet((4, 4), 0.1, stiffness=40.0, damping=0.2).replace(spring=TensionOnlySpring()), 1)
BALL = moving(box((3, 3, 3), 0.1, stiffness=60.0, damping=0.1), 2).translate((5.0, 0.0, 0.0))


def test_a_net_beside_a_ball_moves_as_alone(device):
    algorithm = "auto" if "stencil" not in device else "gather"  # connections of several laws are no lattice
    options = {"device": device, "precision": "float64", "substeps": 40, "gravity": 0.0}
    several, *alone = (Simulation(each, force_algorithm=algorithm, **options) for each in (NET + BALL, NET, BALL))
    for each in (several, *alone):
        each.step(10)
    expected = np.concatenate([each.frame().position for each in alone])
    # A linear force is k (l − l0) here and k l0 ε there: rounding of 5 m, over 400 substeps.
    np.testing.assert_allclose(several.frame().position, expected, rtol=0, atol=1e-12)
    expected = max(rate_bounds(one).stiffness for one in (NET, BALL))
    assert rate_bounds(NET + BALL).stiffness == pytest.approx(expected, rel=1e-12)  # atomic sums


def test_kinds_of_which_one_is_used_are_that_law():
    rope = chain(6, 0.1, stiffness=50.0, damping=0.1, mass=0.1).pin(0)
    kinds = SpringKinds((LimitedSpring(0.1, 3.0), TensionOnlySpring()), [1] * 5)
    how = {"device": "cpu", "precision": "float64"}
    alone, several = (Simulation(rope.replace(spring=one), **how) for one in (TensionOnlySpring(), kinds))
    for one in (alone, several):
        one.step(20)
    # Other kernels: roundings of half a metre in some hundred substeps.
    np.testing.assert_allclose(several.frame().position, alone.frame().position, rtol=0, atol=1e-12)


def test_a_mast_with_guy_ropes_bears_a_side_load(plain_device):
    # The top stands on a strut at the origin; two ropes go down to the ground at 45°. Pushed to the right, the
    # right rope is slack, and the left one bears the push: T cos 45° = H, N = m g + T sin 45°.
    height, mass, push, k = 2.0, 3.0, 5.0, 1e7
    ends = np.array([[0.0, height], [0.0, 0.0], [-height, 0.0], [height, 0.0]])
    mast = System(
        position=ends,
        mass=[mass, math.inf, math.inf, math.inf],
        connections=[[0, 1], [0, 2], [0, 3]],
        stiffness=k,
        damping=20.0,
        spring=SpringKinds((Spring(), TensionOnlySpring()), [0, 1, 1]),
    )
    simulation = Simulation(mast, gravity=(push / mass, -9.82), device=plain_device, precision="float64")
    simulation.settle(1e-7)
    force = k * (simulation.system.replace(position=simulation.frame().position).strain * mast.rest_length)
    # The strut shortens by N/k, and the top moves aside by about as much: it leans by 2e-6, and N is 7 H.
    tension = push * math.sqrt(2)
    assert force[1] == pytest.approx(tension, rel=5e-5)
    assert force[0] == pytest.approx(-(mass * 9.82 + push), rel=5e-5)
    assert force[2] < 0  # what a linear spring would push with
    assert simulation.measure().elastic_energy == pytest.approx((force[:2] ** 2).sum() / (2 * k), rel=1e-9)


def prism(cable: float, strut: float) -> System:
    """Return a tensegrity prism in equilibrium, by its force densities.

    Three struts between two triangles, one of which is turned by 30°. With the force density q of the three
    vertical cables it is −q in the struts and q/√3 in the triangles (Connelly and Terrell, Globally rigid
    symmetric tensegrities, 1995).
    """
    angle = np.concatenate([np.arange(3) * 2 * np.pi / 3, np.arange(3) * 2 * np.pi / 3 + np.pi / 6])
    position = np.stack([np.cos(angle), np.sin(angle), np.repeat([0.0, 1.5], 3)], axis=1)
    ring = [(0, 1), (1, 2), (2, 0), (3, 4), (4, 5), (5, 3)]
    cables, struts = ([(i, 3 + (i + turn) % 3) for i in range(3)] for turn in (0, 1))  # turned by 30° and 150°
    connections = np.array(ring + cables + struts)
    length = np.linalg.norm(np.subtract(*position[connections.T]), axis=1)
    density = np.repeat([10.0 / math.sqrt(3), 10.0, -10.0], [6, 3, 3])
    stiffness = np.repeat([cable, strut], [9, 3])
    return System(
        position=position,
        connections=connections,
        stiffness=stiffness,
        damping=2.0,
        rest_length=length * (1 - density / stiffness),
        spring=SpringKinds((TensionOnlySpring(), Spring()), np.repeat([0, 1], [9, 3])),
    )


@pytest.mark.slow
@pytest.mark.parametrize("changes", [{"yield_strain": 0.02}, {"break_strain": 0.5}], ids=["yields", "tears"])
def test_worlds_have_the_laws(plain_device, changes):
    net = sheet((4, 4), 0.1, stiffness=40.0, damping=0.2).replace(spring=TensionOnlySpring())
    system = net + box((3, 3, 3), 0.1, stiffness=60.0, damping=0.1).translate((5.0, 0.0, 0.0))
    x = system.position
    system = system.replace(**changes).with_velocity(4.0 * (x - x.mean(axis=0)) * (0.01, 1.0, 1.0))
    ensemble = Ensemble(system, 2, stiffness=[30.0, 60.0], gravity=0.0, device=plain_device, precision="float64")
    ensemble.step(10)
    alone = ensemble.simulation_of(1)
    alone.step(10)
    position = alone.frame().position
    assert np.abs(position - system.position).max() > 0.002
    # On a GPU several threads share a particle of a simulation: another order of sums.
    np.testing.assert_allclose(ensemble.frame().position[1], position, rtol=0, atol=1e-11)


def test_a_file_holds_all_laws(tmp_path):
    system = NET.replace(damper=QuadraticDamper(0.5)) + BALL
    with TrajectoryWriter(tmp_path / "run.vtkhdf", system, fps=60.0) as writer:
        writer.write(Frame(0.0, system.position, system.velocity))
    read = Trajectory(tmp_path / "run.vtkhdf").system
    assert read.spring == system.spring
    assert read.damper == system.damper
    assert read.spring != SpringKinds(system.spring.laws, 1 - system.spring.kind)


def test_laws_follow_their_connections():
    both = chain(3).replace(spring=TensionOnlySpring()) + chain(4) + chain(2).replace(spring=TensionOnlySpring())
    assert both.spring == SpringKinds((TensionOnlySpring(), Spring()), [0, 0, 1, 1, 1, 0])
    turned = both.renumbered(np.arange(8, -1, -1))
    ends = {
        tuple(sorted(8 - pair)): kind for pair, kind in zip(turned.connections, turned.spring.kind, strict=True)
    }
    assert [ends[tuple(pair)] for pair in both.connections] == both.spring.kind.tolist()
    tied = join(both, pairs=[(0, 4), (4, 8)], stiffness=5.0)
    assert tied.spring.kind.tolist() == [*both.spring.kind, 1, 1]  # ties are linear
    scenes = [Scene(system=both), Scene(system=both.replace(spring=SpringKinds(both.spring.laws, [0] * 6)))]
    assert digest(scenes[0]) != digest(scenes[1])


@wp.func
def own(strain: Any):
    return strain


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: SpringKinds((Spring(), Spring()), [0, 1]), "it must be one to 16 different built-in laws"),
        (
            lambda: chain(3).replace(spring=OwnSpring(own)) + chain(3),
            "it must be one to 16 different built-in laws",
        ),
        (lambda: SpringKinds((Spring(), Damper()), [0, 1]), "laws[1] is Damper()"),
        (lambda: SpringKinds(SPRINGS, [0.5, 1.0]), "it must be a whole number for each connection"),
        (lambda: SpringKinds(SPRINGS[:2], [0, 2]), "kind[1] is 2"),
        (lambda: chain(4).replace(spring=SpringKinds(SPRINGS[:2], [0, 1])), "spring has 2 kinds"),
        (
            lambda: chain(3).replace(spring=SpringKinds(SPRINGS[:2], [0, 1]), break_force=5.0),
            "only linear springs have it",
        ),
        (
            lambda: Simulation(NET + BALL, device="cpu", force_algorithm="stencil"),
            "connections follow several laws",
        ),
        (
            lambda: Simulation(NET + BALL, device="cpu", integrator=LinearlyImplicitEuler()),
            "it must be an explicit method",
        ),
    ],
)
def test_what_is_wrong_is_said(make, said):
    with pytest.raises(ValueError, match=re.escape(said)):
        make()
