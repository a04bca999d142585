"""Membranes: shells with a material or a tension, against the theory of drums."""

import itertools
import math

import numpy as np
import pytest
from elasticity import deflection_matrix
from scipy.sparse import diags
from scipy.sparse.linalg import eigsh
from scipy.spatial import Delaunay
from scipy.special import jn_zeros

import msdwarp as msd
from msdwarp import Material, disc, shell

FILM = Material(density=1200.0, youngs_modulus=2e9)
THICKNESS, TENSION, RADIUS = 2e-4, 500.0, 0.2
SPEED = math.sqrt(TENSION / (FILM.density * THICKNESS))
"""Of waves in the drum [m/s]."""


def held(drum: msd.System) -> np.ndarray:
    """Return the mask of the particles on the rim."""
    return np.linalg.norm(drum.position, axis=1) > RADIUS * (1 - 1e-9)


def frequencies(drum: msd.System, count: int) -> np.ndarray:
    """Return the lowest frequencies of deflection, with the rim held [rad/s]."""
    free = np.flatnonzero(~held(drum))
    weight = diags(drum.mass[free] ** -0.5)
    matrix = weight @ deflection_matrix(drum)[free][:, free] @ weight
    return np.sqrt(np.sort(eigsh(matrix.tocsc(), count, sigma=0)[0]))


def forces(body: msd.System) -> np.ndarray:
    """Return the sum of the springs' forces on each particle [N], shape [particle_count, 3]."""
    i, j = body.connections.T
    pull = (body.stiffness * (body.length - body.rest_length) / body.length)[:, None] * (
        body.position[j] - body.position[i]
    )
    total = np.zeros_like(body.position)
    np.add.at(total, i, pull)
    np.add.at(total, j, -pull)
    return total


@pytest.mark.parametrize("kind", ["material", "stiffness"])
def test_a_drum_has_the_frequencies_of_bessels_functions(kind):
    if kind == "material":
        drum = shell(disc(RADIUS, 12), material=FILM, thickness=THICKNESS, tension=TENSION)
    else:
        mass = math.pi * RADIUS**2 * FILM.density * THICKNESS
        drum = shell(disc(RADIUS, 12), stiffness=1e5, total_mass=mass, tension=TENSION)
    zeros = sorted([*jn_zeros(0, 2), *2 * [jn_zeros(1, 1)[0]], *2 * [jn_zeros(2, 1)[0]]])
    expected = np.array(zeros) * SPEED / RADIUS
    # The aim is 1 %. An error of second order: of linear elements with lumped masses (q a)²/24 or more, for q a of
    # up to 0.46 at 12 rings.
    np.testing.assert_allclose(frequencies(drum, 6), expected, rtol=0.0101)
    assert frequencies(drum, 1)[0] == pytest.approx(expected[0], rel=0.003)


def test_the_error_of_a_drum_is_of_second_order():
    expected = jn_zeros(0, 1)[0] * SPEED / RADIUS
    error = [
        frequencies(shell(disc(RADIUS, n), material=FILM, thickness=THICKNESS, tension=TENSION), 1)[0] / expected
        - 1
        for n in (6, 12, 24)
    ]
    for coarse, fine in itertools.pairwise(error):
        assert 3.7 < coarse / fine < 4.3  # next to a² come terms of a⁴: a few per cent at 6 rings
    assert -0.01 < error[0] < 0  # six rings suffice for 1 %


