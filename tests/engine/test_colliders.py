"""Solid colliders, fixed and moving: distances against brute force; bounce, slide and rest by closed forms."""

import math

import numpy as np
import pytest
import warp as wp
from problems import EPS32, EPS64

from msdwarp import (
    RK4,
    RKC2,
    Box,
    Capsule,
    Cone,
    Leapfrog,
    LinearlyImplicitEuler,
    Plane,
    Simulation,
    Sphere,
    SymplecticEuler,
    System,
    box,
)
from msdwarp.engine.model import Model
from msdwarp.kernels.basis import kernel, vector
from msdwarp.kernels.contact.distance import KINDS, signed_distance, solids
from msdwarp.world.colliders import Collider

G = 9.82
STEPS = [1 / 60, 1 / 240, 1 / 960]
INTEGRATORS = [
    SymplecticEuler(),
    Leapfrog(),
    Leapfrog(damper_extrapolation=0.5),
    RK4(),
    RKC2(),
    LinearlyImplicitEuler(iterations=1),  # more would take long, and change little here
]
every_integrator = pytest.mark.parametrize("integrator", INTEGRATORS, ids=str)
every_step = pytest.mark.parametrize("h", STEPS)


def particle(position, velocity=0.0) -> System:
    return System(position=[position], velocity=velocity)


def simulate(system: System, colliders, device: str, *, h: float, substeps: int = 1, **options) -> Simulation:
    """Return a float64 simulation among colliders with substeps of h."""
    colliders = [colliders] if isinstance(colliders, Collider) else colliders
    options = {"gravity": G, "precision": "float64"} | options
    return Simulation(
        system, colliders=colliders, fps=1 / (h * substeps), substeps=substeps, device=device, **options
    )


# Distances


def axes_of(collider: Box, dim: int) -> np.ndarray:
    """Return the directions of a box's edges, by the exponential of its turn."""
    if collider.turn is None:
        return np.eye(dim)
    if dim == 2:
        generator = collider.turn * np.array([[0, -1], [1, 0]])
    else:
        x, y, z = collider.turn
        generator = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    values, vectors = np.linalg.eig(generator)
    return (vectors @ np.diag(np.exp(values)) @ np.linalg.inv(vectors)).real


def level(collider: Collider, x: np.ndarray) -> np.ndarray:
    """Return numbers that are 0 on the surface, below 0 inside: no distances, but for a plane and a sphere."""
    dim = x.shape[1]
    if isinstance(collider, Plane):
        return x @ collider.unit_normal(dim) - collider.offset
    if isinstance(collider, Sphere):
        return np.linalg.norm(x - collider.position, axis=1) - collider.radius
    if isinstance(collider, Box):
        q = (x - collider.position) @ axes_of(collider, dim)
        return (np.abs(q) - np.array(collider.size) / 2).max(axis=1)
    if isinstance(collider, Capsule):
        a, b = np.array(collider.start), np.array(collider.end)
        t = np.clip((x - a) @ (b - a) / ((b - a) @ (b - a)), 0, 1)
        return np.linalg.norm(x - a - t[:, None] * (b - a), axis=1) - collider.radius
    a, b = np.array(collider.apex), np.array(collider.base)
    along = (x - a) @ (b - a) / ((b - a) @ (b - a))
    off = np.linalg.norm(x - a - along[:, None] * (b - a), axis=1)
    return np.maximum(off - collider.radius * along, (along - 1) * np.linalg.norm(b - a))


def on_surface(collider: Collider, dim: int, rng: np.random.Generator) -> np.ndarray:
    """Return points all over the surface: where rays from inside leave it, by bisection."""
    ways = rng.normal(size=(4000, dim))
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    inside = {
        Plane: lambda c: (c.offset - 1) * c.unit_normal(dim),
        Sphere: lambda c: c.position,
        Box: lambda c: c.position,
        Capsule: lambda c: (np.array(c.start) + c.end) / 2,
        Cone: lambda c: 0.3 * np.array(c.apex) + 0.7 * np.array(c.base),
    }[type(collider)](collider)
    low, high = np.zeros(len(ways)), np.full(len(ways), 40.0)
    for _ in range(60):
        middle = (low + high) / 2
        outside = level(collider, np.array(inside) + middle[:, None] * ways) > 0
        low, high = np.where(outside, low, middle), np.where(outside, middle, high)
    points = np.array(inside) + high[:, None] * ways
    return points[high < 39]


