"""Contact with planes: bounce and friction by closed forms, whatever the step, and rest that is rest."""

import math

import numpy as np
import problems
import pytest

from msdwarp import RK4, Leapfrog, Plane, Simulation, SymplecticEuler, System, box

G = 9.82
FLOOR = {3: (0.0, 0.0, 1.0), 2: (0.0, 1.0), 1: (1.0,)}
OBLIQUE = (2 / 3, -1 / 3, 2 / 3)
every_integrator = pytest.mark.parametrize(
    "integrator", [SymplecticEuler(), Leapfrog(), RK4()], ids=["euler", "leapfrog", "rk4"]
)


def particle(position, velocity) -> System:
    return System(position=[position], velocity=velocity)


def simulate(system: System, planes, device: str, *, h: float, substeps: int = 1, **options) -> Simulation:
    """Return a float64 simulation among planes with substeps of h."""
    colliders = [planes] if isinstance(planes, Plane) else planes
    options = {"gravity": 0.0, "precision": "float64"} | options
    return Simulation(
        system, colliders=colliders, fps=1 / (h * substeps), substeps=substeps, device=device, **options
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
    simulation = simulate(
        particle(start, velocity), plane, plain_device, h=1 / 1000, substeps=50, integrator=integrator
    )
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
    plane = Plane(normal, restitution=0.5, friction=0.2)
    simulation = simulate(particle(0.05 * np.array(normal), velocity), plane, plain_device, h=0.01, substeps=5)
    simulation.step()
    expected = after_hit(velocity, normal, restitution=0.5, friction=0.2)
    np.testing.assert_allclose(simulation.frame().velocity[0], expected, rtol=0, atol=1e-15)  # roundings


def test_normal_may_have_any_length():
    np.testing.assert_allclose(Plane((0, 3, 4)).normal, (0, 0.6, 0.8), rtol=1e-15)  # one rounding


@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_one_hit_with_infinite_friction_is_the_reports_rule(plain_device, precision):
    # Without a force in the substep both rules are v_n' = −e v_n, v_t' = f v_t.
    velocity, atol = (3.0, -1.0, -2.0), {"float32": 1e-6, "float64": 1e-15}[precision]  # roundings of 3 m/s
    for collider_rule in ("coulomb", "report"):
        plane = Plane(restitution=0.6, friction=math.inf, tangential_factor=0.8)
        simulation = simulate(
            particle((0, 0, 0.01), velocity),
            plane,
            plain_device,
            h=0.01,
            collider_rule=collider_rule,
            precision=precision,
        )
        simulation.step()
        now = simulation.frame()
        np.testing.assert_allclose(now.velocity[0], (2.4, -0.8, 1.2), rtol=0, atol=atol)
        # By "report" on the surface; by "coulomb" on its way from where the substep began: 1 cm and h 1.2 m/s.
        assert now.position[0, 2] == pytest.approx(0.0 if collider_rule == "report" else 0.022, rel=1e-6, abs=0)


def test_rules_differ_in_the_normal_speed_they_return(plain_device):
    # v is −2 m/s before and −2 − g h after the kick of the substep: "report" mirrors that, "coulomb" what
    # the particle came with, so that gravity during the hit adds nothing to the bounce.
    h, plane = 0.01, Plane(restitution=0.5, friction=0.25, tangential_factor=0.75)
    found = {}
    for collider_rule in ("report", "coulomb"):
        simulation = simulate(
            particle((0, 0, 0.01), (4.0, 0.0, -2.0)),
            plane,
            plain_device,
            h=h,
            gravity=G,
            collider_rule=collider_rule,
        )
        simulation.step()
        found[collider_rule] = simulation.frame().velocity[0]
    np.testing.assert_allclose(found["report"], (3.0, 0, 0.5 * (2 + G * h)), rtol=0, atol=1e-15)
    # j = 1 + 2 + g h and μ j = 0.77 < (1 − f)|v_t| = 1: Coulomb's friction is the smaller.
    np.testing.assert_allclose(found["coulomb"], (4 - 0.25 * (3 + G * h), 0, 1.0), rtol=0, atol=1e-15)


def test_report_rule_multiplies_at_every_touch(plain_device):
    # A particle held down by gravity touches every substep: f^n after n of them, whatever the load.
    plane = Plane(restitution=0.0, tangential_factor=0.9)
    simulation = simulate(
        particle((0, 0, 0), (5.0, 0, 0)),
        plane,
        plain_device,
        h=0.01,
        substeps=20,
        gravity=G,
        collider_rule="report",
    )
    simulation.step()
    np.testing.assert_allclose(simulation.frame().velocity[0], (5 * 0.9**20, 0, 0), rtol=1e-14)  # 20 roundings


@pytest.mark.parametrize(("speed", "bounces"), [(0.009, False), (0.011, True)])
def test_slow_approach_does_not_bounce(plain_device, speed, bounces):
    simulation = simulate(
        particle((0, 0, 0), (0, 0, -speed)), Plane(restitution=0.5, rest_speed=0.01), plain_device, h=0.01
    )
    simulation.step()
    assert simulation.frame().velocity[0, 2] == (0.5 * speed if bounces else 0.0)  # half of a number is exact


@pytest.mark.filterwarnings("ignore::msdwarp.StartWarning")  # it starts inside
def test_particle_on_its_way_out_is_left_alone(plain_device):
    start, velocity = (0.0, 0.0, -1.0), (3.0, 0.0, 0.5)
    simulation = simulate(particle(start, velocity), Plane(friction=1.0), plain_device, h=0.125, substeps=8)
    simulation.step()  # 1 s; every number here is exact in binary
    np.testing.assert_array_equal(simulation.frame().position[0], (3.0, 0.0, -0.5))
    np.testing.assert_array_equal(simulation.frame().velocity[0], velocity)


@pytest.mark.parametrize("h", [1 / 500, 1 / 1000, 1 / 4000])
def test_bouncing_ball_reaches_e_squared_of_its_height(plain_device, h):
    plane = Plane(restitution=0.8)
    simulation = simulate(particle((0, 0, 1.0), (0, 0, 0)), plane, plain_device, h=h, gravity=G)
    apexes, before = [], simulation.frame()
    while len(apexes) < 4:
        simulation.step()
        now = simulation.frame()
        if now.velocity[0, 2] > 0 > before.velocity[0, 2]:  # it has bounced
            apexes.append(0.0)
        if apexes:
            apexes[-1] = max(apexes[-1], float(now.position[0, 2]))
        before = now
    # For each hit: the speed before it is that of up to a substep earlier, of 4.4 … 2.8 m/s, which counts
    # twice for the height, and symplectic Euler flies v h/2 lower; in all a share of 3 g h / 2.3 m/s.
    for hits, apex in enumerate(apexes[:3], start=1):
        assert apex == pytest.approx(0.64**hits, rel=hits * 3 * G * h / 2.3)


@pytest.mark.parametrize("h", [1 / 60, 1 / 240, 1 / 960])
def test_particle_slides_as_far_as_coulomb_says(plain_device, h):
    v, mu = 6.0, 0.3
    simulation = simulate(particle((0, 0, 0), (v, 0, 0)), Plane(friction=mu), plain_device, h=h, gravity=G)
    simulation.step(math.ceil(1.1 * v / (mu * G * h)))
    now = simulation.frame()
    assert not now.velocity.any()
    # v²/2μg, to half a substep's way: a share of μ g h / v, 0.8 % at the longest step.
    assert now.position[0, 0] == pytest.approx(v**2 / (2 * mu * G), rel=0.01)


@pytest.mark.parametrize("h", [1 / 1200, 1 / 2400, 1 / 9600])
def test_die_slides_as_far_as_coulomb_says(device, h):
    v, mu = 3.0, 0.5
    die = box((3, 3, 3), stiffness=1e5, damping=20.0).translate((0, 0, 1)).with_velocity((v, 0, 0))
    simulation = simulate(
        die, Plane(friction=mu, restitution=0.5), device, h=h, substeps=round(0.05 / h), gravity=G
    )
    simulation.step(16)  # 0.8 s; it stops after v/μg = 0.61 s
    now = simulation.snapshot()
    moved = now.centre_of_mass[0] - die.centre_of_mass[0]
    assert moved == pytest.approx(v**2 / (2 * mu * G), rel=0.01)
    # Stopped, but for the swing that is left when friction ends: at most μ g / ω = 0.03 m/s with ω of the
    # slowest shear mode, √(k/m)/2 or above. Of the travel it is 0.2 mm.
    assert abs(now.velocity[:, 0].mean()) < 0.03


def slope(angle: float, **coefficients) -> Plane:
    """Return a plane through the origin that falls towards +x."""
    return Plane((math.sin(angle), 0.0, math.cos(angle)), **coefficients)


@every_integrator
@pytest.mark.parametrize("h", [1 / 60, 1 / 600])
def test_particle_on_a_slope_within_friction_stays(plain_device, integrator, h):
    # tan 0.4 = 0.42 < μ = 0.5: friction holds all of gravity along the slope.
    simulation = simulate(
        particle((0, 0, 0), (0, 0, 0)),
        slope(0.4, friction=0.5),
        plain_device,
        h=h,
        substeps=60,
        gravity=G,
        integrator=integrator,
    )
    simulation.step(10)
    assert np.abs(simulation.frame().position).max() < 1e-12  # 600 substeps of roundings of g h²
    if not isinstance(integrator, Leapfrog):  # which has gravity's half kick in the velocity it tells
        assert np.abs(simulation.frame().velocity).max() < 1e-15  # roundings of g h


def test_particle_on_a_slope_beyond_friction_slides(plain_device):
    angle, mu, h = 0.4, 0.3, 1 / 600
    simulation = simulate(
        particle((0, 0, 0), (0, 0, 0)), slope(angle, friction=mu), plain_device, h=h, substeps=60, gravity=G
    )
    simulation.step(10)
    now = simulation.frame()
    down = np.array([math.cos(angle), 0, -math.sin(angle)])
    a, t = G * (math.sin(angle) - mu * math.cos(angle)), 1.0
    np.testing.assert_allclose(now.velocity[0], a * t * down, rtol=0, atol=1e-12)  # 600 roundings of 1 m/s
    # Positions take the velocity of one end of a substep, before or after friction: within h times the
    # largest speed there, with gravity's share.
    np.testing.assert_allclose(now.position[0], a * t**2 / 2 * down, rtol=0, atol=h * (a + G * 0.4) * t)


@pytest.mark.parametrize("start", [(0.1, 0.0, 0.3), (0.1, 0.0, 0.2)], ids=["in turn", "at once"])
def test_corner_turns_a_particle_twice(plain_device, start):
    planes = [
        Plane((1, 0, 0), restitution=0.5, friction=0.0),
        Plane((0, 0, 1), restitution=0.25, friction=0.0),
    ]
    simulation = simulate(particle(start, (-1.0, 3.0, -2.0)), planes, plain_device, h=0.01, substeps=50)
    simulation.step()
    now = simulation.frame()
    np.testing.assert_allclose(now.velocity[0], (0.5, 3.0, 0.5), rtol=0, atol=1e-15)  # roundings
    assert now.position[0, 1] == pytest.approx(1.5, rel=1e-14)
    assert (now.position[0] > 0).all()


@pytest.mark.slow
@pytest.mark.parametrize("integrator", [Leapfrog(), RK4()], ids=["leapfrog", "rk4"])
def test_energy_of_a_bouncing_particle_never_rises(device, integrator):
    # In flight both keep it, with velocities at the instant of the positions. A hit takes its share, and no height
    # comes from nothing.
    start = particle((0, 0, 1.0), (6.0, -1.0, -2.0))
    plane = Plane(restitution=0.9, friction=0.1)
    simulation = simulate(start, plane, device, h=1 / 200, gravity=G, integrator=integrator)
    energies = [problems.energy(start, gravity=G)]
    for _ in range(2000):
        simulation.step()
        energies.append(problems.energy(simulation.snapshot(), gravity=G))
    assert np.diff(energies).max() < 20 * energies[0] * problems.EPS64  # roundings of the sum
    assert energies[-1] < 0.1 * energies[0]


def falling_block() -> System:
    block = box((3, 3, 3), spacing=0.1, mass=0.1, stiffness=2000.0, damping=5.0)
    return block.rotate(0.5, axis=(1, 1, 0.3)).translate((0, 0, 0.4))


def test_energy_of_a_falling_block_never_rises(device):
    block = falling_block()
    plane = Plane(restitution=0.5, friction=0.5)
    simulation = simulate(block, plane, device, h=1 / 2000, substeps=20, gravity=G)
    energies = [problems.energy(block, gravity=G)]
    for _ in range(150):
        simulation.step()
        energies.append(problems.energy(simulation.snapshot(), gravity=G))
    # Symplectic Euler's energy wanders by hω/2 = 0.12 of what is elastic, which is a few per cent.
    assert np.diff(energies).max() < 0.12 * 0.05 * energies[0]
    assert max(energies) == energies[0]


def test_block_at_rest_does_not_tremble(device):
    simulation = simulate(falling_block(), Plane(restitution=0.3), device, h=1 / 2000, substeps=200, gravity=G)
    simulation.step(150)  # 15 s; the slowest mode, a swing over the ground, decays by e^-4 a second
    then = simulation.frame()
    simulation.step(5)
    now = simulation.frame()
    # Forces are in balance to a few roundings of 26 springs · 2000 N/m · 1 m: on 0.1 kg, for a substep,
    # 6e-14 m/s each.
    assert np.abs(now.velocity).max() < 1e-12
    np.testing.assert_allclose(now.position, then.position, rtol=0, atol=1e-12)
    assert now.position[:, 2].min() == 0.0  # on the floor, neither above nor in it


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"normal": (0.0, 0.0, 0.0)}, r"normal is \(0.0, 0.0, 0.0\)"),
        ({"normal": (0.0, math.nan, 1.0)}, r"normal is \(0.0, nan, 1.0\)"),
        ({"normal": (0.0, math.inf, 1.0)}, r"normal is \(0.0, inf, 1.0\)"),
        ({"normal": [[0.0, 0.0, 1.0]]}, r"normal is \[\[0.0, 0.0, 1.0\]\]"),
        ({"normal": "up"}, "normal must be an array of numbers, not 'up'"),
        ({"offset": math.nan}, "offset is nan"),
        ({"offset": -math.inf}, "offset is -inf"),
        ({"offset": (1.0, 2.0)}, r"offset .*\(1.0, 2.0\)"),
        ({"restitution": -0.1}, "restitution is -0.1"),
        ({"restitution": 1.5}, "restitution is 1.5"),
        ({"restitution": math.nan}, "restitution is nan"),
        ({"restitution": "much"}, "restitution is 'much'"),
        ({"tangential_factor": 2.0}, "tangential_factor is 2.0"),
        ({"tangential_factor": -1.0}, "tangential_factor is -1.0"),
        ({"friction": -0.5}, "friction is -0.5"),
        ({"friction": math.nan}, "friction is nan"),
        ({"friction": "much"}, "friction is 'much'"),
        ({"rest_speed": -1.0}, "rest_speed is -1"),
        ({"rest_speed": math.inf}, "rest_speed is inf"),
    ],
)
def test_bad_plane_is_named(arguments, message):
    with pytest.raises(ValueError, match=message):
        Plane(**arguments)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"colliders": [Plane((0, 1))]}, r"colliders\[0\].normal is \(0.0, 1.0\).*3 coordinates"),
        ({"colliders": [Plane(), "floor"]}, r"colliders\[1\] is 'floor'"),
        ({"collider_rule": "sticky"}, "collider_rule is 'sticky'.*'coulomb', 'report'"),
    ],
)
def test_bad_contact_is_named(options, message):
    with pytest.raises(ValueError, match=message):
        Simulation(particle((0, 0, 0), 0.0), device="cpu", **options)
