"""Materials: a lattice has the modulus, the mass and the damping that were asked for, and errs as stated."""

import itertools
import math

import numpy as np
import pytest
from scipy.sparse import bmat, coo_matrix, csc_matrix, vstack
from scipy.sparse.linalg import spsolve

from msdwarp import STEEL_WIRE, Leapfrog, Material, Simulation, System, box, chain, lattice, sheet

SOLID = Material(density=1000.0, youngs_modulus=3e6, damping_ratio=0.1)
THICKNESS = 0.02
AREA = 3e-4

ANGLE = np.ones((5, 4, 3), dtype=bool)
ANGLE[2:, 2:] = False  # two bars at right angles: a corner that points inwards
FRAME = np.ones((6, 5), dtype=bool)
FRAME[2, 2] = False  # a hole of four cells

BODIES = {
    "box": box((4, 3, 5), 0.1, material=SOLID),
    "cell": box((2, 2, 2), 0.1, material=SOLID),
    "angle": lattice(ANGLE, 0.1, material=SOLID),
    "sheet": sheet((4, 3), 0.1, material=SOLID, thickness=THICKNESS, dim=2),
    "frame": lattice(FRAME, 0.1, material=SOLID, thickness=THICKNESS, dim=2),
    "box of 6": box((4, 3, 5), 0.1, neighbours=6, material=SOLID),
    "sheet of 4": sheet((4, 3), 0.1, neighbours=4, material=SOLID, thickness=THICKNESS, dim=2),
    "chain": chain(4, 0.1, material=SOLID, area=AREA, dim=1),
}
VOLUMES = {
    "box": 3 * 2 * 4 * 0.1**3,
    "cell": 0.1**3,
    "angle": (4 * 3 - 3 * 2) * 2 * 0.1**3,
    "sheet": 3 * 2 * 0.1**2 * THICKNESS,
    "frame": (5 * 4 - 4) * 0.1**2 * THICKNESS,
    "box of 6": 3 * 2 * 4 * 0.1**3,
    "sheet of 4": 3 * 2 * 0.1**2 * THICKNESS,
    "chain": 0.3 * AREA,
}


def stiffness_matrix(system: System) -> csc_matrix:
    """Return the tangent stiffness of a system at rest [N/m], shape [particle_count d, particle_count d]."""
    n, dim = system.position.shape
    i, j = system.connections.T
    axis = (system.position[j] - system.position[i]) / system.rest_length[:, None]
    block = system.stiffness[:, None, None] * axis[:, :, None] * axis[:, None, :]
    rows, columns, values = [], [], []
    for p, q, sign in ((i, i, 1), (j, j, 1), (i, j, -1), (j, i, -1)):
        rows.append(np.broadcast_to((dim * p[:, None] + np.arange(dim))[:, :, None], block.shape).ravel())
        columns.append(np.broadcast_to((dim * q[:, None] + np.arange(dim))[:, None, :], block.shape).ravel())
        values.append(sign * block.ravel())
    entries = np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))
    return coo_matrix(entries, (n * dim, n * dim)).tocsc()


def displacement(system: System, force: np.ndarray, conditions: list[np.ndarray]) -> np.ndarray:
    """Return the displacement under a static force such that the product with each condition is 0."""
    matrix = stiffness_matrix(system)
    held = vstack([csc_matrix(condition.reshape(1, -1)) for condition in conditions])
    whole = bmat([[matrix, held.T], [held, None]]).tocsc()
    known = np.concatenate([force.ravel(), np.zeros(held.shape[0])])
    return spsolve(whole, known)[: force.size].reshape(force.shape)


def rigid_motions(x: np.ndarray, weights: np.ndarray) -> list[np.ndarray]:
    """Return the conditions that a displacement has no mean and no mean turn, over weighted particles."""
    dim = x.shape[1]
    conditions = []
    for k in range(dim):
        shift = np.zeros(x.shape)
        shift[:, k] = weights
        conditions.append(shift)
    for k, m in itertools.combinations(range(dim), 2):
        turn = np.zeros(x.shape)
        turn[:, k], turn[:, m] = -weights * x[:, m], weights * x[:, k]
        conditions.append(turn)
    return conditions


def energy(system: System, strain: np.ndarray) -> float:
    """Return the energy of a homogeneous strain [J], by the stiffness matrix."""
    u = (system.position @ strain).ravel()
    return float(u @ (stiffness_matrix(system) @ u)) / 2


