"""What of a body can touch: of closed and open surfaces, embedded ones, ropes and grains; the nearest point."""

import numpy as np
import pytest
import warp as wp
from problems import EPS64
from surfaces import nearest_distances

from msdwarp import Surface, System, ball, box, chain, cloth, icosphere, sheet, shell
from msdwarp.bodies import contact_surfaces
from msdwarp.kernels.collision.nearest_point import nearest_on_triangle


def grains(count: int, seed: int = 0) -> System:
    position = np.random.default_rng(seed).uniform(0, 3, (count, 3))
    return System(position=position, connections=np.zeros((0, 2), int))


def places(system: System, found) -> np.ndarray:
    """Return where the vertices are, shape [vertex_count, 3]."""
    return np.einsum("vk,vkd->vd", found.weight, system.position[found.particle])


def volume(system: System, found) -> float:
    """Return what the facets enclose, by the divergence theorem."""
    return np.linalg.det(places(system, found)[found.corner]).sum() / 6


def assert_points_lie_on_vertices_and_edges(found, edges: int) -> None:
    """Check that there is one point on each vertex, and one in the middle of each of so many edges."""
    vertices = len(found.particle)
    np.testing.assert_array_equal(found.ends[:vertices], np.arange(vertices)[:, None] * [1, 1])
    assert (found.fraction[:vertices] == 0).all()
    assert (found.fraction[vertices:] == 0.5).all()
    on_edges = np.sort(found.ends[vertices:], axis=1)
    assert len(on_edges) == len(np.unique(on_edges, axis=0)) == edges


def test_the_mesh_of_a_solid_body_lies_a_quarter_of_its_spacing_below_its_surface():
    body = box((3, 4, 5), 0.1)
    found = contact_surfaces(body)
    # 60 particles, of which 1 x 2 x 3 are inside. Euler: V − E + F = 2, and 3 F = 2 E.
    assert len(found.particle) == 54
    assert len(found.corner) == 2 * (54 - 2)
    assert_points_lie_on_vertices_and_edges(found, 3 * (54 - 2))
    assert found.solid.tolist() == [True]
    r = found.radius[0]
    assert r == pytest.approx(found.spacing[0] / 4, rel=4 * EPS64)
    # Sums of some hundred numbers of about 0.001 m³.
    assert volume(body, found) == pytest.approx((0.2 - 2 * r) * (0.3 - 2 * r) * (0.4 - 2 * r), rel=100 * EPS64)
    assert found.spacing[0] == pytest.approx(0.75 * body.rest_length.mean(), rel=100 * EPS64)
    assert found.stiffness[0] == pytest.approx(body.stiffness.mean(), rel=100 * EPS64)


def test_an_open_sheet_is_as_thick_as_a_quarter_of_its_spacing():
    found = contact_surfaces(sheet((4, 5), 0.1))
    assert found.solid.tolist() == [False]
    assert len(found.corner) == 2 * 3 * 4
    assert_points_lie_on_vertices_and_edges(found, 3 * 5 + 4 * 4 + 3 * 4)
    assert 2 * found.radius[0] == pytest.approx(found.spacing[0] / 4, rel=4 * EPS64)


def test_a_rope_touches_by_its_connections():
    found = contact_surfaces(chain(7, 0.2))
    assert found.solid.tolist() == [False]
    assert len(found.particle) == 7
    assert_points_lie_on_vertices_and_edges(found, 6)
    np.testing.assert_array_equal(found.corner[:, 1], found.corner[:, 2])  # segments
    assert {frozenset(pair) for pair in found.corner[:, :2].tolist()} == {frozenset((k, k + 1)) for k in range(6)}
    assert found.spacing[0] == pytest.approx(0.2, rel=10 * EPS64)
    assert 2 * found.radius[0] == pytest.approx(0.1, rel=10 * EPS64)  # half as thick as its particles are apart


def test_a_net_touches_by_its_cords_and_not_by_its_bending_springs():
    found = contact_surfaces(sheet((5, 4), 0.1, neighbors=4).replace(surface=None))
    assert len(found.corner) == 4 * 4 + 5 * 3  # its cords along x and y
    np.testing.assert_array_equal(found.corner[:, 1], found.corner[:, 2])
    stiff = sheet((5, 4), 0.1, neighbors=4, stiffness=100.0, bending=0.01).replace(surface=None)
    assert stiff.connection_count > 4 * 4 + 5 * 3
    np.testing.assert_array_equal(contact_surfaces(stiff).corner, found.corner)


