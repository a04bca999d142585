"""Routes to the forces: all give the same forces and the same motion, and some of them bit for bit."""

import functools
import importlib
from types import SimpleNamespace

import numpy as np
import problems
import pytest
import warp as wp
from test_forces import evaluate

from msdwarp import (
    RK4,
    RKC2,
    ExplicitEuler,
    Integrator,
    Leapfrog,
    Plane,
    Scene,
    Simulation,
    SymplecticEuler,
    System,
    box,
    chain,
    sheet,
    stability_limit,
)
from msdwarp.engine import dynamics, forces, routes
from msdwarp.engine.dynamics import Dynamics
from msdwarp.engine.lattice_search import find_lattice
from msdwarp.engine.model import Model
from msdwarp.engine.routes import ROUTES, automatic_route, scatter_order

PRECISIONS = {
    "float32": problems.EPS32,
    "float32-compensated": problems.EPS32,
    "float64": problems.EPS64,
}
CONSTANTS = ("rest_length", "stiffness", "damping")
METHODS = {
    "symplectic euler": SymplecticEuler(),
    "leapfrog": Leapfrog(),
    "leapfrog extrapolated": Leapfrog(damper_extrapolation=0.5),
    "rk4": RK4(),
    "rkc2": RKC2(3),
    "explicit euler": ExplicitEuler(),
}
SCENES = {"cube": {"size": 4}, "cloth": {"size": 7}, "worm": {"length": 6}}
"""What makes each scene small."""
FAR = (5e4, 0, 0)
"""So far out [m] float32 rounds positions to 4 mm, which springs feel and compensated precision must not."""
every_route = pytest.mark.parametrize("route", ROUTES)
every_method = pytest.mark.parametrize("method", METHODS.values(), ids=METHODS.keys())
gathering = pytest.mark.parametrize("route", ["gather", "stencil"])


# Forces.


def tangle(dim: int, count: int, own: tuple[str, ...], *, damped: bool) -> System:
    """Return particles joined at random: one with half of all, many with few, the last few with none.

    Constants in `own` differ from connection to connection; of the others there is one for all.
    """
    random = np.random.default_rng(100 * dim + count)
    joined = max(2, count - 3)
    hub = [(0, j) if j % 4 == 1 else (j, 0) for j in range(1, joined, 2)]
    pairs = [random.choice(joined, 2, replace=False) for _ in range(2 * count)]
    connections = random.permutation(np.array([*hub, *pairs]))  # some pairs come twice
    constants = {"rest_length": 0.8, "stiffness": 30.0, "damping": 2.0 if damped else 0.0}
    for name in own:
        constants[name] = constants[name] * random.uniform(0.5, 1.5, len(connections))
    position, velocity = random.normal(size=(2, count, dim))
    return System(position=position, velocity=velocity, connections=connections, **constants)


def assert_forces_are_right(system: System, device: str, precision: str, route: str) -> None:
    """Compare the force on every particle with the plain sum over connections."""
    x, v, eps = system.position, system.velocity, PRECISIONS[precision]
    if precision != "float64":
        v = v.astype(np.float32).astype(np.float64)
    if precision == "float32":
        x = x.astype(np.float32).astype(np.float64)
    (i, j), degree = system.connections.T, np.bincount(system.connections.ravel(), minlength=len(x))
    length, speed = np.linalg.norm(x[i] - x[j], axis=1), np.linalg.norm(v[i] - v[j], axis=1)
    size = system.stiffness * (length + system.rest_length) + system.damping * speed
    # A connection's force is (k − (k l0 − b Δv·Δx/|Δx|)/|Δx|) Δx: no part of it goes through more than 16
    # roundings (the constants' own, 2 in 1/√ on a GPU, and so on), each of at most ε/2 of k |Δx|, k l0 or b |Δv|.
    # Then as many are added as meet in the particle, each time with a rounding of the sum so far.
    sizes = np.bincount(i, size, len(x)) + np.bincount(j, size, len(x))
    bound = (8 + degree / 2) * eps * sizes
    error = np.abs(evaluate(system, device, precision, route) - problems.forces(system, x, v)).max(axis=1)
    assert (error <= bound).all()  # exactly 0 for a particle that is alone
    assert bound[degree > 0].max() < 1e-2 * size.max()  # it is a bound that says something


@pytest.mark.parametrize("route", ["scatter", "gather"])
@pytest.mark.parametrize(
    ("own", "damped"),
    [((), True), (CONSTANTS, True), (("rest_length",), False), (("damping",), True)],
    ids=["one constant each", "all their own", "own lengths, undamped", "own dampers"],
)
@pytest.mark.parametrize("dim", [1, 2, 3])
def test_forces_of_a_tangle(plain_device, dim, own, damped, route):
    for count in (2, 3, 31, 32, 33, 63, 64, 65, 200):
        assert_forces_are_right(tangle(dim, count, own, damped=damped), plain_device, "float64", route)