def expected_energy(name: str, strain: np.ndarray) -> float:
    """Return ½ V ε:C:ε of the elastic body that a lattice stands for."""
    e, volume = SOLID.youngs_modulus, VOLUMES[name]
    square, trace = (strain**2).sum(), np.trace(strain)
    if name in ("box", "cell", "angle"):  # ν = 1/4: λ = μ = 2/5 E
        density = 0.4 * e * (trace**2 / 2 + square)
    elif name in ("sheet", "frame"):  # plane stress with ν = 1/3: E/(1 − ν²) ((1 − ν) ε:ε + ν (tr ε)²)/2
        density = e / (1 - 1 / 9) * (2 / 3 * square + 1 / 3 * trace**2) / 2
    else:  # springs along the axes alone
        density = e * (np.diag(strain) ** 2).sum() / 2
    return volume * density


@pytest.mark.parametrize("name", BODIES)
def test_the_energy_of_homogeneous_strain_is_that_of_the_elastic_body(name):
    system = BODIES[name]
    dim = system.dim
    random = np.random.default_rng(3).normal(size=(dim, dim))
    unit = np.eye(dim)
    simple = [np.outer(unit[k], unit[m]) for k, m in itertools.combinations_with_replacement(range(dim), 2)]
    for strain in (*simple, random):
        strain = (strain + strain.T) / 2
        # A few hundred terms, all positive, of relative error ε.
        found = energy(system, 1e-3 * strain)
        scale = 1e-6 * SOLID.youngs_modulus * VOLUMES[name]
        assert found == pytest.approx(expected_energy(name, 1e-3 * strain), rel=1e-12, abs=1e-13 * scale)


def elasticity(system: System, volume: float) -> np.ndarray:
    """Return C_ijkl of a body [Pa], from the energies of strains."""
    dim = system.dim
    unit = np.eye(dim)
    pairs = list(itertools.product(range(dim), repeat=2))
    strain = {(k, m): (np.outer(unit[k], unit[m]) + np.outer(unit[m], unit[k])) / 2 for k, m in pairs}
    result = np.empty((dim,) * 4)
    for p, q in itertools.product(pairs, repeat=2):
        both = energy(system, strain[p] + strain[q]) - energy(system, strain[p]) - energy(system, strain[q])
        result[(*p, *q)] = both / volume
    return result


@pytest.mark.parametrize(("name", "poisson"), [("box", 1 / 4), ("angle", 1 / 4), ("sheet", 1 / 3)])
def test_the_modulus_is_the_same_in_all_directions(name, poisson):
    system = BODIES[name]
    dim = system.dim
    stiffness = elasticity(system, VOLUMES[name])
    others = np.random.default_rng(1).normal(size=(5, dim))
    for direction in ([1, 0, 0][:dim], [1, 1, 0][:dim], [1, 1, 1][:dim], *others):
        d = np.array(direction) / np.linalg.norm(direction)
        stress = np.outer(d, d)
        strain = np.linalg.pinv(stiffness.reshape(dim**2, dim**2)) @ stress.ravel()
        strain = strain.reshape(dim, dim)
        # Sums of some hundred terms, and the inverse of a matrix of condition 5.
        assert 1 / (d @ strain @ d) == pytest.approx(SOLID.youngs_modulus, rel=1e-11)
        across = np.linalg.svd(d[None])[2][1]
        assert -(across @ strain @ across) / (d @ strain @ d) == pytest.approx(poisson, rel=1e-11)


def test_long_waves_are_as_slow_as_stated():
    # From the connections of the particle in the middle: D(q) u = ω² m u for a wave of wave number q.
    a, s = 0.1, 1 / 4
    system = box((3, 3, 3), a, material=SOLID)
    mine = (system.connections == 13).any(axis=1)
    ends = system.connections[mine]
    apart = system.position[ends[:, 0]] - system.position[ends[:, 1]]
    axis = apart / np.linalg.norm(apart, axis=1)[:, None]
    speed = math.sqrt(1.2 * SOLID.youngs_modulus / SOLID.density)  # λ + 2 μ = 6/5 E
    for direction, factor in (((1, 0, 0), 1), ((1, 1, 0), 3 / 2), ((1, 1, 1), (11 + 10 * s) / 9)):
        n = np.array(direction) / np.linalg.norm(direction)
        q = 0.1 / a
        weight = system.stiffness[mine] * (1 - np.cos(q * apart @ n))
        omega = math.sqrt(n @ (axis.T * weight @ axis) @ n / system.mass[13])
        # The next term is about (q a)²/80 times as large.
        assert (1 - omega / (speed * q)) * 24 / (q * a) ** 2 == pytest.approx(factor, rel=1e-3)


