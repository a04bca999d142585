"""Laws of springs: their forces, energies and stable steps, by each algorithm; and what is refused."""

import re
from typing import Any

import numpy as np
import problems
import pytest
import warp as wp
from tangles import PRECISIONS, evaluate, moving, tangle
from warp._src.context import Module

from msdwarp import (
    CoulombDamper,
    ExponentialSpring,
    Frame,
    LimitedSpring,
    LinearlyImplicitEuler,
    OwnDamper,
    OwnSpring,
    PolynomialSpring,
    QuadraticDamper,
    Simulation,
    SpringKinds,
    System,
    TensionOnlySpring,
    Trajectory,
    TrajectoryWriter,
    box,
    chain,
    sheet,
)
from msdwarp.engine.diagnostics.rate_bounds import rate_bounds


@wp.func
def cubic(strain: Any):
    return strain + type(strain)(4.0) * strain * strain * strain


@wp.func
def taut(strain: Any, rate: Any, damping: Any):
    return damping * (type(strain)(1.0) + type(strain)(3.0) * strain) * rate


LAWS = {
    "tension": (TensionOnlySpring(), lambda e: np.maximum(e, 0.0), lambda e: np.maximum(e, 0.0) ** 2 / 2),
    "limited": (
        LimitedSpring(0.05, 10.0),
        lambda e: e + 9.0 * np.maximum(e - 0.05, 0.0),
        lambda e: e * e / 2 + 9.0 * np.maximum(e - 0.05, 0.0) ** 2 / 2,
    ),
    "exponential": (
        ExponentialSpring(5.0),
        lambda e: np.expm1(5.0 * e) / 5.0,
        lambda e: np.expm1(5.0 * e) / 25.0 - e / 5.0,
    ),
    "polynomial": (
        PolynomialSpring((1.0, -0.5, 2.0)),
        lambda e: e - 0.5 * e**2 + 2.0 * e**3,
        lambda e: e**2 / 2 - e**3 / 6 + e**4 / 2,
    ),
    "own": (OwnSpring(cubic), lambda e: e + 4.0 * e**3, lambda e: e**2 / 2 + e**4),
}
every_law = pytest.mark.parametrize("name", LAWS)


def strained(system: System) -> tuple[np.ndarray, ...]:
    """Return the ends, axis, length, strain and rate of lengthening of each connection."""
    i, j = system.connections.T
    dx, dv = (one[i] - one[j] for one in (system.position, system.velocity))
    length = np.linalg.norm(dx, axis=1)
    axis = dx / length[:, None]
    return i, j, axis, length, length / system.rest_length - 1, (dv * axis).sum(axis=1)


def damping(resisting: np.ndarray, pull: np.ndarray, name: str | None) -> np.ndarray:
    """Return the forces of dampers beside springs that pull so much: no more than these, if they only pull."""
    return np.clip(resisting, -pull, pull) if name == "tension" else resisting


def expected_forces(system: System, name: str | None, resisting: np.ndarray | None = None) -> np.ndarray:
    """Return the forces of springs that follow a law, by default with linear dampers."""
    i, j, axis, _, strain, rate = strained(system)
    pull = system.stiffness * system.rest_length * (strain if name is None else LAWS[name][1](strain))
    resisting = damping(system.damping * rate, pull, name) if resisting is None else resisting
    pull = (pull + resisting)[:, None] * axis
    total = np.zeros_like(system.position)
    np.add.at(total, i, -pull)
    np.add.at(total, j, pull)
    return total


BODIES = {
    "tangle": tangle(3, 20, ("rest_length", "stiffness", "damping"), damped=True),
    "box": moving(box((4, 3, 3), 1.2, stiffness=30.0, damping=2.0)),
    "undamped": moving(sheet((5, 4), 1.2, stiffness=30.0, dim=2)),
}


@every_law
@pytest.mark.parametrize(
    ("body", "precision"), [("tangle", "float64"), ("box", "float64"), ("box", "float32"), ("undamped", "float32")]
)
@pytest.mark.each_value
def test_forces_follow_the_law(device, body, precision, name):
    system = BODIES[body].replace(spring=LAWS[name][0])
    if precision == "float32":
        rounded = (one.astype(np.float32).astype(float) for one in (system.position, system.velocity))
        system = system.replace(**dict(zip(("position", "velocity"), rounded, strict=True)))
    algorithm = "gather" if body == "tangle" and "stencil" in device else "auto"  # it is no lattice
    found, expected = evaluate(system, device, precision, algorithm), expected_forces(system, name)
    # Sums of a few rounded terms; a strain has the rounding of lengths, which steep laws magnify.
    *_, strain, _ = strained(system)
    steep = np.abs(LAWS[name][1](strain)).max() + 20 * (1 + np.abs(strain).max())
    size = (system.stiffness * system.rest_length).max() * steep + np.abs(expected).max()
    assert np.abs(found - expected).max() < 20 * PRECISIONS[precision] * size


