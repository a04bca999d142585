"""Work: of what moves particles from outside: what a body has more of, or has turned to heat."""

import importlib
import math

import numpy as np
import pytest
from problems import balance, drifts

from msdwarp import (
    RK4,
    RKC2,
    Attachment,
    Box,
    Capsule,
    ExplicitEuler,
    Force,
    Leapfrog,
    LinearlyImplicitEuler,
    Plane,
    PrescribedMotion,
    Simulation,
    SimulationDiverged,
    Sphere,
    SymplecticEuler,
    System,
    box,
    chain,
)


def options(device, **more):
    return {"gravity": 0.0, "precision": "float64", "fps": 20.0, "substeps": 40, "device": device, **more}


def shake(t):
    return 0.1 * np.sin(7 * t), 0.05 * t, 0 * t


def rope(damping: float = 0.0) -> System:
    """Return four particles in a line, of 0.5 kg each, on springs of 100 N/m."""
    return chain(4, 0.5, mass=0.5, stiffness=100.0, damping=damping)


METHODS = [(SymplecticEuler(), 1), (Leapfrog(), 2), (Leapfrog(damper_extrapolation=0.5), 2), (RK4(), 4)]


def pulled(method, substeps: int, device: str, damping: float) -> tuple[float, float]:
    """Return the work in 1 s of what pulls a mass on a spring at constant speed, and that by the closed form [J].

    The end of the spring goes at V from the start on; seen from there the mass is thrown at −V, and swings:
    u'' = −2g u' − ω² u.
    The force of the drive is all that acts, so that it does V times the momentum which the mass has got.
    """
    k, m, speed = 40.0, 0.5, 0.3
    system = System(
        position=[[0.0], [1.0]], mass=m, connections=[(0, 1)], stiffness=k, damping=damping, rest_length=1.0
    )
    how = options(device, integrator=method, substeps=substeps, allow_unstable=True, energy_limit=math.inf)
    simulation = Simulation(system, loads=[PrescribedMotion([0], lambda t: (speed * t,))], **how)
    simulation.step(20)
    g = damping / (2 * m)
    w = math.sqrt(k / m - g * g)
    relative = -speed * math.exp(-g) * (math.cos(w) - g / w * math.sin(w))
    return simulation.measure().external_work, m * (relative + speed) * speed


PULLED = [
    (SymplecticEuler(), 2.0, 1),
    (Leapfrog(), 0.0, 2),
    (RK4(), 2.0, 4),
    pytest.param(Leapfrog(damper_extrapolation=0.5), 2.0, 2, marks=pytest.mark.slow),
    pytest.param(RKC2(4), 2.0, 2, marks=pytest.mark.slow),
    pytest.param(ExplicitEuler(), 2.0, 1, marks=pytest.mark.slow),
    pytest.param(LinearlyImplicitEuler(2), 0.0, 1, marks=pytest.mark.slow),
    pytest.param(LinearlyImplicitEuler(2), 2.0, 1, marks=pytest.mark.slow),
]


@pytest.mark.parametrize(("method", "damping", "order"), PULLED, ids=str)
def test_what_pulls_a_mass_evenly_does_speed_times_momentum(device, method, damping, order):
    coarse, fine = (
        abs(found - exact) / exact for found, exact in (pulled(method, n, device, damping) for n in (20, 40))
    )
    assert math.log2(coarse / fine) == pytest.approx(order, abs=0.1)  # hω/2 beyond it: 0.01
    # A method of order p errs by (hω)ᵖ⁺¹/(p + 1)! of the swing in each of 800 substeps. It has half the work.
    swing = math.sqrt(80) / 800
    assert fine < 800 * swing ** (order + 1) / math.factorial(order + 1) / 2


