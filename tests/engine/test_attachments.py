"""Attachments: springs to points of the world and of what moves, by closed forms."""

import math

import numpy as np
import pytest
from problems import EPS64
from scipy.integrate import solve_ivp

import msdwarp as msd
from msdwarp import RK4, Attachment, Box, Leapfrog, LinearlyImplicitEuler, Simulation, Sphere, System, box
from msdwarp.engine.diagnostics.rate_bounds import rate_bounds
from msdwarp.engine.stepping.assemble import assemble

K, OMEGA = 36.0, 6.0
"""Stiffness [N/m] and frequency [rad/s] of 1 kg on it."""


def one(dim: int = 3, velocity=0.0) -> System:
    """Return a particle of 1 kg, and one that nothing holds."""
    return System(position=np.array([np.arange(1.0, 1 + dim), np.full(dim, -9.0)]), velocity=velocity)


def options(device, **more):
    return {"gravity": 0.0, "precision": "float64", "fps": 10.0, "substeps": 60, "device": device, **more}


@pytest.mark.slow
@pytest.mark.parametrize("blocks", ["auto", None], ids=["one launch", "launches"])
@pytest.mark.parametrize("dim", [1, 2, 3])
@pytest.mark.each_value
def test_a_particle_swings_about_its_point(plain_device, dim, blocks):
    # x'' = −k x / m in each coordinate. RK4 at hω = 0.01 errs by (hω)⁴ ωt / 120 of the amplitude.
    point = np.zeros(dim)
    how = options(plain_device, integrator=RK4(), blocks=blocks)
    simulation = Simulation(one(dim), loads=[Attachment([0], point, stiffness=K)], **how)
    simulation.step(10)
    found, error = simulation.frame(), 3 * 6 * 0.01**4 / 120
    expected = one(dim).position[0] * math.cos(OMEGA)
    np.testing.assert_allclose(found.position[0], expected, rtol=0, atol=error + 1e-12)
    assert (found.position[1] == -9.0).all()


def test_a_damped_one_comes_to_rest(plain_device):
    # x'' = −k x − b x': x = e^(−βt) (cos ω't + β/ω' sin ω't), β = b/2, ω'² = k − β².
    b = 4.0
    load = Attachment([0], (0.0, 0.0, 0.0), stiffness=K, damping=b)
    simulation = Simulation(one(), loads=[load], integrator=RK4(), **options(plain_device))
    simulation.step(10)
    w = math.sqrt(K - b * b / 4)
    decay = math.exp(-b / 2) * (math.cos(w) + b / 2 / w * math.sin(w))
    np.testing.assert_allclose(simulation.frame().position[0], one().position[0] * decay, rtol=0, atol=1e-8)
    v = simulation.frame().velocity[0]
    assert simulation.measure().dissipated_power == pytest.approx(b * float(v @ v), rel=1e-12)


def test_by_default_particles_are_held_where_they_are(plain_device):
    # k (x − x₀) is m g: the deepest point of a swing lies 2 m g / k below; the mean at m g / k.
    how = options(plain_device, gravity=9.0, integrator=RK4())
    simulation = Simulation(one(), loads=[Attachment([0], stiffness=K)], **how)
    simulation.step(5)
    sunk = simulation.frame().position[0, 2] - one().position[0, 2]
    # RK4's error of a swing of g/k, as above.
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


SPEED = np.array([1.0, -2.0, 0.5])


@pytest.mark.slow
def test_what_is_attached_to_steady_motion_moves_as_at_rest_in_its_frame(plain_device):
    # Galileo: a point at constant velocity is a point at rest, seen from beside it; the damper too.
    carrier = Sphere((5.0, 0, 0), 0.1, motion=lambda t: SPEED * t)
    how = options(plain_device, integrator=RK4())
    rest = Simulation(one(), loads=[Attachment([0], (0.0, 0, 0), stiffness=K, damping=2.0)], **how)
    along = Simulation(
        one(velocity=[SPEED, np.zeros(3)]),
        loads=[Attachment([0], (0.0, 0, 0), carried_by=carrier, stiffness=K, damping=2.0)],
        **how,
    )
    for simulation in (rest, along):
        simulation.step(10)
    moved = along.frame().position[0] - SPEED
    # The velocity of the point is a difference over h/50 = 3e-5 s of places of 1 m: 1e-11 of it.
    np.testing.assert_allclose(moved, rest.frame().position[0], rtol=0, atol=1e-10)
    assert along.measure().effect_energy == pytest.approx(rest.measure().effect_energy, rel=1e-8)
    assert along.measure().dissipated_power == pytest.approx(rest.measure().dissipated_power, rel=1e-8)


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


