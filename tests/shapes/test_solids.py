"""Bodies with smooth surfaces: balls, cylinders and cones."""

import math

import numpy as np
import pytest
from surfaces import area, area_vectors, assert_closed, cells_of, normals, volume

import msdwarp as msd

examples = pytest.importorskip("pyvista.examples")

SOLIDS = {
    "ball": lambda spacing, **kind: msd.ball(0.5, spacing, **kind),
    "cylinder": lambda spacing, **kind: msd.cylinder(0.4, 1.2, spacing, **kind),
    "cone": lambda spacing, **kind: msd.cone(0.5, 1.0, spacing, **kind),
}
AREA = {
    "ball": 4 * math.pi * 0.5**2,
    "cylinder": 2 * math.pi * 0.4 * (0.4 + 1.2),
    "cone": math.pi * 0.5 * (0.5 + math.hypot(0.5, 1.0)),
}
VOLUME = {"ball": 4 / 3 * math.pi * 0.5**3, "cylinder": math.pi * 0.4**2 * 1.2, "cone": math.pi * 0.5**2 / 3}


def uv_areas(surface: msd.Surface) -> np.ndarray:
    """Return the signed area of each triangle in the texture."""
    a, b, c = surface.uv[surface.triangles].transpose(1, 0, 2)
    return ((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]) / 2


@pytest.mark.parametrize("name", SOLIDS)
def test_area_and_volume_approach_the_closed_forms(name):
    # A circle of n chords is short by (π/n)²/6 and has an area too small by 2 (π/n)²/3.
    least = 32 if name == "ball" else 64  # chords around
    coarse, fine = (SOLIDS[name](spacing) for spacing in (0.1, 0.02))
    assert_closed(coarse)
    missing = np.array([[1 - area(s) / AREA[name], 1 - volume(s) / VOLUME[name]] for s in (coarse, fine)])
    assert (missing > 0).all()
    assert (missing[0] < 2 * (math.pi / least) ** 2).all()
    around = 4 * math.ceil(math.tau * (0.4 if name == "cylinder" else 0.5) / 0.02 / 4)
    # Second order in the number of chords.
    np.testing.assert_allclose(missing[1] / missing[0], (least / around) ** 2, rtol=0.05)


@pytest.mark.parametrize("spacing", [0.4, 0.13, 0.1])
@pytest.mark.parametrize("name", SOLIDS)
def test_every_particle_is_at_a_cell(name, spacing):
    system = SOLIDS[name](spacing)
    cells = cells_of(system, spacing)
    np.testing.assert_array_equal(np.unique(cells), np.arange(system.particle_count))
    # Symmetric about the axis, so that nothing makes it lean.
    turned = {tuple(p) for p in np.rint(system.position * [-2e6, -2e6, 2e6]).astype(int).tolist()}
    assert turned == {tuple(p) for p in np.rint(system.position * 2e6).astype(int).tolist()}


@pytest.mark.parametrize("name", SOLIDS)
def test_cells_fill_the_body(name):
    # What is missing and what is too much along the surface, up to half a cell thick, nearly cancels.
    for spacing in (0.1, 0.05):
        cells = len(cells_of(SOLIDS[name](spacing), spacing))
        assert cells * spacing**3 == pytest.approx(VOLUME[name], abs=0.15 * AREA[name] * spacing)


@pytest.mark.parametrize("name", SOLIDS)
def test_mass_is_density_times_volume(name):
    for spacing in (0.2, 0.1, 0.07):
        system = SOLIDS[name](spacing, material=msd.JELLY)
        assert system.mass.sum() == pytest.approx(msd.JELLY.density * VOLUME[name], rel=1e-12)
    cloth = msd.cloth([[0, 0], [2, 0], [0, 1]], 0.15, material=msd.COTTON, thickness=0.001)
    assert cloth.mass.sum() == pytest.approx(msd.COTTON.density * 1.0 * 0.001, rel=1e-12)


@pytest.mark.parametrize(
    "make",
    [
        *(lambda make=make: make(0.1) for make in SOLIDS.values()),
        lambda: msd.from_mesh(examples.load_nut(), across=12),
        lambda: msd.cloth([[0, 0], [2, 0.3], [1.4, 1.6], [0.8, 0.9], [0.2, 1.2]], 0.15),
    ],
)
def test_the_surface_follows_affine_motions(make):
    system = make()
    size = np.abs(system.position).max()
    before = system.surface.points(system.position)
    turned = system.rotate(1.1, axis=(1, 2, 3), about=(0, 0, 0)).translate((3 * size, -size, 2 * size))
    turn = msd.System(position=np.eye(3)).rotate(1.1, axis=(1, 2, 3), about=(0, 0, 0)).position
    # Coordinates of up to 5 sizes and weights of up to 3, rounded a few times.
    expected = before @ turn + np.array([3, -1, 2]) * size
    np.testing.assert_allclose(turned.surface.points(turned.position), expected, rtol=0, atol=1e-13 * size)
    stretch = np.random.default_rng(1).normal(size=(3, 3))
    bent = system.surface.points(system.position @ stretch)
    np.testing.assert_allclose(bent, before @ stretch, rtol=0, atol=1e-13 * size)