@pytest.mark.parametrize("name", BODIES)
def test_mass_is_density_times_volume(name):
    assert BODIES[name].mass.sum() == pytest.approx(SOLID.density * VOLUMES[name], rel=1e-14)


@pytest.mark.parametrize("name", BODIES)
def test_constants_are_shared_by_whole_cells(name):
    # Cell by cell in a loop, from the positions alone.
    system = BODIES[name]
    dim, a = system.dim, 0.1
    x = np.round((system.position - system.position.min(axis=0)) / a).astype(int)
    number = {tuple(map(int, point)): p for p, point in enumerate(x)}
    section = {3: 1.0, 2: THICKNESS, 1: AREA}[dim]
    unit = SOLID.youngs_modulus * section * a ** (dim - 2)
    if len(np.unique(system.rest_length)) == 1:
        inner = [unit]
    else:
        inner = {3: [unit / 2, 3 / 10 * unit, 3 / 40 * unit], 2: [3 / 4 * unit, 3 / 8 * unit]}[dim]
    mass, stiffness = np.zeros(len(x)), dict.fromkeys(map(frozenset, system.connections.tolist()), 0.0)
    for cell in itertools.product(*[range(n) for n in x.max(axis=0)]):
        corners = [tuple(map(sum, zip(cell, c, strict=True))) for c in itertools.product((0, 1), repeat=dim)]
        if all(corner in number for corner in corners):
            for corner in corners:
                mass[number[corner]] += SOLID.density * section * a**dim / 2**dim
            for p, q in itertools.combinations(corners, 2):
                along = sum(map(abs, np.subtract(p, q)))
                if along <= len(inner):
                    stiffness[frozenset((number[p], number[q]))] += inner[along - 1] / 2 ** (dim - along)
    found = {frozenset(pair): k for pair, k in zip(system.connections.tolist(), system.stiffness, strict=True)}
    assert found == pytest.approx(stiffness, rel=1e-14)
    assert min(stiffness.values()) > 0
    np.testing.assert_allclose(system.mass, mass, rtol=1e-14)


@pytest.mark.parametrize("across", [1, 2, 3])
def test_a_bar_of_any_width_stretches_exactly(across):
    # Pulled at both ends by forces that are spread as the mass is.
    system = box((7, across + 1, across + 1), 0.1, material=SOLID)
    x = system.position
    force = np.zeros(x.shape)
    for side in (-1, 1):
        end = np.isclose(x[:, 0], side * 0.3)
        force[end, 0] = side * system.mass[end] / system.mass[end].sum()
    u = displacement(system, force, rigid_motions(x, system.mass))
    strain = 1 / (SOLID.youngs_modulus * (0.1 * across) ** 2)
    expected = strain * x * np.array([1, -1 / 4, -1 / 4])
    # A linear system of condition about 1e4.
    np.testing.assert_allclose(u, expected, rtol=0, atol=1e-10 * 0.3 * strain)


@pytest.mark.parametrize("shape", [(2, 2, 5), (3, 3, 6)])
def test_a_hanging_bar_stretches_by_its_weight(shape):
    # Its top slides on a ceiling; the mean of its bottom sinks by ρ g L²/(2E). By reciprocity with the bar that
    # is pulled, which is exact, so is this.
    system = box(shape, 0.1, material=SOLID)
    x, length, g = system.position, 0.1 * (shape[2] - 1), 9.82
    force = np.zeros(x.shape)
    force[:, 2] = -g * system.mass
    conditions = []
    for p in np.flatnonzero(np.isclose(x[:, 2], length / 2)):
        condition = np.zeros(x.shape)
        condition[p, 2] = 1.0
        conditions.append(condition)
    turns = rigid_motions(x, system.mass)
    u = displacement(system, force, [*conditions, turns[0], turns[1], turns[3]])  # x, y, and the turn about z
    bottom = np.isclose(x[:, 2], -length / 2)
    sunk = -np.average(u[bottom, 2], weights=system.mass[bottom])
    expected = SOLID.density * g * length**2 / (2 * SOLID.youngs_modulus)
    assert sunk == pytest.approx(expected, rel=1e-10)  # a linear system of condition about 1e4


