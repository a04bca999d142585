"""Integrators: order, closed forms, invariants, reversibility and the stable step that each states."""

import math

import numpy as np
import problems
import pytest
import warp as wp
from modes import METHODS
from springs import simulate

from msdwarp import RK4, RKC2, ExplicitEuler, Integrator, Leapfrog, SymplecticEuler, System, chain
from msdwarp.engine.diagnostics.rate_bounds import Rates
from msdwarp.engine.model.model import Model
from msdwarp.engine.model.state import State

EULER, LEAPFROG, RUNGE_KUTTA = SymplecticEuler(), Leapfrog(), RK4()
EXTRAPOLATED = Leapfrog(damper_extrapolation=0.5)
every_integrator = pytest.mark.parametrize(
    "integrator", [EULER, LEAPFROG, RUNGE_KUTTA], ids=["symplectic euler", "leapfrog", "rk4"]
)
kick_drift = pytest.mark.parametrize("integrator", [EULER, LEAPFROG], ids=["symplectic euler", "leapfrog"])


def run(system: System, integrator: Integrator, device: str, *, frames: int = 1, **options) -> System:
    """Return the system after so many frames in float64."""
    # Short runs of hardly damped bodies, for which these two are not made.
    unstable = isinstance(integrator, RKC2 | ExplicitEuler)
    simulation = simulate(system, device, integrator=integrator, allow_unstable=unstable, **options)
    simulation.step(frames)
    return simulation.snapshot()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("integrator", "damping", "order", "counts"),
    [
        # A damper sees the leapfrog's velocity of half a substep ago, which leaves it order 1.
        (EULER, 0.0, 1, (160, 240, 320, 480, 640)),
        (EULER, 0.05, 1, (160, 240, 320, 480, 640)),
        (LEAPFROG, 0.0, 2, (40, 60, 80, 120, 160)),
        (LEAPFROG, 0.05, 1, (160, 240, 320, 480, 640)),
        (EXTRAPOLATED, 0.0, 2, (40, 60, 80, 120, 160)),
        (EXTRAPOLATED, 0.05, 2, (40, 60, 80, 120, 160)),
        (RUNGE_KUTTA, 0.0, 4, (40, 60, 80, 120, 160)),
        (RUNGE_KUTTA, 0.05, 4, (40, 60, 80, 120, 160)),
        (RKC2(2), 0.05, 2, (40, 60, 80, 120, 160)),
        (RKC2(3), 0.05, 2, (40, 60, 80, 120, 160)),
        (RKC2(6), 0.05, 2, (40, 60, 80, 120, 160)),
        (ExplicitEuler(), 0.0, 1, (320, 480, 640, 960, 1280)),
        (ExplicitEuler(), 0.05, 1, (320, 480, 640, 960, 1280)),
    ],
    ids=lambda value: repr(value) if isinstance(value, Integrator) else None,
)
def test_order_of_convergence(device, integrator, damping, order, counts):
    system, duration = problems.tumbling_box(damping=damping), 0.5
    x, v = problems.reference(system, duration, gravity=2.0)
    errors = []
    for n in counts:
        end = run(system, integrator, device, h=duration / n, substeps=n, gravity=2.0)
        errors.append(np.hypot(np.linalg.norm(end.position - x), 0.05 * np.linalg.norm(end.velocity - v)))
    slope = -np.polyfit(np.log(counts), np.log(errors), 1)[0]
    # hω is at most 0.3 for the fastest mode here, so that terms of the next order bend the slope little.
    # (Explicit Euler's error grows as exp(hω²t/2) does: it needs hω of 0.04.)
    assert slope == pytest.approx(order, abs=0.15)


@every_integrator
@pytest.mark.parametrize("damping", [0.0, 1.0], ids=["undamped", "damped"])
def test_oscillator_follows_the_closed_form(device, integrator, damping):
    pair = problems.Oscillator(b=damping)
    h, t = 1 / 2000, 1.0
    x, v = pair.exact(t)
    end = run(pair.system(), integrator, device, h=h, substeps=200, frames=10)
    # Undamped, the phase errs by (hω)² ωt / 24 (kick-drift) or (hω)⁴ ωt / 120 (RK4). Symplectic Euler's
    # velocity lags by h/2, its position by hω/2 of an amplitude; and a damper one step or half a step
    # late changes the decay by at most h(γ² + γω) t.
    w, g = pair.omega, pair.gamma
    error = {
        EULER: h * w / 2 + (h * w) ** 2 * w * t / 24 + h * g * (g + w) * t,
        LEAPFROG: (h * w) ** 2 * (1 + w * t) / 8 + h * g * (g + w) * t,
        RUNGE_KUTTA: (h * w) ** 4 * (1 + w * t) / 60,
    }[integrator]
    atol = error * pair.extension
    np.testing.assert_allclose(end.position, x, rtol=0, atol=atol)
    np.testing.assert_allclose(end.velocity, v, rtol=0, atol=atol * w)


@every_integrator
def test_free_fall_is_each_methods_own(device, integrator):
    # Two particles that know nothing of each other, with velocities of their own.
    system = System(position=[[1.0, 2, 3], [0, 0, -4]], velocity=[[0.5, -1, 20], [0, 3, 0]])
    h, n, g = 1 / 64, 128, 9.82  # h and the times are exact in binary
    end = run(system, integrator, device, h=h, substeps=32, frames=4, gravity=g)
    t = n * h
    velocity = system.velocity - [0, 0, g * t]
    lag = h * t / 2 if integrator == EULER else 0.0  # Σ h² k over k = 1 … n is t²/2 + h t/2
    position = system.position + t * system.velocity - [0, 0, g * (t * t / 2 + lag)]
    # 128 substeps, each rounding numbers of up to 40: 128 · 40 · ε = 1e-12.
    np.testing.assert_allclose(end.velocity, velocity, rtol=0, atol=1e-12)
    np.testing.assert_allclose(end.position, position, rtol=0, atol=1e-12)


