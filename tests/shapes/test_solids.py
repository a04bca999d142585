"""Bodies with smooth surfaces: balls, cylinders, cones, filled meshes and cloths of any outline."""

import itertools
import math

import numpy as np
import pytest

import msdwarp as msd
from msdwarp.shapes.skin import held

pv = pytest.importorskip("pyvista")
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
SAMPLES = {
    "sphere": examples.load_sphere,
    "nut": examples.load_nut,
    "torus": pv.ParametricTorus,
    "capsule": pv.Capsule,
}


def triangles_of(system: msd.System) -> np.ndarray:
    """Return the corners of the triangles that are drawn, shape [triangle_count, 3, d]."""
    return system.surface.points(system.position)[system.surface.triangles]


def area_vectors(system: msd.System) -> np.ndarray:
    """Return the area vector of each triangle that is drawn, shape [triangle_count, 3]."""
    a, b, c = triangles_of(system).transpose(1, 0, 2)
    return np.cross(b - a, c - a) / 2


def area(system: msd.System) -> float:
    return np.linalg.norm(area_vectors(system), axis=1).sum()


def volume(system: msd.System) -> float:
    """Return the volume that a surface which faces outwards encloses, by the divergence theorem."""
    return np.linalg.det(triangles_of(system)).sum() / 6


def normals(system: msd.System) -> np.ndarray:
    """Return the normal of each vertex as it is drawn: of the triangles around all that share it."""
    surface = system.surface
    sums = np.zeros((len(surface.uv), 3))
    own = np.arange(len(sums)) if surface.normal_of is None else surface.normal_of
    for k in range(3):
        np.add.at(sums, own[surface.triangles[:, k]], area_vectors(system))
    return sums[own] / np.linalg.norm(sums[own], axis=1, keepdims=True)


def uv_areas(surface: msd.Surface) -> np.ndarray:
    """Return the signed area of each triangle in the texture."""
    a, b, c = surface.uv[surface.triangles].transpose(1, 0, 2)
    return ((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]) / 2


def assert_closed(system: msd.System) -> None:
    """Check that vertices in one place are exactly there, and each edge is walked once in either direction."""
    _, place = np.unique(system.surface.points(system.position), axis=0, return_inverse=True)
    corners = place.ravel()[system.surface.triangles]
    edges = np.concatenate([corners[:, [0, 1]], corners[:, [1, 2]], corners[:, [2, 0]]])
    there = {tuple(edge) for edge in edges.tolist()}
    assert len(there) == len(edges)
    assert {(b, a) for a, b in there} == there


def cells_of(system: msd.System, spacing: float) -> np.ndarray:
    """Return the corners of all whole cells as particles, shape [cell_count, 2^d], from their positions alone."""
    places = np.rint((system.position - system.position.min(axis=0)) / spacing).astype(int)
    flat = not np.ptp(places[:, -1])
    key = (1, 10**4, 10**8)[: system.dim]  # more than there are particles along an axis
    particle = np.argsort(places @ key)
    known = (places @ key)[particle]
    steps = itertools.product((0, 1), repeat=system.dim)
    sought = np.stack([(places + step) @ key for step in steps if not (flat and step[-1])], axis=1)
    found = np.clip(np.searchsorted(known, sought), 0, len(known) - 1)
    return particle[found][(known[found] == sought).all(axis=1)]


@pytest.mark.parametrize("name", SOLIDS)
def test_area_and_volume_approach_the_closed_forms(name):
    # A circle of n chords is short by (π/n)²/6 and has an area too small by 2 (π/n)²/3. Around go at least 64.
    coarse, fine = (SOLIDS[name](spacing) for spacing in (0.1, 0.02))
    missing = np.array([[1 - area(s) / AREA[name], 1 - volume(s) / VOLUME[name]] for s in (coarse, fine)])
    assert (missing > 0).all()
    assert (missing[0] < 2 * (math.pi / 64) ** 2).all()
    around = 4 * math.ceil(math.tau * (0.4 if name == "cylinder" else 0.5) / 0.02 / 4)
    # Second order in the number of chords.
    np.testing.assert_allclose(missing[1] / missing[0], (64 / around) ** 2, rtol=0.05)