def distances(colliders, x: np.ndarray, p: int) -> tuple[np.ndarray, np.ndarray]:
    """Return (normals, distances) of points from collider p, as kernels compute them on the CPU."""
    dim = x.shape[1]
    model = Model(System(position=x[:1]), colliders=colliders, device="cpu", precision="float64")
    (around,) = model.effects
    kinds = tuple(sorted({type(one).__name__ for one in colliders}, key=KINDS.index))
    distance, V = signed_distance(dim, wp.float64, kinds), vector(dim, wp.float64)
    Solids, Result = solids(dim, wp.float64), wp.types.vector(dim + 1, wp.float64)

    @kernel
    def measure_distances(s: Solids, p: int, x: wp.array(dtype=V), found: wp.array(dtype=Result)):
        found[wp.tid()] = distance(s, p, x[wp.tid()])

    found = wp.zeros(len(x), dtype=Result, device="cpu")
    inputs = [around.data.solids, p, wp.array(x, dtype=V, device="cpu")]
    wp.launch(measure_distances, len(x), inputs, [found], device="cpu")
    result = found.numpy().reshape(len(x), dim + 1)
    return result[:, :dim], result[:, dim]


SOLIDS = {
    1: [Plane((-1.0,), offset=0.2), Sphere((0.1,), 0.4), Box((-0.2,), (0.7,))],
    2: [
        Plane((3.0, 4.0), offset=0.2),
        Sphere((0.1, -0.2), 0.4),
        Box((-0.2, 0.1), (0.7, 1.1), 0.6),
        Capsule((-0.3, 0.2), (0.5, -0.1), 0.3),
        Cone((0.2, 0.7), (-0.1, -0.4), 0.5),
    ],
    3: [
        Plane((2.0, -1.0, 2.0), offset=-0.2),
        Sphere((0.1, -0.2, 0.3), 0.4),
        Box((-0.2, 0.1, 0.0), (0.7, 1.1, 0.5), (0.6, -0.9, 0.4)),
        Capsule((-0.3, 0.2, 0.4), (0.5, -0.1, -0.3), 0.3),
        Cone((0.2, 0.7, 0.1), (-0.1, -0.4, 0.3), 0.6),
        Cone((0.0, 0.0, 0.2), (0.0, 0.0, 0.0), 0.9),  # flat: its base is often the nearest
        Box((0.0, 0.0, 0.0), (1.0, 0.2, 0.6)),
    ],
}
every_solid = pytest.mark.parametrize(("dim", "p"), [(dim, p) for dim in SOLIDS for p in range(len(SOLIDS[dim]))])


@every_solid
def test_distances_are_those_of_the_nearest_point_of_the_surface(dim, p):
    collider, rng = SOLIDS[dim][p], np.random.default_rng(dim)
    x = rng.uniform(-1.2, 1.2, (150, dim))
    n, d = distances(SOLIDS[dim], x, p)
    np.testing.assert_allclose(np.linalg.norm(n, axis=1), 1.0, rtol=0, atol=8 * EPS64)  # roundings of a root
    assert np.abs(d).min() > 1e-6  # no place is so near that roundings could choose its side
    np.testing.assert_array_equal(d < 0, level(collider, x) < 0)
    # From above: going by the distance against the normal ends on the surface, to roundings of 1.2 m.
    assert np.abs(level(collider, x - d[:, None] * n)).max() < 20 * EPS64
    # From below: of thousands of points of the surface none is nearer.
    points = on_surface(collider, dim, rng)
    for place, distance in zip(x, d, strict=True):
        assert np.linalg.norm(points - place, axis=1).min() > abs(distance) - 20 * EPS64


@every_solid
def test_normals_are_gradients_of_distances(dim, p):
    x = np.random.default_rng(dim + 10).uniform(-1.2, 1.2, (400, dim))
    step = 1e-6
    n, d = distances(SOLIDS[dim], x, p)
    slopes = np.zeros((2, *x.shape))
    for k in range(dim):
        for side, sign in enumerate((1, -1)):
            there = distances(SOLIDS[dim], x + sign * step * np.eye(dim)[k], p)[1]
            slopes[side, :, k] = sign * (there - d) / step
    # Where two points of the surface are equally near there is no gradient: few of so many places.
    smooth = np.abs(slopes[0] - slopes[1]).max(axis=1) < 1e-3
    assert smooth.mean() > 0.97
    # Central differences: step²/r² for a curvature of 1/r, and a rounding of 1 m over the step.
    np.testing.assert_allclose(slopes.mean(axis=0)[smooth], n[smooth], rtol=0, atol=1e-9 + 4 * EPS64 / step)


