"""Contact with planes: bounce and friction by closed forms, whatever the step and the rule, and rest."""

import math

import numpy as np
import problems
import pytest
from collisions import G, particle, simulate

from msdwarp import RK4, RKC2, Leapfrog, Plane, Simulation, SymplecticEuler, System, box

STEPS = [1 / 240, 1 / 3840]
every_rule = pytest.mark.parametrize("collider_rule", ["coulomb", "report"])
every_step = pytest.mark.parametrize("h", STEPS, ids=["1/240", "1/3840"])
FLOOR = {3: (0.0, 0.0, 1.0), 2: (0.0, 1.0), 1: (1.0,)}
OBLIQUE = (2 / 3, -1 / 3, 2 / 3)
every_integrator = pytest.mark.parametrize(
    "integrator", [SymplecticEuler(), Leapfrog(), RK4()], ids=["euler", "leapfrog", "rk4"]
)


def after_hit(v, normal, *, restitution: float, friction: float, factor: float = 0.0) -> np.ndarray:
    """Return the velocity after one undisturbed hit: impulse (1 + e)|v_n|, friction at most μ times it."""
    v, n = np.array(v), np.array(normal)
    v_n = v @ n
    v_t = v - v_n * n
    speed = np.linalg.norm(v_t)
    loss = min((1 - factor) * speed, friction * (1 + restitution) * -v_n)
    return v_t * (1 - loss / speed if speed else 1) - restitution * v_n * n


@every_integrator
@pytest.mark.parametrize(
    ("restitution", "friction"),
    [
        (0.0, 0.0),
        (1.0, 0.0),
        (0.7, 0.1),  # slides through the hit
        (0.7, 5.0),  # sticks
        (0.5, math.inf),
    ],
)
def test_oblique_bounce_has_the_closed_form(plain_device, integrator, restitution, friction):
    plane = Plane(OBLIQUE, offset=0.4, restitution=restitution, friction=friction)
    n = np.array(OBLIQUE)
    start, velocity = 0.6 * n + [0.3, 0.1, 0.2], np.array([-3.0, 0.5, -1.0])
    how = {"h": 1 / 1000, "substeps": 50, "gravity": 0.0, "integrator": integrator}
    simulation = simulate(particle(start, [velocity]), plane, plain_device, **how)
    simulation.step(10)
    now = simulation.frame()
    expected = after_hit(velocity, n, restitution=restitution, friction=friction)
    np.testing.assert_allclose(now.velocity[0], expected, rtol=0, atol=1e-14)  # a dozen roundings of 3 m/s
    t_hit = (start @ n - 0.4) / -(velocity @ n)
    assert 0.0 < t_hit < 0.4
    place = start + t_hit * velocity + (0.5 - t_hit) * expected
    # The hit is known to one substep, during which either velocity may hold.
    assert np.abs(now.position[0] - place).max() < 1 / 1000 * (np.linalg.norm(velocity - expected) + 1e-9)


@pytest.mark.parametrize("dim", [1, 2, 3])
def test_planes_in_every_dimension(plain_device, dim):
    normal = FLOOR[dim]
    velocity = {1: (-2.0,), 2: (1.5, -2.0), 3: (1.5, -0.5, -2.0)}[dim]
    plane = Plane(restitution=0.5, friction=0.2)  # which faces up by default
    start = particle(0.05 * np.array(normal), [velocity])
    simulation = simulate(start, plane, plain_device, h=0.01, substeps=5, gravity=0.0)
    simulation.step()
    expected = after_hit(velocity, normal, restitution=0.5, friction=0.2)
    np.testing.assert_allclose(simulation.frame().velocity[0], expected, rtol=0, atol=1e-15)  # roundings