def test_an_implicit_method_loses_energy_and_never_makes_any(device):
    # In one dimension springs are linear. With x += h v and v at the end of the substep each one makes heat of
    # m Δv²/2 + k Δl²/2 exactly: energy less work only falls, at steps far beyond the explicit limit too.
    line = chain(6, 0.5, mass=0.5, stiffness=400.0, dim=1)
    loads = [PrescribedMotion([0], lambda t: (0.05 * np.sin(7 * t),)), PrescribedMotion([5], lambda t: (0.1 * t,))]
    how = options(device, integrator=LinearlyImplicitEuler(30), substeps=1, energy_limit=math.inf)
    simulation = Simulation(line, loads=loads, **how)
    left = [balance(simulation)[0]]
    for _ in range(40):
        before = simulation.frame()
        simulation.step()
        after = simulation.frame()
        free = slice(1, 5)
        heat = 0.25 * ((after.velocity[free] - before.velocity[free]) ** 2).sum()
        heat += 200.0 * (np.diff(after.position[:, 0] - before.position[:, 0]) ** 2).sum()
        left.append(balance(simulation)[0])
        # Rounding of 30 iterations with 4 unknowns, of energies of 0.1 J.
        assert left[-2] - left[-1] == pytest.approx(heat, abs=1e-13)
    assert left[0] - left[-1] > 0.01


@pytest.mark.slow
def test_with_dampers_the_rest_is_heat(device):
    # ∫ Σ b l'² + b |v − u|² dt over the frames by Simpson's rule, whose error at 5 Hz and 200 frames/s is
    # (0.15)⁴/180 of it.
    how = options(device, gravity=3.0, fps=200.0, substeps=8, integrator=RK4())
    carried_along = Attachment([3], Sphere((0, 0, 1), 0.1, motion=shake), stiffness=50.0, damping=3.0)
    simulation = Simulation(rope(damping=2.0), loads=[PrescribedMotion([0], shake), carried_along], **how)
    (start, _), power = balance(simulation), [simulation.measure().dissipated_power]
    for _ in range(100):
        simulation.step()
        power.append(simulation.measure().dissipated_power)
    heat = (power[0] + 4 * sum(power[1::2]) + 2 * sum(power[2:-1:2]) + power[-1]) / 600
    assert heat > 0.02
    assert start - balance(simulation)[0] == pytest.approx(heat, rel=1e-5)


@pytest.mark.parametrize(("method", "order"), METHODS[::3] + METHODS[2:3], ids=str)
def test_what_carries_attachments_along_does_the_work_that_a_body_has(plain_device, method, order):
    # Energy less work is constant, to the order of the method. Beside a point that stands still, along an axis and
    # in all directions, and turning too. How fast a carrier is at the very start is that of h/100 later: of RK4's
    # work a share that falls with less than its order.
    def make(substeps: int) -> Simulation:
        arm = Sphere((0, 0, 1), 0.1, motion=lambda t: (shake(t), (0 * t, 0 * t, 2 * t)))
        loads = [
            Attachment([0, 1], (0.3, 0.4, 0.5), carried_by=arm, stiffness=50.0, rest_length="now"),
            Attachment([1, 3], arm, stiffness=20.0),
            Attachment([3], stiffness=9.0),
        ]
        how = options(plain_device, gravity=3.0, integrator=method, substeps=substeps)
        return Simulation(rope(), loads=loads, **how)

    coarse, fine = drifts(20, make)
    if order < 4:
        assert math.log2(coarse / fine) == pytest.approx(order, abs=0.1)
    assert fine < {1: 0.01, 2: 1e-4, 4: 1e-8}[order]  # (hω/2)^order and less: hω = 0.02


@pytest.mark.parametrize("integrator", [SymplecticEuler(), Leapfrog()], ids=str)
def test_a_look_at_the_energy_does_no_work(integrator):
    # It takes half a kick, to which the work of forces of time is summed: not that of drives, nor of carriers.
    arm = Sphere((0, 0, 1), 0.1, motion=lambda t: (shake(t), (0 * t, 0 * t, 2 * t)))
    loads = [
        PrescribedMotion([0], lambda t: np.stack(shake(t), axis=-1)),
        Attachment([1, 3], arm, stiffness=20.0),
        Force(lambda t: (0.3, 0.0, 0.0)),
    ]
    simulation = Simulation(rope(0.5), loads=loads, **options("cpu", integrator=integrator))
    for _ in range(5):
        simulation.step()
        before = simulation.measure().external_work
        for _ in range(3):
            simulation.stepping.balance()
        assert simulation.measure().external_work == before
    assert abs(before) > 0.01


# Obstacles that move