@pytest.mark.slow
def test_a_struck_drum_sounds_its_lowest_note():
    drum = shell(disc(RADIUS, 8), material=FILM, thickness=THICKNESS, tension=TENSION)
    drum = drum.pin(held(drum))
    period = 2 * math.pi * RADIUS / (jn_zeros(0, 1)[0] * SPEED)
    z = np.where(drum.pinned, 0.0, 1e-5 * np.cos(np.linalg.norm(drum.position, axis=1) * math.pi / 2 / RADIUS))
    bowed = drum.replace(
        position=drum.position + np.stack([0 * z, 0 * z, z], axis=1), rest_length=drum.rest_length
    )
    simulation = msd.Simulation(
        bowed, gravity=0.0, fps=40 / period, integrator=msd.Leapfrog(), precision="float64", device="cpu"
    )
    middle = [frame.position[:, 2] @ z for frame in simulation.frames(4 * period)]
    times = np.arange(len(middle)) * period / 40
    down = np.flatnonzero((np.array(middle[:-1]) > 0) & (np.array(middle[1:]) <= 0))
    crossing = [times[k] + period / 40 * middle[k] / (middle[k] - middle[k + 1]) for k in down]
    # Its projection on its shape crosses 0 once in a period; higher modes have 1 % of it and move that by 0.3 %.
    assert len(crossing) == 4
    assert (crossing[-1] - crossing[0]) / 3 == pytest.approx(period, rel=0.01)


def test_any_flat_mesh_is_in_equilibrium():
    points = np.random.default_rng(5).random((200, 2))
    mesh = np.c_[points, np.zeros(200)], Delaunay(points).simplices
    edge = np.unique(Delaunay(points).convex_hull)
    body = shell(mesh, stiffness=1e4, tension=3.0)
    inside = np.setdiff1d(np.arange(200), edge)
    # Each force is T l (cot α + cot β)/2, and all in all they sum to 0 within their rounding.
    largest = (body.stiffness * np.abs(body.length - body.rest_length)).max()
    assert np.abs(forces(body)[inside]).max() < 1e-11 * largest
    # The virial of a stress T in a plane of area A is 2 T A.
    stress = (body.stiffness * (body.length - body.rest_length) * body.length).sum()
    a, b, c = mesh[0][mesh[1]].transpose(1, 0, 2)
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2
    assert stress == pytest.approx(2 * 3.0 * area, rel=1e-10)


def test_a_bubble_is_held_by_two_tensions_over_its_radius():
    points, triangles = msd.icosphere(RADIUS, 3)
    bubble = shell((points, triangles), stiffness=1e4, tension=TENSION / 50)
    total = -np.einsum("nd,nd->", forces(bubble), bubble.position)
    area = np.linalg.norm(np.cross(*np.diff(points[triangles], axis=1).transpose(1, 0, 2)), axis=1).sum() / 2
    assert total == pytest.approx(2 * TENSION / 50 * area, rel=1e-10)
    volume = np.linalg.det(points[triangles]).sum() / 6
    # Of pressure it is 3 p V: at p = 2 T/R an icosphere differs from a sphere, by its edges squared.
    assert 3 * (2 * TENSION / 50 / RADIUS) * volume == pytest.approx(total, rel=0.01)


def equilateral(n: int = 6) -> tuple[np.ndarray, np.ndarray]:
    """Return a rhombus of n × n points, 1 m apart, in equilateral triangles."""
    i, j = np.meshgrid(np.arange(n), np.arange(n))
    points = np.stack([(i + j / 2).ravel(), (j * 3**0.5 / 2).ravel(), np.zeros(n * n)], axis=1)
    a = (np.arange(n - 1)[:, None] * n + np.arange(n - 1)).ravel()
    return points, np.concatenate([np.stack([a, a + 1, a + n]), np.stack([a + 1, a + n + 1, a + n])], axis=1).T


