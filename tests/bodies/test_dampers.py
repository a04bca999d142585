"""Laws of damping: what they do to a motion, by closed forms, and the steps they need."""

import math

import numpy as np
import problems
import pytest
from problems import EPS64
from springs import simulate

from msdwarp import (
    RK4,
    RKC2,
    CoulombDamper,
    DamperKinds,
    Leapfrog,
    LinearlyImplicitEuler,
    QuadraticDamper,
    Simulation,
    SymplecticEuler,
    System,
    UnstableStep,
    chain,
)
from msdwarp.bodies.dampers import LINEAR, Damper
from msdwarp.engine.diagnostics.rate_bounds import rate_bounds

# Each law has kernels of its own.
LAWS = [LINEAR, QuadraticDamper(0.5), CoulombDamper(0.4)]
IMPLICIT = LinearlyImplicitEuler(iterations=2)  # for two unknowns
ORDERS = [(SymplecticEuler(), 1), (Leapfrog(damper_extrapolation=0.5), 2), (RK4(), 4), (IMPLICIT, 1)]
every_law = pytest.mark.parametrize("law", LAWS, ids=str)


def sliding(law: Damper, *, b: float, speed: float, m: float = 0.5, k: float = 0.0) -> System:
    """Return a particle that moves away from a pinned one, held back by a damper."""
    pair = chain(2, dim=2, stiffness=k, damping=b, mass=[math.inf, m]).replace(damper=law)
    return pair.with_velocity([[0.0, 0.0], [speed, 0.0]])