def carried(device, motion, method=None, **more) -> tuple[Simulation, float]:
    """Return a damped block that lies on a floor which moves, and its mass."""
    body = box((3, 3, 3), 0.1, mass=0.01, stiffness=200.0, damping=0.2).translate((0, 0, 0.1))
    floor = Plane(motion=motion, restitution=0.0, friction=0.5)
    how = {"gravity": 9.0, "precision": "float64", "substeps": 20, "device": device}
    return Simulation(body, colliders=[floor], integrator=method or SymplecticEuler(), **(how | more)), 0.27


@pytest.mark.parametrize("method", [SymplecticEuler(), Leapfrog(), RK4()], ids=str)
def test_a_floor_that_lifts_does_m_g_z(plain_device, method):
    # At u from the start: m u² in the jerk, of which half is heat, and m g u t. Leapfrog's first half kick pushes
    # the block down before it is caught, and its last one knows of no floor: m u g h/2 each.
    u, h = 0.5, 1 / 1200
    simulation, mass = carried(plain_device, lambda t: (0 * t, 0 * t, u * t), method)
    simulation.step(60)
    found = simulation.measure()
    assert found.external_work == pytest.approx(mass * (u * u + 9.0 * u), abs=2 * mass * 9.0 * u * h)
    # What it was at the start, the work, and less the heat of the jerk: the block has swung out.
    rest, slack = carried(plain_device, None)[0], 3 * mass * 9.0 * u * h
    rest.step(60)
    gained = found.energy - rest.measure().energy
    assert gained == pytest.approx(mass * (u * u / 2 + 9.0 * u), abs=slack)


def test_a_turning_bat_does_what_a_ball_gets(device):
    # A single particle hit by a face that comes at u = ωr leaves at (1 + e) u: the work is m (1 + e) u², more than
    # m (1 + e)² u²/2, which it then has, by m (1 − e²) u²/2, the heat.
    rate, e, r, m = 2.0, 0.5, 1.5, 0.3
    bat = Box(
        (0, 0, 0),
        (4, 0.1, 1),
        motion=lambda t: ((0 * t, 0 * t, 0 * t), (0 * t, 0 * t, rate * t)),
        restitution=e,
        friction=0.0,
    )
    ball = System(position=[(r, 0.055, 0.0)], mass=m)
    how = {"gravity": 0.0, "precision": "float64", "fps": 1000.0, "substeps": 10, "device": device}
    simulation = Simulation(ball, colliders=[bat], **how)
    simulation.step(10)
    found, u = simulation.measure(), rate * r
    # Met after 2 ms, when the face has turned by 4e-3 and its surface moves at ω (r, 0.05): shares of 1e-3.
    assert found.kinetic_energy == pytest.approx(0.5 * m * (1 + e) ** 2 * u * u, rel=5e-3)
    assert found.external_work == pytest.approx(m * (1 + e) * u * u, rel=5e-3)


@pytest.mark.slow
@pytest.mark.parametrize(("method", "rule"), [(SymplecticEuler(), "coulomb"), (RK4(), "report")], ids=str)
def test_no_obstacle_is_a_source_of_energy(plain_device, method, rule):
    # Thrown by a shaken tray, hit by a fast ball, swept by a thin rod: energy less work only falls. What is put
    # back on a surface is moved against its springs, by no more than it goes in a substep: a share of first order
    # in h, less than the 2 % that the pace of automatic substeps lets pass.
    def shaken(t):
        return 0.05 * np.sin(20 * t), 0 * t, 0.1 * np.sin(25 * t)

    fast, slow = (lambda t: (8 * t, 0 * t, 0 * t)), (lambda t: (3 * t, 0 * t, 0 * t))
    ball, past = (Sphere((-1.5, y, 0.25), 0.3, motion=fast, restitution=0.5) for y in (0, 99))
    rod, off = (Capsule((-0.6, y - 1, 0.35), (-0.6, y + 1, 0.35), 0.02, motion=slow) for y in (0, 99))
    for colliders in (  # of the same kinds, by the same kernels: what is not meant passes far away
        [Plane(motion=shaken, restitution=0.7, friction=0.3), past, off],
        [Plane(), ball, off],
        [Plane(), past, rod],
    ):
        body = box((4, 4, 4), 0.1, mass=0.01, stiffness=200.0, damping=0.1).translate((0, 0, 0.3))
        how = {"integrator": method, "collider_rule": rule, "substeps": 20, "device": plain_device}
        simulation = Simulation(body, colliders=colliders, **how)
        least, most = math.inf, 0.0
        for _ in range(60):
            simulation.step()
            now, work = balance(simulation)
            least, most = min(least, now), max(most, abs(work))
            assert now <= least + 0.02 * max(most, 1.0)
        assert most > 0.1