@pytest.mark.parametrize("route", ["scatter", "gather"])
@pytest.mark.parametrize("precision", ["float32", "float32-compensated"])
def test_forces_of_a_tangle_in_single_precision(plain_device, precision, route):
    for count in (3, 33, 200):
        far = tangle(3, count, CONSTANTS, damped=True).translate(FAR)
        assert_forces_are_right(far, plain_device, precision, route)


def moving(system: System, seed: int = 3) -> System:
    """Return the system distorted by about a tenth, and in turbulent motion."""
    random = np.random.default_rng(seed)
    noise, velocity = random.normal(size=(2, *system.position.shape))
    return system.replace(position=system.position + 0.1 * noise, velocity=velocity)


def lattices(damping: float) -> dict[str, System]:
    """Return lattices of all kinds, whole, cut and together."""
    constants = {"stiffness": 30.0, "damping": damping}
    small, tall = box((3, 3, 3), 1.2, **constants), box((2, 4, 5), 0.9, **constants)
    return {
        "chain": chain(9, dim=1, **constants),
        "sheet 4": sheet((5, 7), neighbours=4, dim=2, **constants),
        "sheet 8": sheet((7, 5), **constants),
        "smallest sheet": sheet((2, 2), **constants),
        "box 6": box((3, 4, 5), neighbours=6, **constants),
        "box 26": box((5, 4, 3), **constants),
        "smallest box": box((2, 2, 2), **constants),
        "thin box": box((2, 2, 7), **constants),
        "ball": problems.ball(7, **constants),
        "two equal boxes": small + small.translate((5, 0, 0)),
        "two unlike boxes": small + tall.replace(stiffness=80.0).translate((5, 0, 0)),
        "two kinds of one shape": small + small.replace(stiffness=80.0).translate((5, 0, 0)),
        "a box and what has fewer directions": small + sheet((4, 3)).translate((0, 0, 4)) + chain(5),
    }


@every_route
@pytest.mark.parametrize("damping", [0.0, 2.0])
@pytest.mark.parametrize("name", lattices(0.0))
def test_forces_of_a_lattice(plain_device, name, damping, route):
    assert_forces_are_right(moving(lattices(damping)[name]), plain_device, "float64", route)


@pytest.fixture
def in_columns(monkeypatch) -> None:
    """Advance lattices that have layers in columns, on the CPU too, however small they are."""

    def choose(model: Model, columns=dynamics.columns) -> int:
        gpu = SimpleNamespace(is_cuda=True)
        return columns(SimpleNamespace(lattice=model.lattice, particle_count=model.particle_count, device=gpu))

    monkeypatch.setattr(dynamics, "LEAST_IN_COLUMNS", 0)
    monkeypatch.setattr(dynamics, "columns", choose)


LAYERED = (
    "sheet 4",
    "sheet 8",
    "smallest sheet",
    "box 6",
    "box 26",
    "smallest box",
    "thin box",
    "two equal boxes",
)


@pytest.mark.parametrize("damping", [0.0, 2.0])
@pytest.mark.parametrize("name", LAYERED)
def test_forces_in_columns(plain_device, in_columns, name, damping):
    system = moving(lattices(damping)[name])
    stride = find_lattice(system).stride
    assert dynamics.columns(Model(system, device="cpu", route="stencil")) in range(
        system.particle_count // 2, system.particle_count // 2 + stride + 1
    )
    assert_forces_are_right(system, plain_device, "float64", "stencil")


@pytest.mark.parametrize("shape", [(3, 4, 2), (3, 4, 3), (4, 3, 6), (2, 2, 9)])
@pytest.mark.parametrize("precision", ["float32", "float32-compensated"])
def test_forces_in_columns_in_single_precision(plain_device, in_columns, precision, shape):
    far = moving(box(shape, stiffness=30.0, damping=2.0)).translate(FAR)
    assert_forces_are_right(far, plain_device, precision, "stencil")


def test_stencils_of_equally_many_rows_are_not_taken_for_one(plain_device):
    cube, cloth = box((3, 3, 3)), sheet((4, 4)).translate((9, 0, 0))
    for system in (cube + cloth, cloth + cube):  # the directions in another order
        assert_forces_are_right(moving(system), plain_device, "float64", "stencil")


@pytest.mark.parametrize("columns", [False, True])
def test_directions_may_be_named_in_any_order(plain_device, request, columns):
    if columns:
        request.getfixturevalue("in_columns")
    grid = moving(sheet((5, 4), stiffness=30.0, damping=2.0))
    stiffness = np.empty(grid.connection_count)
    for k, part in enumerate(grid.directions[0].values()):
        stiffness[part] = 10.0 * (k + 1)
    names = list(grid.directions[0])
    for order in (names, names[::-1]):
        named = grid.replace(stiffness=stiffness, directions=({n: grid.directions[0][n] for n in order},))
        assert_forces_are_right(named, plain_device, "float64", "stencil")