def speed_after(system: System, device: str, time: float, steps: int, **options) -> float:
    simulation = simulate(system, device, h=time / steps, substeps=steps // 10, allow_unstable=True, **options)
    simulation.step(10)  # short frames, as each launch of a frame is recorded
    return float(simulation.frame().velocity[1, 0])


def resistance(law: Damper, rate: np.ndarray) -> np.ndarray:
    """Return the force per constant b at these rates of lengthening."""
    name, speed = law.law
    if name == "quadratic":
        return np.where(np.abs(rate) < speed, np.abs(rate) * rate, speed * rate)
    if name == "coulomb":
        return np.where(np.abs(rate) < speed, rate / speed, np.sign(rate))
    return rate


@pytest.mark.slow
@pytest.mark.parametrize(("integrator", "order"), ORDERS, ids=str)
def test_quadratic_drag_slows_by_its_law(device, integrator, order):
    # v' = −(b/m) v²: v = v0 / (1 + b v0 t/m), here 2/(1 + 2.4).
    system = sliding(QuadraticDamper(most_speed=3.0), b=0.6, speed=2.0)
    exact = 2.0 / (1 + 0.6 * 2.0 * 1.0 / 0.5)
    coarse, fine = (speed_after(system, device, 1.0, n, integrator=integrator) - exact for n in (60, 120))
    # The implicit method takes the law's steepest slope for its slope: h b 2 s/m = 0.06. The others' is less.
    assert abs(fine) < 0.1 * exact
    assert math.log2(abs(coarse / fine)) == pytest.approx(order, abs=0.25)  # with 0.1 and 0.2, not yet nothing


@pytest.mark.parametrize("integrator", [one for one, _ in ORDERS[:-1]], ids=str)
def test_dry_friction_slows_evenly(device, integrator):
    # v0 − b t/m whatever the step or the method, as long as it slides: 500 roundings of 2 m/s.
    system = sliding(CoulombDamper(0.01), b=0.6, speed=2.0)
    found = speed_after(system, device, 1.0, 500, integrator=integrator)
    assert found == pytest.approx(2.0 - 0.6 / 0.5, abs=500 * 2 * EPS64)


def test_dry_friction_takes_its_share_of_every_swing(device):
    # Amplitudes fall by 2 F/k a half swing, 4 F/k a swing, whatever they are.
    m, k, F, start, s = 0.5, 50.0, 0.4, 0.2, 1e-3
    system = sliding(CoulombDamper(s), b=F, speed=0.0, m=m, k=k)
    system = system.replace(position=[[-0.5, 0.0], [0.5 + start, 0.0]], rest_length=1.0)
    h, half = 1e-4, math.pi * math.sqrt(m / k)
    simulation = simulate(system, device, h=h, substeps=round(half / h), integrator=RK4())
    for n in range(1, 6):
        simulation.step()
        # Below s friction is not whole: for the time 2 s/(ω² A) about each turn, in which it moves by less
        # than s²/(ω² A) < 1e-7 m. Where it turns it is not more than h/2 away from the frame: A (ω h)²/8.
        amplitude = start - 2 * n * F / k
        found = (-1) ** n * (simulation.snapshot().length[0] - 1.0)
        assert found == pytest.approx(amplitude, abs=n * 1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("force_algorithm", ["scatter", "gather", "stencil"])
@every_law
@pytest.mark.each_value
def test_every_route_has_every_law(plain_device, force_algorithm, law):
    # One step of symplectic Euler is a force: against NumPy, from rates of ± 2 m/s.
    body = problems.tumbling_box(damping=0.7).replace(stiffness=0.0, damper=law)
    body = body.with_velocity(np.random.default_rng(3).uniform(-1, 1, body.position.shape))
    simulation = simulate(body, plain_device, h=1e-3, force_algorithm=force_algorithm)
    simulation.step()
    i, j = body.connections.T
    axis = (body.position[i] - body.position[j]) / body.length[:, None]
    rate = ((body.velocity[i] - body.velocity[j]) * axis).sum(axis=1)
    assert np.abs(rate).min() < 0.4 < 0.5 < np.abs(rate).max()  # on both sides of a law's speed
    force = -0.7 * resistance(law, rate)[:, None] * axis
    expected = np.zeros_like(body.velocity)
    np.add.at(expected, i, force)
    np.add.at(expected, j, -force)
    found = (simulation.frame().velocity - body.velocity) / 1e-3
    # Roundings of 1 m/s over h, and of a rate over the sliding speed.
    np.testing.assert_allclose(found, expected / body.mass[:, None], rtol=0, atol=EPS64 * (1e3 + 1e4))


@every_law
def test_dissipated_power_is_what_energy_loses(device, law):
    body = problems.tumbling_box(damping=0.3).replace(damper=law)
    rng = np.random.default_rng(4)
    body = body.with_velocity(body.velocity + rng.uniform(-0.5, 0.5, body.velocity.shape))
    h = 1e-5
    simulation = simulate(body, device, h=h, integrator=RK4())
    before = simulation.measure().energy
    simulation.step()
    middle = simulation.measure()
    simulation.step()
    lost = (before - simulation.measure().energy) / (2 * h)
    assert middle.dissipated_power > 0.01
    # Central differences: (h/τ)²/6 = 2e-5 with τ = m s/7b = 1e-3 s at the least, of the hundredth of the power of
    # those that are below their speed; and a rounding of 10 J over h.
    assert lost == pytest.approx(middle.dissipated_power, rel=1e-6, abs=10 * EPS64 / h)


@pytest.mark.parametrize("law", [QuadraticDamper(3.0), CoulombDamper(0.01)], ids=str)
@pytest.mark.parametrize(
    "integrator",
    [one for one, _ in ORDERS],
    ids=str,
)
@pytest.mark.each_value
def test_a_strong_damper_only_ever_slows(device, integrator, law):
    # The automatic step is for the steepest slope of the law; with a pinned partner it is twice as safe as that,
    # so that no step takes more speed than there is.
    system = sliding(law, b=200.0, speed=2.9)
    simulation = Simulation(system, gravity=0.0, integrator=integrator, device=device, precision="float64")
    speeds = [2.9]
    for _ in range(30):
        simulation.step()
        speeds.append(float(simulation.frame().velocity[1, 0]))
    # RK4's steps may be twice as long: it goes past 0 in none, its stability function being positive.
    assert (np.diff(speeds) <= 0).all()
    assert speeds[-1] >= -1e-15 * 2.9  # what is left is rounding of what was there


@every_law
def test_the_bound_of_the_rates_knows_the_steepest_slope(law):
    body = problems.tumbling_box(damping=0.3)
    linear, found = rate_bounds(body), rate_bounds(body.replace(damper=law))
    assert found.damping == pytest.approx(law.steepest * linear.damping, rel=1e-12)  # roundings
    assert found.stiffness == linear.stiffness
    # It is the steepest slope: of the law's own force, by differences that see no bend from afar.
    rate = np.linspace(-6, 6, 240_001)
    slope = np.diff(resistance(law, rate)) / np.diff(rate)
    assert slope.max() == pytest.approx(law.steepest, rel=1e-4)  # 5e-5 m/s apart


def test_chebyshev_refuses_what_has_no_damper_at_some_speed():
    body = problems.tumbling_box(damping=0.3)
    Simulation(body, integrator=RKC2(), device="cpu")
    for law in LAWS[1:]:
        with pytest.raises(UnstableStep, match=r"RKC2.* is stable at no step here"):
            Simulation(body.replace(damper=law), integrator=RKC2(), device="cpu")


def test_systems_of_different_laws_keep_them():
    linear, dry = (sliding(law, b=0.5, speed=0.0) for law in (LINEAR, CoulombDamper(0.1)))
    assert (dry + linear).damper == DamperKinds((CoulombDamper(0.1), LINEAR), [0, 1])
    other = dry.replace(damper=CoulombDamper(0.2))
    assert (dry + other + dry).damper == DamperKinds((CoulombDamper(0.1), CoulombDamper(0.2)), [0, 1, 0])
    assert (dry + dry).damper == CoulombDamper(0.1)
    undamped = sliding(LINEAR, b=0.0, speed=0.0)
    for both in (dry + undamped, undamped + dry):
        assert both.damper == CoulombDamper(0.1)
        assert sorted(both.damping) == [0.0, 0.5]


def test_systems_keep_their_law():
    system = sliding(QuadraticDamper(2.0), b=0.5, speed=1.0)
    for moved in (system.translate((1, 0)), system.set_rest_shape(), system.named("it"), system.pin(1)):
        assert moved.damper == QuadraticDamper(2.0)
    simulation = simulate(system, "cpu", h=0.01)
    simulation.change(damping=0.2)
    assert simulation.system.damper == simulation.snapshot().damper == QuadraticDamper(2.0)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: QuadraticDamper(0.0), "most_speed is 0; it must be a number above 0"),
        (lambda: QuadraticDamper("fast"), "most_speed is 'fast'"),
        (lambda: CoulombDamper(-1.0), "sliding_speed is -1"),
        (lambda: CoulombDamper(math.nan), "sliding_speed is nan"),
        (lambda: chain(2).replace(damper="coulomb"), r"damper is 'coulomb'; .* such as CoulombDamper\(\)"),
        (lambda: chain(2).replace(damper=CoulombDamper), "damper is <class"),
    ],
)
def test_bad_law_is_named(make, message):
    with pytest.raises(ValueError, match=message):
        make()
