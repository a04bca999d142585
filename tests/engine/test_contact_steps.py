"""What a contact rule makes of the substep: ours nothing, the report's what can be predicted."""

import math

import numpy as np
import pytest

from msdwarp import RK4, RKC2, Leapfrog, Plane, Simulation, SymplecticEuler, System, box

G = 9.82
STEPS = [1 / 240, 1 / 960, 1 / 3840]
every_rule = pytest.mark.parametrize("collider_rule", ["coulomb", "report"])
STEP_NAMES = [f"1/{1 / h:.0f}" for h in STEPS]
every_step = pytest.mark.parametrize("h", STEPS, ids=STEP_NAMES)


def simulate(system: System, plane: Plane, *, h: float, substeps: int = 1, **options) -> Simulation:
    options = {"gravity": G, "device": "cpu", "precision": "float64"} | options
    return Simulation(system, colliders=[plane], fps=1 / (h * substeps), substeps=substeps, **options)


def heights(count: int = 200) -> np.ndarray:
    """Return heights from which particles hit the floor at as many instants within a substep."""
    return np.linspace(1.0, 1.1, count)


def droplets(speed: float = 0.0) -> System:
    """Return particles that know nothing of each other."""
    z = heights()
    return System(position=np.column_stack([np.zeros_like(z), np.zeros_like(z), z]), velocity=(speed, 0.0, 0.0))


# Bounce energy


@every_step
@every_rule
def test_energy_of_an_elastic_bounce(collider_rule, h):
    # RK4 falls exactly. "coulomb" returns the speed of the substep's start where that began, and so loses nothing;
    # "report" mirrors the speed from below the floor, and gains the depth it is lifted by.
    simulation = simulate(
        droplets(), Plane(restitution=1.0, friction=0.0), h=h, collider_rule=collider_rule, integrator=RK4()
    )
    z = heights()
    simulation.step(math.ceil(1.02 * math.sqrt(2 * z[-1] / G) / h))
    now = simulation.frame()
    assert (now.velocity[:, 2] > 0).all()
    energy = now.velocity[:, 2] ** 2 / 2 + G * now.position[:, 2]
    last = np.floor(np.sqrt(2 * z / G) / h) * h  # the last instant above the floor
    gain = 0.0 if collider_rule == "coulomb" else G * (G * (last + h) ** 2 / 2 - z)
    # Up to 2000 substeps round 10 J/kg.
    np.testing.assert_allclose(energy - G * z, gain, rtol=0, atol=2000 * 10 * 2.2e-16)


@pytest.mark.parametrize("h", [*STEPS[:2], pytest.param(STEPS[2], marks=pytest.mark.slow)], ids=STEP_NAMES)
@pytest.mark.parametrize("integrator", [SymplecticEuler(), Leapfrog()], ids=["euler", "leapfrog"])
def test_elastic_bounces_lead_back_to_the_height_of_the_fall(integrator, h):
    # Velocities half a substep behind positions are turned round there: the particle flies back the way it came.
    # It comes as high as it was at a substep; the middle of the flight may lie half a substep from the next one.
    simulation = simulate(droplets(), Plane(restitution=1.0, friction=0.0), h=h, integrator=integrator)
    z, highest = heights(), np.zeros(200)
    simulation.step(math.ceil(6.5 * math.sqrt(2 * z[-1] / G) / h))  # three bounces
    for _ in range(math.ceil(2.1 * math.sqrt(2 * z[-1] / G) / h)):
        simulation.step()
        highest = np.maximum(highest, simulation.frame().position[:, 2])
    # Roundings of 1 m in each of up to 16 000 substeps; symplectic Euler's start at rest is half a substep late.
    np.testing.assert_allclose(highest, z, rtol=0, atol=G * h**2 / 8 + 16_000 * 1.1e-16)


@pytest.mark.slow
@pytest.mark.parametrize("e", [0.5, 0.95, 1.0])
@pytest.mark.parametrize(
    ("integrator", "substeps"),
    [(SymplecticEuler(), 4), (SymplecticEuler(), 8), (Leapfrog(damper_extrapolation=0.5), 8), (RK4(), 8)],
    ids=["euler 4", "euler 8", "leapfrog extrapolated 8", "rk4 8"],
)
def test_no_bounce_of_a_jelly_gains_energy(integrator, substeps, e):
    # Undamped, on its floor for 20 s: 360 000 hits and more. Before hits left the positions alone this gained
    # twentyfold within 10 s from e = 0.95 on, and ended in numbers that are not finite.
    jelly = box((6, 6, 6), 0.1, mass=0.01, stiffness=50.0).translate((0, 0, 0.3))
    floor = Plane(restitution=e, friction=0.0)
    simulation = Simulation(
        jelly,
        colliders=[floor],
        substeps=substeps,
        device="cpu",
        precision="float64",
        integrator=integrator,
        energy_limit=math.inf,
    )
    start = most = simulation.stepping.balance().energy
    for _ in range(200):
        simulation.step(6)
        most = max(most, simulation.stepping.balance().energy)  # that which the method conserves
    # What is left, at the longest steps: the conserved energy's own error at the strains of a jelly pressed flat.
    assert most < 1.02 * start


@every_step
@every_rule
def test_bounces_lose_e_squared(collider_rule, h):
    e = 0.8
    simulation = simulate(
        droplets(), Plane(restitution=e, friction=0.0), h=h, collider_rule=collider_rule, integrator=RK4()
    )
    z, fall = heights(), np.sqrt(2 * heights() / G)
    t = 1.5 * float(fall.mean())  # after the first bounce and before the second
    steps = round(t / h)
    simulation.step(steps)
    now = simulation.frame()
    energy = now.velocity[:, 2] ** 2 / 2 + G * now.position[:, 2]
    # A substep's way at 4.7 m/s is known to no better: of the height it is v h / z, of the energy at most that.
    np.testing.assert_allclose(energy, e**2 * G * z, rtol=4.7 * h)