@pytest.mark.parametrize("dim", [2, 3])
def test_alone_a_solid_is_as_among_others(dim):
    x = np.random.default_rng(dim).uniform(-1.2, 1.2, (50, dim))
    for p, collider in enumerate(SOLIDS[dim][:5]):
        for one, of_many in zip(distances([collider], x, 0), distances(SOLIDS[dim], x, p), strict=True):
            np.testing.assert_allclose(one, of_many, rtol=0, atol=4 * EPS64)  # other instructions may be chosen


@pytest.mark.parametrize("dim", [2, 3])
def test_where_all_ways_out_are_alike_one_is_taken(dim):
    # Centres, axes and corners: a unit normal and the right distance, whatever the direction.
    up = np.eye(dim)[-1]
    for collider, place, depth in (
        (Sphere(tuple(0 * up), 0.4), 0 * up, -0.4),
        (Capsule(tuple(-up), tuple(up), 0.3), 0.2 * up, -0.3),
        (Cone(tuple(up), tuple(0 * up), 1.0), 0.5 * up, -math.sqrt(0.125)),  # 0.5 m below an apex of 45°
        (Cone(tuple(up), tuple(0 * up), 1.0), 0.1 * up, -0.1),
        (Cone(tuple(up), tuple(0 * up), 1.0), 3.0 * up, 2.0),
        (Box(tuple(0 * up), (1.0,) * dim), 0 * up, -0.5),
    ):
        n, d = distances([collider], np.array([place]), 0)
        assert np.linalg.norm(n) == pytest.approx(1.0, abs=4 * EPS64)
        assert d[0] == pytest.approx(depth, abs=4 * EPS64)


# Bounce, slide and rest on each solid. All tops lie at z = 0.

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


@every_top
@every_step
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


EACH_ONCE = [(SymplecticEuler(), h) for h in STEPS] + [(one, STEPS[1]) for one in INTEGRATORS[1:]]
each_once = pytest.mark.parametrize(("integrator", "h"), EACH_ONCE, ids=[f"{one}-{h:.2g}" for one, h in EACH_ONCE])


