"""Hollow bodies of triangles."""

import math

import numpy as np
import pytest

from msdwarp import icosphere, shell
from msdwarp.shapes.shells import edges_of


@pytest.mark.parametrize("subdivisions", [0, 1, 3])
def test_a_sphere_of_triangles(subdivisions):
    points, triangles = icosphere(2.0, subdivisions)
    assert (len(points), len(triangles)) == (10 * 4**subdivisions + 2, 20 * 4**subdivisions)
    np.testing.assert_allclose(np.linalg.norm(points, axis=1), 2.0, rtol=1e-14)
    edges, across = edges_of(triangles)
    assert len(points) - len(edges) + len(triangles) == 2  # Euler
    assert len(across) == len(edges)
    a, b, c = (points[triangles[:, k]] for k in range(3))
    assert (np.einsum("td,td->t", np.cross(b - a, c - a), a) > 0).all()  # facing out
    enclosed = np.einsum("td,td->", a, np.cross(b, c)) / 6
    # An icosahedron has 0.605 of the volume of the sphere around it. What is cut off falls as the square of edges.
    assert 4 / 3 * math.pi * 8 * (1 - 0.6 / 4**subdivisions) < enclosed < 4 / 3 * math.pi * 8


def test_a_shell_has_the_mesh_and_its_mass_by_area():
    mesh = icosphere(0.5, 2)
    body = shell(mesh, total_mass=0.3, stiffness=50.0, damping=0.2)
    assert body.mass.sum() == pytest.approx(0.3, rel=1e-14)
    assert body.connection_count == 480
    np.testing.assert_array_equal(body.surface.triangles, mesh[1])
    folded = shell(mesh, total_mass=0.3, stiffness=50.0, damping=0.2, folding=7.0)
    assert folded.connection_count == 960
    np.testing.assert_array_equal(folded.connections[:480], body.connections)
    np.testing.assert_array_equal(folded.stiffness[480:], 7.0)
    np.testing.assert_array_equal(folded.damping[480:], 0.0)
    assert np.abs(folded.strain).max() < 1e-14
    assert (np.linalg.norm(folded.position, axis=1) > 0.49).all()


def test_coincident_points_are_one_particle():
    pv = pytest.importorskip("pyvista")
    mesh = pv.Cylinder(resolution=30).triangulate()  # sides and lids have points of their own
    body = shell(mesh, total_mass=0.1, stiffness=500.0)
    assert body.particle_count == len(np.unique(mesh.points.round(5), axis=0)) == 60
    edges, across = edges_of(body.surface.particle[body.surface.triangles])
    assert body.connection_count == len(edges) == len(across) == 3 * 60 - 6  # closed: Euler
    assert len(body.surface.particle) == mesh.n_points  # each with its own normal: the rim is sharp
    assert body.mass.sum() == pytest.approx(0.1, rel=1e-14)


def test_two_triangles_fold_along_their_edge():
    edges, across = edges_of(np.array([[0, 1, 2], [2, 1, 3]]))
    np.testing.assert_array_equal(edges, [[0, 1], [0, 2], [1, 2], [1, 3], [2, 3]])
    np.testing.assert_array_equal(across, [[0, 3]])


@pytest.mark.parametrize(
    ("mesh", "options", "message"),
    [
        (([[0, 0, 0], [1, 0, 0], [2, 0, 0]], [[0, 1, 2]]), {}, "the area of a triangle"),
        (([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]), {"total_mass": 0.0}, "total_mass is 0"),
        (([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]), {"folding": -1.0}, "folding is -1"),
        ("ball.obj", {}, "mesh is 'ball.obj'; it must be"),
    ],
)
def test_bad_meshes_are_refused(mesh, options, message):
    with pytest.raises(ValueError, match=message):
        shell(mesh, **options)


def test_bad_spheres_are_refused():
    with pytest.raises(ValueError, match="radius is 0"):
        icosphere(0.0)
    with pytest.raises(ValueError, match="subdivisions is 9"):
        icosphere(1.0, 9)