@pytest.mark.parametrize("name", SOLIDS)
def test_solids_are_closed(name):
    assert_closed(SOLIDS[name](0.13))


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


def test_mass_of_a_ball_tends_to_density_times_volume():
    # The number of lattice points in a ball (Gauss's problem) errs erratically, by about the root of the number of
    # cells along its surface over that inside, (spacing/radius)²; measured 24, 5.4, 0.8 and 0.12 %.
    for spacing in (0.2, 0.1, 0.05, 0.025):
        system = msd.ball(0.5, spacing, material=msd.JELLY)
        error = system.mass.sum() / (msd.JELLY.density * VOLUME["ball"]) - 1
        assert abs(error) < 1.5 * (spacing / 0.5) ** 2


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
    # At seam and poles too. The triangles around a vertex span 4π/64; what does not cancel is of that squared.
    np.testing.assert_allclose(normals(system), points / 0.5, rtol=0, atol=0.02)


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


def test_cylinder_tiles():
    system = msd.cylinder(0.4, 1.2, 0.1)
    x, y, z = system.surface.points(system.position).T
    u, v = system.surface.uv.T
    facing = area_vectors(system)[:, 2] / np.linalg.norm(area_vectors(system), axis=1)
    for part, expected in (
        (np.unique(system.surface.triangles[facing < -0.9]), (0.25 + y / 1.6, 0.75 + x / 1.6)),
        (np.unique(system.surface.triangles[facing > 0.9]), (0.75 + x / 1.6, 0.75 + y / 1.6)),
    ):
        np.testing.assert_allclose(u[part], expected[0][part], rtol=0, atol=1e-14)
        np.testing.assert_allclose(v[part], expected[1][part], rtol=0, atol=1e-14)
    side = np.unique(system.surface.triangles[np.abs(facing) < 0.1])
    np.testing.assert_allclose(v[side], (z[side] + 0.6) / 2.4, rtol=0, atol=1e-14)
    np.testing.assert_allclose(np.cos(2 * math.pi * u[side]), -x[side] / 0.4, rtol=0, atol=1e-13)


def test_a_slim_cone_has_particles_up_to_its_apex():
    system = msd.cone(0.1, 1.0, 0.05)
    assert system.position[:, 2].max() == pytest.approx(0.5, abs=0.05)


@pytest.mark.parametrize("name", SOLIDS)
def test_constants_reach_the_lattice(name):
    system = SOLIDS[name](0.25, neighbours=6, mass=0.2, stiffness=30.0, damping=0.4)
    assert set(system.directions[0]) == {"x", "y", "z"}
    assert (system.mass == 0.2).all()
    assert (system.stiffness == 30.0).all()
    assert (system.damping == 0.4).all()


# Meshes


@pytest.mark.parametrize("across", [12, 25])
@pytest.mark.parametrize("name", SAMPLES)
def test_a_mesh_is_drawn_where_it_is_and_filled(name, across):
    mesh = SAMPLES[name]()
    system = msd.from_mesh(mesh, across=across)
    spacing = max(np.ptp(np.reshape(mesh.bounds, (3, 2)), axis=1)) / across
    assert system.rest_length.min() == pytest.approx(spacing, rel=1e-6)  # the mesh is single precision
    assert_closed(system)
    # Single precision, and PyVista's own sums.
    solid = mesh.triangulate()
    assert area(system) == pytest.approx(solid.area, rel=1e-5)
    assert volume(system) == pytest.approx(solid.volume, rel=1e-4)
    points = system.surface.points(system.position)
    np.testing.assert_allclose(points.min(axis=0), solid.points.min(axis=0), atol=1e-5 * across * spacing)
    # No long edges are left, and every vertex is near the cell that carries it.
    corners = triangles_of(system)
    assert np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=-1).max() <= 2 * spacing * (1 + 1e-12)
    low = system.position[system.surface.particle[:, 0]]
    assert np.linalg.norm(points - np.clip(points, low, low + spacing), axis=1).max() < spacing
    # Cells too few and too many along the surface nearly cancel: measured less than a fifth of a cell all over.
    cells = len(cells_of(system, spacing))
    assert cells * spacing**3 == pytest.approx(solid.volume, abs=0.25 * solid.area * spacing)


