"""Growth past the stability limit: equal to the spectral radius of linear theory, method by method."""

import math

import modes
import numpy as np
import pytest
from modes import METHODS, SCENES

from msdwarp import RKC2, ExplicitEuler, Leapfrog, SymplecticEuler, System, box, stability_limit
from msdwarp.engine.diagnostics.rate_bounds import Rates

SEED = 1e-8
"""Of positions of 10 m a rounding is 1e-15 m, 1e-7 of this; bent springs answer a share of 1e-8 otherwise."""
every_method = pytest.mark.parametrize("method", METHODS.values(), ids=METHODS.keys())
every_scene = pytest.mark.parametrize("scene", SCENES)


def seed(matrix: np.ndarray) -> tuple[complex, np.ndarray, np.ndarray]:
    """Return the largest eigenvalue, a real start that holds its eigenvector, and the left eigenvector."""
    values, vectors = np.linalg.eig(matrix)
    k = int(np.argmax(np.abs(values)))
    start = vectors[:, k].real / np.abs(vectors[:, k].real).max()
    return values[k], SEED * start, np.linalg.inv(vectors)[k]


@pytest.mark.slow
@every_scene
@every_method
@pytest.mark.parametrize("share", [1.02, 1.05, 1.10])
def test_past_the_limit_a_mode_grows_by_the_spectral_radius(method, scene, share):
    mode = modes.fastest(scene)
    h = share * modes.limit(method, mode.p, mode.q)
    value, start, left = seed(modes.amplification(method, h * h * mode.p, h * mode.q))
    assert abs(value) > 1
    # So many substeps that it grows at most a hundredfold.
    steps = min(20, max(2, int(math.log(100) / math.log(abs(value)))))
    found = mode.run(method, h, steps, start)
    # (x, u) projected on an eigenvector is multiplied by exactly its eigenvalue in each substep.
    growth = (abs(found[-1] @ left) / abs(found[0] @ left)) ** (1 / steps)
    # Roundings are 1e-7 of the seed and are amplified at most as it is; the projection, ill-conditioned near
    # the limit, may lose another factor of ten.
    assert growth == pytest.approx(abs(value), abs=1e-6)


@pytest.mark.slow
@every_scene
@every_method
def test_short_of_the_limit_it_stays_bounded(method, scene):
    mode = modes.fastest(scene)
    h = 0.98 * modes.limit(method, mode.p, mode.q)
    matrix = modes.amplification(method, h * h * mode.p, h * mode.q)
    _, start, _ = seed(matrix)
    found = mode.run(method, h, 150, start)
    # Aⁿ = V Λⁿ V⁻¹ with |Λ| ≤ 1; roundings, 1e-7 each, are bounded in the same way.
    bound = np.linalg.cond(np.linalg.eig(matrix)[1]) * np.linalg.norm(start)
    assert np.linalg.norm(found, axis=1).max() <= bound * (1 + 150 * 1e-7)


@every_scene
def test_limits_have_their_closed_forms(scene):
    # Theory against theory: the first departure of the spectral radius from 1, found by search.
    mode = modes.fastest(scene)
    p, q = mode.p, mode.q
    for method, weight in ((SymplecticEuler(), 2), (Leapfrog(), 2), (Leapfrog(damper_extrapolation=0.5), 4)):
        h = modes.limit(method, p, q)
        assert h * h * p + weight * h * q == pytest.approx(4, rel=1e-6)
        assert method.stable_step(Rates(p, q, q / p)) == pytest.approx(h, rel=1e-6)
    # Where the fastest mode oscillates a determinant of 1, else an eigenvalue of −1; and with b = r k all
    # slower modes are bounded by the former alone.
    h = modes.limit(ExplicitEuler(), p, q)
    if h * q < 2:
        assert h == pytest.approx(q / p, rel=1e-6)
    else:
        assert 2 * h * q == pytest.approx(4 + h * h * p, rel=1e-6)
    stated = ExplicitEuler().stable_step(Rates(p, q, q / p))
    assert stated <= h * (1 + 1e-6)
    assert all(modes.radius(ExplicitEuler(), stated, share * p, share * q) <= 1 + 1e-12 for share in (0.1, 0.5, 1))


@pytest.mark.parametrize("h", [1e-5, 1e-4, 1e-3])
def test_explicit_euler_grows_without_damping_at_every_step(h):
    mode = modes.Mode(box((3, 3, 3), stiffness=1e4))
    alpha = h * h * mode.p
    steps = 40
    found = mode.run(ExplicitEuler(), h, steps, np.array([SEED, 0.0]))
    size = np.hypot(math.sqrt(alpha) * found[:, 0], found[:, 1])  # h times the root of twice its energy
    # Every substep multiplies it by √(1 + α): exact but for 1e-7 of rounding, over 40 substeps.
    assert (size[-1] / size[0]) ** (1 / steps) == pytest.approx(math.sqrt(1 + alpha), abs=1e-8)


DAMPED = METHODS | {"rkc2": RKC2(stages=2)}  # whose reach on the real axis is exact, as with any even number


@pytest.mark.parametrize("method", DAMPED.values(), ids=DAMPED.keys())
def test_damper_alone_past_its_limit(method):
    # Two particles: the speed apart is multiplied by R(−β), β = 2 h b/m.
    b, m = 3.0, 0.5
    pair = System(position=[[0.0, 0, 0], [1, 0, 0]], mass=m, connections=[[0, 1]], stiffness=0.0, damping=b)
    q = 2 * b / m
    h_limit = stability_limit(pair, method)
    reach = {"explicit euler": 2.0, "rk4": 2.785, "rkc2": None, "leapfrog extrapolated": 1.0}
    name = next(key for key, value in DAMPED.items() if value == method)
    if reach.get(name, 2.0) is not None:
        assert h_limit * q == pytest.approx(reach.get(name, 2.0), rel=1e-12)
    for share in (0.97, 1.03):
        h = share * h_limit
        run = modes.Run(pair.with_velocity([[SEED, 0, 0], [-SEED, 0, 0]]), method, h)
        speeds = [SEED]
        for _ in range(60):
            run.step()
            speeds.append(abs(run.state.v.numpy()[0, 0]))
        growth = (speeds[-1] / speeds[40]) ** (1 / 20)
        # Velocities know nothing of positions here. Of the extrapolation's two eigenvalues, near −1 and ½, the
        # other's share is about 2⁻⁴⁰ after forty substeps.
        theory = np.abs(np.linalg.eigvals(modes.amplification(method, 0.0, h * q)[1:, 1:])).max()
        assert growth == pytest.approx(theory, abs=1e-6)
        assert (growth > 1) == (share > 1)


@pytest.mark.parametrize("masses", [(1.0, 1e-3), (1e-3, 1.0), (1.0, 1000.0)])
def test_unequal_pair_has_the_reduced_mass(masses):
    k = 50.0
    pair = System(position=[[0.0, 0, 0], [1, 0, 0]], mass=masses, connections=[[0, 1]], stiffness=k)
    mode = modes.Mode(pair)
    p = k * (1 / masses[0] + 1 / masses[1])
    assert mode.p == pytest.approx(p, rel=1e-12)
    # The bound takes the lighter particle for both: at most a factor of two in p, never the other way.
    assert math.sqrt(0.5) <= stability_limit(pair, SymplecticEuler()) / (2 / math.sqrt(p)) <= 1 + 1e-12
