"""Solid colliders as they are drawn: their meshes, their poses, and where both renderers show them."""

from collections import Counter

import numpy as np
import pytest
from backends import BACKENDS, pixel_of

import msdwarp as msd
from msdwarp import checks
from msdwarp.pictures.collider_meshes import AROUND, extent, mesh_of, meshes, pose_in_space
from msdwarp.pictures.drawing import Drawing
from msdwarp.pictures.light import CONTACT, SHADOW, TONE

SIZE = (320, 180)

TURN = (0.3, -0.5, 0.9)
SOLIDS = {
    "sphere": msd.Sphere((1.0, -2.0, 0.5), 0.7),
    "box": msd.Box((0.2, 0.1, -0.4), (1.0, 2.0, 0.3), turn=TURN),
    "capsule": msd.Capsule((0.0, 0.5, 0.0), (1.0, 1.5, -0.7), 0.4),
    "capsule along x": msd.Capsule((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), 0.2),
    "cone": msd.Cone((1.0, 0.2, 2.0), (0.5, 0.0, 0.5), 0.6),
    "cone on its tip": msd.Cone((0.0, 0.0, 0.0), (0.0, 0.0, 1.5), 0.5),
}
VOLUMES = {
    "sphere": 4 / 3 * np.pi * 0.7**3,
    "box": 0.6,
    "capsule": 4 / 3 * np.pi * 0.4**3 + np.pi * 0.4**2 * np.sqrt(1 + 1 + 0.49),
    "capsule along x": 4 / 3 * np.pi * 0.2**3 + np.pi * 0.2**2,
    "cone": np.pi * 0.6**2 * np.sqrt(0.25 + 0.04 + 2.25) / 3,
    "cone on its tip": np.pi * 0.5**2 * 1.5 / 3,
}


def signed_distance(solid, points):
    """Return how far points are outside a solid [m], exact near its surface, in plain NumPy."""
    if isinstance(solid, msd.Sphere):
        return np.linalg.norm(points - solid.position, axis=1) - solid.radius
    if isinstance(solid, msd.Box):
        inside = (points - solid.position) @ solid.geometry(3)["axes"]
        past = np.abs(inside) - np.array(solid.size) / 2
        return np.linalg.norm(np.maximum(past, 0), axis=1) + np.minimum(past.max(axis=1), 0)
    start, end = (solid.start, solid.end) if isinstance(solid, msd.Capsule) else (solid.base, solid.apex)
    axis = np.subtract(end, start)
    length = np.linalg.norm(axis)
    along = (points - start) @ axis / length
    off = np.linalg.norm(points - start - np.outer(along, axis / length), axis=1)
    if isinstance(solid, msd.Capsule):
        return np.hypot(off, along - np.clip(along, 0, length)) - solid.radius
    slope = (off * length - (length - along) * solid.radius) / np.hypot(length, solid.radius)
    return np.maximum(slope, -along)


def directed_edges(mesh):
    """Count the edges of triangles by the places that they join, from one to the other."""
    _, place = np.unique(np.round(mesh.points, 9), axis=0, return_inverse=True)
    corners = place.ravel()[mesh.triangles]
    return Counter((int(t[k]), int(t[(k + 1) % 3])) for t in corners for k in range(3))


@pytest.mark.parametrize("name", SOLIDS)
def test_a_mesh_encloses_its_solid(name):
    solid, mesh = SOLIDS[name], mesh_of(SOLIDS[name], 3)
    edges = directed_edges(mesh)
    assert all(a != b and count == 1 for (a, b), count in edges.items())
    assert all((b, a) in edges for a, b in edges)
    a, b, c = (mesh.points[mesh.triangles[:, k]] for k in range(3))
    normal = np.cross(b - a, c - a)
    for k in range(3):
        assert ((normal * mesh.normals[mesh.triangles[:, k]]).sum(axis=1) > 0).all()
    volume = (a * np.cross(b, c)).sum() / 6
    assert volume > 0
    # Inscribed: a round section of n corners loses 2π²/3n² of its area, and a round profile about as much again.
    assert -1e-12 < 1 - volume / VOLUMES[name] < 5 * np.pi**2 / 3 / AROUND**2

    np.testing.assert_allclose(signed_distance(solid, mesh.points), 0, atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(mesh.normals, axis=1), 1, atol=1e-12)
    used = np.unique(mesh.triangles)
    # A step out changes the distance by its length where the surface is smooth; beside an edge, a step from
    # the middle of a triangle does.
    middle, normal = (array[mesh.triangles].mean(axis=1) for array in (mesh.points, mesh.normals))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    step = 1e-4
    gain = signed_distance(solid, middle + step * normal) - signed_distance(solid, middle)
    np.testing.assert_allclose(gain, step, rtol=0.02)
    assert (mesh.uv[used] >= 0).all()
    assert (mesh.uv[used] <= 1).all()


