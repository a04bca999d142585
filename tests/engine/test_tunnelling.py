"""What goes further in a substep than an obstacle is thick: met where it enters, never passed unseen."""

import math
from typing import Any

import numpy as np
import pytest
from collisions import INTEGRATORS, G, level
from problems import EPS32, EPS64

from msdwarp import Box, Capsule, Cone, Plane, Simulation, Sphere, System
from msdwarp.world.colliders import Collider

H = 1 / 60


@pytest.fixture
def device(plain_device: str) -> str:
    """Each device once: particles without connections have no forces that algorithms could sum."""
    return plain_device


def far(dim: int) -> list[Collider]:
    """Return one solid of each kind, large and out of the way: scenes with them share one kernel."""
    at, up = tuple(-1000.0 * np.eye(dim)[-1]), tuple(-900.0 * np.eye(dim)[-1])
    return [
        Plane(offset=-2000.0),
        Sphere(at, 20.0),
        Box(at, (50.0,) * dim),
        Capsule(at, up, 20.0),
        Cone(up, at, 60.0),
    ]


def simulate(device: str, x, v, colliders, *, h: float = H, **options) -> Simulation:
    """Return a simulation of particles that know nothing of each other, with one substep of h a frame."""
    system = System(position=x, velocity=np.array(v, dtype=float))
    options = {"gravity": 0.0, "precision": "float64"} | options
    company = [] if any(one.motion for one in colliders) else far(system.dim)
    return Simulation(system, colliders=[*colliders, *company], fps=1 / h, substeps=1, device=device, **options)


def after_one(device: str, x, v, colliders, **options) -> tuple[np.ndarray, np.ndarray]:
    simulation = simulate(device, x, v, colliders, **options)
    simulation.step()
    return simulation.frame().position, simulation.frame().velocity