def skewed() -> System:
    """Return particles that are a lattice by their numbers alone: y and z lead 5 and 20 further, y+z leads 27."""
    random = np.random.default_rng(9)
    steps = {"y": 5, "z": 20, "y+z": 27}
    connections = [np.stack([np.arange(60 - step), np.arange(step, 60)], axis=1) for step in steps.values()]
    ends = np.cumsum([0, *map(len, connections)])
    directions = {name: slice(*ends[k : k + 2]) for k, name in enumerate(steps)}
    return System(
        position=random.normal(size=(60, 3)),
        velocity=random.normal(size=(60, 3)),
        connections=np.concatenate(connections),
        rest_length=1.0,
        stiffness=30.0,
        damping=1.0,
        directions=(directions,),
    )


def test_layers_that_do_not_follow_each_other_are_no_columns(plain_device, in_columns):
    lattice = find_lattice(skewed())
    assert lattice.uniform
    assert lattice.stride == 0
    assert_forces_are_right(skewed(), plain_device, "float64", "stencil")


@pytest.mark.parametrize("name", ["chain", "ball", "two unlike boxes", "two kinds of one shape"])
def test_lattices_without_layers_have_no_columns(in_columns, name):
    assert_forces_are_right(moving(lattices(2.0)[name]), "cpu", "float64", "stencil")
    made = Dynamics(Model(lattices(2.0)[name], device="cpu", route="stencil"))
    assert made.composition.route.column_forces is None or made._columns == 0


@every_route
@pytest.mark.parametrize("name", ["box 26", "ball"])
@pytest.mark.parametrize("precision", ["float32", "float32-compensated"])
def test_forces_of_a_lattice_in_single_precision(plain_device, precision, name, route):
    far = moving(lattices(2.0)[name]).translate(FAR)
    assert_forces_are_right(far, plain_device, precision, route)


@every_route
@pytest.mark.parametrize("precision", PRECISIONS)
@pytest.mark.parametrize("damping", [0.0, 2.0])
def test_coincident_neighbours_feel_what_else_pulls_them(plain_device, damping, precision, route):
    # Particles 7 and 8 of 5 × 3 lie in one place; their spring has no axis, the other springs are as ever.
    grid = moving(sheet((5, 3), stiffness=30.0, damping=damping))
    position = grid.position.astype(np.float32).astype(np.float64)  # the same place in every precision
    position[8] = position[7]
    grid = grid.replace(position=position)
    found = evaluate(grid, plain_device, precision, route)
    (away,) = np.nonzero((grid.connections == (7, 8)).all(axis=1))
    assert len(away) == 1
    rest = {name: np.delete(getattr(grid, name), away, axis=0) for name in ("connections", *CONSTANTS)}
    others = System(position=position, velocity=grid.velocity, **rest)
    expected = problems.forces(others, position, grid.velocity)
    # 8 springs of some 30 N/m · 1.5 m and 2 Ns/m · 3 m/s, as many roundings as above.
    np.testing.assert_allclose(found, expected, rtol=0, atol=8 * (8 + 4) * 50 * PRECISIONS[precision])


@pytest.mark.parametrize("route", ["scatter", "gather"])
def test_all_particles_in_one_place_feel_nothing(plain_device, route):
    heap = tangle(3, 40, CONSTANTS, damped=True).replace(position=np.full((40, 3), 0.7))
    for precision in PRECISIONS:
        assert not evaluate(heap, plain_device, precision, route).any()  # NaN would count as true


@every_route
def test_without_connections_there_is_no_force(plain_device, route):
    # As a lattice: one of which no connection is left.
    alone = problems.cut(chain(7), np.arange(7) % 2 == 0)
    assert alone.connection_count == 0
    assert alone.particle_count == 4
    assert not evaluate(alone, plain_device, "float64", route).any()


# Motion.


@functools.cache
def moment(name: str) -> Scene:
    """Return a scene as it is just before its first contact, small.

    What has just met the ground has not yet forgotten how: the first body to buckle or tumble does so long after.
    The cloth, which hangs free, has the ground put under its lowest edge.
    """
    scene = importlib.import_module(f"msdwarp.scenes.{name}").build(**SCENES[name])
    colliders = scene.colliders or [Plane(offset=scene.system.position[:, 2].min() - 1e-3, friction=0.3)]
    options = {"colliders": colliders, "fps": 240, "device": "cpu", "precision": "float64", "route": "scatter"}
    simulation = Simulation(scene.system, **options)
    before = scene.system
    for _ in range(240):
        if simulation.frame().position[:, 2].min() <= colliders[0].offset:
            return Scene(system=before, colliders=colliders)
        before = simulation.snapshot()
        simulation.step()
    raise AssertionError(f"the {name} meets no ground within a second")


