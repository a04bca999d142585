"""Bounds of the fastest rates: above the true eigenvalue, and at most twice it."""

import math

import numpy as np
import problems
import pytest

from msdwarp import SymplecticEuler, System, box, chain, sheet
from msdwarp.engine.diagnostics.rate_bounds import rate_bounds
from msdwarp.integrators.stability import choose_stable

ROUNDING = 1e-12  # eigenvalues of matrices of some hundred rows


def stretched(system: System) -> System:
    """Return the system at twice its width, where springs are stiff across their axis too."""
    return system.replace(position=system.position * np.linspace(2.0, 1.2, system.dim))


random = np.random.default_rng(3)
CONTRASTING = 10.0 ** random.uniform(-2, 2, 36)
SYSTEMS = {
    "pair": chain(2),
    "chain": chain(30, dim=1),
    "chain in space": chain(30),
    "sheet 4": sheet((6, 6), neighbors=4, dim=2),
    "sheet 8": sheet((6, 6), dim=2),
    "sheet in space": sheet((6, 6)),
    "box 6": box((4, 4, 4), neighbors=6),
    "box 26": box((4, 4, 4)),
    "heavy and light": sheet((6, 6), mass=CONTRASTING),
    "hard and soft": sheet((6, 6)).replace(stiffness=10.0 ** random.uniform(-2, 2, 110)),
    "pinned edge": sheet((6, 6)).pin(slice(0, 6)),
    "pinned but for one": box((3, 3, 3)).pin(np.arange(27) != 13),
    "stretched sheet": stretched(sheet((6, 6))),
    "stretched box": stretched(box((4, 4, 4))),
    "distorted box": problems.tumbling_box().replace(position=2 * problems.tumbling_box().position),
}


@pytest.mark.parametrize("system", SYSTEMS.values(), ids=SYSTEMS.keys())
def test_bounds_hold_and_are_at_most_twice_the_truth(system):
    system = system.replace(damping=0.3 * system.stiffness)
    bounds = rate_bounds(system)
    truths = (
        np.linalg.eigvalsh(problems.rate_matrix(system, system.stiffness))[-1],
        np.linalg.eigvalsh(problems.rate_matrix(system, system.damping, across=False))[-1],
    )
    for bound, truth in zip(bounds[:2], truths, strict=True):
        assert truth * (1 - ROUNDING) <= bound <= 2 * truth * (1 + ROUNDING)


def test_bound_of_a_compressed_body_holds():
    # Compressed springs push across their axis, which only slows modes down: no claim of a factor of two.
    system = box((4, 4, 4)).replace(position=0.8 * box((4, 4, 4)).position)
    truth = np.linalg.eigvalsh(problems.rate_matrix(system, system.stiffness))[-1]
    assert truth <= rate_bounds(system)[0]


def test_bound_is_exact_for_an_endless_chain():
    # ω = 2 √(k/m) sin(π mode / 2 count): 4k/m in the limit, which is also the bound.
    assert rate_bounds(chain(30, dim=1, stiffness=7.0, mass=2.0))[0] == pytest.approx(14.0, rel=ROUNDING)
    omega, _ = problems.chain_mode(30, 29, m=2.0, k=7.0)
    matrix = problems.rate_matrix(chain(30, dim=1, mass=2.0), np.full(29, 7.0))
    assert np.linalg.eigvalsh(matrix)[-1] == pytest.approx(omega**2, rel=ROUNDING)


@pytest.mark.parametrize(
    ("shape", "value"),
    [
        ((20, 7, 2), 12.282),
        ((3, 3, 3), 10.956),
        ((5, 5, 5), 14.468),
        ((7, 7, 7), 15.736),
    ],
)
def test_known_lattices(shape, value):
    # λ m/k of the lattices of the report's scenes.
    system = box(shape, stiffness=1.0, mass=1.0)
    truth = np.linalg.eigvalsh(problems.rate_matrix(system, system.stiffness))[-1]
    assert truth == pytest.approx(value, abs=5e-4)  # the digits given
    assert truth <= rate_bounds(system)[0] <= 2 * truth


def test_rates_scale_with_constants_and_masses():
    one = rate_bounds(box((3, 3, 3), stiffness=1.0, damping=1.0, mass=1.0))
    other = rate_bounds(box((3, 3, 3), stiffness=50.0, damping=3.0, mass=0.2))
    rates = np.array(one[:3]) * (50 / 0.2, 3 / 0.2, 3 / 50)
    np.testing.assert_allclose(other[:3], rates, rtol=ROUNDING)


def test_nothing_that_moves_has_no_rate():
    lone = System(position=[[0.0, 0.0]])
    for system in (lone, chain(4, damping=1.0).pin(slice(None)), chain(4, stiffness=0.0)):
        assert rate_bounds(system)[:2] == (0.0, 0.0)
        assert choose_stable(rate_bounds(system), SymplecticEuler(), 60).substeps == 1


def test_coincident_particles_are_no_obstacle():
    # Without an axis a connection has no force, and no rate.
    system = System(position=np.zeros((2, 3)), connections=[[0, 1]], rest_length=1.0, damping=1.0)
    assert all(math.isfinite(rate) for rate in rate_bounds(system))


def test_substeps_leave_the_margin():
    system = box((4, 4, 4), stiffness=1e5, damping=20.0)
    limit = SymplecticEuler().stable_step(rate_bounds(system))
    n = choose_stable(rate_bounds(system), SymplecticEuler(), 60, safety=0.8).substeps
    assert 1 / (60 * n) <= 0.8 * limit < 1 / (60 * (n - 1))
    assert choose_stable(rate_bounds(system), SymplecticEuler(), 60, safety=0.4).substeps in (2 * n - 1, 2 * n)