@every_top
@each_once
def test_rests_on_top(device, top, h, integrator):
    simulation = simulate(
        particle((0, 0, 0)), top(friction=0.0), device, h=h, substeps=round(0.1 / h), integrator=integrator
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
@pytest.mark.parametrize("contact", ["coulomb", "report"])
def test_one_hit_mirrors_and_multiplies(device, tilted, contact):
    # Without a force, and with infinite friction, both rules are v_n' = −e v_n and v_t' = f v_t: from a place so
    # near that the hit is where the normal is tilted by 0.3.
    collider, place = tilted(restitution=0.6, friction=math.inf, tangential_factor=0.8)
    n, velocity = np.array([math.sin(0.3), 0, math.cos(0.3)]), np.array([1.0, -0.5, -2.0])
    h = 1e-9
    start = np.array(place) - 0.5 * h * velocity
    simulation = simulate(particle(start, [velocity]), collider, device, h=h, gravity=0.0, contact=contact)
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


def test_a_corner_of_a_box_turns_what_comes_from_outside(device):
    # The box's edge at (0.5, 0, 0.5) is met from 45° above: thrown back along the way it came.
    simulation = simulate(
        particle((0.6, 0, 0.6), [[-1.0, 0, -1.0]]),
        Box((0, 0, 0), (1, 1, 1), restitution=1.0, friction=0.0),
        device,
        h=0.001,
        substeps=200,
        gravity=0.0,
    )
    simulation.step()
    now = simulation.frame()
    # Inside it is found by the face that is nearer, which of two equal depths is one or the other: it mirrors one
    # of the components, or in two substeps both.
    assert sorted(np.abs(now.velocity[0])) == pytest.approx([0, 1, 1], abs=4 * EPS64)
    assert distances([Box((0, 0, 0), (1, 1, 1))], now.position, 0)[1][0] >= 0


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


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("precision", ["float32", "float32-compensated", "float64"])
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


@pytest.mark.parametrize("dim", [1, 2, 3])
def test_a_plane_faces_up_by_default(device, dim):
    floor = Plane(offset=0.25)
    np.testing.assert_array_equal(floor.unit_normal(dim), np.eye(dim)[-1])
    simulation = simulate(System(position=np.ones((1, dim))), floor, device, h=0.01, substeps=100)
    simulation.step(5)
    # Exactly: on an axis a depth is the difference of two near numbers.
    np.testing.assert_array_equal(simulation.frame().position[0], [1.0] * (dim - 1) + [0.25])


# Moving colliders


def moving(motion, **fields) -> dict:
    return {"motion": motion, "restitution": 0.4, "friction": 0.3} | fields


@every_integrator
def test_what_moves_evenly_is_as_what_stands(device, integrator):
    # Galilei: a box that moves at w, seen by somebody who moves with it. With gravity, so that it bounces, slides
    # and comes to rest; compared at 1.5 s.
    w, start, v = np.array([0.7, -0.4, 0.2]), np.array([0.0, 0.1, 0.8]), np.array([1.0, 0.3, -1.0])
    fields = {"position": (0.2, 0, 0), "size": (4, 4, 0.5), "turn": (0.05, 0.1, 0.3)}
    found = []
    for motion, velocity in ((None, v), (lambda t: t * w, v + w)):
        simulation = simulate(
            particle(start, [velocity]),
            Box(**fields, **moving(motion)),
            device,
            h=1 / 400,
            substeps=50,
            integrator=integrator,
        )
        simulation.step(12)
        found.append(simulation.frame())
    fixed, moved = found
    # 600 substeps that round places of 2 m; a velocity of the obstacle has such a rounding over h.
    np.testing.assert_allclose(moved.position - 1.5 * w, fixed.position, rtol=0, atol=600 * 2 * EPS64)
    np.testing.assert_allclose(moved.velocity - w, fixed.velocity, rtol=0, atol=400 * 20 * EPS64)
    assert abs(fixed.velocity[0, 2]) < 0.5  # it has long hit


def lift(acceleration, h: float) -> dict:
    a = np.array(acceleration)
    return {"motion": lambda t: a * t**2 / 2, "first": -a * h / 2}


@pytest.mark.parametrize("integrator", [SymplecticEuler(), Leapfrog()], ids=str)
@every_step
def test_what_gathers_speed_is_as_gravity(device, integrator, h):
    # Einstein: a floor that is accelerated by −g, seen by somebody on it. Its speed in the substep before the
    # first is −a h/2, which is what somebody on it takes for rest.
    a, w = np.array([2.0, -1.0, 12.0]), np.array([[1.0, 0.5, -2.0]])
    block = box((2, 2, 2), spacing=0.2, mass=0.2, stiffness=60.0, damping=0.3).rotate(0.4, axis=(1, 2, 0))
    block = block.translate((0, 0, 0.5))
    common = {"h": h, "substeps": round(0.1 / h), "integrator": integrator}
    fixed = simulate(block.with_velocity(w), Plane(restitution=0.6, friction=0.4), device, gravity=-a, **common)
    floor = Plane(restitution=0.6, friction=0.4, motion=lambda t: a * t**2 / 2)
    moved = simulate(block.with_velocity(w - a * h / 2), floor, device, gravity=0.0, **common)
    if isinstance(integrator, Leapfrog):  # which takes velocities back by half a substep itself
        moved = simulate(block.with_velocity(w), floor, device, gravity=0.0, **common)
    for _ in range(10):
        fixed.step()
        moved.step()
    assert fixed.frame().position[:, 2].min() == 0.0
    # Roundings of 6 m, of which velocities of the floor have one over h, and the swinging block makes more: ω/γ
    # times as many at most.
    t = moved.time
    np.testing.assert_allclose(
        moved.frame().position - a * t**2 / 2, fixed.frame().position, rtol=0, atol=1000 * 6 * EPS64 / h
    )


@each_once
def test_a_piston_carries_what_lies_on_it(device, h, integrator):
    # It gathers speed faster than `rest_speed` in a substep, and still nothing bounces.
    a = 15.0
    piston = Box((0, 0, -0.5), (1, 1, 1), motion=lambda t: (0, 0, a * t**2 / 2), restitution=1.0)
    start, common = particle((0.1, 0.2, 0)), {"h": h, "integrator": integrator, "gravity": 0.0}
    simulation = simulate(start, piston, device, substeps=1, **common)
    simulation.step()
    assert simulation.frame().velocity[0, 2] == pytest.approx(a * h / 2, rel=1e-12)  # from the first substep on
    simulation = simulate(start, piston, device, substeps=round(0.1 / h), **common)
    for _ in range(10):
        simulation.step()
        now, t = simulation.frame(), simulation.time
        np.testing.assert_allclose(now.position[0], (0.1, 0.2, a * t**2 / 2), rtol=0, atol=t / h * 8 * EPS64)
        # Its speed is the piston's of half a substep ago; places of 8 m have roundings, which count over h.
        np.testing.assert_allclose(now.velocity[0], (0, 0, a * (t - h / 2)), rtol=0, atol=40 * EPS64 / h)


@every_step
def test_a_shaking_floor_carries_and_throws(device, h):
    # A ω² = 0.8 g carries. At 1.5 g it lets go where A ω² sin ω t = g, and what flies does so by itself.
    omega, g = 10.0, 10.0
    for strength in (0.8, 1.5):
        A = strength * g / omega**2
        floor = Plane(motion=lambda t, A=A: (0, 0, A * math.sin(omega * t)), restitution=0.0)
        start = particle((0, 0, 0), [[0, 0, A * omega]])
        simulation = simulate(start, floor, device, h=h, gravity=g)
        flight = []
        while simulation.time < 0.3:
            simulation.step()
            z, t = simulation.frame().position[0, 2], simulation.time
            gap = z - A * math.sin(omega * t)
            if strength < 1:
                assert abs(gap) < 4 * EPS64
            else:
                flight.append((t, z, gap))
        if strength > 1:
            phase = math.asin(1 / strength)
            leaves, speed = phase / omega, A * omega * math.cos(phase)
            for t, z, gap in flight:
                s = t - leaves
                if s < -h:
                    assert abs(gap) < 4 * EPS64
                elif s > h:  # speed and place to half a substep of g and of speed
                    flown = A / strength + speed * s - g * s**2 / 2
                    assert z == pytest.approx(flown, abs=h * (g * s + speed + 1))
            assert max(gap for *_, gap in flight) > 0.02


@every_step
def test_a_turning_disc_takes_a_particle_with_it(device, h):
    # From rest it slips until friction has brought it to speed; then it turns with the disc and never creeps.
    omega, radius = 3.0, 0.5
    disc = Box(
        (0.2, 0.1, -0.1), (4, 4, 0.2), friction=0.9, motion=lambda t: ((0.0, 0.0, 0.0), (0.0, 0.0, omega * t))
    )
    centre = np.array([0.2, 0.1, 0.0])
    assert omega**2 * radius < 0.9 * G
    simulation = simulate(particle(centre + np.array([radius, 0, 0])), disc, device, h=h, substeps=round(0.05 / h))
    simulation.step()
    # μ g at first, along y: for 0.05 s, in which the disc turns its direction by less than 0.15.
    assert np.linalg.norm(simulation.frame().velocity[0]) == pytest.approx(0.9 * G * 0.05, rel=0.02)
    simulation.step(39)

    def on_disc() -> np.ndarray:
        angle, place = omega * simulation.time, simulation.frame().position[0] - centre
        return np.array([[math.cos(angle), math.sin(angle)], [-math.sin(angle), math.cos(angle)]]) @ place[:2]

    then = on_disc()
    simulation.step(20)
    np.testing.assert_allclose(on_disc(), then, rtol=0, atol=1.0 / h * 8 * EPS64)  # a rounding or two a substep
    # The way of a substep, which is the secant of an arc.
    speed = np.linalg.norm(simulation.frame().velocity[0])
    secant = 2 / h * math.sin(omega * h / 2) * np.linalg.norm(then)
    assert speed == pytest.approx(secant, rel=8 * EPS64 / h)  # roundings of places, over h
    assert np.linalg.norm(then) < 1.5


def test_a_turning_ball_drags_what_it_hits(device):
    # It turns about its own centre: at the top its surface runs along x at ω R, the particle takes it over.
    omega, R = 4.0, 0.5
    ball = Sphere(
        (0.3, -0.2, 0.1), R, restitution=0.0, friction=math.inf, motion=lambda t: (np.zeros(3), (0, omega * t, 0))
    )
    h = 1 / 4000
    simulation = simulate(particle((0.3, -0.2, 0.6 + h / 2), [[0, 0, -1.0]]), ball, device, h=h, gravity=0.0)
    simulation.step()
    # To ω h of its direction, and (ω h)²/24 of its length.
    np.testing.assert_allclose(
        simulation.frame().velocity[0], (omega * R, 0, 0), rtol=0, atol=omega * R * omega * h
    )


@every_step
def test_a_paddle_in_the_plane_strikes(device, h):
    # A rod that turns about its middle meets a particle at rest 1 m away, at ω · 1 m across the rod.
    omega = 2.0
    rod = Box((0.5, 0.0), (4.0, 0.1), restitution=0.5, friction=0.0, motion=lambda t: ((0.0, 0.0), omega * t))
    simulation = simulate(System(position=[[1.5, 0.3]]), rod, device, h=h, gravity=0.0)
    simulation.step(round(0.5 / h))
    # e = 0.5: 1.5 times the speed of the place that is hit, along the normal there; the hit is known to a substep.
    hit = math.hypot(1.0, 0.3)
    speed = np.linalg.norm(simulation.frame().velocity[0])
    assert speed == pytest.approx(1.5 * omega * math.sqrt(hit**2 - 0.05**2), rel=omega * h)


@every_integrator
def test_pinned_particles_are_not_moved(device, integrator):
    # A wall sweeps through a block: it takes along what is free, and passes what is pinned.
    block = box((2, 2, 2), spacing=0.2, mass=0.1, stiffness=100.0, damping=0.5).pin([0, 5])
    wall = Plane((1, 0, 0), offset=-0.5, restitution=0.0, motion=lambda t: (2.0 * t, 0, 0))
    simulation = simulate(block, wall, device, h=1 / 1000, substeps=50, integrator=integrator, gravity=0.0)
    for _ in range(10):
        simulation.step()
    now = simulation.frame()
    np.testing.assert_array_equal(now.position[[0, 5]], block.position[[0, 5]])
    assert not now.velocity[[0, 5]].any()
    free = np.delete(now.position, [0, 5], axis=0)
    assert free[:, 0].min() > 0.5 - 1e-12  # where the wall is: roundings


@pytest.mark.parametrize("substeps", [1, 2, 5])
def test_a_motion_is_known_from_time_zero_on(device, substeps):
    # What is hit in the very first substep moves as it does later, though its motion has no past: 2 m/s come in
    # upon a floor that comes up at 1 m/s, and e = 0.5.
    seen = []

    def rise(t: float):
        seen.append(t)
        return 0, 0, t

    h = 0.01
    floor = Plane(motion=rise, restitution=0.5, friction=0.0)
    start = particle((0, 0, h), [[0.3, 0, -1.0]])
    simulation = simulate(start, floor, device, h=h, substeps=substeps, gravity=0.0)
    simulation.step()
    np.testing.assert_allclose(simulation.frame().velocity[0], (0.3, 0, 2.0), rtol=0, atol=8 * EPS64 / h)
    assert min(seen) == 0.0


@pytest.mark.parametrize("integrator", INTEGRATORS[:5], ids=str)
def test_one_launch_is_as_many(device, integrator):
    def shaken(**options) -> Simulation:
        floor = Plane(
            friction=0.3, motion=lambda t: ((0.2 * t * t, 0, 0.05 * math.sin(9 * t)), (0, 0.1 * t * t, 0))
        )
        block = box((2, 2, 2), spacing=0.2, mass=0.1, stiffness=100.0, damping=0.5).translate((0, 0, 0.2))
        simulation = simulate(block, floor, device, h=1 / 1000, substeps=25, integrator=integrator, **options)
        simulation.step(20)
        return simulation

    one = shaken().frame()
    many = shaken(blocks=None).frame()
    # 500 substeps with roundings of 1 m and of 1 m/s, which hits and swings make a hundred times more.
    np.testing.assert_allclose(many.position, one.position, rtol=0, atol=100 * 500 * EPS64)
    np.testing.assert_allclose(many.velocity, one.velocity, rtol=0, atol=100 * 500 * 30 * EPS64)


@pytest.mark.parametrize("stays", [True, False], ids=["one launch", "launches"])
def test_a_frame_may_be_taken_in_parts(device, stays):
    # As what looks for the substep of a divergence does: colliders are where they are then.
    options = {} if stays else {"blocks": None}
    floor = Plane(motion=lambda t: (0, 0, 4.0 * t * t))
    whole, parts = (simulate(particle((0, 0, 0)), floor, device, h=0.01, substeps=8, **options) for _ in range(2))
    whole.step()
    parts.stepping.dynamics.begin_frame(0.0)
    for count, first in ((3, 0), (1, 3), (4, 4)):
        parts.stepping.stepper.take(count, first)
    np.testing.assert_array_equal(parts.frame().position, whole.frame().position)
    assert whole.frame().position[0, 2] == pytest.approx(4.0 * 0.08**2, rel=1e-12)


def test_reset_takes_time_back(device):
    floor = Plane(motion=lambda t: (0, 0, 0.1 * math.sin(8 * t)), restitution=0.7)
    simulation = simulate(particle((0, 0, 0.3)), floor, device, h=1 / 500, substeps=10)
    first = [simulation.frame() for _ in range(40) if simulation.step() is None]
    simulation.reset()
    again = [simulation.frame() for _ in range(40) if simulation.step() is None]
    for a, b in zip(first, again, strict=True):
        np.testing.assert_array_equal(a.position, b.position)
        np.testing.assert_array_equal(a.velocity, b.velocity)


def test_a_change_does_not_disturb_what_moves(device):
    # Another stiffness of no connection: the collider goes on from where it is.
    floor = Plane(motion=lambda t: (0.3 * t, 0, 2.0 * t * t))
    simulation = simulate(particle((0, 0, 0)), floor, device, h=1 / 100, substeps=10)
    simulation.step(3)
    simulation.change(stiffness=10.0)
    simulation.step(3)
    assert simulation.frame().position[0, 2] == pytest.approx(2.0 * 0.6**2, rel=1e-12)


def test_a_fixed_one_among_moving_ones_stands(device):
    floor = Plane(friction=0.0)
    wall = Plane((1, 0, 0), offset=-1.0, motion=lambda t: (t, 0, 0), restitution=0.0)
    simulation = simulate(particle((0, 0, 0.5)), [floor, wall], device, h=1 / 100, substeps=100)
    simulation.step(2)
    # To roundings of 1 m a substep.
    np.testing.assert_allclose(simulation.frame().position[0], (1.0, 0, 0), rtol=0, atol=200 * EPS64)


def test_solids_turn_about_their_middles():
    turn = (0.3, -0.2, 0.9)
    for collider, middle in (
        (Sphere((1, 2, 3), motion=lambda t: (np.zeros(3), turn)), (1, 2, 3)),
        (Box((1, 2, 3), motion=lambda t: (np.zeros(3), turn)), (1, 2, 3)),
        (Capsule((1, 2, 3), (3, 2, 1), motion=lambda t: (np.zeros(3), turn)), (2, 2, 2)),
        (Plane((0, 1, 0), 2.0, motion=lambda t: (np.zeros(3), turn)), (0, 2, 0)),
    ):
        R, o = collider.pose(1.0, 3)
        np.testing.assert_allclose(R @ middle + o, middle, rtol=0, atol=16 * EPS64)
        np.testing.assert_allclose(R @ turn, turn, rtol=0, atol=4 * EPS64)  # its own axis
        np.testing.assert_allclose(R.T @ R, np.eye(3), rtol=0, atol=4 * EPS64)
        assert np.trace(R) == pytest.approx(1 + 2 * math.cos(np.linalg.norm(turn)), abs=4 * EPS64)


@pytest.mark.parametrize(
    ("dim", "motion", "message"),
    [
        (3, lambda t: (0.0, 0.0), r"motion\(0\) is \(0.0, 0.0\); it must be 3 finite numbers"),
        (3, lambda t: 0.5 * t, r"motion\(0\) is 0.0; it must be 3 finite numbers"),  # along which axis?
        (3, lambda t: None, r"motion\(0\) must be an array of numbers, not None"),
        (3, lambda t: "up", r"motion\(0\) must be an array of numbers, not 'up'"),
        (3, lambda t: (0, 0, math.nan), r"motion\(0\) is \(0, 0, nan\)"),
        (3, lambda t: (np.zeros(3), (0, 0, math.inf)), r"turn of motion\(0\) is \(0, 0, inf\)"),
        (3, lambda t: (np.zeros(3), 0.1), r"turn of motion\(0\) is 0.1; it must be 3 finite numbers"),
        (2, lambda t: (np.zeros(2), (0, 0, 1)), r"turn of motion\(0\) is \[\(0, 0, 1\)\]|turn of motion\(0\)"),
        (2, lambda t: (0, 0, 0), r"motion\(0\) is \(0, 0, 0\); it must be 2 finite numbers"),
        (1, lambda t: ((0.0,), 1.0), r"turn of motion\(0\) is 1.0; in one dimension nothing turns"),
    ],
)
def test_bad_motion_is_named(dim, motion, message):
    with pytest.raises(ValueError, match=message):
        Simulation(System(position=np.zeros((1, dim))), colliders=[Plane(motion=motion)], device="cpu")


def test_motion_that_goes_wrong_later_is_named_and_nothing_is_lost(device):
    floor = Plane(motion=lambda t: (0, 0, 0.1 * t if t < 0.25 else math.inf))
    simulation = simulate(particle((0, 0, 0)), floor, device, h=0.01, substeps=10)
    simulation.step(2)
    kept = simulation.frame()
    with pytest.raises(ValueError, match=r"motion\(0.25\) is \(0, 0, inf\)"):
        simulation.step()
    np.testing.assert_array_equal(simulation.frame().position, kept.position)
    assert simulation.time == kept.time


@pytest.mark.parametrize(
    ("dim", "motion"),
    [
        (1, lambda t: 0.2 * t),
        (1, lambda t: (0.2 * t,)),
        (2, lambda t: (0.0, 0.2 * t)),
        (2, lambda t: ((0.0, 0.2 * t), None)),
        (2, lambda t: (np.array([0.0, 0.2 * t]), 0.0)),
        (3, lambda t: [0.0, 0.0, 0.2 * t]),
        (3, lambda t: (np.array([0.0, 0.0, 0.2 * t]), np.zeros(3))),
    ],
)
def test_motion_in_every_form(device, dim, motion):
    simulation = simulate(
        System(position=np.zeros((1, dim))), Plane(motion=motion, restitution=0.0), device, h=0.01, substeps=50
    )
    simulation.step(2)
    np.testing.assert_allclose(  # 100 roundings of 0.2 m
        simulation.frame().position[0], [0.0] * (dim - 1) + [0.2], rtol=0, atol=100 * EPS64
    )


# What is refused


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Sphere(radius=0.0), "radius is 0; it must be a number above 0"),
        (lambda: Sphere(radius=math.inf), "radius is inf"),
        (lambda: Sphere((0, math.nan, 0)), r"position is \(0, nan, 0\)"),
        (lambda: Sphere((0, 0, 0, 0)), r"position is \(0, 0, 0, 0\)"),
        (lambda: Sphere("here"), "position must be an array of numbers, not 'here'"),
        (lambda: Box(size=(1, 0, 1)), r"size is \(1, 0, 1\)"),
        (lambda: Box(size=(1, 1)), r"size is \(1, 1\); .* as many .* as position"),
        (lambda: Box(turn=(0, 1)), r"turn is \(0, 1\); it must be 3 finite numbers"),
        (lambda: Box(turn=0.3), "turn is 0.3; it must be 3 finite numbers"),
        (lambda: Box(turn=(0, math.nan, 0)), r"turn is \(0, nan, 0\)"),
        (lambda: Box((0, 0), (1, 1), math.nan), "turn is .*nan"),
        (lambda: Box((0, 0), (1, 1), (0, 0, 1)), "turn is .*0, 0, 1"),
        (lambda: Box((0,), (1,), 0.5), "turn is 0.5; in one dimension nothing turns"),
        (lambda: Capsule((0, 0, 0), (0, 0, 0)), r"end is \(0.0, 0.0, 0.0\); it must be another point than start"),
        (lambda: Capsule((0, 0, 0), (0, 1)), r"end is \(0.0, 1.0\); .* as many coordinates"),
        (lambda: Capsule(radius=-1.0), "radius is -1"),
        (lambda: Cone((0, 0, 0), (0, 0, 0)), r"base is \(0.0, 0.0, 0.0\); it must be another point than apex"),
        (lambda: Cone(radius="wide"), "radius is 'wide'"),
        (lambda: Sphere(motion=(0, 0, 1)), r"motion is \(0, 0, 1\); it must be a function of time"),
        (lambda: Cone(restitution=2.0), "restitution is 2.0"),
        (lambda: Capsule(friction=-0.5), "friction is -0.5"),
    ],
)
def test_bad_solid_is_named(make, message):
    with pytest.raises(ValueError, match=message):
        make()