def test_a_box_is_textured_as_a_body_of_that_shape():
    body = msd.box((2, 2, 2))
    mesh = mesh_of(msd.Box(), 3)
    np.testing.assert_allclose(mesh.points, body.surface.points(body.position))
    np.testing.assert_array_equal(mesh.uv, body.surface.uv)


@pytest.mark.parametrize(
    "solid",
    [
        msd.Sphere((1.0, 2.0), 0.5),
        msd.Box((1.0, 2.0), (0.5, 3.0), turn=0.4),
        msd.Capsule((0.0, 1.0), (2.0, 1.5), 0.3),
        msd.Cone((0.0, 2.0), (0.5, 0.0), 0.4),
    ],
    ids=lambda solid: type(solid).__name__,
)
def test_in_a_plane_system_the_section_of_a_solid_is_what_was_given(solid):
    mesh = mesh_of(solid, 2)
    edges = directed_edges(mesh)
    assert all((b, a) in edges for a, b in edges)
    x, y, z = mesh.points.T
    if isinstance(solid, msd.Box):
        axes = solid.geometry(2)["axes"]
        np.testing.assert_allclose(np.abs((np.stack([x, z], axis=1) - solid.position) @ axes), [[0.25, 1.5]] * 24)
        np.testing.assert_allclose(np.abs(y), 0.25)  # as deep as its shorter edge
        return
    # In the plane y = 0 of the drawing it is the given shape: lift that into space, and ask there.
    fields = {"position": "position", "start": "start", "end": "end", "apex": "apex", "base": "base"}
    lifted = {
        name: (getattr(solid, name)[0], 0.0, getattr(solid, name)[1]) for name in fields if hasattr(solid, name)
    }
    whole = type(solid)(**lifted, radius=solid.radius)
    np.testing.assert_allclose(signed_distance(whole, mesh.points), 0, atol=1e-12)


def test_solids_on_a_line_are_drawn():
    for solid in (msd.Sphere((1.0,), 0.5), msd.Box((1.0,), (1.0,))):
        points = mesh_of(solid, 1).points
        assert np.ptp(points[:, 0]) == pytest.approx(1.0)


def sway(time):
    """Move 0.5 m/s along x, and turn about z."""
    return (0.5 * time, 0.0, 0.0), (0.0, 0.0, time)


@pytest.fixture
def body():
    return msd.box((4, 4, 4), 0.1, mass=0.1).translate((0, 0, 0.6))


def test_a_moving_solid_follows_its_pose(body):
    block = msd.Box((1.0, 0.5, 0.3), (0.4, 0.2, 0.6), motion=sway)
    scene = msd.Scene(system=body, colliders=[msd.Plane(), msd.Sphere((-1, 0, 0.3), 0.3), block], duration=2.0)
    drawing = Drawing(scene, "texture")
    vertices, still, moved = len(body.surface.particle), *(mesh for _, mesh in meshes(scene))
    for time in (0.0, 0.8):
        drawing.follow(body.position, time)
        points, normals = drawing.points.numpy(), drawing.normals.numpy()
        turn, shift = block.pose(time, 3)
        last = -len(moved.points)
        np.testing.assert_allclose(points[last:], moved.points @ turn.T + shift, atol=1e-6)
        np.testing.assert_allclose(normals[last:], moved.normals @ turn.T, atol=1e-6)
        np.testing.assert_allclose(points[vertices:last], still.points, atol=1e-6)
        np.testing.assert_allclose(points[:vertices], body.position[body.surface.particle], atol=1e-6)


def test_a_pose_in_the_plane_is_one_in_space():
    block = msd.Box((1.0, 2.0), (0.5, 1.0), motion=lambda t: ((t, 2 * t), 0.3 * t))
    turn, shift = block.pose(2.0, 2)
    given = np.array([[0.3, 0.7], [1.0, 2.0]])
    wanted = given @ turn.T + shift
    in_space, offset = pose_in_space(block, 2.0, 2)
    upright = np.insert(given, 1, 0.2, axis=1) @ in_space.T + offset
    np.testing.assert_allclose(upright, np.insert(wanted, 1, 0.2, axis=1))
    assert np.linalg.det(in_space) == pytest.approx(1)


