"""Colliders that stand: bounce, slide and rest on each solid, by closed forms."""

import itertools
import math

import numpy as np
import pytest
from collisions import EACH_ONCE, G, distances, every_step, level, particle, simulate as simulate_among
from problems import EPS32, EPS64

from msdwarp import RK4, Box, Capsule, Cone, Plane, Simulation, Sphere, SymplecticEuler, System
from msdwarp.world.colliders import Collider


@pytest.fixture
def device(plain_device: str) -> str:
    """Each device once: particles without connections have no forces that algorithms could sum."""
    return plain_device


AWAY = [
    Plane(offset=-99.0),
    Sphere((0, 0, -99)),
    Box((0, 0, -99), (1, 1, 1)),
    Capsule((0, 0, -99), (1, 0, -99), 0.1),
    Cone((0, 0, -98), (0, 0, -99), 20.0),
]


def simulate(system: System, colliders: Collider | list[Collider], device: str, **options) -> Simulation:
    """Return a simulation among these and, far away, all kinds: the kernels for all kinds serve all tests."""
    colliders = [colliders] if isinstance(colliders, Collider) else colliders
    return simulate_among(system, [*colliders, *AWAY], device, **options)


# All tops lie at z = 0.
TOPS = {
    "plane": lambda **c: Plane(**c),
    "sphere": lambda **c: Sphere((0, 0, -0.5), 0.5, **c),
    "box": lambda **c: Box((0, 0, -0.25), (40, 2, 0.5), **c),
    "capsule": lambda **c: Capsule((-20, 0, -0.3), (20, 0, -0.3), 0.3, **c),
    "cone": lambda **c: Cone((0, 0, -1), (0, 0, 0), 20.0, **c),  # on its base
}
every_top = pytest.mark.parametrize("top", TOPS.values(), ids=TOPS)
flat_top = pytest.mark.parametrize(
    "top", [one for name, one in TOPS.items() if name != "sphere"], ids=[name for name in TOPS if name != "sphere"]
)


@pytest.mark.slow
@every_top
@every_step
@pytest.mark.each_value
def test_bounces_return_e_squared_of_the_height(device, top, h):
    e = 0.7
    simulation = simulate(particle((0, 0, 1.0)), top(restitution=e), device, h=h)
    simulation.step(round(0.452 / h))  # it falls for √(2/g) = 0.4513 s
    heights = []
    for _ in range(round(0.6 / h)):  # and is back after another 2 · 0.7 · 0.4513 s
        simulation.step()
        heights.append(simulation.frame().position[0])
    # The speed before the hit is that of up to a substep earlier, of v = √(2g) = 4.43 m/s: a share of g h/v, twice
    # for the height. Symplectic Euler falls faster than it should by v h/2, and flies lower by e v h/2.
    v = math.sqrt(2 * G)
    assert max(place[2] for place in heights) == pytest.approx(e**2, rel=2 * G * h / v + v * h / 2 + v * h / 2 / e)
    assert not np.array(heights)[:, :2].any()  # straight up


@flat_top
@every_step
@pytest.mark.each_value
def test_slides_as_far_as_friction_lets_it(device, top, h):
    v, mu = 3.0, 0.4
    simulation = simulate(particle((0, 0, 0), [[v, 0, 0]]), top(friction=mu), device, h=h)
    simulation.step(round(0.3 / h))
    # μ g whatever the step: roundings of 3 m/s, on the capsule also of its normals.
    assert simulation.frame().velocity[0, 0] == pytest.approx(v - mu * G * 0.3, abs=100 * EPS64 * 0.3 / h)
    simulation.step(round(0.6 / h))
    now = simulation.frame()
    np.testing.assert_allclose(now.velocity[0], 0.0, rtol=0, atol=1e-14)  # it has stopped
    # v²/2μg, to half a substep's way: of v h/2.
    assert now.position[0, 0] == pytest.approx(v**2 / (2 * mu * G), abs=v * h / 2)
    np.testing.assert_allclose(now.position[0, 1:], 0.0, rtol=0, atol=1e-14)


@every_step
def test_slips_off_a_ball_where_it_should(device, h):
    # Without friction it leaves the ball where cos θ = 2/3 + v0²/(3 g R).
    R, v = 2.0, 0.8
    ball = Sphere((0, 0, -R), R, friction=0.0, restitution=0.0)
    simulation = simulate(particle((0, 0, 0), [[v, 0, 0]]), ball, device, h=h)
    touched = []
    for _ in range(round(1.2 / h)):
        simulation.step()
        up = simulation.frame().position[0] + [0, 0, R]
        if abs(np.linalg.norm(up) - R) < 1e-12:  # it has been put back on the surface
            touched.append(up[2] / R)
    # It is put back along the normal, every time it has come in: a first-order method, whose speed is off by
    # g h of the 4 m/s that it has, as cos θ = v²/g R is by twice that.
    expected = 2 / 3 + v**2 / (3 * G * R)
    assert touched[-1] == pytest.approx(expected, abs=2 * G * h / 4.0 * expected + 1.5 * h * 4.0 / R)
    assert simulation.frame().position[0, 0] > 1.0