@pytest.mark.slow
@pytest.mark.parametrize("across", [40, 60])
@pytest.mark.parametrize("name", ["nut", "torus", "sphere"])
def test_large_meshes(name, across):
    test_a_mesh_is_drawn_where_it_is_and_filled(name, across)


def test_a_torus_is_filled_where_it_is():
    mesh = pv.ParametricTorus(ringradius=1.0, crosssectionradius=0.4)
    system = msd.from_mesh(mesh, 0.1)
    # All cells of the grid, against the equation of a torus of chords, which is thinner by up to 0.4 (π/100)²/2.
    shape = [math.ceil(n) for n in np.ptp(np.reshape(mesh.bounds, (3, 2)), axis=1) / 0.1 - 1e-6]
    axes = [0.1 * (np.arange(n) - (n - 1) / 2) for n in shape]
    centre = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    depth = 0.4 - np.hypot(np.hypot(centre[..., 0], centre[..., 1]) - 1, centre[..., 2])
    middles = {
        tuple(p) for p in np.rint(system.position[cells_of(system, 0.1)].mean(axis=1) * 20).astype(int).tolist()
    }
    inside = {tuple(p) for p in np.rint(centre[depth > 0.002] * 20).astype(int).tolist()}
    near = {tuple(p) for p in np.rint(centre[depth > -0.1] * 20).astype(int).tolist()}
    assert len(inside) > 1000
    assert inside <= middles <= near


@pytest.mark.parametrize("across", [8, 15, 30])
def test_thin_parts_hold_together(across):
    # The ant's legs and feelers are a twentieth as thick as it is long.
    system = msd.from_mesh(examples.load_ant(), across=across)
    assert system.particle_count > 100
    points = system.surface.points(system.position)
    low, spacing = system.position[system.surface.particle[:, 0]], system.rest_length.min()
    assert np.linalg.norm(points - np.clip(points, low, low + spacing), axis=1).max() < spacing


@pytest.mark.parametrize("thickness", [0.5, 0.1, 0.01])
def test_a_plate_thinner_than_a_cell_is_a_cell_thick(thickness):
    plate = pv.Cube(x_length=10, y_length=6, z_length=thickness)
    system = msd.from_mesh(plate, 1.0)
    assert system.particle_count == 11 * 7 * 2
    assert volume(system) == pytest.approx(60 * thickness, rel=1e-6)


def test_held_cells_bridge_a_gap_of_one_cell():
    cells = np.zeros((6, 4), dtype=bool)
    cells[:2], cells[3:] = True, True
    # A thin part runs from piece to piece through cell (2, 1), always within ½ of one of them.
    samples = np.stack([np.linspace(-2, 2, 11), np.full(11, -0.5)], axis=1)
    filled = held(cells, samples)
    assert set(map(tuple, np.argwhere(filled & ~cells))) == {(2, 1)}
    # Where the pieces are joined by a neighbour already, nothing is added.
    cells[2, 0] = True
    np.testing.assert_array_equal(held(cells, samples), cells)


def cube(turned: bool = False) -> tuple[np.ndarray, np.ndarray]:
    """Return the points and triangles of a cube from 0 to 1."""
    mesh = pv.Cube(clean=True).triangulate()
    faces = mesh.regular_faces
    return np.array(mesh.points) + 0.5, faces[:, ::-1] if turned else faces


def test_points_and_triangles_make_a_mesh():
    system = msd.from_mesh(cube(), 0.25)
    expected = msd.box((5, 5, 5), 0.25).translate((0.5, 0.5, 0.5))
    np.testing.assert_allclose(system.position, expected.position, rtol=0, atol=1e-15)
    np.testing.assert_array_equal(system.connections, expected.connections)
    assert volume(system) == pytest.approx(1.0, rel=1e-12)