SWEPT = {
    "limited": lambda n: {"spring": LimitedSpring(0.01 + 1e-4 * n, 5.0 + n), "damper": QuadraticDamper(1.0 + n)},
    "polynomial": lambda n: {"spring": PolynomialSpring((1.0, 2.0 + n, 3.0, 4.0, 5.0)[: 2 + n % 4])},
}


@pytest.mark.parametrize("name", ["limited", pytest.param("polynomial", marks=pytest.mark.slow)])
def test_fifty_values_of_a_coefficient_load_no_kernel_after_the_first(monkeypatch, name):
    loaded, load = set(), Module.load

    def load_and_note(module, *given, **named):
        loaded.add(module)
        return load(module, *given, **named)

    monkeypatch.setattr(Module, "load", load_and_note)
    pair = chain(2, 0.11, stiffness=30.0, damping=0.1).with_velocity([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    energies, counts = set(), set()
    for n in range(50):
        simulation = Simulation(pair.replace(rest_length=0.1, **SWEPT[name](n)), device="cpu")
        simulation.step()
        energies.add(simulation.measure().energy)
        counts.add(len(loaded))
    assert len(counts) == 1
    assert len(energies) == 50


def times(factor: float) -> OwnSpring:
    @wp.func
    def law(strain: Any):
        return type(strain)(factor) * strain

    return OwnSpring(law)


@pytest.mark.parametrize(
    "laws",
    [
        (ExponentialSpring(5.0), ExponentialSpring(5.0 + 1e-9)),
        (CoulombDamper(0.4), CoulombDamper(0.4 + 1e-9)),
        (times(0.5), times(0.5 + 1e-9)),
    ],
)
def test_laws_that_differ_in_the_tenth_digit_have_their_own_forces(plain_device, laws):
    # In float64 no number of a law is rounded to float32; and of constants Warp compares kernels by these digits.
    field = "damper" if isinstance(laws[0], CoulombDamper) else "spring"
    one, other = (evaluate(BODIES["box"].replace(**{field: law}), plain_device, "float64") for law in laws)
    assert 1e-12 < np.abs(other - one).max() / np.abs(one).max() < 1e-7


@pytest.mark.slow
@every_law
def test_energy_is_the_integral_of_the_force(plain_device, name):
    system = BODIES["box"].replace(spring=LAWS[name][0])
    simulation = Simulation(system, gravity=0.0, device=plain_device, precision="float64")
    *_, strain, rate = strained(system)
    stored = (system.stiffness * system.rest_length**2 * LAWS[name][2](strain)).sum()
    found = simulation.measure()
    assert found.elastic_energy == pytest.approx(stored, rel=1e-9)  # of Gauss's rule, for the exponential
    pull = system.stiffness * system.rest_length * LAWS[name][1](strain)
    lost = damping(system.damping * rate, pull, name) * rate
    assert found.dissipated_power == pytest.approx(lost.sum(), rel=1e-12)


@pytest.mark.slow
def test_leapfrog_keeps_the_energy_of_several_laws(plain_device):
    body = box((3, 3, 3), 1.0, stiffness=100.0)
    laws = [one for name, (one, *_) in LAWS.items() if name != "own"]
    kinds = SpringKinds(laws, np.arange(body.connection_count) % len(laws))
    problems.assert_leapfrog_keeps_energy(body.replace(spring=kinds), plain_device)


def stiffness_rate(system: System, name: str) -> float:
    """Return the largest eigenvalue of M⁻¹K of springs that follow a law."""
    rest = system.rest_length
    return problems.stiffness_rate(
        system, lambda x: expected_forces(system.replace(position=x, rest_length=rest), name)
    )


@every_law
@pytest.mark.parametrize("stretch", [0.9, 1.0, 1.04, 1.2])
@pytest.mark.each_value
def test_the_bound_of_the_step_holds(name, stretch):
    start = box((3, 3, 3), 1.0, stiffness=100.0).replace(spring=LAWS[name][0])
    system = start.replace(position=start.position * stretch, rest_length=start.rest_length)
    assert stiffness_rate(system, name) <= rate_bounds(system).stiffness * (1 + 1e-6)


def test_a_cable_becomes_taut_without_a_jump_and_never_pushes(plain_device):
    # As Modelica's ElastoGap: its damper pulls or slackens by no more than its spring pulls.
    rates, pulls = np.array([-2.0, 2.0]), []
    for strain in (-1e-6, 1e-6, 0.02, 0.2):
        pair = chain(2, 1.0 + strain, stiffness=100.0, damping=5.0, mass=1.0)
        pair = pair.replace(rest_length=1.0, spring=TensionOnlySpring())
        thrown = (pair.with_velocity([[0.0, 0, 0], [rate, 0, 0]]) for rate in rates)
        pulls.append([-evaluate(one, plain_device, "float64")[1, 0] for one in thrown])
    spring = 100.0 * np.array([0.0, 1e-6, 0.02, 0.2])[:, None]
    expected = spring + np.clip(5.0 * rates, -spring, spring)
    np.testing.assert_allclose(pulls, expected, rtol=0, atol=1e-13 * 100.0)  # rounding of a length of 1 m


@pytest.mark.slow
def test_files_hold_the_laws_but_not_ones_own(tmp_path):
    own = {"damping": 1.0, "damper": OwnDamper(taut, 4.0)}
    for number, changes in enumerate((*({"spring": one} for one, *_ in LAWS.values()), own)):
        system, path = chain(3, 0.1).replace(**changes), tmp_path / f"{number}.vtkhdf"
        with TrajectoryWriter(path, system, fps=60.0) as writer:
            writer.write(Frame(0.0, system.position, system.velocity))
        read = Trajectory(path).system
        if isinstance(system.spring, OwnSpring) or changes is own:
            said = "damper is UnknownDamper" if changes is own else "does not hold a law of one's own"
            with pytest.raises(ValueError, match=said):
                Simulation(read, device="cpu")
        else:
            assert read.spring == system.spring
    assert Simulation(read.replace(damper=own["damper"]), device="cpu").substeps > 0


@pytest.mark.parametrize("spring", ["tension", "own", None])
@pytest.mark.parametrize("body", ["tangle", "box"])
@pytest.mark.each_value
def test_a_damper_that_knows_the_strain(device, body, spring):
    # By each algorithm, with a constant of its own for each spring of the tangle.
    system = BODIES[body].replace(damper=OwnDamper(taut, 4.0))
    system = system if spring is None else system.replace(spring=LAWS[spring][0])
    *_, strain, rate = strained(system)
    pull = system.stiffness * system.rest_length * (strain if spring is None else LAWS[spring][1](strain))
    resisting = damping(system.damping * (1 + 3 * strain) * rate, pull, spring)
    expected = expected_forces(system, spring, resisting)
    algorithm = "gather" if body == "tangle" and "stencil" in device else "auto"  # it is no lattice
    found = evaluate(system, device, "float64", algorithm)
    most = np.abs(pull + resisting).max()
    assert np.abs(found - expected).max() < 1e-11 * most  # sums of some 26 terms
    measured = Simulation(system, gravity=0.0, device="cpu", precision="float64", substeps=1, allow_unstable=True)
    assert measured.measure().dissipated_power == pytest.approx((resisting * rate).sum(), rel=1e-11)


@wp.func
def of_float(strain: float):
    return strain


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: LimitedSpring(-0.1), "strain is -0.1"),
        (lambda: ExponentialSpring(0.0), "exponent is 0"),
        (lambda: PolynomialSpring(()), "must be one to five numbers"),
        (lambda: PolynomialSpring((1.0, float("nan"))), "coefficients[1] is nan"),
        (lambda: OwnSpring(lambda e: e), "it must be a wp.func"),
        (lambda: OwnSpring(of_float), "it must be a wp.func (strain: Any)"),
        (lambda: OwnDamper(cubic), "it must be a wp.func (strain: Any, rate: Any, damping: Any) -> the force [N]"),
        (lambda: OwnDamper(taut, 0.0), "steepest is 0"),
        (lambda: chain(3).replace(spring="tension"), "spring is 'tension'; it must be a Spring"),
        (lambda: chain(3).replace(spring=TensionOnlySpring(), break_force=5.0), "only linear springs have it"),
        (
            lambda: Simulation(
                chain(3, damping=1.0).replace(spring=TensionOnlySpring()),
                integrator=LinearlyImplicitEuler(),
                device="cpu",
            ),
            "it must be an explicit method",
        ),
    ],
)
def test_what_is_wrong_is_said(make, said):
    with pytest.raises(ValueError, match=re.escape(said)):
        make()
