"""Attachments: springs to points of the world and of what moves, by closed forms."""

import math

import numpy as np
import pytest
from problems import EPS64
from scipy.integrate import solve_ivp

import msdwarp as msd
from msdwarp import RK4, Attachment, Box, Leapfrog, Simulation, Sphere, System, box
from msdwarp.engine.diagnostics.rate_bounds import rate_bounds
from msdwarp.engine.stepping.assemble import assemble
from msdwarp.world import Problem

K, OMEGA = 36.0, 6.0
"""Stiffness [N/m] and frequency [rad/s] of 1 kg on it."""


def one(dim: int = 3, velocity=0.0) -> System:
    """Return a particle of 1 kg, and one that nothing holds."""
    return System(position=np.array([np.arange(1.0, 1 + dim), np.full(dim, -9.0)]), velocity=velocity)


def options(device, **more):
    return {"gravity": 0.0, "precision": "float64", "fps": 10.0, "substeps": 60, "device": device, **more}


@pytest.mark.slow
@pytest.mark.parametrize("dim", [1, 2, 3])
def test_a_particle_swings_about_its_point_and_comes_to_rest(plain_device, dim):
    # x'' = −k x − b x': x = e^(−βt) (cos ω't + β/ω' sin ω't), β = b/2, ω'² = k − β².
    b = 4.0
    load = Attachment([0], np.zeros(dim), stiffness=K, damping=b)
    simulation = Simulation(one(dim), loads=[load], integrator=RK4(), **options(plain_device))
    simulation.step(10)
    w, found = math.sqrt(K - b * b / 4), simulation.frame()
    decay = math.exp(-b / 2) * (math.cos(w) + b / 2 / w * math.sin(w))
    # RK4 at hω = 0.01 errs by (hω)⁴ ωt / 120 of the amplitude.
    np.testing.assert_allclose(found.position[0], one(dim).position[0] * decay, rtol=0, atol=1e-8)
    assert (found.position[1] == -9.0).all()
    v = found.velocity[0]
    assert simulation.measure().dissipated_power == pytest.approx(b * float(v @ v), rel=1e-12)


def test_by_default_particles_are_held_where_they_are(plain_device):
    # k (x − x₀) is m g: the deepest point of a swing lies 2 m g / k below; the mean at m g / k.
    how = options(plain_device, gravity=9.0, integrator=RK4())
    simulation = Simulation(one(), loads=[Attachment([0], stiffness=K)], **how)
    simulation.step(5)
    sunk = simulation.frame().position[0, 2] - one().position[0, 2]
    # RK4's error, (hω)⁴ ωt / 120, of a swing of g/k.
    assert sunk == pytest.approx(-9.0 / K * (1 - math.cos(OMEGA * 0.5)), abs=0.25 * 3 * 0.01**4 / 120 + 1e-12)


@pytest.mark.slow
def test_one_with_a_rest_length_is_a_connection_to_a_pinned_particle(device):
    load = Attachment([0], (0.0, 0.0, 0.0), stiffness=K, damping=2.0, rest_length=3.0)
    rod = System(
        position=[*one().position, (0.0, 0, 0)],
        velocity=[(1.0, 0, -2), (0.0, 0, 0), (0.0, 0, 0)],
        mass=[1.0, 1.0, np.inf],
        connections=[(0, 2)],
        stiffness=K,
        damping=2.0,
        rest_length=3.0,
    )
    how = options(device, integrator=RK4())
    held = Simulation(one(velocity=[(1.0, 0, -2), (0.0, 0, 0)]), loads=[load], **how)
    tied = Simulation(rod, **how)
    for simulation in (held, tied):
        simulation.step(10)
    np.testing.assert_allclose(held.frame().position, tied.frame().position[:2], rtol=0, atol=600 * 16 * EPS64)
    own, others = held.measure(), tied.measure()
    assert own.effect_energy == pytest.approx(others.elastic_energy, rel=1e-10)
    assert own.dissipated_power == pytest.approx(others.dissipated_power, rel=1e-10)