def ways_past(collider: Collider, dim: int, count: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Return starts all around a solid, half a metre away or more, and ways of 3 m that pass it or hit it."""
    start = rng.normal(size=(count, dim))
    start *= rng.uniform(0.8, 1.2, (count, 1)) / np.linalg.norm(start, axis=1, keepdims=True)
    way = rng.uniform(-0.3, 0.3, (count, dim)) - start
    return start, 3 * way / np.linalg.norm(way, axis=1, keepdims=True)


def entries(collider: Collider, start: np.ndarray, way: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return (least level on each way, share of the way at the entry, outward normal there), by brute force."""
    count, dim = start.shape
    t = np.linspace(0, 1, 6001)
    places = start[:, None] + t[:, None] * way[:, None]
    levels = level(collider, places.reshape(-1, dim)).reshape(count, -1)
    high = t[np.argmax(levels < 0, axis=1)]
    low = high - t[1]
    for _ in range(50):
        middle = (low + high) / 2
        outside = level(collider, start + middle[:, None] * way) > 0
        low, high = np.where(outside, middle, low), np.where(outside, high, middle)
    place, step = start + high[:, None] * way, 1e-6
    slope = [level(collider, place + step * e) - level(collider, place - step * e) for e in np.eye(dim)]
    normal = np.column_stack(slope)
    return levels.min(axis=1), high, normal / np.linalg.norm(normal, axis=1, keepdims=True)


E, MU, F = 0.6, 0.2, 0.7
COEFFICIENTS: dict[str, Any] = {"restitution": E, "friction": MU, "tangential_factor": F}
SMALL = {
    2: [
        Sphere((0.03, -0.02), 0.1, **COEFFICIENTS),
        Box((-0.05, 0.04), (0.4, 0.05), 0.6, **COEFFICIENTS),
        Capsule((-0.2, 0.1), (0.2, -0.05), 0.04, **COEFFICIENTS),
        Cone((0.0, 0.2), (-0.1, -0.1), 0.15, **COEFFICIENTS),
    ],
    3: [
        Sphere((0.03, -0.02, 0.05), 0.1, **COEFFICIENTS),
        Box((-0.05, 0.04, 0.0), (0.4, 0.3, 0.05), (0.6, -0.9, 0.4), **COEFFICIENTS),
        Capsule((-0.2, 0.1, 0.0), (0.2, -0.05, 0.1), 0.04, **COEFFICIENTS),
        Cone((0.0, 0.2, 0.1), (-0.1, -0.1, 0.0), 0.15, **COEFFICIENTS),
    ],
}
slow = pytest.mark.slow


@pytest.mark.parametrize(
    ("dim", "precision", "collider_rule"),
    [
        (3, "float64", "coulomb"),
        pytest.param(3, "float32", "coulomb", marks=slow),
        pytest.param(3, "float64", "report", marks=slow),
        pytest.param(2, "float64", "coulomb", marks=slow),
        pytest.param(2, "float32", "report", marks=slow),
    ],
)
@pytest.mark.parametrize("p", range(4), ids=["sphere", "box", "capsule", "cone"])
def test_what_passes_in_one_substep_is_met_where_it_enters(device, dim, precision, collider_rule, p):
    collider, rng = SMALL[dim][p], np.random.default_rng(p)
    start, way = ways_past(collider, dim, 150, rng)
    least, t, n = entries(collider, start, way)
    v = way / H
    x_after, v_after = after_one(device, start, v, [collider], precision=precision, collider_rule=collider_rule)
    # Between two places that are looked at, half a millimetre apart, an edge may be cut by as much.
    hit, miss = least < -5e-4, least > 5e-4
    assert min(hit.sum(), miss.sum()) > 10
    # A miss is what it is where there is nothing, bit for bit.
    x_free, v_free = after_one(device, start, v, [], precision=precision, collider_rule=collider_rule)
    np.testing.assert_array_equal(x_after[miss], x_free[miss])
    np.testing.assert_array_equal(v_after[miss], v_free[miss])
    # A hit bounces from the tangent plane at the entry; along it friction takes its share of the way from there.
    v_n = (v * n).sum(axis=1, keepdims=True) * n
    v_t, speed = v - v_n, np.linalg.norm(v - v_n, axis=1, keepdims=True)
    loss = MU * (1 + E) * np.linalg.norm(v_n, axis=1, keepdims=True)
    share = (
        1 - np.minimum((1 - F) * speed, loss) / speed if collider_rule == "coulomb" else np.full((len(v), 1), F)
    )
    rest = (1 - t[:, None]) * H * v_t * (share if collider_rule == "coulomb" else 1)
    expected = start + t[:, None] * way + rest
    # The sweep ends within 1e-10 (1e-4 in float32) of the inradius, which is a turn of the normal by as much over
    # the sine of a grazing angle, 0.1, times what the tip of a cone is thinner; differences of the reference have
    # 1e-10 themselves, float32 has roundings of 2 m over 0.04 m. All times the way of 3 m, the speed of 180 m/s.
    turn = 1e-8 if precision == "float64" else 2e-3
    np.testing.assert_allclose(x_after[hit], expected[hit], rtol=0, atol=3 * turn)
    np.testing.assert_allclose(v_after[hit], (share * v_t - E * v_n)[hit], rtol=0, atol=2 * turn * 180)
    outside = level(collider, x_after[hit])
    assert outside.min() > -(1e-11 if precision == "float64" else 16 * EPS32)  # near, and roundings of 2 m


@pytest.mark.parametrize("z", [0.02, -0.01, -0.024])
@pytest.mark.parametrize("y", [0.0, 0.499])
def test_what_ends_inside_is_put_out_where_it_came_in(device, y, z):
    # Also beyond the middle, or nearer to a side.
    h, plate = 0.01, Box(size=(1.0, 1.0, 0.05), restitution=0.5, friction=0.0)
    (x,), (v,) = after_one(device, [[0.0, y, 0.1]], [(0.0, 0.0, (z - 0.1) / h)], [plate], h=h)
    np.testing.assert_allclose(x, (0, y, 0.025), rtol=0, atol=EPS64)  # roundings of 0.1 m
    np.testing.assert_allclose(v, (0, 0, 0.5 * (0.1 - z) / h), rtol=4 * EPS64)


def test_a_tip_thinner_than_the_rest_is_not_passed(device):
    # 2 cm thick there, though a ball of 10 cm has room below; the way is 5 cm.
    spike = Cone((0.0, 0.0, 1.0), (0.0, 0.0, -1.0), 0.1, restitution=0.0, friction=0.0)
    (x,), (v,) = after_one(device, [[0.03, 0.0, 0.8]], [(-0.05 / H, 0.0, 0.0)], [spike])
    n = np.array([1, 0, 0.05]) / math.hypot(1, 0.05)
    np.testing.assert_allclose((x - (0, 0, 1)) @ n, 0.0, atol=4 * EPS64)  # on its flank: roundings of 1 m
    assert v @ n == pytest.approx(0.0, abs=4 * EPS64 / H)


@pytest.mark.parametrize("order", [1, -1])
def test_of_two_plates_the_nearer_is_met(device, order):
    # From either side, and from between them: the other is not met, though the list begins with it.
    plates = [Box((0.0, 0.0, z), (2.0, 2.0, 0.02), restitution=0.5, friction=0.0) for z in (0.0, 0.2)][::order]
    x = [[0, 0, 0.3], [0, 0, -0.1], [0, 0, 0.1], [0, 0, 0.1]]
    v = np.array([[3.0, 0, -60], [3, 0, 60], [3, 0, -60], [3, 0, 60]])
    found_x, found_v = after_one(device, x, v, plates)
    np.testing.assert_allclose(found_x[:, 2], (0.21, -0.01, 0.01, 0.19), rtol=0, atol=4 * EPS64)
    np.testing.assert_allclose(found_v, v * [1, 1, -0.5], rtol=0, atol=60 * EPS64)


@pytest.mark.parametrize("order", [1, -1])
def test_a_fence_is_not_jumped_by_what_the_floor_behind_it_lifts(device, order):
    # The way meets the fence 1 cm above the floor; straight to where the floor would lift its end it clears it.
    obstacles = [Plane(restitution=0.5), Box((0.0, 0.0, 0.0), (0.02, 2.0, 0.04), restitution=0.5)][::order]
    (x,), (v,) = after_one(device, [[-0.1, 0.0, 0.1]], [(0.2 / H, 0.0, -0.2 / H)], obstacles)
    assert x[0] <= -0.01 + EPS64
    assert x[2] >= -EPS64
    assert v[0] < 0 < v[2]


@pytest.mark.parametrize("order", [1, -1])
@pytest.mark.parametrize("angle", [0.2, 0.6, 1.0])
def test_nothing_leaves_a_wedge_by_its_walls(device, order, angle):
    # Two walls of 1 cm lean against each other in a V; what falls in between is thrown from one to the other.
    out = [np.array([-side * math.cos(angle), 0, math.sin(angle)]) for side in (1, -1)]
    up = [np.array([side * math.sin(angle), 0, math.cos(angle)]) for side in (1, -1)]
    walls = [
        Box(tuple(1.2 * u - 0.005 * n), (0.01, 9.0, 2.4), (0.0, side * angle, 0.0), restitution=0.5)
        for n, u, side in zip(out, up, (1, -1), strict=True)
    ][::order]
    rng = np.random.default_rng(1)
    x = np.column_stack([rng.uniform(-0.1, 0.1, 200), np.zeros(200), np.full(200, 0.8)])
    v = np.column_stack([rng.uniform(-40, 40, 200), np.zeros(200), np.full(200, -70.0)])
    now, _ = after_one(device, x, v, walls)
    assert min((now @ n).min() for n in out) > -1e-9  # 1e-10 of the inradius, and roundings of 1 m


@pytest.mark.slow
@pytest.mark.parametrize("e", [0.0, 0.5])
def test_a_bat_that_flies_past_takes_a_ball_along(device, e):
    # 1 cm thick and 50 cm on in a substep: the ball, at rest, is met as the bat's speed against a bat at rest.
    w = 0.5 / H
    bat = Box((-0.1, 0.0, 0.0), (0.01, 1.0, 1.0), restitution=e, motion=lambda t: (w * t, 0.0, 0.0))
    (x,), (v,) = after_one(device, [[0.0, 0.05, 0.1]], [(0.0, 0.0, 0.0)], [bat])
    # On its front; roundings of 0.5 m, for the speed over h.
    np.testing.assert_allclose(x, (0.405, 0.05, 0.1), rtol=0, atol=4 * EPS64)
    np.testing.assert_allclose(v, ((1 + e) * w, 0, 0), rtol=0, atol=8 * EPS64 / H)


def test_a_turning_bat_takes_a_ball_along(device):
    # By 0.5 rad in a substep, over a ball that lies 0.3 rad ahead of it, 60 cm out.
    omega = 0.5 / H
    size, motion = (2.0, 0.02, 0.5), lambda t: (np.zeros(3), (0.0, 0.0, omega * t))
    bat = Box(size=size, restitution=0.0, friction=0.0, motion=motion)
    start = 0.6 * np.array([math.cos(0.3), math.sin(0.3), 0.0])
    (x,), (v,) = after_one(device, [start], [(0.0, 0.0, 0.0)], [bat])
    # Seen from the bat where it then is, the ball has come from 0.3 to −0.2 rad: it stays at its front, n.
    n, along = (np.array([-math.sin(0.5), math.cos(0.5), 0]), np.array([math.cos(0.5), math.sin(0.5), 0]))
    assert x @ n == pytest.approx(0.01, abs=4 * EPS64)  # roundings of 0.6 m
    assert x @ along == pytest.approx(0.6 * math.cos(0.2), abs=4 * EPS64)  # no friction
    # It has the speed across the bat of the place where it was, by the way of that in the substep.
    came = 0.6 * np.array([math.cos(0.8), math.sin(0.8), 0.0])
    np.testing.assert_allclose(v, (came - start) @ n / H * n, rtol=0, atol=8 * EPS64 / H)


@pytest.mark.parametrize("moves", [False, True])
def test_rest_on_what_is_thinner_than_a_substeps_fall(device, moves):
    # g h² = 2.7 mm, the plate is 2 mm thick, and leans by 0.3, which friction holds.
    n, rng = np.array([math.sin(0.3), 0, math.cos(0.3)]), np.random.default_rng(0)
    down = np.array([math.cos(0.3), 0, -math.sin(0.3)])
    plate = Box(size=(2.0, 2.0, 0.002), turn=(0, 0.3, 0), motion=(lambda t: np.zeros(3)) if moves else None)
    x = 0.001 * n + rng.uniform(-0.8, 0.8, (20, 1)) * down + rng.uniform(-0.8, 0.8, (20, 1)) * [0, 1, 0]
    simulation = simulate(device, x, np.zeros(3), [plate], gravity=G)
    simulation.step(200)
    now = simulation.frame()
    # A place of 1 m has two roundings a substep, of which those across the plate do not add up.
    np.testing.assert_allclose(now.position, x, rtol=0, atol=200 * 2 * EPS64)
    np.testing.assert_allclose((now.position - x) @ n, 0.0, rtol=0, atol=4 * EPS64)
    np.testing.assert_allclose(now.velocity, 0.0, rtol=0, atol=8 * EPS64 / H)


@slow
@pytest.mark.parametrize("integrator", INTEGRATORS[::2] + INTEGRATORS[3:4], ids=str)
def test_by_every_method_nothing_passes_a_thin_plate(device, integrator):
    z = np.linspace(0.03, 0.5, 40)
    x = np.column_stack([np.zeros_like(z), np.zeros_like(z), z])
    plate = Box(size=(1.0, 1.0, 0.01), restitution=0.3)
    simulation = simulate(device, x, (1.0, 0, -8.0), [plate], integrator=integrator, gravity=G)
    for _ in range(20):
        simulation.step()
        assert simulation.frame().position[:, 2].min() >= 0.005 - EPS64
