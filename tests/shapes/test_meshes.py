"""Bodies that fill a mesh: where it is, how it is drawn, and what of smooth bodies is refused."""

import math
import re
import warnings

import numpy as np
import pytest
from surfaces import area, assert_closed, cells_of, normals, triangles_of, volume

import msdwarp as msd
from msdwarp.shapes.meshes import _filled
from msdwarp.shapes.skin import held

pv = pytest.importorskip("pyvista")
examples = pytest.importorskip("pyvista.examples")

SAMPLES = {
    "sphere": examples.load_sphere,
    "nut": examples.load_nut,
    "torus": pv.ParametricTorus,
    "capsule": pv.Capsule,
}


@pytest.mark.slow
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


@pytest.mark.parametrize("side", [0.1, 0.2, 0.3, 0.5])
def test_a_side_of_whole_cells_in_single_precision_has_no_cell_more(side):
    foam = msd.Material(density=1000.0, youngs_modulus=1e5)
    mesh = pv.Cube(x_length=1, y_length=side, z_length=1)  # single precision
    for body in (msd.from_mesh(mesh, across=10, material=foam), msd.from_volume(mesh, 0.1, material=foam)):
        assert np.ptp(body.position, axis=0) == pytest.approx([1, side, 1], rel=1e-6)
        assert body.mass.sum() == pytest.approx(1000 * side, rel=1e-6)
    assert len(msd.from_mesh(pv.Cube(x_length=side, y_length=side, z_length=side), side).position) == 8
    one = float(np.float32(side)) * (1 + 1e-7)
    for body in (msd.ball(one, 0.1), msd.cylinder(one, 0.4 + 1e-8, 0.1), msd.cone(one, 0.4, 0.1)):
        assert np.ptp(body.position, axis=0)[:2] == pytest.approx(2 * side, abs=0.11)
    assert np.ptp(msd.ball(one, 0.1).position[:, 0]) == pytest.approx(2 * side)
    assert np.ptp(msd.cylinder(one, 0.4 + 1e-8, 0.1).position[:, 2]) == pytest.approx(0.4)
    cloth = msd.cloth(np.float32([[0, 0], [1, 0], [1, side], [0, side]]), 0.1)
    assert np.ptp(cloth.position, axis=0)[1] == pytest.approx(side)


@pytest.mark.parametrize(
    ("mesh", "across", "thin"),
    [
        (pv.Cube(x_length=1, y_length=1, z_length=0.02), 10, True),
        (pv.Cube(x_length=1, y_length=0.102, z_length=0.102), 10, True),
        (pv.Cube(x_length=1, y_length=0.1, z_length=0.1), 10, False),
        (pv.Sphere(theta_resolution=40, phi_resolution=40), 6, False),
    ],
)
def test_a_mesh_of_a_material_has_the_mass_of_its_volume(mesh, across, thin):
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        body = msd.from_mesh(mesh, across=across, material=msd.FOAM)
    assert body.mass.sum() == pytest.approx(msd.FOAM.density * mesh.triangulate().volume, rel=1e-5)  # float32
    assert [one.category for one in caught] == [msd.StartWarning] * thin
    if thin:  # with as many cells across as it says, nothing is to be said
        enough = int(re.search(r"across=(\d+)", str(caught[0].message))[1])
        assert enough <= 120
        msd.from_mesh(mesh, across=enough, material=msd.FOAM)


def test_cells_are_filled_where_the_winding_number_is_above_0():
    # A ball through which a smaller one is cut, and a third that overlaps the first: 1 − 1, and 1 + 1 are known.
    centres, radii, turn = np.array([[0, 0, 0], [0.1, 0, 0], [0.9, 0.2, 0.1]]), (1.0, 0.5, 0.6), (1, -1, 1)
    parts = [msd.icosphere(r, 4) for r in radii]
    points = np.concatenate([p + c for (p, _), c in zip(parts, centres, strict=True)])
    first = np.cumsum([0, *(len(p) for p, _ in parts)])
    triangles = np.concatenate([t[:, ::s] + k for (_, t), s, k in zip(parts, turn, first, strict=False)])
    shape = (40, 31, 33)
    filled = _filled(points * 10, triangles, shape)
    x = np.stack(np.meshgrid(*[(np.arange(n) - (n - 1) / 2) / 10 for n in shape], indexing="ij"), axis=-1)
    away = [np.linalg.norm(x - c, axis=-1) - r for c, r in zip(centres, radii, strict=True)]
    winding = sum(s * (one < 0) for s, one in zip(turn, away, strict=True))
    sure = np.min(np.abs(away), axis=0) > 0.005  # chords are nearer to the centre by up to 0.0025
    assert sure.mean() > 0.9
    np.testing.assert_array_equal(filled[sure], winding[sure] > 0)