def test_grains_touch_as_spheres_each_a_body_of_its_own():
    found = contact_surfaces(grains(5))
    np.testing.assert_array_equal(found.corner, np.arange(5)[:, None] * [1, 1, 1])
    np.testing.assert_array_equal(found.body, np.arange(5))
    assert len(found.fraction) == 5
    for name in ("solid", "radius", "spacing", "stiffness"):  # nothing to take these from
        assert not getattr(found, name).any()


def test_a_lattice_without_a_surface_is_a_heap_of_spheres():
    found = contact_surfaces(box((3, 3, 3), 0.1).replace(surface=None))
    np.testing.assert_array_equal(found.corner, np.arange(27)[:, None] * [1, 1, 1])
    assert found.solid.tolist() == [False]
    assert 2 * found.radius[0] == pytest.approx(found.spacing[0] / 2, rel=4 * EPS64)


@pytest.mark.parametrize(
    ("body", "inner"), [(ball(0.5, 0.2), True), (shell(icosphere(0.5, 2)), False)], ids=["embedded", "shell"]
)
def test_round_bodies_are_closed_and_stay_round(body, inner):
    found = contact_surfaces(body)
    assert found.solid.tolist() == [True]
    np.testing.assert_allclose(found.weight.sum(axis=1), 1.0, rtol=0, atol=1e-9)  # weights are told apart to 1e-9
    distance = np.linalg.norm(places(body, found), axis=1)
    # A shell has no particles inside, to which vertices could move. In a ball a vertex moves until all planes
    # around it have moved by r. These differ by up to 0.4 rad, so that its way is up to r / cos(0.2).
    r = found.radius[0] * inner
    np.testing.assert_allclose(distance, radius := 0.5 - r, rtol=0, atol=0.02 * r + 1e-9)
    # One closed piece without handles, by Euler: V − E + F = 2 and 3 F = 2 E.
    assert len(found.corner) == 2 * (len(found.particle) - 2)
    # Chords of facets of angle a lose about a²/4 of the volume: here they are 0.4 rad or less.
    assert 0.93 < volume(body, found) / (4 / 3 * np.pi * radius**3) < 1.0


def test_a_cloth_touches_with_the_cells_of_its_lattice():
    # It is drawn with 16 times as many triangles, nearer to each other than its contact is thick.
    outline = [(-0.26, -0.35), (0.26, -0.35), (0.22, 0.26), (0.0, 0.32), (-0.2, 0.26)]
    body, solid = cloth(outline, 0.05, mass=1e-3, stiffness=10.0), ball(0.5, 0.2)
    system = body + solid
    found = contact_surfaces(system)
    those = found.corner[found.body[found.corner[:, 0]] == 0]
    assert found.solid.tolist() == [False, True]
    assert len(found.corner) - len(those) == len(contact_surfaces(solid).corner)  # what is solid stays as drawn
    used = np.unique(those)
    np.testing.assert_array_equal((np.abs(found.weight[used]) > 1e-9).sum(axis=1), 1)
    np.testing.assert_array_equal(np.sort(found.particle[used, 0]), np.arange(body.particle_count))
    a, b, c = found.points(system.position)[those].transpose(1, 0, 2)
    halves = np.cross(b - a, c - a) / 2
    np.testing.assert_allclose(halves, np.broadcast_to([0, 0, 0.05**2 / 2], halves.shape), rtol=0, atol=1e-12)
    # By Euler, as it has no holes: V − E + F = 1, with the cells as faces and the springs along axes as edges.
    length = np.linalg.norm(np.diff(body.position[body.connections], axis=1)[:, 0], axis=1)
    assert len(those) == 2 * (1 - body.particle_count + np.count_nonzero(length < 1.2 * 0.05))


def test_a_closed_body_with_a_hole_is_open():
    body = box((3, 3, 3), 0.1)
    skin = body.surface
    holed = body.replace(surface=Surface(particle=skin.particle, uv=skin.uv, triangles=skin.triangles[:-1]))
    assert contact_surfaces(holed).solid.tolist() == [False]