def bar(dim: int, cells: int, ratio: int) -> System:
    """Return a bar along x of so many cells in height, 1 m high and wide (or thick) and `ratio` times as long."""
    a = 1 / cells
    if dim == 2:
        return sheet((ratio * cells + 1, cells + 1), a, material=SOLID, thickness=1.0, dim=2)
    return box((ratio * cells + 1, cells + 1, cells + 1), a, material=SOLID)


@pytest.mark.parametrize(("dim", "cells"), [(2, 1), (2, 2), (2, 3), (2, 8), (3, 1), (3, 2), (3, 3)])
def test_a_bar_resists_bending_as_stated(dim, cells):
    # Moments at both ends; the curvature is that of the middle, a height from either end of what is measured.
    system, ratio = bar(dim, cells, 6), 6
    x, z = system.position, system.position[:, -1]
    force = np.zeros(x.shape)
    for side in (-1, 1):
        end = np.isclose(x[:, 0], side * ratio / 2)
        force[end, 0] = side * (system.mass * z)[end] / (system.mass * z**2)[end].sum()
    u = displacement(system, force, rigid_motions(x, system.mass))

    def turn(where: float) -> float:
        section = np.isclose(x[:, 0], where)
        moment = system.mass[section] * z[section]
        return (moment @ u[section, 0]) / (moment @ z[section])

    curvature = turn(1.0) - turn(-1.0)
    excess = 2 / (curvature * SOLID.youngs_modulus / 12) - 1
    if dim == 2:
        # What the ends disturb has died away to 1e-6 two heights on.
        assert excess * cells**2 == pytest.approx(5 / 4, rel=1e-5)
    else:
        assert 1 < excess * cells**2 < 11 / 10


def cantilever(dim: int, cells: int) -> tuple[float, float, float]:
    """Return how far the end of a cantilever sinks under 1 N: found, and by Bernoulli, and what shear adds."""
    ratio = 10
    system = bar(dim, cells, ratio)
    x = system.position
    root, tip = np.isclose(x[:, 0], -ratio / 2), np.isclose(x[:, 0], ratio / 2)
    force = np.zeros(x.shape)
    force[tip, -1] = system.mass[tip] / system.mass[tip].sum()
    conditions = []
    for p in np.flatnonzero(root):  # the root stays plane, and is free to contract
        condition = np.zeros(x.shape)
        condition[p, 0] = 1.0
        conditions.append(condition)
    motions = rigid_motions(x, system.mass * root)
    conditions += motions[1:2] if dim == 2 else [motions[1], motions[2], motions[5]]
    u = displacement(system, force, conditions)
    found = float((force * u).sum())
    e, poisson = SOLID.youngs_modulus, {2: 1 / 3, 3: 1 / 4}[dim]
    # The shear coefficient of a rectangle by Cowper, J. Appl. Mech. 33 (1966) 335-340; of a thin one 5/6.
    coefficient = {2: 5 / 6, 3: 10 * (1 + poisson) / (12 + 11 * poisson)}[dim]
    return found, ratio**3 / (3 * e / 12), ratio * 2 * (1 + poisson) / (coefficient * e)


@pytest.mark.parametrize(("dim", "cells"), [(2, 1), (2, 2), (2, 4), (2, 8), (3, 1), (3, 2), (3, 3)])
def test_a_cantilever_bends_as_the_textbook_says(dim, cells):
    found, bent, sheared = cantilever(dim, cells)
    excess = {2: 5 / 4, 3: 11 / 10}[dim] / cells**2
    # Shear's small part, 0.8 %, has an error of its own, and a solid's in bending is at most what is stated.
    # Measured: 5e-3 (sheet) and 1.4e-2 (solid) at one cell, 2.4e-3 and 1.1e-3 at two, less from there on.
    assert found == pytest.approx(bent / (1 + excess) + sheared, rel=3e-3 if cells > 1 else 1.5e-2)


@pytest.mark.parametrize(("dim", "coarse", "fine"), [(2, 2, 8), (3, 1, 3)])
def test_the_error_of_bending_falls_with_the_square_of_the_spacing(dim, coarse, fine):
    excess = []
    for cells in (coarse, fine):
        found, bent, sheared = cantilever(dim, cells)
        excess.append((bent + sheared) / found - 1)
    order = math.log(excess[0] / excess[1]) / math.log(fine / coarse)
    assert order == pytest.approx(2, abs=0.1)  # measured: 1.99 and 1.97