def test_rules_differ_in_the_normal_speed_they_return(plain_device):
    # v is −2 m/s before and −2 − g h after the kick of the substep: "report" mirrors that, "coulomb" what
    # the particle came with, so that gravity during the hit adds nothing to the bounce.
    h, plane = 0.01, Plane(restitution=0.5, friction=0.25, tangential_factor=0.75)
    found = {}
    for collider_rule in ("report", "coulomb"):
        start = particle((0, 0, 0.01), [(4.0, 0.0, -2.0)])
        simulation = simulate(start, plane, plain_device, h=h, collider_rule=collider_rule)
        simulation.step()
        found[collider_rule] = simulation.frame().velocity[0]
    np.testing.assert_allclose(found["report"], (3.0, 0, 0.5 * (2 + G * h)), rtol=0, atol=1e-15)
    # j = 1 + 2 + g h and μ j = 0.77 < (1 − f)|v_t| = 1: Coulomb's friction is the smaller.
    np.testing.assert_allclose(found["coulomb"], (4 - 0.25 * (3 + G * h), 0, 1.0), rtol=0, atol=1e-15)


@pytest.mark.parametrize(("speed", "bounces"), [(0.009, False), (0.011, True)])
def test_slow_approach_does_not_bounce(plain_device, speed, bounces):
    start, floor = particle((0, 0, 0), [(0, 0, -speed)]), Plane(restitution=0.5, rest_speed=0.01)
    simulation = simulate(start, floor, plain_device, h=0.01, gravity=0.0)
    simulation.step()
    assert simulation.frame().velocity[0, 2] == (0.5 * speed if bounces else 0.0)  # half of a number is exact


@pytest.mark.parametrize("h", [1 / 1200, 1 / 9600])
def test_die_slides_as_far_as_coulomb_says(device, h):
    v, mu = 3.0, 0.5
    die = box((3, 3, 3), stiffness=1e5, damping=20.0).translate((0, 0, 1)).with_velocity((v, 0, 0))
    simulation = simulate(die, Plane(friction=mu, restitution=0.5), device, h=h, substeps=round(0.05 / h))
    simulation.step(16)  # 0.8 s; it stops after v/μg = 0.61 s
    now = simulation.snapshot()
    moved = now.center_of_mass[0] - die.center_of_mass[0]
    assert moved == pytest.approx(v**2 / (2 * mu * G), rel=0.01)
    # Stopped, but for the swing that is left when friction ends: at most μ g / ω = 0.03 m/s with ω of the
    # slowest shear mode, √(k/m)/2 or above. Of the travel it is 0.2 mm.
    assert abs(now.velocity[:, 0].mean()) < 0.03


@every_integrator
def test_particle_on_a_slope_within_friction_stays(plain_device, integrator):
    # tan 0.4 = 0.42 < μ = 0.5: friction holds all of gravity along the slope.
    slope = Plane((math.sin(0.4), 0.0, math.cos(0.4)), friction=0.5)
    simulation = simulate(particle((0, 0, 0)), slope, plain_device, h=1 / 60, substeps=60, integrator=integrator)
    simulation.step(10)
    assert np.abs(simulation.frame().position).max() < 1e-12  # 600 substeps of roundings of g h²
    if not isinstance(integrator, Leapfrog):  # which has gravity's half kick in the velocity it tells
        assert np.abs(simulation.frame().velocity).max() < 1e-15  # roundings of g h


@pytest.mark.parametrize("start", [(0.1, 0.0, 0.3), (0.1, 0.0, 0.2)], ids=["in turn", "at once"])
def test_corner_turns_a_particle_twice(plain_device, start):
    planes = [Plane((1, 0, 0), restitution=0.5, friction=0.0), Plane(restitution=0.25, friction=0.0)]
    thrown = particle(start, [(-1.0, 3.0, -2.0)])
    simulation = simulate(thrown, planes, plain_device, h=0.01, substeps=50, gravity=0.0)
    simulation.step()
    now = simulation.frame()
    np.testing.assert_allclose(now.velocity[0], (0.5, 3.0, 0.5), rtol=0, atol=1e-15)  # roundings
    assert now.position[0, 1] == pytest.approx(1.5, rel=1e-14)
    assert (now.position[0] > 0).all()