def test_the_extent_holds_solids_wherever_they_go(body):
    ball = msd.Sphere((0, 0, 1.0), 0.5, motion=lambda t: (3 * np.sin(np.pi * t), 0, 0))
    scene = msd.Scene(system=body, colliders=[msd.Plane(), ball], duration=1.0)
    points = extent(scene)
    np.testing.assert_allclose([points[:, 0].min(), points[:, 0].max()], [-0.5, 3.5], atol=1e-3)
    assert extent(msd.Scene(system=body, colliders=[msd.Plane()])).shape == (0, 3)


def test_planes_have_no_mesh(body):
    assert meshes(msd.Scene(system=body, colliders=[msd.Plane(), msd.Plane(normal=(1, 0, 0), offset=-3)])) == []


def shade(color, normal, camera, height):
    """Return the color of a matt surface with this normal, 0 … 255; `height` is over the extent of the view."""
    sky, bounce, key, head, fill = camera.lights(even=False)
    light = key * max(normal @ camera.light, 0) + head * max(-normal @ camera.forward, 0)
    light += fill * max(normal @ camera.fill, 0)
    below = (1 - normal[2]) / 2
    light += sky * (1 - below) + bounce * below * height / (height + CONTACT)
    return 255 * np.array(color) * (light + TONE * light * (1 - light))


@pytest.mark.slow
@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("coloring", ["texture", "strain"])
def test_an_obstacle_is_seen_where_it_is_in_its_color(body, backend, coloring):
    # A block beside the body, half of it below the ground.
    block = msd.Box((1.2, 0.0, 0.0), (0.6, 0.6, 1.0))
    look = msd.Look(obstacle="#4060c0", obstacle_gloss=0.0)
    scene = msd.Scene(system=body, colliders=[msd.Plane(), block], look=look)
    seen = np.concatenate([body.position, [[1.2, -1.5, 0.0]]])  # room in front of the block
    renderer = msd.Renderer(scene, seen, resolution=SIZE, backend=backend, coloring=coloring)
    for corner in block.position + np.array([[0.3, 0.3, 0.5], [0.3, -0.3, 0.0], [-0.3, 0.3, 0.5]]):
        row, column = pixel_of(renderer, corner)
        assert 0 <= row < SIZE[1]
        assert 0 <= column < SIZE[0]
    image = renderer.image(body.position).astype(int)
    camera, color = renderer.stage.camera, checks.color("", "#4060c0")
    for place, normal in (((1.2, -0.3, 0.25), (0, -1, 0)), ((1.2, 0.0, 0.5), (0, 0, 1))):
        wanted = shade(color, np.array(normal), camera, place[2] / renderer.stage.ground.reach)
        np.testing.assert_allclose(image[pixel_of(renderer, place)], wanted, atol=2)
    # Where its lower half would be seen, if the ground did not hide it, there is ground.
    blue = image[pixel_of(renderer, (1.2, -0.3, -0.2))]
    assert np.ptp(blue) < 40


@pytest.mark.parametrize("backend", BACKENDS)
def test_the_shadow_of_an_obstacle_ends_where_it_meets_the_ground(body, backend):
    # A ball, most of which is below the ground: without the cut its shadow would be as wide as the ball.
    ball = msd.Sphere((1.2, 0.0, -0.6), 0.8)
    scene = msd.Scene(system=body, colliders=[msd.Plane(), ball])
    around = np.concatenate([body.position, [[2.5, 1.0, 0.0], [-1.0, -1.5, 0.0]]])
    renderer = msd.Renderer(scene, around, resolution=SIZE, backend=backend)
    image = renderer.image(body.position).astype(float)
    bare = renderer.stage.ground
    rim = np.sqrt(0.8**2 - 0.6**2)

    def brightness(point):
        u, v = bare.uv(np.array(point))
        return image[pixel_of(renderer, point)].mean() / bare.texture[int(v * 2048), int(u * 2048)].mean()

    towards = renderer.stage.camera.light * (1, 1, 0) / np.linalg.norm(renderer.stage.camera.light[:2])
    assert brightness(np.array([1.2, 0, 0]) + (rim + 0.08) * towards) == pytest.approx(1.0, abs=0.02)
    body_shadow = (
        body.center_of_mass - body.center_of_mass[2] / renderer.stage.camera.light[2] * renderer.stage.camera.light
    )
    assert brightness(body_shadow) == pytest.approx(SHADOW, abs=0.02)


