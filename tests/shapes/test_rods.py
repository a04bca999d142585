"""Rods: the elastica, a cantilever, vibrations, and what forces of angles keep."""

import math
import re

import numpy as np
import problems
import pytest
from scipy.optimize import brentq
from scipy.special import ellipe, ellipk
from tangles import PRECISIONS, evaluate

from msdwarp import Angles, Leapfrog, Material, Simulation, System, chain, rod
from msdwarp.engine.diagnostics.rate_bounds import rate_bounds

WIRE = Material(density=1000.0, youngs_modulus=1e8)
LENGTH, RADIUS = 1.0, 0.004
LINE = Angles(particles=[[0, 1, 2]], stiffness=1.0)
RIGIDITY = WIRE.youngs_modulus * math.pi * RADIUS**4 / 4


def tangled(dim: int) -> System:
    random = np.random.default_rng(4)
    position, velocity = random.normal(size=(2, 12, dim))
    particles = np.array([random.choice(12, 3, replace=False) for _ in range(15)])
    angles = Angles(
        particles=particles, stiffness=random.uniform(0.5, 2, 15), damping=random.uniform(0.1, 0.5, 15)
    )
    return System(position=position, velocity=velocity, angles=angles)


def energy(angles: Angles, x: np.ndarray) -> np.ndarray:
    a, b, c = angles.particles.T
    e, f = x[b] - x[a], x[c] - x[b]
    cosine = (e * f).sum(axis=1) / np.sqrt((e * e).sum(axis=1) * (f * f).sum(axis=1))
    return (2 * angles.stiffness * (1 - cosine) / (1 + cosine)).sum()


@pytest.mark.parametrize(
    ("dim", "precision"), [(2, "float64"), (3, "float64"), (3, "float32"), (2, "float32-compensated")]
)
def test_forces_are_the_slope_of_the_energy(device, dim, precision):
    system = tangled(dim)
    x = system.position
    if precision != "float64":
        x = x.astype(np.float32).astype(float)
    still = system.replace(position=x, velocity=np.zeros_like(x))
    found, expected = evaluate(still, device, precision, "gather"), np.zeros_like(x)
    for index in np.ndindex(x.shape):  # a complex step: exact but for rounding
        moved = x.astype(complex)
        moved[index] += 1e-30j
        expected[index] = -energy(system.angles, moved).imag / 1e-30
    # Lines that are almost folded back have large forces, from a difference 1 + cos θ that is rounded.
    assert np.abs(found - expected).max() < 200 * PRECISIONS[precision] * np.abs(expected).max()