def course(
    scene: Scene, method: Integrator, device: str, *, precision: str = "float64", route: str, **options
) -> tuple[np.ndarray, np.ndarray]:
    """Return (positions, velocities) after each of four frames, by default of 25 substeps at half the limit."""
    simulation = Simulation(
        scene.system,
        colliders=scene.colliders,
        integrator=method,
        device=device,
        precision=precision,
        route=route,
        **({"fps": 1 / (25 * half_the_limit(scene, method)), "substeps": 25} | options),
    )
    position, velocity = [], []
    for _ in range(4):
        simulation.step()
        _, x, v = simulation.frame()
        position.append(x)
        velocity.append(v)
    assert simulation.model.route == route
    return np.array(position), np.array(velocity)


def half_the_limit(scene: Scene, method: Integrator) -> float:
    """Return half of the longest substep that is stable [s]."""
    return stability_limit(scene.system, method) / 2


def assert_same(a: tuple, b: tuple) -> None:
    """Compare courses bit for bit."""
    for one, other in zip(a, b, strict=True):
        np.testing.assert_array_equal(one, other)


def assert_alike(a: tuple, b: tuple, scene: Scene, method: Integrator) -> None:
    """Compare courses in float64 by two kernels of the same pieces, to roundings in 32 substeps at most.

    Compiled apart, one may round a product and a sum at once where the other does not. Room as for routes below.
    """
    atol = 1e-12 * np.ptp(scene.system.position, axis=0).max()
    for one, other, bound in zip(a, b, (atol, atol / half_the_limit(scene, method)), strict=True):
        np.testing.assert_allclose(one, other, rtol=0, atol=bound)


@functools.cache
def plain_course(name: str, method: Integrator) -> tuple[np.ndarray, np.ndarray]:
    """Return the course of a scene by scattering on the CPU in float64."""
    return course(moment(name), method, "cpu", route="scatter")


def assert_course_is_plain(name: str, method: Integrator, found: tuple, share: float) -> None:
    """Compare positions with the plain course's to a share of the body's size, velocities to it in a substep."""
    (x, v), (plain_x, plain_v), scene = found, plain_course(name, method), moment(name)
    atol = share * np.ptp(scene.system.position, axis=0).max()
    np.testing.assert_allclose(x, plain_x, rtol=0, atol=atol)
    np.testing.assert_allclose(v, plain_v, rtol=0, atol=atol / half_the_limit(scene, method))
    assert (plain_x[..., 2] == scene.colliders[0].offset).any()  # contact puts what it stops onto the plane
    assert np.abs(plain_x[-1] - scene.system.position).max() > 1000 * atol  # far more than they may differ by