@pytest.mark.parametrize("name", SOLIDS)
def test_vertices_are_carried_by_a_cell_nearby(name):
    system = SOLIDS[name](0.1)
    surface = system.surface
    corners = system.position[surface.particle]
    np.testing.assert_allclose(np.ptp(corners, axis=1), 0.1, rtol=1e-12)
    points = surface.points(system.position)
    outside = points - np.clip(points, corners.min(axis=1), corners.max(axis=1))
    assert np.linalg.norm(outside, axis=1).max() < 0.1


def test_a_ball_has_the_normals_of_a_ball():
    system = msd.ball(0.5, 0.1)
    points = system.surface.points(system.position)
    # At seam and poles too. The triangles around a vertex span 4π/32; half of that squared does not cancel.
    np.testing.assert_allclose(normals(system), points / 0.5, rtol=0, atol=(4 * math.pi / 32) ** 2 / 2)


def test_a_ball_has_the_texture_of_a_globe():
    system = msd.ball(0.5, 0.1)
    x, y, z = system.surface.points(system.position).T
    u, v = system.surface.uv.T
    np.testing.assert_allclose(v, 0.5 + np.arcsin(z / 0.5) / math.pi, rtol=0, atol=1e-7)  # √ε: asin near 1
    off_axis = np.hypot(x, y) > 1e-3
    x, y, u = x[off_axis], y[off_axis], u[off_axis]
    np.testing.assert_allclose(np.cos(2 * math.pi * u), -x / np.hypot(x, y), rtol=0, atol=1e-12)
    np.testing.assert_allclose(np.sin(2 * math.pi * u), -y / np.hypot(x, y), rtol=0, atol=1e-12)


@pytest.mark.parametrize("name", SOLIDS)
def test_textures_are_neither_mirrored_nor_smeared(name):
    surface = SOLIDS[name](0.1).surface
    assert (uv_areas(surface) > 0).all()
    assert surface.uv.min() >= 0
    assert surface.uv.max() <= 1
    spans = np.ptp(surface.uv[surface.triangles], axis=1)
    assert spans.max() < 0.13  # a fourth of a disc's radius; a triangle across the seam would span 0.98


@pytest.mark.parametrize("name", ["cylinder", "cone"])
def test_rims_are_sharp_and_seams_are_not(name):
    system = SOLIDS[name](0.1)
    x, y, _ = system.surface.points(system.position).T
    normal = normals(system)
    facing = area_vectors(system)[:, 2] / np.linalg.norm(area_vectors(system), axis=1)
    top, bottom, side = (
        np.unique(system.surface.triangles[part]) for part in (facing > 0.9, facing < -0.9, np.abs(facing) < 0.9)
    )
    assert len(top) + len(bottom) + len(side) == len(normal)  # no vertex is of two
    np.testing.assert_allclose(normal[bottom], np.broadcast_to((0, 0, -1), (len(bottom), 3)), atol=1e-12)
    if name == "cylinder":
        np.testing.assert_allclose(normal[top], np.broadcast_to((0, 0, 1), (len(top), 3)), atol=1e-12)
        outwards = np.stack([x, y, np.zeros_like(x)], axis=1)[side] / 0.4
        # The chords on both sides of a vertex have unequal areas where a row begins or ends.
        np.testing.assert_allclose(normal[side], outwards, rtol=0, atol=math.pi / 64)
    else:
        assert not len(top)
        # As steep everywhere, up to the apex: (height, radius) / slant height, short by a chord's share.
        np.testing.assert_allclose(normal[side][:, 2], 0.5 / math.hypot(0.5, 1.0), rtol=2e-3)


def test_a_slim_cone_has_particles_up_to_its_apex():
    system = msd.cone(0.1, 1.0, 0.05)
    assert system.position[:, 2].max() == pytest.approx(0.5, abs=0.05)


@pytest.mark.parametrize("name", SOLIDS)
def test_constants_reach_the_lattice(name):
    system = SOLIDS[name](0.25, neighbors=6, mass=0.2, stiffness=30.0, damping=0.4)
    assert set(system.directions[0]) == {"x", "y", "z"}
    assert (system.mass == 0.2).all()
    assert (system.stiffness == 30.0).all()
    assert (system.damping == 0.4).all()