@pytest.mark.slow
@kick_drift
def test_oscillator_keeps_its_discrete_energy(device, integrator):
    # With q = hω, x and v of the relative motion: v² + ω²x² − hω²xv is an invariant of symplectic Euler,
    # v² + ω²x²(1 − q²/4) of leapfrog, exactly. Energy itself then stays within q/2 or q²/4 of its start.
    pair = problems.Oscillator()
    h, w = 0.4 / pair.omega, pair.omega
    system = pair.system()

    def invariant(s: System) -> float:
        x = np.linalg.norm(s.position[0] - s.position[1]) - pair.rest_length
        v = (s.velocity[0] - s.velocity[1]) @ pair.axis
        if integrator == EULER:
            return v * v + w * w * x * x - h * w * w * x * v
        return v * v + w * w * x * x * (1 - (h * w) ** 2 / 4)

    simulation = simulate(system, device, h=h, substeps=7, integrator=integrator)
    start, energy = invariant(system), problems.energy(system)
    for _ in range(2000):
        simulation.step()
        now = simulation.snapshot()
        # 14 000 substeps: a random walk would leave √14000 ε; roundings of one sign 14000 · 8 · ε = 2e-11.
        assert invariant(now) == pytest.approx(start, rel=2e-11)
        # v² + ω²x² ∓ … differ by at most the share q/2 = 0.2 or q²/4 = 0.04, at either end.
        share = 0.2 if integrator == EULER else 0.04
        assert (1 - share) / (1 + share) < problems.energy(now) / energy < (1 + share) / (1 - share)


def test_leapfrog_is_reversible(device):
    system = problems.tumbling_box()
    forth = run(system, LEAPFROG, device, h=1 / 200, substeps=50, frames=4, gravity=2.0)
    back = run(
        forth.with_velocity(-forth.velocity), LEAPFROG, device, h=1 / 200, substeps=50, frames=4, gravity=2.0
    )
    assert np.abs(forth.position - system.position).max() > 0.5
    # 400 substeps round numbers of up to 25, and the motion stretches a rounding a hundredfold in 1 s.
    atol = 400 * 25 * problems.EPS64 * 100
    np.testing.assert_allclose(back.position, system.position, rtol=0, atol=atol)
    np.testing.assert_allclose(-back.velocity, system.velocity, rtol=0, atol=25 * atol)


def rk4_polynomial(z: complex | np.ndarray) -> complex | np.ndarray:
    """Return R(z) = 1 + z + z²/2 + z³/6 + z⁴/24, by which RK4 multiplies a mode with eigenvalue z/h."""
    return 1 + z + z**2 / 2 + z**3 / 6 + z**4 / 24


def rk4_radius(h: float, stiffness_rate: float, damping_rate: float) -> float:
    """Return the largest spectral radius of RK4 for x'' = −p x − q x' with p and q up to the given rates."""
    p = stiffness_rate * np.linspace(0, 1, 101)[:, None]
    q = damping_rate * np.linspace(0, 1, 101)
    root = np.sqrt(q**2 - 4 * p + 0j)
    return max(np.abs(rk4_polynomial(h * z)).max() for z in ((-q + root) / 2, (-q - root) / 2))


@pytest.mark.parametrize("ratio", [0.0, 0.1, 0.3, 0.5, 0.7, 0.9, 1.0, 1.5, 3.0, 30.0])
def test_rk4_stable_step_is_the_largest_for_these_rates_to_8_percent(ratio):
    stiffness_rate, damping_rate = 400.0, 2 * ratio * 20.0
    h = RUNGE_KUTTA.stable_step(Rates(stiffness_rate, damping_rate, 0.0))
    # It holds whichever modes a system has: 2.615 and 2.785 round down, and R itself rounds by a few ε.
    assert rk4_radius(h, stiffness_rate, damping_rate) <= 1 + 1e-12
    # Beyond it by 8 % (2.828/2.615 = 1.0815) there are modes of such rates that grow.
    assert rk4_radius(1.082 * h, stiffness_rate, damping_rate) > 1


@every_integrator
def test_without_forces_any_step_is_stable(integrator):
    assert integrator.stable_step(Rates(0.0, 0.0, math.inf)) == math.inf


@pytest.mark.parametrize("integrator", METHODS.values(), ids=METHODS.keys())
def test_a_substep_is_data_and_launches_nothing(integrator, monkeypatch):
    state = State.from_system(chain(3), Model(chain(3), device="cpu"), integrator.method_state)
    before, work = state.state_in, integrator.workspace(state)
    monkeypatch.setattr(wp, "launch", None)
    stages = integrator.substep(state, work, 0.01)
    assert state.state_in is before
    assert len(stages) == len(integrator.stage_times) == len(integrator.weights)
    assert integrator.tableau is None or integrator.tableau.shape == (len(stages), len(stages))
    # The last stage writes where the next instant's positions and velocities lie.
    assert stages[-1].fields["x_out"] is state.state_out.x
    assert stages[0].fields["x"] is state.state_in.x