@pytest.mark.slow
@pytest.mark.parametrize(  # a method knows nothing of shapes: each solid, each method and each step in turn
    ("top", "integrator", "h"),
    [(top, *one) for top, one in zip(itertools.cycle(TOPS), EACH_ONCE, strict=False)],
    ids=str,
)
def test_rests_on_top(device, top, integrator, h):
    simulation = simulate_among(
        particle((0, 0, 0)), TOPS[top](friction=0.0), device, h=h, substeps=round(0.1 / h), integrator=integrator
    )
    simulation.step(20)
    # Where it is put back is rounded, to the rounding of a distance of 1 m; that does not add up.
    np.testing.assert_allclose(simulation.frame().position[0], 0.0, rtol=0, atol=EPS64)


TILTED = {  # solids, and a place on each where the normal is tilted by 0.3 towards x
    "plane": lambda **c: (Plane((math.sin(0.3), 0, math.cos(0.3)), **c), (0, 0, 0)),
    "sphere": lambda **c: (
        Sphere((0.4, 0.1, 0.2), 0.7, **c),
        (0.4 + 0.7 * math.sin(0.3), 0.1, 0.2 + 0.7 * math.cos(0.3)),
    ),
    "box": lambda **c: (
        Box((0, 0, 0), (1, 1, 1), (0, 0.3, 0), **c),
        (0.5 * math.sin(0.3), 0, 0.5 * math.cos(0.3)),
    ),
    "capsule": lambda **c: (
        Capsule((0, -1, 0), (0, 1, 0), 0.3, **c),
        (0.3 * math.sin(0.3), 0.2, 0.3 * math.cos(0.3)),
    ),
    "cone": lambda **c: (Cone((0, 0, 0), (0, 0, -math.tan(0.3)), 1.0, **c), (0.4, 0, -0.4 * math.tan(0.3))),
}


@pytest.mark.parametrize("tilted", TILTED.values(), ids=TILTED)
@every_step
@pytest.mark.each_value
def test_friction_holds_on_a_slope_of_any_shape(device, tilted, h):
    # tan 0.3 = 0.31 < μ = 0.5: no creep in 2 s, whatever the step. A substep rounds a place of 1 m.
    collider, place = tilted(friction=0.5)
    simulation = simulate(particle(place), collider, device, h=h, substeps=round(0.1 / h))
    simulation.step(10)
    then = simulation.frame().position[0]
    simulation.step(10)
    np.testing.assert_allclose(simulation.frame().position[0], then, rtol=0, atol=1.0 / h * EPS64)
    # On a curved surface it stays where it is drawn back to, along the tangent: above the surface by w²/2R, twice
    # that being room for what this does to the way w of a substep itself.
    way, radius = G * h**2, getattr(collider, "radius", math.inf)
    off = 0.0 if isinstance(collider, Cone) else way**2 / radius
    np.testing.assert_allclose(then, place, rtol=0, atol=off + 1.0 / h * EPS64)


@pytest.mark.parametrize("tilted", [TILTED["plane"], TILTED["box"], TILTED["cone"]], ids=["plane", "box", "cone"])
@every_step
@pytest.mark.each_value
def test_slides_down_a_slope_of_any_shape(device, tilted, h):
    # At first by g (sin 0.3 − μ cos 0.3).
    mu, t = 0.1, 0.1
    collider, place = tilted(friction=mu)
    simulation = simulate(particle(place), collider, device, h=h, substeps=round(t / h))
    simulation.step()
    now, down = simulation.frame(), np.array([math.cos(0.3), 0, -math.sin(0.3)])
    a = G * (math.sin(0.3) - mu * math.cos(0.3))
    np.testing.assert_allclose(now.velocity[0], a * t * down, rtol=0, atol=4 * EPS64 / h)  # roundings, t/h of them
    np.testing.assert_allclose(now.position[0], np.array(place) + a * t**2 / 2 * down, rtol=0, atol=a * t * h)


@pytest.mark.parametrize("tilted", TILTED.values(), ids=TILTED)
@pytest.mark.parametrize("collider_rule", ["coulomb", "report"])
@pytest.mark.each_value
def test_one_hit_mirrors_and_multiplies(device, tilted, collider_rule):
    # Without a force, and with infinite friction, both rules are v_n' = −e v_n and v_t' = f v_t: from a place so
    # near that the hit is where the normal is tilted by 0.3.
    collider, place = tilted(restitution=0.6, friction=math.inf, tangential_factor=0.8)
    n, velocity = np.array([math.sin(0.3), 0, math.cos(0.3)]), np.array([1.0, -0.5, -2.0])
    h = 1e-9
    start = np.array(place) - 0.5 * h * velocity
    simulation = simulate(
        particle(start, [velocity]), collider, device, h=h, gravity=0.0, collider_rule=collider_rule
    )
    simulation.step()
    v_n = velocity @ n * n
    # The normal turns by h v over a radius of 0.3 m, and has roundings of places over it.
    np.testing.assert_allclose(
        simulation.frame().velocity[0], 0.8 * (velocity - v_n) - 0.6 * v_n, rtol=0, atol=10 * h
    )