def test_a_falling_block_gains_no_energy_and_comes_to_rest_without_trembling(device):
    block = box((3, 3, 3), spacing=0.1, mass=0.1, stiffness=2000.0, damping=5.0)
    block = block.rotate(0.5, axis=(1, 1, 0.3)).translate((0, 0, 0.4))
    plane = Plane(restitution=0.3, friction=0.5)
    simulation = simulate(block, plane, device, h=1 / 2000, substeps=20)
    energies = [problems.energy(block, gravity=G)]
    for _ in range(150):
        simulation.step()
        energies.append(problems.energy(simulation.snapshot(), gravity=G))
    # Symplectic Euler's energy wanders by hω/2 = 0.12 of what is elastic, which is a few per cent.
    assert np.diff(energies).max() < 0.12 * 0.05 * energies[0]
    assert max(energies) == energies[0]
    simulation.step(1350)  # to 15 s; the slowest mode, a swing over the ground, decays by e^-4 a second
    then = simulation.frame()
    simulation.step(50)
    now = simulation.frame()
    # Forces are in balance to a few roundings of 26 springs · 2000 N/m · 1 m: on 0.1 kg, for a substep,
    # 6e-14 m/s each.
    assert np.abs(now.velocity).max() < 1e-12
    np.testing.assert_allclose(now.position, then.position, rtol=0, atol=1e-12)
    assert now.position[:, 2].min() == 0.0  # on the floor, neither above nor in it


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
    floor = Plane(restitution=1.0, friction=0.0)
    simulation = simulate(droplets(), floor, "cpu", h=h, collider_rule=collider_rule, integrator=RK4())
    z = heights()
    simulation.step(math.ceil(1.02 * math.sqrt(2 * z[-1] / G) / h))
    now = simulation.frame()
    assert (now.velocity[:, 2] > 0).all()
    energy = now.velocity[:, 2] ** 2 / 2 + G * now.position[:, 2]
    last = np.floor(np.sqrt(2 * z / G) / h) * h  # the last instant above the floor
    gain = 0.0 if collider_rule == "coulomb" else G * (G * (last + h) ** 2 / 2 - z)
    # Up to 2000 substeps round 10 J/kg.
    np.testing.assert_allclose(energy - G * z, gain, rtol=0, atol=2000 * 10 * 2.2e-16)


@pytest.mark.parametrize("h", [1 / 240, pytest.param(1 / 3840, marks=pytest.mark.slow)], ids=["1/240", "1/3840"])
@pytest.mark.parametrize("integrator", [SymplecticEuler(), Leapfrog()], ids=["euler", "leapfrog"])
def test_elastic_bounces_lead_back_to_the_height_of_the_fall(integrator, h):
    # Velocities half a substep behind positions are turned round there: the particle flies back the way it came.
    # It comes as high as it was at a substep; the middle of the flight may lie half a substep from the next one.
    floor = Plane(restitution=1.0, friction=0.0)
    simulation = simulate(droplets(), floor, "cpu", h=h, integrator=integrator)
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
@pytest.mark.each_value
def test_no_bounce_of_a_jelly_gains_energy(integrator, substeps, e):
    # Undamped, on its floor for 20 s: 360 000 hits and more. Before hits left the positions alone this gained
    # twentyfold within 10 s from e = 0.95 on, and ended in numbers that are not finite.
    jelly = box((6, 6, 6), 0.1, mass=0.01, stiffness=50.0).translate((0, 0, 0.3))
    floor, h = Plane(restitution=e, friction=0.0), 1 / (60 * substeps)
    how = {"h": h, "substeps": substeps, "integrator": integrator, "energy_limit": math.inf}
    simulation = simulate(jelly, floor, "cpu", **how)
    start = most = simulation.stepping.balance().energy
    for _ in range(200):
        simulation.step(6)
        most = max(most, simulation.stepping.balance().energy)  # that which the method conserves
    # What is left, at the longest steps: the conserved energy's own error at the strains of a jelly pressed flat.
    assert most < 1.02 * start


# Rest


@every_step
@pytest.mark.parametrize("e", [0.0, 0.5, 0.9])
@every_rule
@pytest.mark.each_value
def test_speed_at_rest(collider_rule, e, h):
    # "report" bounces the speed g h that gravity gives in a substep: v' = e (g h − v) has the fixed point
    # e g h / (1 + e), which it nears as e^n.
    how = {"h": h, "substeps": 50, "collider_rule": collider_rule}
    simulation = simulate(particle((0.3, 0.0, 0.0)), Plane(restitution=e), "cpu", **how)
    simulation.step(8)
    now = simulation.frame()
    expected = 0.0 if collider_rule == "coulomb" else e * G * h / (1 + e)
    assert now.velocity[0, 2] == pytest.approx(expected, rel=1e-12, abs=0)  # 0.9⁴⁰⁰ is 5e-19
    np.testing.assert_array_equal(now.position, [[0.3, 0, 0]])