def test_inside_out_meshes_are_turned():
    assert volume(msd.from_mesh(cube(turned=True), across=3)) == pytest.approx(1.0, rel=1e-12)


def test_points_without_triangles_do_not_count():
    points, triangles = cube()
    system = msd.from_mesh((np.concatenate([[[50.0, 0, 0]], points]), triangles + 1), across=3)
    assert system.position.max() == pytest.approx(1.0)


def test_a_mesh_far_away_keeps_its_form():
    points, triangles = cube()
    system = msd.from_mesh((points + 1e7, triangles), across=4)
    assert system.particle_count == 125  # single precision would have lost it


def test_a_hollow_body_stays_hollow():
    outer, inner = pv.Sphere(radius=1.0), pv.Sphere(radius=0.6).flip_faces()
    points = np.concatenate([outer.points, inner.points])
    triangles = np.concatenate([outer.regular_faces, inner.regular_faces + outer.n_points])
    system = msd.from_mesh((points, triangles), 0.1)
    cells = cells_of(system, 0.1)
    assert np.linalg.norm(system.position, axis=1).min() > 0.4
    expected = 4 / 3 * math.pi * (1 - 0.6**3)
    assert len(cells) * 0.1**3 == pytest.approx(expected, rel=0.05)  # a tenth of the cells are on a surface


def test_coincident_vertices_share_normals_where_the_surface_is_smooth():
    # PyVista's cylinder has points of their own for side and lids: its rim is sharp.
    mesh = pv.Cylinder(radius=0.5, height=2, direction=(0, 0, 1), resolution=40)
    assert mesh.n_open_edges > 0
    system = msd.from_mesh(mesh, 0.2)
    assert_closed(system)
    normal = normals(system)
    upright = np.abs(normal[:, 2])
    assert ((upright < 1e-6) | (upright > 1 - 1e-6)).all()


def test_texture_coordinates_and_seams_are_kept():
    columns, rows = 24, 8
    u, v = np.meshgrid(np.linspace(0, 1, columns + 1), np.linspace(0, 1, rows + 1))
    angle, height = 2 * np.pi * u.ravel(), np.pi * (v.ravel() - 0.5)
    points = np.stack([np.cos(height) * np.cos(angle), np.cos(height) * np.sin(angle), np.sin(height)], axis=1)
    index = np.arange(points.shape[0]).reshape(rows + 1, columns + 1)
    a, b, c, d = (part.ravel() for part in (index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]))
    triangles = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    mesh = pv.PolyData.from_regular_faces(points.astype(np.float32), triangles)
    mesh.active_texture_coordinates = np.stack([u.ravel(), v.ravel()], axis=1)
    system = msd.from_mesh(mesh, 0.08)  # so fine that its triangles are divided
    assert_closed(system)
    assert len(system.surface.triangles) > 2 * len(triangles)
    place = system.surface.points(system.position)
    uv = system.surface.uv
    # Halfway along a slanted chord the angle is off by a share of the 2π/24 between its ends: measured 0.04.
    off_axis = np.hypot(place[:, 0], place[:, 1]) > 0.3
    x, y = place[off_axis, :2].T
    apart = np.exp(2j * np.pi * uv[off_axis, 0]) - (x + 1j * y) / np.hypot(x, y)
    assert np.abs(apart).max() < 0.05
    # On the seam, at y = 0, the normals of both sides are as one. Alone, each would be off by sin(π/24) = 0.13;
    # triangles halved unlike on both sides leave a fifth of that.
    seams = [np.flatnonzero(off_axis & (uv[:, 0] == u)) for u in (0, 1)]
    low, high = (seam[np.argsort(place[seam, 2])] for seam in seams)
    assert len(low) > rows
    np.testing.assert_array_equal(place[low], place[high])
    np.testing.assert_array_equal(normals(system)[low], normals(system)[high])
    assert np.abs(normals(system)[low][:, 1]).max() < 0.05
    assert np.ptp(uv[system.surface.triangles], axis=1).max() < 2 / rows