@pytest.mark.parametrize(
    ("dim", "collider", "message"),
    [
        (3, Plane((0, 1)), r"colliders\[0\].normal is \(0.0, 1.0\); it must have 3 coordinates"),
        (2, Sphere(), r"colliders\[0\].position is \(0.0, 0.0, 0.0\); it must have 2 coordinates"),
        (3, Box((0, 0), (1, 1)), r"colliders\[0\].position is \(0.0, 0.0\); it must have 3 coordinates"),
        (3, Capsule((0, 0), (1, 1)), r"colliders\[0\].start is \(0.0, 0.0\); it must have 3 coordinates"),
        (2, Cone(), r"colliders\[0\].apex is \(0.0, 0.0, 1.0\); it must have 2 coordinates"),
        (1, Cone((0,), (1,)), r"colliders\[0\].apex is \(0.0,\); a cone needs at least 2 coordinates"),
        (1, Capsule((0,), (1,)), r"colliders\[0\].start is \(0.0,\); a capsule needs at least 2 coordinates"),
        (3, Collider(), r"colliders\[0\] is Collider\(.*; it must be a Plane, Sphere, Box, Capsule, Cone"),
    ],
)
def test_solid_that_does_not_fit_is_named(dim, collider, message):
    with pytest.raises(ValueError, match=message):
        Simulation(System(position=np.zeros((1, dim))), colliders=[collider], device="cpu")


def test_a_motion_that_fails_on_the_way_is_named():
    body = System(position=[[0.0, 0, 1]])
    fails = Sphere((0, 0, 0), 0.5, motion=lambda t: (math.sqrt(0.05 - t), 0, 0))
    simulation = Simulation(body, colliders=[Plane(offset=-9), fails], substeps=2, device="cpu")
    with pytest.raises(ValueError, match=r"colliders\[1\] has no place at 0\.0\d* s: .*"):
        simulation.step(9)
