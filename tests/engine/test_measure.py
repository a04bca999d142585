"""Measures: against NumPy sums over frames, closed forms, and the balance of energy and power."""

import math

import numpy as np
import problems
import pytest
from scipy.integrate import simpson

from msdwarp import RK4, Leapfrog, Simulation, SymplecticEuler, System, box

GRAVITY = (1.5, -2.0, -9.82)
EXTRAPOLATED = Leapfrog(damper_extrapolation=0.5)


def bag(dim: int) -> System:
    """Return particles of many masses, some pinned, at random places with random connections."""
    random = np.random.default_rng(7)
    mass = random.uniform(0.1, 3.0, 40)
    ends = np.array([random.choice(40, 2, replace=False) for _ in range(90)])
    return System(
        position=random.normal(size=(40, dim)),
        velocity=random.normal(size=(40, dim)),
        mass=mass,
        connections=ends,
        rest_length=random.uniform(0.5, 2.0, 90),
        stiffness=random.uniform(0.0, 9.0, 90),
        damping=random.uniform(0.0, 2.0, 90),
    ).pin([3, 17, 39])


def sums(system: System, gravity: np.ndarray) -> dict[str, np.ndarray]:
    """Return what the measures are, by NumPy in float64."""
    free = np.isfinite(system.mass)
    m, x, v = system.mass[free], system.position[free], system.velocity[free]
    i, j = system.connections.T
    dx, dv = system.position[i] - system.position[j], system.velocity[i] - system.velocity[j]
    length = np.linalg.norm(dx, axis=1)
    closing = (dx * dv).sum(axis=1) / length
    p = m[:, None] * v
    turn = {1: lambda: np.zeros((1, 0)), 2: lambda: x[:, :1] * p[:, 1:] - x[:, 1:] * p[:, :1]}
    return {
        "kinetic_energy": 0.5 * (m * (v**2).sum(axis=1)).sum(),
        "elastic_energy": 0.5 * (system.stiffness * (length - system.rest_length) ** 2).sum(),
        "gravitational_energy": -(m * (x @ gravity)).sum(),
        "dissipated_power": (system.damping * closing**2).sum(),
        "momentum": p.sum(axis=0),
        "angular_momentum": turn.get(system.dim, lambda: np.cross(x, p))().sum(axis=0),
        "largest_strain": np.abs(length / system.rest_length - 1).max(),
    }


@pytest.mark.parametrize("precision", ["float32", "float64"])
@pytest.mark.parametrize("dim", [1, 2, 3])
@pytest.mark.parametrize("integrator", [SymplecticEuler(), Leapfrog()], ids=["euler", "leapfrog"])
@pytest.mark.each_value
def test_measures_are_the_sums_over_the_frame(device, integrator, dim, precision):
    gravity = np.array(GRAVITY[-dim:])
    simulation = Simulation(
        bag(dim), gravity=gravity, integrator=integrator, fps=100, device=device, precision=precision
    )
    eps = {"float32": problems.EPS32, "float64": problems.EPS64}[precision]
    for _ in range(3):
        measures, now = simulation.measure(), simulation.snapshot()
        # Frames are what measures sum, in float64: constants alone are rounded to the precision, each sum by
        # a rounding or two of terms that add up to at most 2000 (J, W, kg m/s).
        for name, value in sums(now, gravity).items():
            np.testing.assert_allclose(getattr(measures, name), value, rtol=0, atol=2000 * 2 * eps, err_msg=name)
        parts = measures.kinetic_energy + measures.elastic_energy + measures.gravitational_energy
        assert measures.energy == parts
        simulation.step(2)


def test_what_is_pinned_counts_for_nothing():
    # Weight and inertia of a pin are the world's; its spring counts. Every number is exact in binary.
    system = System(
        position=[[0.0, 0, 50], [0, 0, 48.5]],
        mass=[math.inf, 2.0],
        connections=[[0, 1]],
        rest_length=1.0,
        stiffness=8.0,
    )
    measures = Simulation(system, gravity=10.0, device="cpu", precision="float64").measure()
    assert measures.kinetic_energy == 0.0
    assert measures.elastic_energy == 0.5 * 8 * 0.5**2
    assert measures.gravitational_energy == 2 * 10 * 48.5
    assert measures.largest_strain == 0.5


