"""Muscles: rest lengths as functions of time, by every algorithm and method, their work, and the bound with
them."""

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from alone import one_lane
from problems import EPS64
from scipy.integrate import solve_ivp

from msdwarp import (
    RK4,
    RKC2,
    Actuator,
    Ensemble,
    Leapfrog,
    LinearlyImplicitEuler,
    Simulation,
    SymplecticEuler,
    System,
    box,
)
from msdwarp.engine.diagnostics.rate_bounds import rate_bounds
from msdwarp.engine.stepping.assemble import assemble
from msdwarp.world import Problem

K, LENGTH, SWING, OMEGA = 8.0, 0.5, 0.2, 3.0
"""Stiffness [N/m] and rest length [m] of a spring, its muscle's largest strain, and how fast it swings [rad/s]."""


def pair(dim: int = 3, damping: float = 0.0) -> System:
    """Return two particles of 1 and 2 kg joined by a spring, at rest."""
    position = np.zeros((2, dim))
    position[:, 0] = 0.3, 0.3 + LENGTH
    return System(position=position, mass=[1.0, 2.0], connections=[(0, 1)], stiffness=K, damping=damping)


NATURAL = math.sqrt(K * 1.5)
"""√(k/μ) of the pair, μ = 2/3 kg its reduced mass [rad/s]."""


def jelly() -> System:
    """Return a cube of 4³ that hangs together by all its diagonals."""
    return box((4, 4, 4), 0.1, mass=0.01, stiffness=40.0, damping=0.02)


def swing(t):
    return SWING * np.sin(OMEGA * t)


def options(device, **more):
    return {"gravity": 0.0, "precision": "float64", "fps": 10.0, "substeps": 10, "device": device, **more}


def swung(t: float, damping: float = 0.0) -> float:
    """Return the lengthening of the pair, from rest: u'' + c u' + ω0² u = ω0² l0 a sin ωt, c = b/μ."""
    rate = 1.5 * damping
    forced = NATURAL**2 * LENGTH * SWING / (NATURAL**2 - OMEGA**2 + 1j * rate * OMEGA)  # of e^(iωt)
    own = np.roots([1.0, rate, NATURAL**2]).astype(complex)
    at_first = [-forced.imag, -(1j * OMEGA * forced).imag]
    share = np.linalg.solve(np.stack([np.ones(2), own]), at_first)
    return float((forced * np.exp(1j * OMEGA * t)).imag + (share @ np.exp(own * t)).real)


# In one, two or three coordinates: in how many depends on no method.
METHODS = [
    (SymplecticEuler(), 1, 3),
    (Leapfrog(), 2, 2),
    (RK4(), 4, 1),
    (RKC2(), 2, 3),
    (LinearlyImplicitEuler(6), 1, 3),
]


@pytest.mark.slow
@pytest.mark.parametrize(("method", "order", "dim"), METHODS, ids=lambda one: str(one).split("(")[0])
def test_a_muscle_is_a_forced_oscillator(method, order, dim, plain_device):
    # RKC2 has no step without a damper. It and the implicit method sum work at order 1, which is no divergence,
    # though the body has no energy at the start.
    damping, errors = 0.5 if method == RKC2() else 0.0, []
    for substeps in (5, 10):
        how = options(plain_device, substeps=substeps, integrator=method)
        simulation = Simulation(pair(dim, damping), loads=[Actuator(swing)], **how)
        simulation.step(10)
        x = simulation.frame().position
        assert np.abs(np.average(x, axis=0, weights=[1.0, 2.0])[1:]).max(initial=0.0) < 1e-14
        errors.append(abs(x[1, 0] - x[0, 0] - LENGTH - swung(1.0, damping)))
    # The next order's term is a share of about ω0 h = 0.07 of the error.
    assert math.log2(errors[0] / errors[1]) > order - 0.2, errors
    assert errors[1] < {1: 0.02, 2: 1e-3, 4: 1e-7}[order] * LENGTH


@pytest.mark.parametrize("along", [None, ("x", "x+y")], ids=["all", "some"])
def test_a_held_muscle_is_another_rest_length(device, along):
    body = jelly()
    load = Actuator(-0.15, along=along)
    lengths = np.array(body.rest_length)
    lengths[load.connections(body)] *= 0.85
    assert 0 < (lengths < body.rest_length).sum() <= len(lengths)
    how = options(device, fps=60.0, substeps=20)
    pulled = Simulation(body, loads=[load], **how)
    other = Simulation(body.replace(rest_length=lengths), **how)
    for simulation in (pulled, other):
        simulation.step(20)
    assert np.abs(other.frame().position - body.position).max() > 0.01
    # Other sums, 400 substeps of roundings: as algorithms differ from each other.
    np.testing.assert_allclose(pulled.frame().position, other.frame().position, rtol=0, atol=1e-12)