def test_texture_coordinates_without_any():
    system = msd.from_mesh(pv.Sphere(radius=2.0, center=(1, 2, 3)), 0.5)
    x, y, z = (system.surface.points(system.position) - (1, 2, 3)).T
    u, v = system.surface.uv.T
    # PyVista's sphere has no point at −x, so that the middle of its bounding box is a little off.
    away = np.hypot(x, y) > 0.5
    np.testing.assert_allclose(u[away], (np.abs(np.arctan2(y, x)) / math.pi)[away], rtol=0, atol=0.01)
    np.testing.assert_allclose(v, (z + 2) / 4, rtol=0, atol=1e-6)
    # Nowhere does a triangle span much of the texture, but around the axis.
    flat = away[system.surface.triangles].all(axis=1)
    assert np.ptp(u[system.surface.triangles[flat]], axis=1).max() < 0.3


def two_balls() -> tuple[np.ndarray, np.ndarray]:
    """Return the points and triangles of two balls apart."""
    one = pv.Sphere()
    points = np.concatenate([one.points, one.points + np.array([3, 0, 0])])
    return points, np.concatenate([one.regular_faces, one.regular_faces + one.n_points])


def disagreeing() -> tuple[np.ndarray, np.ndarray]:
    """Return the points and triangles of a cube with a triangle inside out."""
    points, triangles = cube()
    triangles = triangles.copy()
    triangles[5] = triangles[5][::-1]
    return points, triangles


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: msd.ball(0.0, 0.1), "radius is 0"),
        (lambda: msd.ball(0.5, -0.1), "spacing is -0.1"),
        (lambda: msd.ball(0.5, 0.6), r"spacing is 0\.6; it must be at most 0\.5, the radius"),
        (lambda: msd.ball(0.5, 0.1, neighbours=8), "neighbours is 8; it must be one of 26, 6"),
        (lambda: msd.ball(0.5, 0.1, mass=-1.0), r"mass is -1"),
        (lambda: msd.cylinder(0.5, np.inf, 0.1), "height is inf"),
        (lambda: msd.cylinder(0.5, 0.05, 0.1), r"spacing is 0\.1; it must be at most 0\.05, the height"),
        (lambda: msd.cone(0.5, float("nan"), 0.1), "height is nan"),
        (lambda: msd.cone(0.05, 1.0, 0.1), r"spacing is 0\.1; it must be at most 0\.05, the radius"),
        (lambda: msd.ball(0.5, 0.1, material=msd.RUBBER, mass=1.0), r"mass is 1\.0; with a material"),
        (lambda: msd.from_mesh(cube()), "spacing is None and across is None; one of them must be given"),
        (lambda: msd.from_mesh(cube(), 0.1, across=3), r"spacing is 0\.1 and across is 3; one of them must"),
        (lambda: msd.from_mesh(cube(), across=0), "across is 0"),
        (lambda: msd.from_mesh(cube(), 0.0), "spacing is 0"),
        (lambda: msd.from_mesh(cube(), 1.5), r"spacing is 1\.5; it must be at most 1, the longest extent"),
        (lambda: msd.from_mesh("bunny", 0.1), "mesh is a str; it must be a PyVista surface or"),
        (
            lambda: msd.from_mesh(pv.ImageData(dimensions=(3, 3, 3)), 0.1),
            "mesh is a ImageData; it must be a surface",
        ),
        (lambda: msd.from_mesh(pv.PolyData(), 0.1), "mesh has no triangles"),
        (lambda: msd.from_mesh(pv.PolyData(np.eye(3)), 0.1), "mesh has no triangles"),
        (lambda: msd.from_mesh((np.eye(3), []), 0.1), "mesh has no triangles"),
        (lambda: msd.from_mesh((np.ones((4, 2)), [[0, 1, 2]]), 0.1), r"points have shape \(4, 2\)"),
        (lambda: msd.from_mesh((np.eye(3), [[0, 1, 3]]), 0.1), r"triangles\[0, 2\] is 3"),
        (lambda: msd.from_mesh((np.eye(3) * np.nan, [[0, 1, 2]]), 0.1), r"points\[0, 0\] is nan"),
        (lambda: msd.from_mesh(pv.Plane(), 0.1), "mesh is not closed: of its 320 edges 40 have not two triangles"),
        (lambda: msd.from_mesh(examples.load_airplane(), across=20), "mesh is not closed"),
        (lambda: msd.from_mesh((np.zeros((3, 3)), [[0, 1, 2]]), 0.1), "mesh is but a point or a line"),
        (lambda: msd.from_mesh((np.eye(3), [[0, 1, 2], [0, 2, 1]]), 0.1), "mesh encloses a volume of 0"),
        (lambda: msd.from_mesh(disagreeing(), 0.1), "disagree about which side is outside, at 3 edges"),
        (
            lambda: msd.from_mesh(two_balls(), 0.1),
            r"with a spacing of 0\.1 the body is 2 pieces that do not touch",
        ),
        (lambda: msd.cloth([[0, 0], [1, 0]], 0.1), "outline has 2 corners"),
        (lambda: msd.cloth([[0, 0, 0]] * 3, 0.1), r"outline has shape \(3, 3\)"),
        (lambda: msd.cloth([[0, 0], [1, 0], [np.inf, 1]], 0.1), r"outline\[2, 0\] is inf"),
        (lambda: msd.cloth([[0, 0], [1, 0], [1, 0], [0, 1]], 0.1), r"outline\[1\] is the same corner as the next"),
        (lambda: msd.cloth([[0, 0], [2, 0], [1, 0]], 0.1), r"outline turns back on itself at outline\[0\]"),
        (lambda: msd.cloth([[0, 0], [1, 1], [1, 0], [0, 1]], 0.1), r"sides from outline\[0\] and outline\[2\]"),
        (lambda: msd.cloth([[0, 0], [2, 0], [2, 2], [1, 0], [0, 2]], 0.1), "outline crosses or touches itself"),
        (lambda: msd.cloth([[0, 0], [1, 0], [0, 1]], 2.0), r"spacing is 2; it must be at most 1, the longest"),
        (lambda: msd.cloth([[0, 0], [1, 0], [0, 1]], 0.1, dim=1), "dim is 1"),
        (lambda: msd.cloth([[0, 0], [1, 0], [0, 1]], 0.1, neighbours=26), "neighbours is 26"),
        (lambda: msd.cloth([[0, 0], [1, 0], [0, 1]], 0.1, material=msd.COTTON), "thickness is None"),
    ],
)
def test_bad_input_is_named(make, message):
    with pytest.raises(ValueError, match=message):
        make()