def longitudinal_mode(system: System) -> tuple[float, np.ndarray]:
    """Return the frequency [rad/s] and the shape of the mode nearest to that of a free bar along z."""
    x = system.position
    root = np.sqrt(np.repeat(system.mass, 3))
    squares, shapes = np.linalg.eigh(stiffness_matrix(system).toarray() / np.outer(root, root))
    wanted = np.zeros(x.shape)
    wanted[:, 2] = np.sin(np.pi * x[:, 2] / np.ptp(x[:, 2]))
    k = int(np.argmax(np.abs((wanted.ravel() * root) @ shapes)))
    return math.sqrt(squares[k]), (shapes[:, k] / root).reshape(x.shape)


@pytest.mark.parametrize("shape", [(2, 2, 9), (2, 2, 17), (3, 3, 17)])
def test_a_free_bar_rings_at_half_a_wave_length(shape):
    a = 0.1
    system = box(shape, a, material=SOLID)
    length = a * (shape[2] - 1)
    omega, _ = longitudinal_mode(system)
    # A thick bar is slower than c: by the inertia of its contraction, ν² q² r²/2 (Rayleigh), r² the mean square of
    # the distance from its axis. The lattice is slower still, by (q a)²/24 at most; 1e-4 is for the next order.
    q = np.pi / length
    r2 = np.average((system.position[:, :2] ** 2).sum(axis=1), weights=system.mass)
    slow = 1 - q**2 * r2 / 32 - omega / (q * SOLID.wave_speed)
    assert 0.5 < slow / ((q * a) ** 2 / 24) < 1  # measured: 0.63 to 0.68


@pytest.mark.parametrize("spacing", [0.1, 0.05])
def test_damping_is_that_of_the_slowest_mode_at_any_resolution(spacing):
    material = Material(900.0, 2e5, 0.03)
    system = box((round(0.3 / spacing) + 1, 3, 3), spacing, material=material)
    omega = np.pi * material.wave_speed / 0.3
    np.testing.assert_allclose(system.damping, 2 * 0.03 / omega * system.stiffness, rtol=1e-14)


def test_a_body_is_as_long_as_its_longest_extent():
    mask = np.zeros((9, 9, 9), dtype=bool)
    mask[1:3, 2:7, 5:8] = True  # 1 × 4 × 2 cells
    system = lattice(mask, 0.1, material=SOLID)
    np.testing.assert_allclose(system.damping, SOLID.damping_time(0.4) * system.stiffness, rtol=1e-14)


def settled(system: System, device: str, material: Material) -> np.ndarray:
    """Return where a body of material hangs after a hundred times the time that waves take through it."""
    length = np.ptp(system.position[:, 2])
    duration = 20 * length / material.wave_speed
    sim = Simulation(system, gravity=9.82, device=device, precision="float64", fps=20 / duration)
    *_, last = sim.frames(duration)
    return last.position


def test_a_simulated_chain_hangs_as_the_textbook_says(device):
    material = Material(1000.0, 1e6, 1.0)
    count = 9
    hanging = chain(count, 1 / (count - 1), material=material, area=AREA).rotate(np.pi / 2, axis=(0, 1, 0))
    top = int(np.argmax(hanging.position[:, 2]))
    x = settled(hanging.pin(top), device, material)
    # Its slowest mode, π c/(2L) with a damping ratio of ½, has fallen to exp(−π/4 · 20) = 1.5e-7.
    assert np.ptp(x[:, 2]) - 1 == pytest.approx(1000.0 * 9.82 / (2 * 1e6), rel=1e-6)


def test_a_simulated_bar_hangs_as_the_textbook_says(device):
    material = Material(1000.0, 1e9, 1.0)
    system = box((2, 2, 9), 1 / 8, material=material)
    z = system.position[:, 2]
    top, bottom = z == z.max(), z == z.min()
    x = settled(system.pin(top), device, material)
    stretch = -np.mean(x[bottom, 2] - z[bottom])
    expected = 1000.0 * 9.82 / (2 * 1e9)
    # Pinned particles keep it from contracting at its top: over about its width of ⅛ it stretches by less.
    assert stretch == pytest.approx(expected, rel=0.02)
    force, conditions = np.zeros(x.shape), []
    force[:, 2] = -9.82 * system.mass
    for p, k in itertools.product(np.flatnonzero(top), range(3)):
        condition = np.zeros(x.shape)
        condition[p, k] = 1.0
        conditions.append(condition)
    static = -displacement(system, force, conditions)[bottom, 2].mean()
    assert stretch == pytest.approx(static, rel=1e-5)  # it is strained by 1e-5, and has settled to 1.5e-7