@pytest.mark.slow
@pytest.mark.parametrize("backend", BACKENDS)
def test_a_moving_obstacle_is_drawn_where_it_is_at_the_time(body, backend):
    ball = msd.Sphere((0.9, 0, 0.3), 0.3, motion=lambda t: (0.9 * t, 0, 0))
    scene = msd.Scene(
        system=body,
        colliders=[msd.Plane(), ball],
        duration=1.0,
        look=msd.Look(obstacle="#2040d0", obstacle_gloss=0),
    )
    renderer = msd.Renderer(scene, body.position, resolution=SIZE, backend=backend)
    for time, here, there in ((0.0, 0.9, 1.8), (1.0, 1.8, 0.9), (0.0, 0.9, 1.8)):
        image = renderer.image(body.position, time).astype(int)
        red, _, blue = image[pixel_of(renderer, (here, 0, 0.3))]
        assert blue > 2 * red
        red, _, blue = image[pixel_of(renderer, (there, 0, 0.3))]
        assert blue < 1.3 * red


@pytest.mark.slow
@pytest.mark.each_value
@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("textured", ["both", "body", "obstacle"])
def test_body_and_obstacle_keep_their_own_textures(body, backend, textured):
    random = np.random.default_rng(3)
    stripes = np.repeat(random.integers(60, 200, (24, 1, 3)), 36, axis=1).astype(np.uint8)
    dots = np.repeat(np.repeat(random.integers(60, 200, (4, 9, 3)), 8, axis=0), 8, axis=1).astype(np.uint8)
    colors = {"color": "#c03020", "obstacle": "#4060c0", "gloss": 0.0, "obstacle_gloss": 0.0}
    own = {"texture": stripes} if textured != "obstacle" else {}
    other = {"obstacle_texture": dots} if textured != "body" else {}
    block = msd.Box((0.9, 0.0, 0.5), (0.5, 0.5, 0.5))

    def picture(colliders, **look):
        scene = msd.Scene(system=body, colliders=[msd.Plane(), *colliders], look=msd.Look(**colors, **look))
        seen = np.concatenate([body.position, mesh_of(block, 3).points])
        renderer = msd.Renderer(scene, seen, resolution=SIZE, backend=backend)
        return renderer, renderer.image(body.position).astype(int)

    renderer, together = picture([block], **own, **other)
    _, alone = picture([], **own)
    _, block_alone = picture([block], **({"texture": dots} if other else {}), **other)
    side = np.linspace(-0.12, 0.12, 9)
    for u in side:
        for v in side:
            at = pixel_of(renderer, (u, -0.15, 0.6 + v))
            np.testing.assert_allclose(together[at], alone[at], atol=1)  # rounding of texture coordinates
            at = pixel_of(renderer, (0.9 + u, -0.25, 0.5 + v))
            np.testing.assert_allclose(together[at], block_alone[at], atol=1)


def test_planes_that_face_the_camera_and_the_light_are_drawn():
    body = msd.box((3, 3, 3), 0.2).translate((0, 0, 0.2))
    look = msd.Look(azimuth=-60, elevation=20, obstacle="#209040")
    behind, before = msd.Plane((0, -1, 0), offset=-1.0), msd.Plane((0, 1, 0), offset=-1.0)
    for planes, count in (([], 0), ([behind], 2), ([before], 0), ([behind, before], 2)):
        scene = msd.Scene(system=body, colliders=[msd.Plane(), *planes], look=look)
        drawing = Drawing(scene, "texture")
        assert sum(len(one.triangles) for one in drawing.obstacles) == count
    scene = msd.Scene(system=body, colliders=[msd.Plane(), behind], look=look)
    drawing = Drawing(scene, "texture")
    drawing.follow(body.position)
    wall = drawing.points.numpy()[drawing.obstacles[0].vertices]
    np.testing.assert_allclose(wall[:, 1], 1.0, atol=1e-6)  # float32
    np.testing.assert_allclose(drawing.normals.numpy()[drawing.obstacles[0].vertices], [[0, -1, 0]] * 4, atol=1e-6)
    image = msd.Renderer(scene, body.position, resolution=(320, 180)).image(body.position).astype(int)
    assert (image[..., 1] > image[..., 0] + 40).mean() > 0.1  # green