@pytest.mark.parametrize(("mesh", "error"), [("equilateral", 1e-12), ("disc", 1e-3)])
@pytest.mark.parametrize("ratio", [None, 0.2, 0.45])
def test_homogeneous_strain_stores_what_plane_stress_does(mesh, error, ratio):
    material = Material(1000.0, 1e6, 0.1, ratio)
    body = shell(equilateral() if mesh == "equilateral" else disc(1.0, 8), material=material, thickness=0.01)
    area, nu = body.mass.sum() / 10.0, 1 / 3 if ratio is None else ratio
    i, j = body.connections.T
    apart = body.position[j] - body.position[i]
    random = np.random.default_rng(2).normal(size=(4, 2, 2))
    for strain in (random + random.transpose(0, 2, 1)) / 2:
        stretch = np.einsum("ni,ij,nj->n", apart[:, :2], strain, apart[:, :2]) / body.rest_length
        energy = (body.stiffness * stretch**2).sum() / 2
        if body.cells is not None:
            energy += (body.cells.modulus * body.cells.rest_volume).sum() * np.trace(strain) ** 2 / 2
        square, trace = (strain**2).sum(), np.trace(strain)
        expected = area * 1e4 / (1 - nu**2) * ((1 - nu) * square + nu * trace**2) / 2
        # Triangles of a disc are longer around it, by 5 %, so that directions differ by 0.1 % at most.
        assert energy == pytest.approx(expected, rel=error)


@pytest.mark.slow
def test_a_shell_of_a_material_is_simulated_and_damped():
    # Squeezed by 1 %, a disc of rubber, free to move in its plane, comes back to its size.
    body = shell(disc(0.2, 4), material=msd.RUBBER, thickness=1e-3)
    assert body.cells is not None
    np.testing.assert_allclose(body.cells.volumes(body.position), body.cells.rest_volume, rtol=1e-12)
    simulation = msd.Simulation(
        body.replace(position=0.99 * body.position, rest_length=body.rest_length), gravity=0.0, device="cpu"
    )
    before = simulation.measure()
    simulation.step(30)
    after = simulation.measure()
    assert before.elastic_energy > 0
    assert after.elastic_energy + after.kinetic_energy < 0.1 * before.elastic_energy


def test_masses_of_a_shell():
    mesh = msd.icosphere(0.5, 1)
    assert shell(mesh).mass.sum() == pytest.approx(1.0, rel=1e-14)
    np.testing.assert_array_equal(shell(mesh, mass=np.full(42, 0.2)).mass, 0.2)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"mass": 0.3}, "mass is 0.3; since 0.3 it must be the masses of 42 particles: .* is total_mass"),
        ({"mass": np.ones(42), "total_mass": 1.0}, r"total_mass is 1\.0; with mass"),
        ({"total_mass": 0.0}, "total_mass is 0"),
        ({"material": FILM}, "thickness is None; with a material"),
        ({"material": FILM, "thickness": 1.0, "total_mass": 1.0}, r"total_mass is 1\.0; with a material"),
        ({"thickness": 1.0}, r"thickness is 1\.0; without a material"),
        ({"tension": -1.0}, "tension is -1"),
        ({"tension": 1e3}, "tension is 1000 N/m; connections of this stiffness bear at most"),
        ({"tension": 1.0, "stiffness": 0.0}, "tension is 1 N/m; connections of this stiffness bear at most 0"),
    ],
)
def test_bad_input_is_named(options, message):
    with pytest.raises(ValueError, match=message):
        shell(msd.icosphere(0.5, 1), **options)


def test_what_was_bending_is_led_to_folding():
    with pytest.raises(TypeError, match=r"'bending'.*folding"):
        shell(msd.icosphere(0.5, 1), bending=1.0)  # type: ignore[call-arg]


@pytest.mark.parametrize("rings", [1, 2, 5])
def test_a_disc_of_triangles(rings):
    points, triangles = disc(2.0, rings)
    assert (len(points), len(triangles)) == (3 * rings * (rings + 1) + 1, 6 * rings**2)
    a, b, c = (points[triangles[:, k]] for k in range(3))
    up = np.cross(b - a, c - a)[:, 2]
    assert (up > 0).all()
    n = 6 * rings  # a regular polygon
    assert up.sum() / 2 == pytest.approx(n / 2 * 4.0 * math.sin(2 * math.pi / n), rel=1e-12)
    assert np.unique(triangles).size == len(points)
    with pytest.raises(ValueError, match="rings is 0"):
        disc(1.0, 0)