# Cloths


def polygon_area(outline: np.ndarray) -> float:
    """Return the area of a simple polygon: the shoelace formula."""
    x, y = np.asarray(outline, dtype=float).T
    return abs(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1))) / 2


def star(points: int, inner: float) -> np.ndarray:
    """Return a star with tips 1 from the middle."""
    angle = np.arange(2 * points) * math.pi / points
    return np.where(np.arange(2 * points) % 2, inner, 1.0)[:, None] * np.stack(
        [np.cos(angle), np.sin(angle)], axis=1
    )


TURN = np.array([[0.8, 0.6], [-0.6, 0.8]])
OUTLINES = {
    "rectangle": np.array([[0, 0], [2.03, 0], [2.03, 1.17], [0, 1.17]]),
    "clockwise": np.array([[0, 0], [2.03, 0], [2.03, 1.17], [0, 1.17]])[::-1],
    "turned": np.array([[0, 0], [2.03, 0], [2.03, 1.17], [0, 1.17]]) @ TURN + (3, -5),
    "corner": np.array([[0, 0], [3, 0], [3, 1], [1, 1], [1, 4], [0, 4]]) @ TURN,
    "star": star(5, 0.4),
    "dumbbell": [
        [0, 0],
        [1, 0],
        [1, 0.45],
        [3, 0.45],
        [3, 0],
        [4, 0],
        [4, 1],
        [3, 1],
        [3, 0.5],
        [1, 0.5],
        [1, 1],
        [0, 1],
    ],
}