def test_now_is_the_distance_at_the_start(plain_device):
    still = Attachment([0], (0.0, 0.0, 0.0), stiffness=K, rest_length="now")
    simulation = Simulation(one(), loads=[still], **options(plain_device))
    simulation.step(3)
    np.testing.assert_allclose(simulation.frame().position, one().position, rtol=0, atol=180 * 8 * EPS64)
    assert simulation.measure().effect_energy == pytest.approx(0.0, abs=1e-20)


@pytest.mark.slow
@pytest.mark.parametrize(("method", "error"), [(RK4(), 1e-7), (Leapfrog(), 5e-3)], ids=["rk4", "leapfrog"])
def test_what_is_attached_to_a_shaken_point_follows_its_equation(plain_device, method, error):
    # x'' = −k (x − p) − b (x' − p') with p = sin 4t, by SciPy. Leapfrog is of first order with damping: h b/2 of
    # 1 m at most; RK4 errs by (hω)⁴ ωt / 120, and once, at the start, the rate of p is that of h/100 later.
    b, shaken = 3.0, Sphere(motion=lambda t: (np.sin(4 * t), 0 * t, 0 * t))

    def slope(t, y):
        return [y[1], -K * (y[0] - math.sin(4 * t)) - b * (y[1] - 4 * math.cos(4 * t))]

    load = Attachment([0], (0.0, 0, 0), carried_by=shaken, stiffness=K, damping=b)
    simulation = Simulation(one(), loads=[load], integrator=method, **options(plain_device))
    simulation.step(10)
    expected = solve_ivp(slope, (0, 1), [1.0, 0.0], rtol=1e-11, atol=1e-12).y[:, -1]
    assert simulation.frame().position[0, 0] == pytest.approx(expected[0], abs=error)
    assert simulation.frame().velocity[0, 0] == pytest.approx(expected[1], abs=10 * error)


@pytest.mark.slow
def test_a_turning_collider_carries_what_is_attached(device):
    # Stiffly held, a particle goes round with it: m r Ω² = k (r − R), from the start if it moves with it then.
    rate, k, radius = 2.0, 400.0, 1.0
    centre = np.array([0.5, 0.0, 0.0])
    away = radius / (1 - rate**2 / k)  # k (r − R) = r Ω²
    outwards = np.array([1.0, 0.0, 0.0])
    body = System(position=[centre + away * outwards], velocity=[(0.0, away * rate, 0.0)])
    carrier = Box(tuple(centre), (0.1, 0.1, 0.1), motion=lambda t: ((0.0, 0.0, 0.0), (0.0, 0.0, rate * t)))
    # A damper would drag, from a point further in; there is none.
    load = Attachment([0], centre + radius * outwards, carried_by=carrier, stiffness=k)
    simulation = Simulation(body, loads=[load], integrator=RK4(), **options(device))
    simulation.step(10)
    turned = np.array([math.cos(rate), math.sin(rate), 0.0])
    # RK4 at h √(k/m) = 1/30: (hω)⁴ ωt / 120 of 1 m.
    np.testing.assert_allclose(simulation.frame().position[0], centre + away * turned, rtol=0, atol=3e-7)


@pytest.mark.slow
def test_to_a_collider_means_where_particles_are(device):
    # All of a body glued to a plate that shoves it: it goes along, and no spring is stretched at the start.
    body = box((2, 2, 2), 0.1, mass=0.01, stiffness=40.0).named("jelly")
    plate = Box((0, 0, -0.5), (1, 1, 0.1), motion=lambda t: (0.1 * t, 0, 0))
    loads = [Attachment("jelly", plate, stiffness=4.0, damping=0.4)]
    simulation = Simulation(body, loads=loads, colliders=[plate], **options(device))
    assert simulation.measure().effect_energy == 0.0
    simulation.step(20)
    # A relaxation time of 2 m/b = 0.05 s: after 2 s nothing but the steady motion is left.
    np.testing.assert_allclose(simulation.frame().position, body.position + 0.2 * np.eye(3)[0], rtol=0, atol=1e-7)


