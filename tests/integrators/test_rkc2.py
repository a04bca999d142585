"""Runge-Kutta-Chebyshev: its stability polynomial, what is said of it, and its stages as they run."""

import math

import modes
import numpy as np
import pytest

from msdwarp import RKC2, Simulation, System, stability_limit
from msdwarp.engine.diagnostics.rate_bounds import Rates
from msdwarp.integrators.rkc2 import MOST_AUTOMATIC_STAGES, disc_reach, real_reach, tableau

every_number = pytest.mark.parametrize("stages", [2, 3, 4, 5, 6, 10, 20])


def polynomial(stages: int, z: complex) -> complex:
    """Return R(z) by the reference of modes.py, which takes a real matrix: z = x + iy as x + yJ, J² = −1."""
    x, y = complex(z).real, complex(z).imag
    matrix = modes.rkc2_matrix(stages, np.array([[x, -y], [y, x]]))
    return complex(matrix[0, 0], matrix[1, 0])


def by_tableau(stages: int, z: complex) -> complex:
    """Return R(z) by the stages as the package has their coefficients."""
    rows = tableau(stages)
    lower = np.vstack([np.zeros(stages), rows[:-1]])
    return 1 + z * (rows[-1] @ np.linalg.solve(np.eye(stages) - z * lower, np.ones(stages)))


@every_number
def test_stages_make_the_polynomial(stages):
    for z in (-0.3, -0.9 * real_reach(stages), -0.5 + 0.4j, -1.0 + 1.5j, 0.7j):
        # T_s is evaluated near 1 by recurrences, which lose s² roundings.
        assert by_tableau(stages, z) == pytest.approx(polynomial(stages, z), abs=1e-14 * stages**2)


@every_number
def test_polynomial_is_the_exponential_to_order_two(stages):
    for z in 1e-3 * np.exp(1j * np.linspace(0, 2 * math.pi, 7)):
        # What is left is (1/6 − c) z³ with 0 < c < 1/6.
        assert abs(by_tableau(stages, z) - (1 + z + z**2 / 2)) < 1e-9 / 6


@every_number
def test_real_reach_is_right(stages):
    reach = real_reach(stages)
    inside = -reach * np.linspace(0.001, 1, 1000)
    # Damped by ε: |R| stays below 1 by a good part of ε where it swings.
    assert max(abs(polynomial(stages, z)) for z in inside) < 1
    beyond = abs(polynomial(stages, -1.03 * reach))
    if stages % 2 == 0:
        assert beyond > 1
        assert abs(polynomial(stages, -1.001 * reach)) < abs(polynomial(stages, -1.01 * reach))
    # An odd polynomial leaves through −1 and a little later: stated is the end of its even ripple.
    assert abs(polynomial(stages, -1.3 * reach)) > 1


@pytest.mark.parametrize("stages", [3, 4, 5, 6, 10, 20, 40])
def test_real_reach_is_documented(stages):
    # 0.653 (s² − 1), as ε = 2/13 gives in the limit of many stages.
    assert real_reach(stages) == pytest.approx(0.653 * (stages**2 - 1), rel=0.01)


@every_number
def test_disc_reach_is_right(stages):
    radius = disc_reach(stages)
    angles = np.linspace(0, 2 * math.pi, 401)

    def most(r: float) -> float:
        return max(abs(polynomial(stages, r * (np.exp(1j * a) - 1))) for a in angles)

    # At 0 itself R = 1, hence the roundings; every smaller disc is inside.
    for share in (0.1, 0.5, 0.9, 0.999):
        assert most(share * radius) <= 1 + 1e-12
    assert most(1.002 * radius) > 1 + 1e-9


@pytest.mark.parametrize("stages", [2, 3, 6])
def test_substep_on_the_circle_multiplies_by_the_polynomial(stages):
    # A pair with b = r k whose eigenvalues lie on the circle: stable just within, unstable just beyond.
    k, m, radius = 80.0, 0.5, disc_reach(stages)
    angles = np.linspace(0.02, math.pi, 400)
    sizes = [abs(polynomial(stages, 1.01 * radius * (np.exp(1j * a) - 1))) for a in angles]
    angle = angles[int(np.argmax(sizes))]  # where the disc is first left
    # μ = −ζω ± iω√(1 − ζ²) = (−1 + e^{ia})/r with ω = 2 sin(a/2)/r.
    ratio = 2 * math.sin(angle / 2) / math.sqrt(2 * k / m)
    pair = System(position=[[0.0, 0, 0], [1, 0, 0]], mass=m, connections=[[0, 1]], stiffness=k, damping=ratio * k)
    mode, method = modes.Mode(pair), RKC2(stages)
    for share, stable in ((0.99, True), (1.01, False)):
        h = share * radius * ratio
        found = mode.run(method, h, 200, np.array([1e-8, 0.0]))
        theory = modes.radius(method, h, mode.p, mode.q)
        size = abs(polynomial(stages, share * radius * (np.exp(1j * angle) - 1)))
        assert theory == pytest.approx(size, rel=1e-12)
        assert (theory <= 1) == stable
        expected = np.linalg.matrix_power(modes.amplification(method, h * h * mode.p, h * mode.q), 200) @ found[0]
        # 200 substeps of roundings of 1e-16 m are 2e-6 of the start, and the matrix's power loses as much.
        assert found[-1] == pytest.approx(expected, abs=2e-6 * (1e-8 + np.linalg.norm(expected)))


@pytest.mark.parametrize("stages", [2, 3, 6])
def test_stable_step_is_the_smaller_of_both_reaches(stages):
    method = RKC2(stages)
    q, r = 50.0, 0.3
    assert method.stable_step(Rates(q / r, q, r)) == min(real_reach(stages) / q, disc_reach(stages) * r)
    assert method.stable_step(Rates(100.0, 0.0, 0.0)) == 0.0  # without dampers no step is stable
    assert method.stable_step(Rates(0.0, q, math.inf)) == real_reach(stages) / q


def test_stages_left_open_are_the_fewest_that_are_stable():
    soft = modes.SCENES["soft cube"]()
    limits = {s: stability_limit(soft, RKC2(s)) for s in range(2, MOST_AUTOMATIC_STAGES + 1)}
    assert list(limits.values()) == sorted(limits.values())
    for substeps in (8, 12, 20, 40):
        h = 1 / (60 * substeps)
        fewest = next((s for s, limit in limits.items() if limit >= h), None)
        if fewest is None:
            continue
        simulation = Simulation(soft, integrator=RKC2(), substeps=substeps, device="cpu")
        assert simulation.integrator.evaluations == fewest
    automatic = Simulation(soft, integrator=RKC2(), device="cpu")
    assert automatic.dt <= 0.8 * limits[MOST_AUTOMATIC_STAGES]


@pytest.mark.parametrize("stages", [0, 1, 41, 2.5])
def test_bad_number_of_stages_is_named(stages):
    with pytest.raises(ValueError, match=f"stages is {stages}"):
        RKC2(stages)