@pytest.mark.parametrize("name", OUTLINES)
def test_a_cloth_has_the_area_and_the_corners_of_its_outline(name):
    outline = np.asarray(OUTLINES[name])
    system = msd.cloth(outline, 0.1)
    facing = area_vectors(system)
    # Its margin is on the outline, and so are all its corners.
    assert facing[:, 2].sum() == pytest.approx(polygon_area(outline), rel=1e-12)
    assert (facing[:, 2] >= -1e-16).all()
    assert not facing[:, :2].any()
    points = system.surface.points(system.position)
    nearest = np.linalg.norm(points[:, None, :2] - outline, axis=-1).min(axis=0)
    assert nearest.max() < 1e-14
    extent = np.ptp(outline, axis=0)
    expected = (points[:, :2] - outline.min(axis=0)) / extent
    np.testing.assert_allclose(system.surface.uv, expected, rtol=0, atol=1e-13)


def test_a_round_cloth():
    angle = np.arange(400) * math.tau / 400
    outline = 0.5 + np.stack([np.cos(angle), np.sin(angle)], axis=1)
    missing = []
    for spacing in (0.2, 0.1, 0.05):
        system = msd.cloth(outline, spacing)
        missing.append(1 - np.linalg.norm(area_vectors(system), axis=1).sum() / polygon_area(outline))
        particles = math.pi / spacing**2
        assert system.particle_count == pytest.approx(particles, abs=math.tau / spacing)
    # Chords of at most 1.5 fine steps s are away from a circle by (1.5 s)²/8, and that on average less.
    assert 0 < missing[0] < (1.5 * 0.05) ** 2 / 4
    assert missing[2] < missing[1] / 2 < missing[0] / 4


def test_a_rectangular_cloth_is_a_sheet():
    system = msd.cloth([[0, 0], [0.8, 0], [0.8, 0.5], [0, 0.5], [0, 0]], 0.1, mass=0.2)
    expected = msd.sheet((9, 6), 0.1, mass=0.2).translate((0.4, 0.25, 0))
    np.testing.assert_array_equal(system.connections, expected.connections)
    np.testing.assert_allclose(system.position, expected.position, rtol=0, atol=1e-16)
    assert len(system.surface.triangles) == 8 * 5 * 16 * 2


def test_a_cloth_of_a_material_weighs_what_it_should():
    system = msd.cloth(star(5, 0.5), 0.02, material=msd.COTTON, thickness=0.001)
    expected = msd.COTTON.density * 0.001 * polygon_area(star(5, 0.5))
    # Cells along the margin cancel but for the tips: measured 0.2 %.
    assert system.mass.sum() == pytest.approx(expected, rel=0.01)


def test_a_flat_cloth_in_two_coordinates():
    system = msd.cloth(star(5, 0.4), 0.1, dim=2, neighbours=4)
    assert system.dim == 2
    assert system.surface.points(system.position).shape[1] == 2
    assert set(system.directions[0]) == {"x", "y"}


@pytest.mark.parametrize("width", [0.05, 0.02, 0.003])
def test_narrow_parts_of_a_cloth_hold_together(width):
    outline = np.array([[0, 0], [5, 1], [5, 1 + width], [0, width]])
    system = msd.cloth(outline, 0.1)
    # A cell wide, and as long as it should be; what is drawn is as narrow as the outline.
    np.testing.assert_allclose(np.ptp(system.position, axis=0), (5, 1, 0), rtol=0, atol=0.2)
    drawn = np.abs(area_vectors(system)[:, 2]).sum()
    assert drawn == pytest.approx(polygon_area(outline), rel=0.06)


@pytest.mark.parametrize("spacing", [0.3, 0.1, 0.03])
def test_acute_tips_of_a_cloth_hold_together(spacing):
    system = msd.cloth(star(9, 0.2), spacing)
    points = system.surface.points(system.position)[:, :2]
    tips = star(9, 0.2)[::2]
    # Thinner than anything that is drawn, but there: to a fine step.
    assert np.linalg.norm(points[:, None] - tips, axis=-1).min(axis=0).max() < spacing / 4