@pytest.mark.slow
def test_compensated_sums_have_it_too(device):
    # At 400 m float32 has 3e-5 m between numbers; what positions have lost makes strains right all the same.
    body = jelly()
    far = body.translate((400.0, 0.0, 0.0))
    near, other = (
        Simulation(one, loads=[Actuator(-0.15)], **options(device, fps=60.0, substeps=20, precision=precision))
        for one, precision in ((body, "float64"), (far, "float32-compensated"))
    )
    near.step(10)
    other.step(10)
    moved = other.frame().position - np.array([400.0, 0.0, 0.0])
    # Particles begin and are read where float32 can say: within half of 3e-5 m, and swing about there.
    np.testing.assert_allclose(moved, near.frame().position, rtol=0, atol=6e-5)


def test_actuators_add_up_and_keep_to_their_particles(device):
    # Two of opposite strain are none; one on particles that nothing else joins leaves others where they are.
    body = jelly() + jelly().named("mover").translate((1.0, 0.0, 0.0))
    pulling = [Actuator(0.1, on="mover"), Actuator(lambda t: 0.05 + 0 * t, on="mover", along="z")]
    simulation = Simulation(body, loads=[*pulling, Actuator(-0.1, on="mover")], **options(device, fps=60.0))
    simulation.step(5)
    moved = simulation.frame().position - body.position
    assert np.abs(moved[64:, 2]).max() > 1e-3
    np.testing.assert_allclose(moved[:64], 0.0, rtol=0, atol=4 * EPS64)  # rest lengths as placed are rounded
    effect = simulation.assembly.all[0]
    np.testing.assert_array_equal(effect.members, np.arange(128) >= 64)


def test_it_changes_no_momentum(device):
    body = jelly()
    wave = [Actuator(lambda t, k=k: 0.2 * np.sin(9 * t + k), on=body.position[:, 0] < 0.1 * k) for k in (0, 1)]
    simulation = Simulation(body, loads=wave, **options(device, fps=60.0, substeps=20))
    simulation.step(20)
    measures = simulation.measure()
    speed = np.sqrt(2 * measures.kinetic_energy / 0.64)
    assert speed > 0.01
    # Forces on both ends are each other's negative to the last bit; sums of velocities are rounded 400 times, by
    # chance to either side in 64 particles.
    np.testing.assert_allclose(measures.momentum, 0.0, atol=0.64 * 400 * EPS64 * speed)
    np.testing.assert_allclose(measures.angular_momentum, 0.0, atol=0.64 * 400 * EPS64 * speed * 0.3)


@pytest.mark.slow
def test_its_work_over_a_cycle_is_the_loop_of_force_and_length(plain_device):
    # Once the pair swings steadily, u = U sin(ωt − φ), the damper turns π b ω U² to heat in a cycle: the work.
    damping, per_cycle = 2.0, 64
    fps = per_cycle * OMEGA / (2 * math.pi)
    how = options(plain_device, fps=fps, substeps=8, integrator=RK4())
    simulation = Simulation(pair(1, damping), loads=[Actuator(swing)], **how)
    simulation.step(8 * per_cycle)  # 16.8 s: what was at the start has decayed by exp(−1.5 · 16.8) = 1e-11
    before = simulation.measure().external_work
    times, lengths = [], []
    for _ in range(per_cycle):
        x = simulation.frame().position
        times.append(simulation.time)
        lengths.append(x[1, 0] - x[0, 0])
        simulation.step()
    done = simulation.measure().external_work - before
    rate = damping * 1.5
    amplitude = NATURAL**2 * LENGTH * SWING / math.hypot(NATURAL**2 - OMEGA**2, rate * OMEGA)
    expected = math.pi * damping * OMEGA * amplitude**2
    # h ω0 = 0.013, of order 4.
    assert done == pytest.approx(expected, rel=1e-7)
    # −∮ F dl with F = k (l − l0 (1 + s)), the slope of the periodic l by its Fourier series: exact.
    length, wave = np.array(lengths), np.fft.fftfreq(per_cycle, 1 / per_cycle)
    slope = np.fft.ifft(1j * wave * OMEGA * np.fft.fft(length)).real
    tension = K * (length - LENGTH * (1 + swing(np.array(times))))
    loop = -(tension * slope).sum() / fps
    assert done == pytest.approx(loop, rel=1e-7)