# Rest


@every_step
@pytest.mark.parametrize("e", [0.0, 0.5, 0.9])
@every_rule
def test_speed_at_rest(collider_rule, e, h):
    # "report" bounces the speed g h that gravity gives in a substep: v' = e (g h − v) has the fixed point
    # e g h / (1 + e), which it nears as e^n.
    simulation = simulate(
        System(position=[[0.3, 0.0, 0.0]]), Plane(restitution=e), h=h, substeps=50, collider_rule=collider_rule
    )
    simulation.step(8)
    now = simulation.frame()
    expected = 0.0 if collider_rule == "coulomb" else e * G * h / (1 + e)
    assert now.velocity[0, 2] == pytest.approx(expected, rel=1e-12, abs=0)  # 0.9⁴⁰⁰ is 5e-19
    np.testing.assert_array_equal(now.position, [[0.3, 0, 0]])


# Sliding


@every_step
def test_sliding_by_coulombs_law(h):
    v, mu = 3.0, 0.5
    simulation = simulate(
        System(position=[[0.0, 0, 0]], velocity=(v, 0, 0)), Plane(friction=mu, restitution=0.5), h=h, substeps=10
    )
    simulation.step(math.ceil(1.1 * v / (mu * G) / (10 * h)))
    now = simulation.frame()
    assert not now.velocity.any()
    # v²/2μg = 0.9165 m; the last substep may end anywhere: half of v h of the way.
    assert now.position[0, 0] == pytest.approx(v**2 / (2 * mu * G), abs=v * h / 2)


@every_step
def test_sliding_by_the_reports_rule_goes_with_the_step(h):
    # Every touch leaves the share f, after the way of the substep: h v (1 + f + f² + …) = h v / (1 − f).
    v, f = 3.0, 0.9
    simulation = simulate(
        System(position=[[0.0, 0, 0]], velocity=(v, 0, 0)),
        Plane(restitution=0.0, tangential_factor=f),
        h=h,
        substeps=50,
        collider_rule="report",
    )
    simulation.step(8)
    # 0.9⁴⁰⁰ is 5e-19: it has stopped but for roundings.
    assert simulation.frame().position[0, 0] == pytest.approx(h * v / (1 - f), rel=1e-12)


# Below the plane


@pytest.mark.filterwarnings("ignore::msdwarp.StartWarning")  # it starts inside
@every_rule
def test_particle_below_and_moving_up_is_left_alone(collider_rule):
    start, velocity = (0.0, 0.0, -1.0), (3.0, 0.0, 0.5)
    plane = Plane(friction=1.0, tangential_factor=0.5)
    simulation = simulate(
        System(position=[start], velocity=velocity),
        plane,
        h=0.125,
        substeps=8,
        gravity=0.0,
        collider_rule=collider_rule,
    )
    simulation.step()  # 1 s; every number here is exact in binary
    np.testing.assert_array_equal(simulation.frame().position[0], (3.0, 0.0, -0.5))
    np.testing.assert_array_equal(simulation.frame().velocity[0], velocity)


@pytest.mark.filterwarnings("ignore::msdwarp.StartWarning")  # it starts inside
@every_rule
def test_particle_below_and_moving_down_is_led_onto_the_plane(collider_rule):
    simulation = simulate(
        System(position=[[0.0, 0, -2.0]], velocity=(0, 0, -1.0)),
        Plane(restitution=0.0),
        h=0.125,
        gravity=0.0,
        collider_rule=collider_rule,
    )
    # 2 m in half a second, at a steady pace, whatever the step; by "report" at once. No speed comes from that.
    # Exact in binary.
    for height in (0.0, 0.0) if collider_rule == "report" else (-1.5, -1.0, -0.5, 0.0, 0.0):
        simulation.step()
        assert simulation.frame().position[0, 2] == height
        assert simulation.frame().velocity[0, 2] == 0.0


# Order across a contact


@every_rule
@pytest.mark.parametrize(
    "integrator",
    [SymplecticEuler(), Leapfrog(), Leapfrog(damper_extrapolation=0.5), RK4(), RKC2(2)],
    ids=["euler", "leapfrog", "leapfrog extrapolated", "rk4", "rkc2"],
)
def test_every_method_is_first_order_across_a_contact(integrator, collider_rule):
    # The instant of a hit is known to a substep, so one particle's error is anything up to order 1; over
    # many instants within a substep it has a root mean square, in height and along the floor.
    e, mu, v, t = 0.6, 0.1, 2.0, 0.6
    plane = Plane(restitution=e, friction=mu, tangential_factor=0.7 if collider_rule == "report" else 0.0)
    hit = np.sqrt(2 * heights() / G)
    slid = 0.7 * v if collider_rule == "report" else v - mu * (1 + e) * G * hit
    after = t - hit
    exact = np.column_stack([v * hit + slid * after, e * G * hit * after - G * after**2 / 2])
    counts, errors = (60, 120, 240, 480), []
    for n in counts:
        simulation = simulate(
            droplets(v), plane, h=t / n, substeps=n, collider_rule=collider_rule, integrator=integrator
        )
        simulation.step()
        errors.append(np.sqrt(((simulation.frame().position[:, [0, 2]] - exact) ** 2).mean()))
    slope = -np.polyfit(np.log(counts), np.log(errors), 1)[0]
    # 200 instants sample a substep to a few per cent, over a factor of 8 in h.
    assert slope == pytest.approx(1.0, abs=0.1)
    assert errors[-1] < 2 * G * hit.max() * t / counts[-1]  # two substeps' ways