@every_step
@pytest.mark.parametrize("order", [1, -1])
def test_rests_in_the_corner_of_a_box_and_a_plane(device, h, order):
    # Pressed against the box beside it by a gravity that leans; nothing but the two holds it.
    colliders = [Plane(friction=0.0), Box((1.0, 0, 0.4), (1, 1, 1), friction=0.0)][::order]
    simulation = simulate(
        particle((0.45, 0.1, 0.05)), colliders, device, h=h, substeps=round(0.1 / h), gravity=(3.0, 0.0, -G)
    )
    simulation.step(10)
    then = simulation.frame()
    np.testing.assert_allclose(then.position[0], (0.5, 0.1, 0), rtol=0, atol=1e-15)
    simulation.step(20)
    # Rest is rest: a depth is the difference of two near numbers, which is exact, and what is put back lies there.
    np.testing.assert_array_equal(simulation.frame().position, then.position)
    np.testing.assert_allclose(simulation.frame().velocity[0], 0.0, rtol=0, atol=1e-15)


def room(**coefficients) -> list[Collider]:
    """Return the walls of a room of 2 m and one solid of each kind in it."""
    walls = [Plane(tuple(sign * row), offset=-1.0, **coefficients) for row in np.eye(3) for sign in (1, -1)]
    return [
        *walls,
        Sphere((0.5, 0.4, -0.5), 0.3, **coefficients),
        Box((-0.5, 0.4, -0.8), (0.6, 0.5, 0.8), (0.0, 0.0, 0.5), **coefficients),
        Capsule((-0.6, -0.5, 0.3), (0.5, -0.4, 0.1), 0.2, **coefficients),
        Cone((0.1, -0.5, -0.2), (0.2, -0.4, -1.0), 0.4, **coefficients),
    ]


@pytest.mark.slow
@pytest.mark.parametrize("integrator", [SymplecticEuler(), RK4()], ids=str)
def test_energy_never_rises_among_solids(device, integrator):
    rng = np.random.default_rng(6)
    colliders = room(restitution=0.8, friction=0.2)
    x = rng.uniform(-0.9, 0.9, (400, 3))
    outside = np.min([level(one, x) for one in colliders], axis=0) > 0.02
    system = System(position=x[outside], velocity=rng.uniform(-3, 3, (int(outside.sum()), 3)))
    assert system.particle_count > 100
    h = 1 / 2000
    simulation = simulate(system, colliders, device, h=h, substeps=1, integrator=integrator)
    before, highest = simulation.frame(), 0.0
    for _ in range(400):
        simulation.step()
        now = simulation.frame()
        energies = [(one.velocity**2).sum(axis=1) / 2 + G * one.position[:, 2] for one in (before, now)]
        # What is put out of a solid may be lifted by the way that it has come in, against which its speed was
        # lowered; roundings of 20 J.
        lift = G * h * np.linalg.norm(before.velocity, axis=1)
        assert (energies[1] - energies[0] <= lift + 20 * EPS64).all()
        highest = max(highest, float((energies[1] - energies[0]).max()))
        before = now
    total = ((now.velocity**2).sum() / 2 + G * now.position[:, 2].sum()) / system.particle_count
    assert total < (system.velocity**2).sum() / 2 / system.particle_count
    # Nobody is inside anything but for a substep's way.
    depth = np.min([distances(colliders, now.position, p)[1] for p in range(len(colliders))], axis=0)
    assert depth.min() > -6.0 * h


@pytest.mark.slow
@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("precision", ["float32", "float32-compensated", "float64"])
@pytest.mark.each_value
def test_all_kinds_at_once_in_every_precision(device, dim, precision):
    def at(*xz: float) -> tuple[float, ...]:
        return xz if dim == 2 else (xz[0], 0.0, xz[1])

    across = (1.0,) * (dim - 2)
    colliders = [
        Plane(offset=-0.3),
        Sphere(at(0, -0.2), 0.25),
        Box(at(1, 0), (0.5, *across, 0.4)),
        Capsule(at(1.9, 0.1), at(2.1, 0.1), 0.1),
        Cone(at(3, -0.3), at(3, 0.1), 0.2),
    ]
    start = [at(k, 0.5) for k in range(5)]
    simulation = Simulation(
        System(position=start), colliders=colliders, fps=10, substeps=100, device=device, precision=precision
    )
    simulation.step(40)
    expected = [at(0, 0.05), at(1, 0.2), at(2, 0.2), at(3, 0.1), at(4, -0.3)]
    eps = EPS64 if precision == "float64" else EPS32
    # Roundings of places of 4 m.
    np.testing.assert_allclose(simulation.frame().position, expected, rtol=0, atol=8 * eps)