@pytest.mark.slow
def test_a_worm_moves_as_an_independent_reference_says(plain_device):
    # Four particles in a line, a wave of contraction along it, the first pinned; its work is an unknown more.
    position, mass = np.arange(4.0)[:, None], np.array([np.inf, 1.0, 2.0, 0.5])
    ends = np.array([(0, 1), (1, 2), (2, 3)])
    system = System(position=position, mass=mass, connections=ends, stiffness=[30.0, 20.0, 40.0], damping=0.5)
    phase = np.arange(3) * 0.8
    loads = [Actuator(lambda t: 0.2 * np.sin(4 * t), delay=0.2 * (np.arange(4) - 0.5))]

    def rates(t, y):
        x, v = y[:4], y[4:8]
        stretch, rate, s = np.diff(x) - 1, np.diff(v), 0.2 * np.sin(4 * t - phase)
        tension = system.stiffness * (stretch - s) + 0.5 * rate
        force = np.append(tension, 0) - np.append(0, tension)
        return np.concatenate([v, force / mass, [(system.stiffness * s * rate).sum()]])

    start = np.concatenate([position[:, 0], np.zeros(5)])
    expected = solve_ivp(rates, (0, 3), start, method="DOP853", rtol=1e-12, atol=1e-13).y[:, -1]
    simulation = Simulation(system, loads=loads, integrator=RK4(), **options(plain_device, substeps=40))
    simulation.step(30)
    # RK4: (h ω)⁴ ω t / 120 with ω up to 14 rad/s, h = 1/400 s.
    np.testing.assert_allclose(simulation.frame().position[:, 0], expected[:4], rtol=0, atol=1e-6)
    assert simulation.measure().external_work == pytest.approx(expected[8], rel=1e-6)


def test_a_muscle_follows_a_change_of_what_it_pulls_with(plain_device):
    # Twice the stiffness at twice the mass moves alike, but only if the muscle is twice as strong too.
    frames = []
    for factor in (1.0, 2.0):
        simulation = Simulation(jelly(), loads=[Actuator(-0.1)], **options(plain_device, fps=60.0, substeps=20))
        simulation.change(stiffness=40 * factor, damping=0.02 * factor, mass=0.01 * factor)
        simulation.step(10)
        frames.append(simulation.frame().position)
    np.testing.assert_allclose(frames[0], frames[1], rtol=0, atol=200 * 4 * EPS64)


@pytest.mark.parametrize("strain", [-0.3, lambda t: -0.15 + 0.15 * np.cos(2 * t)], ids=["held", "of time"])
def test_the_bound_is_that_of_the_most_contracted_body(plain_device, strain):
    body, how = jelly(), {"device": plain_device, "precision": "float64"}
    short = body.replace(rest_length=0.7 * body.rest_length)
    found = rate_bounds(body, assemble(Problem(system=body, loads=[Actuator(strain)]), **how))
    expected = rate_bounds(short, assemble(Problem(system=short), **how))
    # At 60 looks a second the least of the cosine is found to (2/120)²/2 · 0.15.
    assert found.stiffness == pytest.approx(expected.stiffness, rel=1e-12 if strain == -0.3 else 1e-4)
    plain = rate_bounds(body, assemble(Problem(system=body), **how))
    assert expected.stiffness > 1.2 * plain.stiffness
    longer = rate_bounds(body, assemble(Problem(system=body, loads=[Actuator(0.5)]), **how))
    assert longer.stiffness == pytest.approx(plain.stiffness, rel=1e-14)  # atomics add in any order


def test_the_bound_is_had_of_a_muscle_that_is_made_for_a_short_run():
    def short(t):
        return -0.1 if t < 1 else math.nan

    simulation = Simulation(jelly(), loads=[Actuator(short)], device="cpu", gravity=0.0)
    simulation.step(5)
    assert np.isfinite(simulation.frame().position).all()


@pytest.mark.parametrize("strain", [0.0, 0.1])
def test_what_muscles_do_to_a_body_without_energy_is_no_divergence(plain_device, strain):
    # Work is summed at order 1 by this method: from nothing, it differs from the energy by more than rounding.
    how = options(plain_device, integrator=RKC2())
    simulation = Simulation(pair(damping=0.5), loads=[Actuator(strain)], **how)
    simulation.step(10)
    assert bool(simulation.measure().external_work) == bool(strain)


def triangle(t):
    """Return a wave of differences and products alone: the same to the last bit for one time or many."""
    return np.abs(t % 1.0 - 0.5)