def test_a_body_too_large_for_memory_is_refused_before_it_is_made(monkeypatch):
    monkeypatch.setattr(msd.checks, "free_memory", lambda: int(2e9))
    ico = msd.icosphere(0.5, 2)
    for make, message in (
        (lambda: msd.from_mesh(ico, across=1000), "across is 1000; .* GB of memory"),
        (lambda: msd.from_mesh(ico, across=300, material=msd.FOAM), "GB of memory"),
        (lambda: msd.ball(0.5, 0.001), r"spacing is 0\.001; .* GB of memory"),
        (lambda: msd.box((200, 200, 200)), r"shape is \(200, 200, 200\); .* GB of memory"),
        (lambda: msd.box((140, 140, 140), material=msd.FOAM), "shape is .* GB of memory"),
        (lambda: msd.sheet((3000, 3000)), "shape is .* GB of memory"),
        (lambda: msd.sheet((1600, 1600), bending=1.0), "shape is .* GB of memory"),
        (lambda: msd.lattice(np.ones((200, 200, 200), dtype=bool)), "mask's shape is .* GB of memory"),
        (lambda: msd.cloth([[0, 0], [1, 0], [1, 1], [0, 1]], 0.002), r"spacing is 0\.002; .* GB of memory"),
    ):
        with pytest.raises(ValueError, match=message):
            make()


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


@pytest.mark.slow
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
        (lambda: msd.ball(0.5, 0.6), r"spacing is 0\.6; it must be at most 0\.5, the radius"),
        (lambda: msd.ball(0.5, 0.1, neighbors=8), "neighbors is 8; it must be one of 26, 6"),
        (lambda: msd.cylinder(0.5, 0.05, 0.1), r"spacing is 0\.1; it must be at most 0\.05, the height"),
        (lambda: msd.cone(0.5, float("nan"), 0.1), "height is nan"),
        (lambda: msd.cone(0.05, 1.0, 0.1), r"spacing is 0\.1; it must be at most 0\.05, the radius"),
        (lambda: msd.ball(0.5, 0.1, material=msd.RUBBER, mass=1.0), r"mass is 1\.0; with a material"),
        (lambda: msd.from_mesh(cube()), "spacing is None and across is None; one of them must be given"),
        (lambda: msd.from_mesh(cube(), 0.1, across=3), r"spacing is 0\.1 and across is 3; one of them must"),
        (lambda: msd.from_mesh(cube(), across=0), "across is 0"),
        (lambda: msd.from_mesh(cube(), 1.5), r"spacing is 1\.5; it must be at most 1, the longest extent"),
        (lambda: msd.from_mesh("bunny", 0.1), "mesh is 'bunny'; it must be a PyVista surface or"),
        (lambda: msd.from_mesh(pv.ImageData(dimensions=(3, 3, 3)), 0.1), "mesh is a ImageData; it must be a surf"),
        (lambda: msd.from_mesh(pv.PolyData(), 0.1), "mesh has no triangles"),
        (lambda: msd.from_mesh((np.eye(3), []), 0.1), "mesh has no triangles"),
        (lambda: msd.from_mesh((np.ones((4, 2)), [[0, 1, 2]]), 0.1), r"points have shape \(4, 2\)"),
        (lambda: msd.from_mesh((np.eye(3), [[0, 1, 3]]), 0.1), r"triangles\[0, 2\] is 3"),
        (lambda: msd.from_mesh((np.eye(3) * np.nan, [[0, 1, 2]]), 0.1), r"points\[0, 0\] is nan"),
        (lambda: msd.from_mesh(pv.Plane(), 0.1), "mesh is not closed: of its 320 edges 40 have not two triangles"),
        (lambda: msd.from_mesh(examples.load_airplane(), across=20), "mesh is not closed"),
        (lambda: msd.from_mesh((np.zeros((3, 3)), [[0, 1, 2]]), 0.1), "mesh is but a point or a line"),
        (lambda: msd.from_mesh((np.eye(3), [[0, 1, 2], [0, 2, 1]]), 0.1), "mesh encloses a volume of 0"),
        (lambda: msd.from_mesh(disagreeing(), 0.1), "disagree about which side is outside, at 3 edges"),
        (lambda: msd.from_mesh(two_balls(), 0.1), "with a spacing of 0.1 the body is 2 pieces that do not touch"),
        (lambda: msd.cloth([[0, 0], [1, 0]], 0.1), "outline has 2 corners"),
        (lambda: msd.cloth([[0, 0, 0]] * 3, 0.1), r"outline has shape \(3, 3\)"),
        (lambda: msd.cloth([[0, 0], [1, 0], [np.inf, 1]], 0.1), r"outline\[2, 0\] is inf"),
        (lambda: msd.cloth([[0, 0], [1, 0], [1, 0], [0, 1]], 0.1), r"outline\[1\] is the same corner as the next"),
        (lambda: msd.cloth([[0, 0], [2, 0], [1, 0]], 0.1), r"outline turns back on itself at outline\[0\]"),
        (lambda: msd.cloth([[0, 0], [1, 1], [1, 0], [0, 1]], 0.1), r"sides from outline\[0\] and outline\[2\]"),
        (lambda: msd.cloth([[0, 0], [2, 0], [2, 2], [1, 0], [0, 2]], 0.1), "outline crosses or touches itself"),
        (lambda: msd.cloth([[0, 0], [1, 0], [0, 1]], 2.0), r"spacing is 2; it must be at most 1, the longest"),
        (lambda: msd.cloth([[0, 0], [1, 0], [0, 1]], 0.1, dim=1), "dim is 1"),
        (lambda: msd.cloth([[0, 0], [1, 0], [0, 1]], 0.1, neighbors=26), "neighbors is 26"),
        (lambda: msd.cloth([[0, 0], [1, 0], [0, 1]], 0.1, material=msd.COTTON), "thickness is None"),
    ],
)
def test_bad_input_is_named(make, message):
    with pytest.raises(ValueError, match=message):
        make()