def test_energy_is_conserved(device):
    held = box((2, 3, 3), 0.1, mass=0.01, stiffness=20.0).translate((0.2, 0, 0))
    loads = [
        Attachment([0, 4], (0.0, 0, 0.3), stiffness=3.0, rest_length=0.1),
        Attachment([4, 9], stiffness=2.0),
    ]
    how = options(device, gravity=9.82, integrator=RK4(), fps=50.0, substeps=20)
    simulation = Simulation(held, loads=loads, **how)
    assert simulation.assembly.external_work is None  # what stands still does none
    before = simulation.measure()
    simulation.step(20)
    after = simulation.measure()
    assert after.effect_energy > 0.05 * after.kinetic_energy > 0
    # RK4 loses (hω)⁶/72 of the energy of a mode in each of 400 substeps; ω² ≤ 16 k/m gives hω ≤ 0.18.
    assert after.energy == pytest.approx(before.energy, rel=0, abs=400 * 0.18**6 / 72 * abs(before.energy) + 1e-10)


def test_the_bound_knows_attachments(plain_device):
    # An attached particle swings with k/m, which is the bound: other springs double it.
    loads = [Attachment([0], stiffness=K, damping=3.0), Attachment([0], stiffness=K)]
    rates = rate_bounds(one(), assemble(one(), loads=loads, device=plain_device, precision="float64"))
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


@pytest.mark.slow
def test_an_implicit_method_holds_too(device):
    simulation = Simulation(
        one(),
        loads=[Attachment([0], (0.0, 0, 0), stiffness=K)],
        integrator=LinearlyImplicitEuler(iterations=2),  # there are no springs: it is there at once
        **options(device),
    )
    simulation.step(10)
    # Explicit as every load: first order, hω/2 · ωt of the amplitude.
    np.testing.assert_allclose(
        simulation.frame().position[0], one().position[0] * math.cos(OMEGA), rtol=0, atol=3 * 0.01 / 2 * 6
    )


def held_box(device, **more):
    body = box((3, 3, 3), 0.1, mass=0.01, stiffness=40.0, damping=0.02).named("jelly")
    carrier = Sphere((0, 0, 1), 0.1, motion=lambda t: ((0, 0, math.sin(9 * t)), (0, 0, t)))
    loads = [Attachment([0, 1], carrier, stiffness=9.0, damping=0.1), Attachment([5], stiffness=4.0)]
    return Simulation(body, loads=loads, integrator=Leapfrog(), device=device, **more)


@pytest.mark.slow
def test_a_run_resumes_to_the_last_bit(device):
    whole, first, rest = (held_box(device, force_algorithm="gather", substeps=30) for _ in range(3))
    whole.step(9)
    first.step(4)
    rest.restore(*first.checkpoint())
    rest.step(5)
    np.testing.assert_array_equal(whole.frame().position, rest.frame().position)


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


@pytest.mark.slow
def test_all_routes_carry_attachments(plain_device):
    frames = []
    for force_algorithm, blocks in (
        ("scatter", "auto"),
        ("gather", "auto"),
        ("stencil", "auto"),
        ("gather", None),
    ):
        how = {"force_algorithm": force_algorithm, "blocks": blocks, "precision": "float64"}
        simulation = held_box(plain_device, substeps=30, **how)
        simulation.step(10)
        frames.append(simulation.frame().position)
    for other in frames[1:]:
        np.testing.assert_allclose(frames[0], other, rtol=0, atol=1e-11)  # other orders of sums, 300 substeps


MOVING = Sphere(motion=lambda t: (0, 0, t))
REFUSED = [
    (lambda: [Attachment("tail", stiffness=1.0)], r"loads\[0\]\.on is 'tail'"),
    (lambda: [Attachment([], stiffness=1.0)], r"loads\[0\]\.on is \[\]; it must name one particle"),
    (lambda: [Attachment([0], stiffness=-1.0)], "stiffness is -1; it must be a number of at least 0"),
    (lambda: [Attachment([0], stiffness=1.0, damping=np.inf)], "damping is inf"),
    (lambda: [Attachment([0], stiffness=1.0, rest_length=-0.5)], "rest_length is -0.5; it must be at least 0"),
    (lambda: [Attachment([0], stiffness=1.0, rest_length="then")], "rest_length is 'then'"),
    (lambda: [Attachment([0], (0, np.nan, 0), stiffness=1.0)], r"to\[1\] is nan; it must be finite"),
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