def test_an_older_checkpoint_without_sums_goes_on(plain_device):
    def make():
        return carried(plain_device, lambda t: (0 * t, 0 * t, 5 * t))[0]

    whole, other = make(), make()
    repeats = plain_device == "cpu" or whole.model.force_algorithm != "scatter"  # else rounding of 1e-16 m grows
    whole.step(20)
    arrays, numbers = whole.checkpoint()
    other.restore({name: one for name, one in arrays.items() if not name.startswith("work.")}, numbers)
    whole.step(20)
    other.step(20)
    np.testing.assert_allclose(
        other.frame().position, whole.frame().position, rtol=0, atol=0 if repeats else 1e-12
    )
    assert 0.0 < other.measure().external_work < whole.measure().external_work


# The watch


def test_a_drive_that_does_much_is_no_divergence(device):
    # Lifted by fifty times its size with fixed substeps: far more energy than at the start, all of it the drive's.
    body = box((3, 2, 2), 0.1, mass=0.1, stiffness=200.0, damping=0.5)
    lift = PrescribedMotion([0, 1], lambda t: (0 * t, 0 * t, 10 * t**2 / (1 + t)))
    simulation = Simulation(body, loads=[lift], substeps=20, device=device)
    start = simulation.measure().energy
    simulation.step(90)
    assert simulation.measure().energy > start + 10 * 2 * 1.0 * 9.82 * 0.2


def test_neither_is_a_floor_that_lifts(device):
    # By forty times the size of the block: what it has is compared less the work.
    simulation, mass = carried(device, lambda t: (0 * t, 0 * t, 10 * t**2 / (1 + t)))
    simulation.step(90)
    assert simulation.measure().energy > 10 * mass * 9.0 * 0.2


@pytest.mark.parametrize("what", ["drive", "tray", "arm"])
@pytest.mark.parametrize("method", [SymplecticEuler(), RK4()], ids=["euler", "rk4"])
@pytest.mark.each_value
def test_what_heats_is_found_though_something_shakes_it(plain_device, method, what):
    # A step beyond the limit: its energy is far from infinite in the frame in which it is found.
    body = box((3, 3, 3), 0.1, mass=0.1, stiffness=200.0)
    around = {
        "drive": {"loads": [PrescribedMotion([0, 1, 2], shake)]},
        "tray": {"colliders": [Plane(offset=-0.2, motion=shake)]},
        "arm": {"loads": [Attachment([0, 1], Sphere(motion=shake), stiffness=50.0)]},
    }
    how = {"precision": "float64", "gravity": 1.0, "fps": 1.0, "integrator": method, "device": plain_device}
    how |= around[what]
    limit = Simulation(body, safety=1.0, **how)
    steps = math.floor(limit.substeps / 1.6)  # the bound may be twice the largest rate
    how |= {"fps": steps / 10, "substeps": 10, "allow_unstable": True}
    simulation, unwatched = (Simulation(body, energy_limit=most, **how) for most in (10.0, math.inf))
    with pytest.raises(SimulationDiverged):
        simulation.step(100)
    unwatched.step(simulation.frame_index + 1)
    assert np.isfinite(unwatched.measure().energy)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "seconds", "smaller"),
    [("jelly", 6.0, {"across": 9}), ("walker", 2.0, {})],
)
def test_scenes_that_are_driven_hard_raise_no_alarm(plain_device, name, seconds, smaller):
    # With fixed substeps, a third more than small motions need. tests/test_scenes.py does so with the mattress.
    scene = importlib.import_module(f"msdwarp.scenes.{name}").build(**smaller)
    few = Simulation.from_scene(scene, device=plain_device).substeps
    simulation = Simulation.from_scene(scene, device=plain_device, substeps=math.ceil(1.33 * few))
    simulation.step(round(60 * seconds))
    assert abs(simulation.measure().external_work) > 0.1