@pytest.mark.parametrize("dim", [2, 3])
def test_forces_and_dampers_move_and_turn_nothing(plain_device, dim):
    system = tangled(dim)
    force = evaluate(system, plain_device, "float64", "gather")
    size = np.abs(force).sum()
    assert np.abs(force.sum(axis=0)).max() < 1e-13 * size
    x, f = (np.pad(one, ((0, 0), (0, 3 - dim))) for one in (system.position, force))
    assert np.abs(np.cross(x, f).sum(axis=0)).max() < 1e-13 * size
    # What dampers take is what is measured.
    still = system.replace(velocity=np.zeros_like(system.velocity))
    added = force - evaluate(still, plain_device, "float64", "gather")
    measured = Simulation(system, gravity=0.0, device=plain_device, precision="float64", force_algorithm="gather")
    assert measured.measure().dissipated_power == pytest.approx(-(added * system.velocity).sum(), rel=1e-9)
    assert measured.measure().effect_energy == pytest.approx(energy(system.angles, system.position), rel=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("shortening", [0.1, 0.6])
def test_a_rod_pushed_together_is_the_elastica(plain_device, shortening):
    # With hinged ends: Δ/L = 2 (1 − E/K), w/L = k/K, with elliptic integrals of modulus k (Love, 1927, 263).
    count = 61
    modulus = brentq(lambda k: 2 * (1 - ellipe(k * k) / ellipk(k * k)) - shortening, 1e-6, 0.99)
    straight = rod(count, LENGTH / (count - 1), radius=RADIUS, material=WIRE)
    x = straight.position * (1 - shortening, 1, 1)
    x[:, 1] = 0.3 * np.cos(np.pi * straight.position[:, 0] / LENGTH)  # so that it buckles to this side
    held = straight.replace(position=x, rest_length=straight.rest_length).pin([0, -1])
    simulation = Simulation(held, gravity=0.0, device=plain_device, precision="float64")
    assert simulation.settle(1e-7).converged
    deflection = np.ptp(simulation.frame().position[:, 1])
    # Of second order in the spacing: π²/(24 N²) = 1e-4 of the curvature; it is also shorter by P/(E A) = 4e-5.
    assert deflection == pytest.approx(modulus / ellipk(modulus**2), rel=1e-3)


@pytest.mark.slow
def test_two_pinned_particles_clamp_a_rod_midway_between_them(plain_device):
    error = []
    for count in (11, 21):
        spacing = LENGTH / (count - 1)
        clamped = rod(count, spacing, radius=RADIUS, material=WIRE).pin([0, 1])
        simulation = Simulation(clamped, gravity=0.01, device=plain_device, precision="float64")
        simulation.settle(1e-7)
        weight = WIRE.density * math.pi * RADIUS**2 * 0.01
        beam = weight * ((count - 1.5) * spacing) ** 4 / (8 * RIGIDITY)
        error.append(abs(-simulation.frame().position[-1, 2] / beam - 1))
    # Of second order; from either particle, half a spacing away, the length to the fourth power is off by 10 %.
    assert error[1] < 0.002
    assert error[1] < error[0] / 3


@pytest.mark.slow
def test_a_free_rod_rings_at_its_frequency(plain_device):
    # The first mode of a free beam: (4.730/L)² √(E I/(ρ A)) (Rao, Mechanical Vibrations, 8.5).
    count, beta = 41, 4.73004
    system = rod(count, LENGTH / (count - 1), radius=RADIUS, material=WIRE)
    s = system.position[:, 0] / LENGTH + 0.5
    ratio = (np.cos(beta) - np.cosh(beta)) / (np.sin(beta) - np.sinh(beta))
    mode = np.cos(beta * s) + np.cosh(beta * s) - ratio * (np.sin(beta * s) + np.sinh(beta * s))
    x = system.position + 1e-4 * mode[:, None] * (0, 0, 1)
    omega = beta**2 * math.sqrt(RIGIDITY / (WIRE.density * math.pi * RADIUS**2))
    fps = 40 * omega / (2 * math.pi)
    start = system.replace(position=x, rest_length=system.rest_length)
    simulation = Simulation(
        start, gravity=0.0, integrator=Leapfrog(), fps=fps, device=plain_device, precision="float64"
    )
    heights = []
    for _ in range(80):
        simulation.step()
        heights.append(simulation.frame().position[0, 2])
    expected = x[0, 2] * np.cos(2 * np.pi * np.arange(1, 81) / 40)
    # The discrete rod is slower by some (β/N)²/24 of its frequency: 6e-4, 0.8 % of a turn after two of them.
    np.testing.assert_allclose(heights, expected, atol=0.06 * x[0, 2])


@pytest.mark.parametrize("bent", [0.0, 0.3, 1.0])
def test_the_bound_of_the_step_holds_and_is_near(bent):
    count = 12
    straight = rod(count, 0.1, radius=0.05, material=WIRE)
    x = np.array(straight.position)
    turns = bent * np.arange(count - 1)
    x[1:, :2] = 0.1 * np.cumsum(np.stack([np.cos(turns), np.sin(turns)], axis=1), axis=0)
    x[0, :2] = 0.0
    system = straight.replace(position=x, rest_length=straight.rest_length)
    rest = system.rest_length
    truth = problems.stiffness_rate(
        system, lambda x: evaluate(system.replace(position=x, rest_length=rest), "cpu", "float64")
    )
    assert truth <= rate_bounds(system).stiffness * (1 + 1e-6)
    assert rate_bounds(system).stiffness <= 2.5 * truth


def test_angles_follow_their_particles():
    first, second = (rod(5, 0.1, radius=0.01, material=WIRE) for _ in range(2))
    both = first + second.translate((0, 1, 0)) + chain(4)
    assert len(both.angles) == 6
    assert both.angles.particles[3].tolist() == [5, 6, 7]
    mixed = both.renumbered(np.random.default_rng(0).permutation(both.particle_count))
    assert energy(mixed.angles, mixed.position) == pytest.approx(0.0, abs=1e-20)
    assert energy(both.angles, both.position) == pytest.approx(0.0, abs=1e-20)


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: rod(2, 0.1, radius=0.01, material=WIRE), "count is 2"),
        (lambda: rod(5, 0.1, radius=0.0, material=WIRE), "radius is 0"),
        (lambda: rod(5, 0.1, radius=0.01, material="steel"), "material is 'steel'"),
        (lambda: rod(5, 0.1, radius=0.01, material=WIRE, dim=1), "dim is 1"),
        (lambda: Angles(particles=[[0, 1, 0]], stiffness=1.0), "three different particles"),
        (lambda: Angles(particles=[[0, 1]], stiffness=1.0), "particles has shape (1, 2)"),
        (lambda: Angles(particles=[[0, 1, 2]], stiffness=-1.0), "stiffness is -1"),
        (lambda: chain(2).replace(angles=LINE), "angles.particles[0, 2] is 2"),
        (lambda: chain(3, dim=1).replace(angles=LINE), "the number of coordinates, with angles, is 1"),
    ],
)
def test_what_is_wrong_is_said(make, said):
    with pytest.raises(ValueError, match=re.escape(said)):
        make()