def test_the_bound_knows_attachments(plain_device):
    # An attached particle swings with k/m, which is the bound: other springs double it.
    loads = [Attachment([0], stiffness=K, damping=3.0), Attachment([0], stiffness=K)]
    rates = rate_bounds(
        one(), assemble(Problem(system=one(), loads=loads), device=plain_device, precision="float64")
    )
    assert rates.stiffness == pytest.approx(2 * K, rel=8 * EPS64)
    assert rates.damping == pytest.approx(3.0, rel=8 * EPS64)
    # Near its limit of 2/ω a step is stable, beyond it is refused.
    how = {
        "gravity": 0.0,
        "device": plain_device,
        "fps": 1.0,
        "loads": [Attachment([0], (0.0, 0, 0), stiffness=K)],
    }
    simulation = Simulation(one(), **how)
    assert simulation.substeps == math.ceil(OMEGA / 2 / 0.8)
    simulation.step(50)
    assert np.abs(simulation.frame().position[0]).max() < 2 * 3
    with pytest.raises(msd.UnstableStep):
        Simulation(one(), substeps=2, **how)


def test_a_change_on_the_way_leaves_points_where_they_are():
    simulation = Simulation(one(), loads=[Attachment([0], stiffness=K)], device="cpu", fps=10.0, gravity=9.0)
    simulation.step(5)
    sunk = simulation.frame().position[0, 2]
    assert sunk < 2.9
    simulation.change(mass=2.0)
    stored = 0.5 * K * (3.0 - sunk) ** 2
    assert simulation.measure().effect_energy == pytest.approx(stored, rel=1e-5)  # float32
    simulation.step(2)
    np.testing.assert_allclose(simulation.assembly.all[-1].data.point.numpy()[0], one().position[0])


MOVING = Sphere(motion=lambda t: (0, 0, t))
REFUSED = [
    (lambda: [Attachment("tail", stiffness=1.0)], r"loads\[0\]\.on is 'tail'"),
    (lambda: [Attachment([], stiffness=1.0)], r"loads\[0\]\.on is \[\]; it must name one particle"),
    (lambda: [Attachment([0], stiffness=1.0, rest_length=-0.5)], "rest_length is -0.5; it must be at least 0"),
    (lambda: [Attachment([0], stiffness=1.0, rest_length="then")], "rest_length is 'then'"),
    (lambda: [Attachment([0], (0.0, 1.0), stiffness=1.0)], r"loads\[0\]\.to has shape \(2,\); .* \(1, 3\)"),
    (lambda: [Attachment([0], np.zeros((2, 3)), stiffness=1.0)], r"loads\[0\]\.to has shape \(2, 3\)"),
    (
        lambda: [Attachment([0], stiffness=1.0, rest_length=[1.0, 2.0])],
        r"loads\[0\]\.rest_length has shape \(2,\)",
    ),
    (lambda: [Attachment([0], stiffness=1.0, rest_length=0.1)], "particle 0 starts at the point"),
    (lambda: [Attachment([0], MOVING, carried_by=MOVING, stiffness=1.0)], "beside carried_by it must be points"),
    (lambda: [Attachment([0], carried_by="arm", stiffness=1.0)], "carried_by is 'arm'; it must be a Collider"),
    (
        lambda: [Attachment([0], Sphere((0, 0)), stiffness=1.0)],
        r"loads\[0\]\.carried_by\.position is \(0.0, 0.0\)",
    ),
    (
        lambda: [Attachment([0], Sphere(motion=lambda t: (0, 0, 1 / t)), stiffness=1.0)],
        r"loads\[0\]\.carried_by has no place at 0 s: .*division by zero",
    ),
]


@pytest.mark.parametrize(("make", "message"), REFUSED, ids=[message for _, message in REFUSED])
def test_what_cannot_be_attached_is_refused(make, message):
    with pytest.raises(ValueError, match=message):
        Simulation(one(), loads=make(), device="cpu")


def test_an_attachment_says_what_it_is():
    points = np.zeros((4, 3))
    assert repr(Attachment("rim", stiffness=200.0)) == "Attachment(on='rim', stiffness=200)"
    many = Attachment([0, 1, 2, 3], points, stiffness=2.0, damping=0.5, rest_length=[1.0, 2, 3, 4])
    assert repr(many) == (
        "Attachment(on=4 particles, to=12 numbers, stiffness=2, damping=0.5, rest_length=4 numbers)"
    )
    carried = Attachment(to=MOVING, stiffness=1.0, rest_length="now")
    assert repr(carried) == "Attachment(carried_by=Sphere(motion=<lambda>), stiffness=1, rest_length='now')"