def test_worlds_have_muscles_of_their_own(plain_device):
    body, draw = jelly(), np.random.default_rng(1).uniform
    x, lower = body.position[:, 0], body.position[:, 2] < 0.0
    muscles = [Actuator(lambda t: 0.3 * triangle(2 * t), on=lower, delay=x), Actuator(0.1, along="x")]
    a, f, b = draw(0.1, 0.6, (3, 2)), draw(1.0, 4.0, (3, 1)), draw(0.0, 1.0, (3, 2))
    # What an ensemble is given, and what the muscle k has in the run of world w alone.
    cases: list[tuple[dict[str, Any], Callable[[int, int], dict[str, Any]]]] = [
        ({"strain": lambda t: a * triangle(f * t + b)}, lambda w, k: {"strain": gait(a[w, k], f[w, 0], b[w, k])}),
        ({"strain": lambda t: a[:, 0] * triangle(t)}, lambda w, k: {"strain": gait(a[w, 0], 1.0, 0.0)}),
        ({"strain": -a}, lambda w, k: {"strain": -a[w, k]}),
        ({"delay": b[:, 0]}, lambda w, k: {"delay": b[w, 0]}),
        ({"delay": b[:, :, None] * x}, lambda w, k: {"delay": b[w, k] * x}),
    ]

    def gait(amplitude, frequency, phase):
        return lambda t: amplitude * triangle(frequency * t + phase)

    how = options(plain_device, fps=60.0, force_algorithm="gather")
    for given, own in cases:
        ensemble = Ensemble(body, 3, loads=muscles, **given, **how)
        ensemble.step(6)
        places = ensemble.frame().position
        assert np.ptp(places, axis=0).max() > 1e-4
        for w in range(3):
            loads = [replace(one, **own(w, k)) for k, one in enumerate(muscles)]
            with one_lane():
                alone = Simulation(body, loads=loads, **how)
            alone.step(6)
            np.testing.assert_array_equal(places[w], alone.frame().position)


def test_the_muscles_that_contract_most_set_the_substeps_of_all_worlds(plain_device):
    how = options(plain_device, fps=60.0, substeps="auto", force_algorithm="gather", loads=[Actuator(0.0)])
    ensemble = Ensemble(jelly(), 3, strain=[0.3, -0.6, 0.0], **how)
    alone = [ensemble.simulation_of(w, substeps="auto").choice.rates.stiffness for w in range(3)]
    assert alone[1] > 1.2 * alone[2]
    assert ensemble.choice.rates.stiffness == pytest.approx(alone[1], rel=1e-12)  # atomics add in any order
    assert ensemble.numbers["strain"].tolist() == [0.3, -0.6, 0.0]  # the coordinate of results


def test_strains_of_worlds_that_change_in_number_are_named():
    gait = Ensemble(
        jelly(), 2, loads=[Actuator(0.0)], strain=lambda t: np.zeros(2 if t < 0.1 else 4), device="cpu"
    )
    with pytest.raises(ValueError, match=r"strain has no value .* it returned shape \(4,\), and \(2,\) at time 0"):
        gait.step(10)


def late(t: float) -> float:
    return 0.0 if t < 0.05 else 2.0


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Actuator(1.0), "strain is 1 at 0 s; it must be above -1 and below 1"),
        (lambda: Actuator(-1.5), "strain is -1.5 at 0 s"),
        (lambda: Actuator((0.1, 0.2)), "strain has 2 numbers; it must have 1 number"),
        (lambda: Actuator(lambda t: 1.2), r"loads\[0\]\.strain is 1.2 at 0 s; it must be above -1"),
        (lambda: Actuator(lambda t: 1 / 0), r"loads\[0\]\.strain has no value .* division by zero"),
        (lambda: Actuator(lambda t: (0.1, 0.1)), r"loads\[0\]\.strain has 2 numbers"),
        (lambda: Actuator(0.1, along="w"), r"loads\[0\]\.along is 'w'; it must be .*'x'"),
        (lambda: Actuator(0.1, along=3), "along is 3; it must be"),
        (lambda: Actuator(0.1, delay=[0.0, 0.1]), r"loads\[0\]\.delay has shape \(2,\); .*64 numbers"),
        (lambda: Actuator(0.1, on="tail"), r"loads\[0\]\.on is 'tail'"),
        (lambda: Actuator(0.1, on=[0]), r"loads\[0\]\.on is \[0\]; there must be one connection at least"),
        (lambda: Actuator(0.1, on=[0, 1], along=("y",)), r"joins two of its particles along y"),
    ],
)
def test_bad_muscles_are_named(make, message):
    with pytest.raises(ValueError, match=message):
        Simulation(jelly(), loads=[make()], device="cpu")


def test_a_muscle_that_goes_too_far_on_the_way_is_named():
    simulation = Simulation(jelly(), loads=[Actuator(late)], device="cpu", gravity=0.0)
    with pytest.raises(ValueError, match=r"loads\[0\]\.strain is 2 at 0\.0\d* s"):
        simulation.step(10)


def test_what_yields_or_breaks_has_no_muscles():
    yielding = {"yield_strain": 0.1, "relaxation_time": 0.1}
    for what, fields in (("yield", yielding), ("break", {"break_strain": 0.5}), ("break", {"break_force": 9.0})):
        with pytest.raises(ValueError, match=rf"loads\[0\]\.on has connections that may {what}"):
            Simulation(jelly().replace(**fields), loads=[Actuator(0.1)], device="cpu")