def test_a_simulated_bar_rings_and_fades_as_the_textbook_says(device):
    material = Material(1000.0, 1e6, 0.05)
    a, cells = 1 / 12, 12
    system = box((2, 2, cells + 1), a, material=material)
    omega, shape = longitudinal_mode(system)
    start = 1e-5 * shape / np.abs(shape).max()  # a strain of 1e-5, of which nothing is seen but the linear part
    sim = Simulation(
        system.with_velocity(omega * start),
        integrator=Leapfrog(),
        gravity=0.0,
        device=device,
        precision="float64",
        fps=1000,
        safety=0.2,
    )
    # Three periods of 63 ms, seen in the shape of the mode alone.
    q = [float((system.mass[:, None] * shape * (f.position - system.position)).sum()) for f in sim.frames(0.19)]
    # Samples of a damped oscillation follow q'' = a q' + b q, with the two roots exp((−ζω ± iω') Δt).
    (first, second), *_ = np.linalg.lstsq(np.stack([q[1:-1], q[:-2]], axis=1), np.array(q[2:]), rcond=None)
    root = np.log(np.roots([1, -first, -second]).astype(complex)[0]) * 1000
    textbook = np.pi * material.wave_speed  # L = 1
    # 5 substeps a frame are h = 0.2 ms; where a damper acts leapfrog errs by ω h ζ/2 = 5e-4.
    assert abs(root) == pytest.approx(omega, rel=1e-3)
    # The bar is slow by 0.29 % (see above), and ζ is in proportion to the frequency.
    assert abs(root) == pytest.approx(textbook, rel=4e-3)
    assert -root.real / abs(root) == pytest.approx(0.05, rel=4e-3)


def test_steel_carries_sound_as_fast_as_it_does():
    # 5100 m/s in a thin bar (Irvine, Damping Properties of Materials, table 2), to two figures.
    assert STEEL_WIRE.wave_speed == pytest.approx(5100, rel=0.02)


def test_bad_materials_are_named():
    with pytest.raises(ValueError, match="density is 0; it must be a number above 0"):
        Material(0.0, 1e6)
    with pytest.raises(ValueError, match="youngs_modulus is inf"):
        Material(1000.0, math.inf)
    with pytest.raises(ValueError, match=r"damping_ratio is -0\.1"):
        Material(1000.0, 1e6, -0.1)


SPIKE = np.zeros((4, 3, 3), dtype=bool)
SPIKE[:2], SPIKE[2, 1, 2] = True, True
APART = np.kron(np.eye(2), np.ones((2, 2))).astype(bool)  # two cells that only a diagonal joins, in no cell


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: box((2, 2, 2), material="rubber"), "material is 'rubber'; it must be a Material"),
        (lambda: box((2, 2, 2), material=SOLID, mass=1.0), r"mass is 1\.0; with a material"),
        (lambda: box((2, 2, 2), material=SOLID, stiffness=1.0), r"stiffness is 1\.0; with a material"),
        (lambda: box((2, 2, 2), material=SOLID, damping=0.0), r"damping is 0\.0; with a material"),
        (lambda: sheet((2, 2), material=SOLID), "thickness is None; with a material it must be"),
        (lambda: sheet((2, 2), thickness=0.1), r"thickness is 0\.1; without a material"),
        (lambda: sheet((2, 2), material=SOLID, thickness=-1), "thickness is -1"),
        (lambda: chain(2, material=SOLID), "area is None"),
        (lambda: chain(2, area=0.1), r"area is 0\.1; without a material"),
        (lambda: lattice(FRAME, material=SOLID), "thickness is None"),
        (lambda: lattice(ANGLE, material=SOLID, thickness=1.0), r"thickness is 1\.0; for a solid body"),
        (lambda: lattice(SPIKE, material=SOLID), r"mask\[2, 1, 2\] is True, but it is a corner of no whole cell"),
        (lambda: lattice(APART, material=SOLID, thickness=0.1), "mask is 2 pieces that no connection joins"),
    ],
)
def test_bad_input_is_named(make, message):
    with pytest.raises(ValueError, match=message):
        make()