# Sliding


@every_step
def test_sliding_by_the_reports_rule_goes_with_the_step(h):
    # Every touch leaves the share f, after the way of the substep: h v (1 + f + f² + …) = h v / (1 − f).
    v, f = 3.0, 0.9
    floor = Plane(restitution=0.0, tangential_factor=f)
    how = {"h": h, "substeps": 50, "collider_rule": "report"}
    simulation = simulate(particle((0.0, 0, 0), [(v, 0, 0)]), floor, "cpu", **how)
    simulation.step(8)
    # 0.9⁴⁰⁰ is 5e-19: it has stopped but for roundings.
    assert simulation.frame().position[0, 0] == pytest.approx(h * v / (1 - f), rel=1e-12)


# Below the plane


@pytest.mark.filterwarnings("ignore::msdwarp.StartWarning")  # it starts inside
@every_rule
def test_particle_below_and_moving_up_is_left_alone(collider_rule):
    velocity, plane = (3.0, 0.0, 0.5), Plane(friction=1.0, tangential_factor=0.5)
    how = {"h": 0.125, "substeps": 8, "gravity": 0.0, "collider_rule": collider_rule}
    simulation = simulate(particle((0.0, 0.0, -1.0), [velocity]), plane, "cpu", **how)
    simulation.step()  # 1 s; every number here is exact in binary
    np.testing.assert_array_equal(simulation.frame().position[0], (3.0, 0.0, -0.5))
    np.testing.assert_array_equal(simulation.frame().velocity[0], velocity)


@pytest.mark.filterwarnings("ignore::msdwarp.StartWarning")  # it starts inside
@every_rule
def test_particle_below_and_moving_down_is_led_onto_the_plane(collider_rule):
    start, how = particle((0.0, 0, -2.0), [(0, 0, -1.0)]), {"gravity": 0.0, "collider_rule": collider_rule}
    simulation = simulate(start, Plane(restitution=0.0), "cpu", h=0.125, **how)
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
@pytest.mark.each_value
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
        how = {"h": t / n, "substeps": n, "collider_rule": collider_rule, "integrator": integrator}
        simulation = simulate(droplets(v), plane, "cpu", **how)
        simulation.step()
        errors.append(np.sqrt(((simulation.frame().position[:, [0, 2]] - exact) ** 2).mean()))
    slope = -np.polyfit(np.log(counts), np.log(errors), 1)[0]
    # 200 instants sample a substep to a few per cent, over a factor of 8 in h.
    assert slope == pytest.approx(1.0, abs=0.1)
    assert errors[-1] < 2 * G * hit.max() * t / counts[-1]  # two substeps' ways


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"normal": (0.0, 0.0, 0.0)}, r"normal is \(0.0, 0.0, 0.0\)"),
        ({"normal": (0.0, math.nan, 1.0)}, r"normal is \(0.0, nan, 1.0\)"),
        ({"normal": [[0.0, 0.0, 1.0]]}, r"normal is \[\[0.0, 0.0, 1.0\]\]"),
        ({"normal": "up"}, "normal must be an array of numbers, not 'up'"),
        ({"offset": (1.0, 2.0)}, r"offset .*\(1.0, 2.0\)"),
        ({"restitution": -0.1}, "restitution is -0.1"),
        ({"restitution": 1.5}, "restitution is 1.5"),
        ({"tangential_factor": 2.0}, "tangential_factor is 2.0"),
        ({"tangential_factor": -1.0}, "tangential_factor is -1.0"),
    ],
)
def test_bad_plane_is_named(arguments, message):
    with pytest.raises(ValueError, match=message):
        Plane(**arguments)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"colliders": [Plane(), "floor"]}, r"colliders\[1\] is 'floor'"),
        ({"collider_rule": "sticky"}, "collider_rule is 'sticky'.*'coulomb', 'report'"),
    ],
)
def test_bad_contact_is_named(options, message):
    with pytest.raises(ValueError, match=message):
        Simulation(particle((0, 0, 0)), device="cpu", **options)