def test_closed_forms_of_a_pair():
    # Where it is compared exactly all numbers on the way are whole, or halves.
    pair = System(
        position=[[1.0, 0, 0], [-1, 0, 0]],
        velocity=[[3.0, 4, 0], [-3, -4, 0]],
        mass=0.5,
        connections=[[0, 1]],
        rest_length=1.6,
        stiffness=10.0,
        damping=7.0,
    )
    measures = Simulation(pair, gravity=0.0, device="cpu", precision="float64").measure()
    assert measures.kinetic_energy == 2 * 0.5 * 0.5 * 25
    assert measures.elastic_energy == pytest.approx(0.5 * 10 * 0.4**2, rel=1e-15)
    assert measures.dissipated_power == 7 * 6**2  # only the speed along the axis
    np.testing.assert_array_equal(measures.momentum, (0, 0, 0))
    np.testing.assert_array_equal(measures.angular_momentum, (0, 0, 2 * 0.5 * 4))
    assert measures.largest_strain == pytest.approx(0.25, rel=1e-15)


@pytest.mark.parametrize("dim", [2, 3])
def test_free_flight_changes_momenta_as_gravity_says(device, dim):
    gravity = np.array(GRAVITY[-dim:])
    system = bag(dim)
    system = system.replace(mass=np.where(np.isinf(system.mass), 1.0, system.mass))
    simulation = Simulation(
        system, gravity=gravity, integrator=Leapfrog(), fps=64, device=device, precision="float64"
    )
    before = simulation.measure()
    simulation.step(64)
    after, mass = simulation.measure(), system.mass.sum()
    # Leapfrog is exact for both: internal forces are central, gravity is constant. 64 frames of a few substeps
    # with roundings of sums below 2000.
    np.testing.assert_allclose(after.momentum, before.momentum + mass * gravity, rtol=0, atol=1e-9)
    # About the centre of mass nothing turns it: L − c × p is kept.
    own = []
    for measures, now in ((before, system), (after, simulation.snapshot())):
        c, p = now.center_of_mass, measures.momentum
        orbital = np.cross(c, p) if dim == 3 else np.array([c[0] * p[1] - c[1] * p[0]])
        own.append(measures.angular_momentum - orbital)
    np.testing.assert_allclose(own[1], own[0], rtol=0, atol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("integrator", "order", "counts"),
    [
        (SymplecticEuler(), 1, (400, 800, 1600)),
        (EXTRAPOLATED, 2, (100, 200, 400)),
        (RK4(), 4, (50, 100, 200)),
    ],
    ids=["euler", "leapfrog extrapolated", "rk4"],
)
def test_energy_lost_is_the_dissipated_power(integrator, order, counts):
    # E(t) − E(0) + ∫ P dt is 0 along the exact motion, and of the method's order along a computed one;
    # Simpson's rule is of order 4.
    misses, lost = [], 0.0
    for n in counts:
        simulation = Simulation(
            problems.tumbling_box(damping=0.2),
            gravity=2.0,
            integrator=integrator,
            fps=2 * n,
            substeps=1,
            device="cpu",
            precision="float64",
        )
        record = [simulation.measure()]
        for _ in range(n):  # 0.5 s
            simulation.step()
            record.append(simulation.measure())
        lost = simpson([r.dissipated_power for r in record], dx=1 / (2 * n))
        misses.append(abs(record[-1].energy - record[0].energy + lost))
        assert lost > 0.05 * record[0].elastic_energy  # there is something to balance
    slope = -np.polyfit(np.log(counts), np.log(misses), 1)[0]
    # A quantity of order p may by chance converge faster, never slower; 0.3 for the next order's bend.
    assert slope > order - 0.3
    assert misses[-1] < 0.02 * lost


def test_compensated_measures_are_those_of_the_true_positions():
    body = box((3, 3, 3), 0.1, mass=0.01, stiffness=400.0).translate((1000.0, 0, 0))
    strain = {
        precision: Simulation(body, gravity=0.0, precision=precision, device="cpu").measure().largest_strain
        for precision in ("float32", "float32-compensated")
    }
    # Positions at 1 km are rounded by up to 3e-5 m, a few 1e-4 of the spacing; rest lengths by half of 1.2e-7.
    assert strain["float32"] > 1e-4
    assert strain["float32-compensated"] <= 0.6e-7