@every_route
@every_method
@pytest.mark.parametrize("name", SCENES)
def test_routes_move_a_scene_alike(plain_device, name, method, route):
    found = course(moment(name), method, plain_device, route=route)
    # A substep rounds positions, of up to twice the body's size, by ε/2 of them: 2e-14 of the size if all 100 are
    # of one sign. Springs at half of the stable step, and contact, may stretch that, by far less than fifty.
    assert_course_is_plain(name, method, found, 1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("method", [SymplecticEuler(), RK4()], ids=["symplectic euler", "rk4"])
@pytest.mark.parametrize("name", SCENES)
def test_columns_move_a_scene_alike(plain_device, in_columns, name, method):
    found = course(moment(name), method, plain_device, route="stencil", blocks=None)
    assert_course_is_plain(name, method, found, 1e-12)
    assert_same(course(moment(name), method, plain_device, route="stencil", blocks=None), found)


GROUND = Plane(offset=-2.6, restitution=0.5, friction=0.3)
IRREGULAR = {
    name: Scene(system=moving(lattices(2.0)[name]).replace(mass=0.5), colliders=[GROUND])
    for name in ("ball", "two unlike boxes", "two kinds of one shape")
}


@every_route
@pytest.mark.parametrize("name", IRREGULAR)
def test_routes_move_cut_and_unlike_lattices_alike(plain_device, name, route):
    scene = IRREGULAR[name]
    plain, _ = course(scene, SymplecticEuler(), "cpu", route="scatter")
    found, _ = course(scene, SymplecticEuler(), plain_device, route=route)
    # As above, of bodies of some 8 m.
    np.testing.assert_allclose(found, plain, rtol=0, atol=8e-12)
    assert np.abs(plain[-1] - scene.system.position).max() > 0.1
    assert name != "ball" or (plain[..., 2] == GROUND.offset).any()


@every_route
@pytest.mark.parametrize(("precision", "roundings"), [("float32", 10), ("float32-compensated", 4)])
@pytest.mark.parametrize("name", SCENES)
def test_routes_move_a_scene_alike_in_single_precision(plain_device, name, precision, roundings, route):
    found = course(moment(name), SymplecticEuler(), plain_device, precision=precision, route=route)
    # As above, ε of the size a substep: a walk of 100 steps leads 10 away. Compensated, it is only where contact
    # puts a particle that a rounding is lost.
    assert_course_is_plain(name, SymplecticEuler(), found, roundings * problems.EPS32)


@every_route
def test_what_positions_lose_is_seen_by_every_route(plain_device, route):
    # In free flight, a kilometre out: positions are rounded by 3e-5 m there, and the springs do not notice.
    cube = moment("cube").system.translate((0, 0, 9.0))
    courses = [
        course(Scene(system=system, colliders=moment("cube").colliders), SymplecticEuler(), device, **options)
        for system, device, options in (
            (cube, "cpu", {"route": "scatter"}),
            (cube.translate((1000.0, 0, 0)), plain_device, {"precision": "float32-compensated", "route": route}),
        )
    ]
    (plain, _), (found, _) = courses
    # Forces err by a few ε of k times the spacing of ⅓ m, and h² of that on m is a share of the spacing of
    # (h ω)²/16 < 1/16: for 100 substeps of one sign 100 · 4 ε/16 · ⅓ m.
    np.testing.assert_allclose(found - (1000.0, 0, 0), plain, rtol=0, atol=100 * 4 * problems.EPS32 / 48)


@every_route
@pytest.mark.parametrize("dim", [1, 2, 3])
def test_routes_follow_the_reference(plain_device, dim, route):
    # Masses of all sizes, pins and a floor; as a lattice, a sheet or a chain.
    if route == "stencil":
        body = moving({1: chain(40, dim=1), 2: sheet((7, 6), dim=2), 3: sheet((7, 6))}[dim])
        body = body.replace(stiffness=30.0, damping=0.5)
    else:
        body = tangle(dim, 40, CONSTANTS, damped=True)
    random = np.random.default_rng(8)
    body = body.replace(mass=random.uniform(2.0, 5.0, body.particle_count)).pin([1, 17, 35])
    # On a line those that meet the floor would meet each other, in one place: there it has none.
    floor = float(np.quantile(body.position[:, -1], 0.2)) if dim > 1 else None
    up = (0.0,) * (dim - 1) + (1.0,)
    colliders = [] if floor is None else [Plane(up, offset=floor, restitution=0.5, friction=0.0)]
    options = {"colliders": colliders, "precision": "float64", "device": plain_device, "route": route}
    simulation = Simulation(body, fps=10, substeps=100, **options)
    simulation.step()
    x, v = problems.symplectic_euler_loop(body, gravity=9.82, h=1 / 1000, steps=100, floor=floor, restitution=0.5)
    # 100 substeps of roundings of a few metres, and of forces of up to 1000 N on 2 kg for a millisecond each.
    np.testing.assert_allclose(simulation.frame().position, x, rtol=0, atol=100 * 8 * problems.EPS64)
    np.testing.assert_allclose(simulation.frame().velocity, v, rtol=0, atol=100 * 8 * problems.EPS64 * 1000)
    assert np.abs(x - body.position).max() > 0.1


# Repeatability.


@gathering
@pytest.mark.parametrize("precision", PRECISIONS)
def test_what_is_gathered_is_repeatable(plain_device, precision, route):
    for scene in (moment("cube"), moment("cloth"), *IRREGULAR.values()):
        first, second = (
            course(scene, SymplecticEuler(), plain_device, precision=precision, route=route) for _ in range(2)
        )
        assert_same(first, second)


@every_route
@pytest.mark.parametrize("substeps", [1, 2, 5, 8])
@every_method
def test_a_launch_for_a_frame_equals_one_for_each_stage(method, substeps, route):
    scene = moment("cube")
    options = {"route": route, "substeps": substeps, "fps": 1 / (substeps * half_the_limit(scene, method))}
    stayed = course(scene, method, "cpu", **options)
    assert_alike(course(scene, method, "cpu", **options, blocks=None), stayed, scene, method)


@every_route
@pytest.mark.parametrize("substeps", [3, 4])
def test_a_launch_for_a_frame_equals_one_for_each_stage_of_unlike_lattices(substeps, route):
    scene, method = IRREGULAR["two unlike boxes"], SymplecticEuler()
    options = {"route": route, "substeps": substeps, "fps": 1 / (substeps * half_the_limit(scene, method))}
    stayed = course(scene, method, "cpu", **options)
    assert_alike(course(scene, method, "cpu", **options, blocks=None), stayed, scene, method)


@every_route
@pytest.mark.parametrize("substeps", [3, 4])
def test_a_launch_for_a_frame_keeps_what_positions_lose(substeps, route):
    cube = moment("cube")
    scene = Scene(system=cube.system.translate((1000.0, 0, 0)), colliders=cube.colliders)
    fps = 1 / (substeps * half_the_limit(scene, SymplecticEuler()))
    options = {"route": route, "substeps": substeps, "fps": fps, "precision": "float32-compensated"}
    stayed = course(scene, SymplecticEuler(), "cpu", **options)
    x, v = course(scene, SymplecticEuler(), "cpu", **options, blocks=None)
    # The kernels may round otherwise, as above: by a few ε of a speed of 5 m/s in each of 16 substeps, by which a
    # place may be rounded to the next number. Measured without what is lost: 600 and 6 times as much.
    np.testing.assert_allclose(v, stayed[1], rtol=0, atol=16 * 4 * 5 * problems.EPS32)
    np.testing.assert_allclose(x, stayed[0], rtol=0, atol=np.spacing(np.float32(1000)))


@gathering
@pytest.mark.parametrize(
    ("method", "precision"),
    [*((method, "float64") for method in METHODS.values()), (SymplecticEuler(), "float32-compensated")],
    ids=[*METHODS, "compensated"],
)
def test_frames_may_divide_substeps_in_any_way(plain_device, method, precision, route):
    # After a frame the state lies where it lay before, though each substep writes it elsewhere.
    cube = moment("cube")
    ends = []
    for frames, substeps in ((1, 12), (12, 1), (4, 3), (3, 4)):
        options = {"fps": 8192 / substeps, "substeps": substeps, "precision": precision, "route": route}
        options |= {"colliders": cube.colliders, "integrator": method, "device": plain_device}
        simulation = Simulation(cube.system, **options)
        assert simulation.dt == 1 / 8192
        simulation.step(frames)
        ends.append(simulation.frame()[1:])
    for other in ends[1:]:
        assert_same(other, ends[0])


def clusters() -> list[tuple[int, int]]:
    """Return clusters of blocks, where the GPU has them."""
    return [(2, 128), (8, 64)] if wp.get_device("cuda:0").arch >= 90 else []


@pytest.mark.gpu
@gathering
@every_method
def test_blocks_that_stay_equal_launches(method, route):
    body = box((8, 8, 8), 0.1, mass=0.02, stiffness=600.0, damping=5.0).with_velocity((0.3, 0, -2.0))
    scene = Scene(system=body.rotate(0.3, (1, 2, 0)).translate((0, 0, 0.6)), colliders=moment("cube").colliders)
    courses = []
    for blocks in (None, (1, 128), (1, 512), *clusters()):
        courses.append(course(scene, method, "cuda:0", route=route, blocks=blocks))
    for other in courses[1:]:
        assert_same(other, courses[0])


@pytest.mark.gpu
def test_blocks_that_stay_scatter_as_launches_do():
    # Atomics add in any order: equal to roundings, as above.
    for blocks in (None, (1, 128), *clusters()):
        found = course(moment("cube"), SymplecticEuler(), "cuda:0", route="scatter", blocks=blocks)
        assert_course_is_plain("cube", SymplecticEuler(), found, 1e-12)


# Which route.


def test_unknown_route_is_named():
    for make in (Simulation, Model):
        with pytest.raises(ValueError, match=r"route is 'teleport'.*'auto', 'scatter', 'gather', 'stencil'"):
            make(chain(3), device="cpu", route="teleport")


@pytest.mark.parametrize(
    ("system", "reason"),
    [
        (System(position=[[0.0], [1]], connections=[[0, 1]]), "not every connection is in one direction"),
        (chain(4, stiffness=[1.0, 2, 3]), "stiffness differs among the connections"),
        (tangle(3, 40, (), damped=False), "not every connection is in one direction"),
    ],
)
def test_a_stencil_of_no_lattice_is_refused_with_the_reason(system, reason):
    with pytest.raises(ValueError, match=f"route is 'stencil', which this system cannot take: {reason}"):
        Simulation(system, device="cpu", route="stencil")


def test_a_route_asked_for_is_taken():
    for route in ROUTES:
        assert Simulation(chain(4), device="cpu", route=route).model.route == route
    assert Model(chain(4), device="cpu").lattice is None
    assert Model(chain(4), device="cpu", route="stencil").lattice.steps == ((1, 0, 0),)


@pytest.mark.parametrize("on_gpu", [False, True])
def test_an_automatic_route_is_one_that_can_be_taken(on_gpu):
    systems = [
        *lattices(1.0).values(),
        tangle(3, 40, CONSTANTS, damped=True),
        System(position=np.zeros((1, 1))),
        System(position=np.zeros((5, 3))),
        chain(4, stiffness=[1.0, 2, 3]),
        chain(5).replace(directions=({"weft": slice(0, 4)},)),
        chain(5).replace(directions=()),
        moving(box((3, 3, 3))).freeze(),
    ]
    for system in systems:
        route, lattice = automatic_route(system, on_gpu=on_gpu)
        assert route in ROUTES
        assert (lattice is not None) == (route == "stencil")


def test_automatic_routes_are_those_that_are_fastest():
    cube, jumble, few, grid = box((8, 8, 8)), tangle(3, 200, (), damped=True), chain(200), sheet((150, 300))
    threads = problems.cut(grid, np.arange(grid.particle_count) // 150 % 2 == 0)  # every second row of a cloth
    bodies = (cube, jumble, few, threads)
    assert {automatic_route(system, on_gpu=False)[0] for system in bodies} == {"scatter"}
    # Most of what a stencil of threads reads is no neighbour.
    fastest = ["stencil", "gather", "scatter", "gather"]
    assert [automatic_route(system, on_gpu=True)[0] for system in bodies] == fastest


def test_tests_run_over_every_route(device, request):
    # What the fixture `device` promises to all tests that use it.
    route = request.node.callspec.params["device"].split()[-1]
    expected = "scatter" if route == "cpu" else route
    assert Model(chain(9), device=device).route == expected
    assert Model(tangle(3, 9, (), damped=True), device=device).route == expected.replace("stencil", "gather")


# Order of scattering.


def by_particle(system: System) -> System:
    """Return the system with its connections listed particle by particle, in no direction any longer."""
    order = np.lexsort(system.connections.T[::-1])
    listed = {name: getattr(system, name)[order] for name in ("connections", *CONSTANTS)}
    return system.replace(**listed, directions=({},))


@pytest.mark.parametrize("system", [box((5, 5, 5)), sheet((6, 6)), box((2, 2, 8)), problems.ball(7)])
def test_neighbours_in_the_list_do_not_meet_in_a_particle(system):
    listed = by_particle(system)
    order = scatter_order(listed)
    assert (np.sort(order) == np.arange(system.connection_count)).all()
    first = listed.connections[order, 0]
    assert not (first[1:] == first[:-1]).any()
    met = listed.connections[:, 0]
    assert np.mean(met[1:] == met[:-1]) > 0.5  # as it was listed, most do


def test_any_list_is_put_in_an_order():
    random = np.random.default_rng(4)
    for _ in range(20):
        ends = np.sort(random.integers(0, 30, (200, 2)), axis=0)
        ends = ends[ends[:, 0] != ends[:, 1]]
        order = scatter_order(System(position=random.normal(size=(30, 3)), connections=ends, rest_length=1.0))
        assert (np.sort(order) == np.arange(len(ends))).all()
        # By how many its first particle had before, then by that particle.
        first = ends[order, 0]
        rank = np.array([np.count_nonzero(first[:k] == first[k]) for k in range(len(first))])
        key = rank * 30 + first
        assert (np.diff(key) > 0).all()


@pytest.mark.parametrize(
    "system",
    [
        chain(9),
        sheet((5, 7)),
        box((4, 4, 4)),
        box((4, 4, 4)) + sheet((5, 5)),
        chain(2),
        System(position=[[0.0], [1]]),
    ],
)
def test_what_is_listed_by_directions_keeps_its_order(system):
    assert scatter_order(system) is None


@pytest.mark.parametrize("own", [(), CONSTANTS], ids=["one constant each", "all their own"])
def test_order_of_scattering_does_not_change_forces(plain_device, own):
    # Constants go with their connections.
    body = by_particle(tangle(3, 65, own, damped=True))
    assert scatter_order(body) is not None
    for route in ("scatter", "gather"):
        assert_forces_are_right(body, plain_device, "float64", route)


# Change of parameters.


@pytest.fixture
def as_on_gpu(monkeypatch) -> None:
    """Choose automatic routes as on a GPU."""
    monkeypatch.setattr(
        routes, "automatic_route", lambda system, on_gpu, choose=automatic_route: choose(system, on_gpu=True)
    )


def cloth(route: str) -> Simulation:
    """Return a cloth in free fall onto the ground, that has fallen a while."""
    grid = sheet((10, 11), 0.1, mass=0.05, stiffness=40.0, damping=0.1).rotate(0.4, (1, 1, 0))
    grid = grid.translate((0, 0, 0.5))
    simulation = Simulation(grid, colliders=[Plane()], device="cpu", precision="float64", route=route)
    simulation.step(10)
    assert simulation.model.route == ("stencil" if route == "auto" else route)
    return simulation


def changes(simulation: Simulation) -> dict[str, dict]:
    """Return changes after which the connections of a direction are no longer alike."""
    uneven = np.linspace(30.0, 50.0, simulation.system.connection_count)
    return {
        "stiffness": {"stiffness": uneven},
        "damping": {"damping": uneven / 400},
        "frozen": {"rest_length": simulation.snapshot().length},
    }


@pytest.mark.parametrize("change", ["stiffness", "damping", "frozen"])
def test_a_body_that_is_a_lattice_no_longer_changes_its_route(as_on_gpu, change):
    simulation = cloth("auto")
    parameters = changes(simulation)[change]
    fresh = Simulation(
        simulation.snapshot().replace(**parameters), colliders=[Plane()], device="cpu", precision="float64"
    )
    simulation.change(**parameters)
    assert simulation.model.route == fresh.model.route == "gather"
    simulation.step(10)
    fresh.step(10)
    np.testing.assert_array_equal(simulation.frame().position, fresh.frame().position)  # the same launches
    simulation.change(stiffness=40.0, damping=0.1, rest_length=0.1)
    assert simulation.model.route == "stencil"
    simulation.step()
    simulation.reset()
    assert simulation.model.route == "stencil"


@pytest.mark.parametrize("change", ["stiffness", "damping", "frozen"])
def test_a_stencil_that_was_asked_for_refuses_such_a_change(change):
    simulation, twin = cloth("stencil"), cloth("stencil")
    before, name = simulation.system, {"frozen": "rest_length"}.get(change, change)
    with pytest.raises(ValueError, match=f"route is 'stencil'.* {name} differs among the connections"):
        simulation.change(**changes(simulation)[change])
    assert simulation.system is before
    for each in (simulation, twin):
        each.step(5)
    np.testing.assert_array_equal(simulation.frame().position, twin.frame().position)
    assert simulation.time == twin.time


def test_a_stencil_bears_changes_that_keep_the_lattice():
    simulation = cloth("stencil")
    simulation.change(stiffness=60.0, damping=0.0, mass=np.linspace(0.04, 0.06, 110))
    simulation.step()
    assert simulation.model.route == "stencil"


# Memory.


def arrays(data) -> dict[str, wp.array]:
    """Return the arrays of a struct and of the structs in it."""
    found = {}
    for name in data._cls.vars:
        value = getattr(data, name)
        if isinstance(value, wp.array):
            found[name] = value
        elif hasattr(value, "_cls"):
            found |= arrays(value)
    return found


def read_beside_the_state(route: str, system: System) -> dict[str, wp.array]:
    """Return the arrays that a route's kernels read beside positions and velocities."""
    return arrays(Dynamics(Model(system, device="cpu", route=route)).world.forces)


LISTS = {"scatter": {"f", "connections"}, "gather": {"first", "other"}}
by_lists = pytest.mark.parametrize(("route", "lists"), LISTS.items(), ids=LISTS.keys())


@by_lists
def test_constants_of_all_connections_are_single_numbers(route, lists):
    assert read_beside_the_state(route, tangle(3, 65, (), damped=True)).keys() == lists


@by_lists
@pytest.mark.parametrize("name", CONSTANTS)
def test_constants_of_few_kinds_take_a_byte_for_each_at_most(route, lists, name):
    found = read_beside_the_state(route, tangle(3, 65, (name,), damped=True))
    # Where they are gathered, that byte is one of the four of the neighbour's number.
    assert found.keys() == lists | {"table"} | ({"kind"} if route == "scatter" else set())
    assert len(found["table"]) <= 256
    assert route == "gather" or found["kind"].dtype is wp.uint8


def test_kinds_of_very_many_particles_have_a_byte_of_their_own(monkeypatch, plain_device):
    # More than 2^24 particles leave no byte of a number free; here, by another limit, more than one.
    monkeypatch.setattr(forces, "KIND_SHIFT", 0)
    for own in (("rest_length",), ("damping",)):
        body = tangle(3, 65, own, damped=True)
        assert read_beside_the_state("gather", body).keys() == {"first", "other", "kind", "table"}
        assert_forces_are_right(body, plain_device, "float64", "gather")


@by_lists
@pytest.mark.parametrize("name", CONSTANTS)
def test_constants_of_many_kinds_are_arrays(route, lists, name):
    found = read_beside_the_state(route, tangle(3, 200, (name,), damped=True))
    assert found.keys() == lists | set(CONSTANTS)


def test_a_stencil_of_one_kind_has_a_mask_and_no_other_array():
    found = read_beside_the_state("stencil", box((4, 5, 6), damping=1.0))
    assert found.keys() == {"mask"}
    assert found["mask"].size == 120


def test_a_stencil_of_kinds_has_constants_by_kind():
    boxes = box((3, 3, 3)) + box((3, 3, 3), stiffness=5.0) + box((3, 3, 3))
    found = read_beside_the_state("stencil", boxes)
    assert {name: found[name].size for name in CONSTANTS} == dict.fromkeys(CONSTANTS, 2 * 13)
    assert found["kind"].size == found["mask"].size == 81