def test_bodies_of_all_kinds_together():
    parts = [box((3, 3, 3), 0.1, stiffness=50.0), chain(4, 0.2), grains(2), sheet((3, 3), 0.1), ball(0.5, 0.2)]
    together = parts[0]
    for k, part in enumerate(parts[1:]):
        together = together + part.translate((5.0 + k, 0, 0))
    found = contact_surfaces(together)
    assert found.solid.tolist() == [True, False, False, False, False, True]
    np.testing.assert_array_equal(
        found.body_of_particle, np.repeat(range(6), [27, 4, 1, 1, 9, len(parts[4].mass)])
    )
    # Each body is what it is alone.
    alone = [contact_surfaces(part) for part in parts]
    for name in ("spacing", "radius", "stiffness"):
        expected = np.concatenate([getattr(one, name) for one in alone])
        np.testing.assert_allclose(getattr(found, name), expected, rtol=1e-12)  # of means of some hundred numbers
    # Facets lie body by body, and never between two.
    owner = found.body[found.corner]
    assert (owner == owner[:, :1]).all()
    assert (np.diff(owner[:, 0]) >= 0).all()
    counts = [[len(one.corner)] if k != 2 else [1, 1] for k, one in enumerate(alone)]
    np.testing.assert_array_equal(np.bincount(owner[:, 0]), np.concatenate(counts))
    ends = found.body[found.ends]
    assert (ends[:, 0] == ends[:, 1]).all()


# --- The point of a triangle that is nearest ---


def weights_of(p: np.ndarray, corners: np.ndarray, device: str) -> np.ndarray:
    """Return what the device finds, shape [count, 3], in float64."""
    nearest, V = nearest_on_triangle(wp.float64), wp.vec3d

    @wp.kernel(module="unique", enable_backward=False)
    def ask(p: wp.array(dtype=V), corner: wp.array2d(dtype=V), weight: wp.array(dtype=V)):
        i = wp.tid()
        weight[i] = nearest(p[i], corner[i, 0], corner[i, 1], corner[i, 2])

    found = wp.zeros(len(p), dtype=V, device=device)
    inputs = [wp.array(p, dtype=V, device=device), wp.array(corners, dtype=V, device=device)]
    wp.launch(ask, len(p), inputs, [found], device=device)
    return found.numpy()


def triangles(kind: str, count: int) -> np.ndarray:
    random = np.random.default_rng(5)
    corners = random.normal(size=(count, 3, 3))
    match kind:
        case "slivers":
            corners[:, 2] = corners[:, 0] + random.uniform(-0.5, 1.5, (count, 1)) * (corners[:, 1] - corners[:, 0])
            corners[:, 2] += 1e-3 * random.normal(size=(count, 3))
        case "segments":
            corners[:, 2] = corners[:, 1]
        case "points":
            corners[:] = corners[:, :1]
    return corners


@pytest.mark.parametrize("kind", ["any", "slivers", "segments", "points"])
def test_the_nearest_point_of_a_triangle(plain_device, kind):
    corners = triangles(kind, 600)
    random = np.random.default_rng(6)
    p = random.normal(size=(600, 3))
    # Some in the plane of the triangle, on its sides, and on its corners.
    p[:100] = np.einsum("nk,nkd->nd", random.normal(size=(100, 3)), corners[:100])
    p[100:150] = (corners[100:150, 0] + corners[100:150, 1]) / 2
    p[150:200] = corners[150:200, 2]
    weight = weights_of(p, corners, plain_device)
    assert (weight >= 0).all()
    np.testing.assert_allclose(weight.sum(axis=1), 1.0, rtol=0, atol=4 * EPS64)  # of three numbers
    found = np.linalg.norm(p - np.einsum("nk,nkd->nd", weight, corners), axis=1)
    # Of squares of numbers of about 5; those of slivers lose their width of 1e-3 twice to cancellation, 1e-6.
    tolerance = 1e-14 / (1e-6 if kind == "slivers" else 1e-2)
    np.testing.assert_allclose(found, nearest_distances(p, corners), rtol=0, atol=tolerance)
