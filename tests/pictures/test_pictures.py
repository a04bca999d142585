"""Pictures: the camera, normals, colors, both renderers, and memory."""

import os
import sys
from pathlib import Path

import numpy as np
import pytest
from backends import BACKENDS, pixel_of

import msdwarp as msd
from msdwarp import checks
from msdwarp.bodies.space import in_space
from msdwarp.pictures.drawing import Drawing
from msdwarp.pictures.light import SHADOW
from msdwarp.pictures.stage import UNSEEN, Camera, Ground, outermost

SIZE = (320, 180)


@pytest.fixture
def scene():
    """A cube of 0.4 m that floats half a metre above the floor."""
    cube = msd.box((5, 5, 5), 0.1, mass=0.1).translate((0, 0, 0.7))
    return msd.Scene(system=cube, colliders=[msd.Plane()], look=msd.Look(color="#c03020"))


@pytest.mark.parametrize("aspect", [0.5, 16 / 9])
@pytest.mark.parametrize(("azimuth", "angle"), [(-60, 30.0), (200, 100.0)])
def test_the_camera_is_as_near_as_it_can_be_and_sees_everything(aspect, azimuth, angle):
    points = np.random.default_rng(1).normal(size=(500, 3)) * (3, 1, 2) + (5, 6, 7)
    look = msd.Look(azimuth=azimuth, elevation=25, field_of_view=angle)
    camera = Camera.that_sees(points, look, aspect, margin=1.0)
    offset = points - camera.eye
    depth = offset @ camera.forward
    tan = np.tan(np.radians(look.field_of_view) / 2)
    across = np.abs(offset @ camera.right) / (depth * tan * aspect)
    along = np.abs(offset @ camera.up) / (depth * tan)
    # 1 is the edge of the picture: reached, to rounding, and not crossed.
    assert max(across.max(), along.max()) == pytest.approx(1.0, abs=1e-9)


def test_balls_are_in_view_as_wholes():
    random = np.random.default_rng(3)
    points, radius = random.normal(size=(6, 3)) * (3, 1, 2), np.array([0.0, 0.1, 0.7, 0.4, 0.0, 1.5])
    look, aspect = msd.Look(azimuth=20, elevation=25), 1.5
    camera = Camera.that_sees(points, look, aspect, margin=1.0, radius=radius)
    ways = random.normal(size=(20000, 1, 3))
    offset = points + radius[:, None] * ways / np.linalg.norm(ways, axis=2, keepdims=True) - camera.eye
    tan = np.tan(np.radians(look.field_of_view) / 2) * (offset @ camera.forward)
    edge = max(np.abs(offset @ camera.right / (tan * aspect)).max(), np.abs(offset @ camera.up / tan).max())
    assert 1 - 1e-3 < edge <= 1 + 1e-9  # of 20000 points on a ball one is a hundredth of its radius from any


@pytest.mark.parametrize("dim", [1, 2, 3])
def test_a_few_particles_decide_what_the_camera_and_the_ground_are(dim):
    frames = np.random.default_rng(2).normal(size=(20, 100, dim)).cumsum(axis=0)
    look = msd.Look(azimuth=140, elevation=35)
    few = np.concatenate([outermost(position, look, 1.5) for position in frames])
    assert few.shape[0] <= 20 * 10
    one, other = (in_space(points, np.float64).reshape(-1, 3) for points in (frames, few))
    for name in ("eye", "target"):
        positions = [getattr(Camera.that_sees(points, look, 1.5), name) for points in (one, other)]
        np.testing.assert_allclose(*positions, atol=1e-12)  # rounding of numbers of about ten
    np.testing.assert_array_equal(one.min(axis=0), other.min(axis=0))
    np.testing.assert_array_equal(one.max(axis=0), other.max(axis=0))


def test_smooth_normals_of_a_bent_sheet_are_those_of_the_surface():
    flat = msd.sheet((41, 41), 0.05)
    x, y, _ = flat.position.T
    bowl = flat.replace(position=np.stack([x, y, 0.5 * (x**2 + y**2)], axis=1))
    drawing = Drawing(msd.Scene(system=bowl), "texture")
    drawing.follow(bowl.position)
    exact = np.stack([-x, -y, np.ones_like(x)], axis=1)
    exact /= np.linalg.norm(exact, axis=1, keepdims=True)
    inside = (np.abs(x) < 0.99) & (np.abs(y) < 0.99)
    # The normals of the six triangles around a vertex vary by (curvature · spacing) = 0.05; their mean is off
    # by its square.
    particle = bowl.surface.particle
    error = np.abs(drawing.normals.numpy() - exact[particle])
    assert error[inside[particle]].max() < 0.05**2


def test_connections_are_grey_at_rest_red_when_stretched_and_blue_when_compressed():
    body = msd.System(
        position=[[0, 0, 0], [1, 0, 0], [2.2, 0, 0], [3.0, 0, 0], [3.9, 0, 0]],
        connections=[[0, 1], [1, 2], [2, 3], [3, 4]],
        rest_length=1.0,
    )
    drawing = Drawing(msd.Scene(system=body, look=msd.Look(full_strain=0.2)), "strain")
    drawing.follow(body.position)
    rest, stretched, compressed, half = drawing.colors.numpy()[:24].reshape(4, 6, 3)[:, 0]
    assert np.ptp(rest) < 0.05  # grey
    assert stretched[0] > 2 * max(stretched[1:])  # red
    assert compressed[2] > 2 * max(compressed[:2])  # blue
    np.testing.assert_allclose(half, (0.22, 0.50, 0.85), atol=1e-5)  # half way to blue; float32 lengths of about 1


def test_inside_a_large_body_no_connections_are_drawn():
    body = msd.box((12, 12, 12), 0.1)
    drawing = Drawing(msd.Scene(system=body), "strain")
    middle = body.position[body.connections].mean(axis=1)
    assert len(drawing.triangles) < 6 * body.connection_count
    drawing.follow(body.position)
    points = drawing.points.numpy()
    assert np.abs(points).max() > 0.54  # the outermost are there
    inner = np.abs(middle).max(axis=1) < 0.3
    assert inner.any()
    assert np.abs(points).max(axis=1).min() > 0.4  # none reaches deeper than one spacing of 0.1 below 0.55


def test_the_camera_leaves_room_for_a_legend():
    body = msd.box((3, 3, 3), 0.2)
    for coloring, free in (("texture", 0.0), ("strain", 0.125)):
        renderer = msd.Renderer(msd.Scene(system=body), body.position, coloring=coloring, backend="raycast")
        rows, columns = renderer.stage.camera.pixels(body.position, 720, 1280)
        assert rows.min() >= 720 * free
        assert rows.max() <= 720
        assert columns.min() >= 0
        assert columns.max() <= 1280


def test_an_embedded_surface_follows_its_particles():
    random = np.random.default_rng(5)
    body = msd.box((3, 3, 3), 0.3)
    particle, weights = random.integers(0, 27, (12, 4)), random.random((12, 4))
    surface = msd.Surface(
        particle=particle,
        weights=weights / weights.sum(axis=1, keepdims=True),
        uv=np.zeros((12, 2)),
        triangles=np.arange(12).reshape(-1, 3),
    )
    drawing = Drawing(msd.Scene(system=body.replace(surface=surface)), "texture")
    position = body.position + 0.1 * random.normal(size=body.position.shape)
    drawing.follow(position)
    points = surface.points(position)
    np.testing.assert_allclose(drawing.points.numpy(), points, atol=1e-6)  # float32
    a, b, c = points.reshape(-1, 3, 3).transpose(1, 0, 2)
    normal = np.cross(b - a, c - a)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    np.testing.assert_allclose(drawing.normals.numpy(), np.repeat(normal, 3, axis=0), atol=1e-5)


def test_normals_are_shared_over_a_seam():
    # Two squares meet at a right angle, with vertices of their own there.
    body = msd.System(
        position=[[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0], [0, 1, 1], [1, 1, 1]],
        connections=[[0, 1]],
        rest_length=1.0,
    )
    parts = {"particle": [0, 1, 2, 3, 2, 3, 4, 5], "uv": np.zeros((8, 2))}
    parts["triangles"] = [[0, 1, 3], [0, 3, 2], [4, 5, 7], [4, 7, 6]]

    def normals(**more):
        surface = msd.Surface(**parts, **more)
        drawing = Drawing(msd.Scene(system=body.replace(surface=surface)), "texture")
        drawing.follow(body.position)
        return drawing.normals.numpy()

    up, back, between = (0, 0, 1), (0, -1, 0), (0, -np.sqrt(0.5), np.sqrt(0.5))
    np.testing.assert_allclose(normals(), [up] * 4 + [back] * 4, atol=1e-6)
    shared = normals(normal_of=[0, 1, 2, 3, 2, 3, 6, 7])
    np.testing.assert_array_equal(shared[2:4], shared[4:6])
    np.testing.assert_allclose(shared[[0, 6]], [up, back], atol=1e-6)
    # At vertex 2 lie two triangles of the first square and, of the second, two of the same area.
    np.testing.assert_allclose(shared[2:4].mean(axis=0), between, atol=0.2)


def test_flat_shading_gives_each_triangle_its_own_normal():
    flat = msd.sheet((4, 4), 0.5)
    bent = flat.replace(position=flat.position + [[0, 0, 0.1 * k % 0.37] for k in range(16)])
    drawing = Drawing(msd.Scene(system=bent, look=msd.Look(smooth=False)), "texture")
    drawing.follow(bent.position)
    points, normals = drawing.points.numpy(), drawing.normals.numpy()
    a, b, c = (points[drawing.triangles[:, k]] for k in range(3))
    normal = np.cross(b - a, c - a)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    for k in range(3):
        np.testing.assert_allclose(normals[drawing.triangles[:, k]], normal, atol=1e-6)


@pytest.mark.parametrize(
    ("particles", "count", "drawn"), [(None, 20, True), (None, 300, False), (True, 300, True)]
)
def test_particles_of_small_systems_are_balls(particles, count, drawn):
    chain = msd.chain(count, 0.1).pin(0)
    drawing = Drawing(msd.Scene(system=chain, look=msd.Look(particles=particles)), "strain")
    drawing.follow(chain.position)
    tubes = 6 * (count - 1)
    tube, balls = (one.radius for one in drawing.body)
    assert (balls > 2 * tube) == drawn
    if not drawn:
        assert balls == tube  # which close the bends
        return
    balls = drawing.points.numpy()[tubes:].reshape(count, -1, 3)
    np.testing.assert_allclose(balls.mean(axis=1), chain.position, atol=1e-5)
    radius = np.linalg.norm(balls - chain.position[:, None], axis=2)
    np.testing.assert_allclose(radius, 0.11 * 0.1, rtol=1e-2)  # float32 places of 30 m, to a micrometre
    colors = drawing.colors.numpy()[tubes:].reshape(count, -1, 3)
    assert (colors[0] < colors[1]).all()  # the pinned one is darker
    assert drawing.triangles.max() < len(drawing.points)


@pytest.mark.slow
@pytest.mark.parametrize("coloring", ["texture", "strain"])
@pytest.mark.parametrize("backend", BACKENDS)
def test_the_body_its_shadow_and_the_backdrop_are_where_they_belong(scene, backend, coloring):
    system = scene.system
    wide = np.concatenate([system.position, [[-1, -1, 0], [2, 2, 0]]])  # leave room around
    renderer = msd.Renderer(scene, wide, resolution=SIZE, coloring=coloring, backend=backend)
    assert renderer.backend == backend
    image = renderer.image(system.position).astype(int)
    assert image.shape == (180, 320, 3)

    centre = system.center_of_mass
    red, green, _ = image[pixel_of(renderer, centre)]
    assert (red > 2 * green) if coloring == "texture" else (green > red)

    np.testing.assert_allclose(image[2, 2], 255 * np.array(checks.color("", scene.look.background)), atol=1)

    light = renderer.stage.camera.light
    ground = Ground(scene, wide)
    lit, shaded = np.array([0.9, -0.9, 0.0]), centre - centre[2] / light[2] * light

    def painted(point):
        u, v = ground.uv(point)
        return ground.texture[int(v * 2048), int(u * 2048)].astype(int)

    # 8-bit rounding, and the texture between its pixels. The shadow of connections has gaps: not looked at.
    np.testing.assert_allclose(image[pixel_of(renderer, lit)], painted(lit), atol=3)
    if coloring == "texture":
        np.testing.assert_allclose(image[pixel_of(renderer, shaded)], SHADOW * painted(shaded), atol=3)


@pytest.mark.parametrize("other", BACKENDS[1:])
@pytest.mark.parametrize("coloring", ["texture", "strain"])
def test_all_renderers_draw_the_same_picture(scene, coloring, other):
    images = [
        msd.Renderer(scene, scene.system.position, resolution=SIZE, backend=backend, coloring=coloring)
        .image(scene.system.position)
        .astype(int)
        for backend in ("raster", other)
    ]
    difference = np.abs(images[0] - images[1]).max(axis=2)
    # Only pixels on outlines, averaged over different points, may differ by more than rounding: of tubes, a few
    # pixels thick, a third of all where they are.
    assert np.median(difference) <= 1
    assert (difference > 8).mean() < (0.02 if coloring == "texture" else 0.1)


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_picture_depends_on_nothing_drawn_before(scene, backend):
    first, second = scene.system.position, scene.system.rotate(1.0, (1, 1, 0)).position
    renderer = msd.Renderer(scene, np.stack([first, second]), resolution=SIZE, backend=backend)
    image = renderer.image(first)
    other = renderer.image(second)
    assert (image != other).any()
    np.testing.assert_array_equal(image, renderer.image(first))


@pytest.mark.parametrize("dim", [1, 2])
@pytest.mark.parametrize("backend", BACKENDS)
def test_lines_and_planes_are_drawn(backend, dim):
    body = msd.chain(5, dim=1) if dim == 1 else msd.sheet((4, 4), dim=2)
    renderer = msd.Renderer(msd.Scene(system=body), body.position, resolution=SIZE, backend=backend)
    assert renderer.image(body.position).std() > 5  # a blank picture has 0


@pytest.mark.parametrize("wrong", [lambda p: p[:20], lambda p: p[:, :2], lambda p: p * np.nan])
def test_positions_of_another_system_are_refused(scene, wrong):
    position = scene.system.position
    renderer = msd.Renderer(scene, np.array([position, position]), resolution=SIZE, backend="raycast")
    with pytest.raises(ValueError, match="position"):
        renderer.image(wrong(position))


def test_a_scene_can_ask_for_strain_colors(scene):
    position = scene.system.position
    strained = msd.Scene(system=scene.system, look=msd.Look(strain=True))
    for one, coloring, wanted in ((scene, None, False), (strained, None, True), (strained, "texture", False)):
        renderer = msd.Renderer(one, position, resolution=SIZE, coloring=coloring, backend="raycast")
        assert renderer.drawing.colors_move == wanted


@pytest.mark.slow
@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="reads /proc")
@pytest.mark.parametrize("backend", BACKENDS)
def test_memory_stays_flat_over_hundreds_of_frames(scene, backend):
    def resident():
        return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")

    positions = [scene.system.rotate(0.01 * k, (1, 1, 0)).position for k in range(10)]
    renderer = msd.Renderer(scene, np.array(positions), resolution=SIZE, backend=backend)
    for k in range(50):
        renderer.image(positions[k % 10])
    before = resident()
    for k in range(200):
        renderer.image(positions[k % 10])
    # A picture is 173 kB: keeping as much as one in three would show.
    assert resident() - before < 11e6


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_sheet_on_the_ground_hides_it_though_it_sinks_in(backend):
    sheet = msd.sheet((9, 9), 0.1, mass=0.1)
    # By half of what may be seen: UNSEEN times the extent, here 0.8 m times the square root of 2.
    sheet = sheet.translate((0, 0, -0.5 * UNSEEN * 0.8 * 2**0.5))
    look = msd.Look(color="#c03020", gloss=0.0, azimuth=-90, elevation=40)
    scene = msd.Scene(system=sheet, colliders=[msd.Plane()], look=look)
    renderer = msd.Renderer(scene, sheet.position, resolution=SIZE, backend=backend)
    image = renderer.image(sheet.position).astype(int)
    for point in 0.9 * sheet.position:
        red, green, _ = image[pixel_of(renderer, point)]
        assert red > 2 * green  # the ground is grey


def test_springs_to_second_neighbours_are_not_drawn():
    # They would hide what they lie along.
    plain, bent = msd.sheet((5, 4)), msd.sheet((5, 4), bending=20.0)
    np.testing.assert_array_equal(bent.connections[bent.between_neighbors], plain.connections)
    assert plain.between_neighbors is None
    drawn = [Drawing(msd.Scene(system=one), "strain") for one in (bent, plain)]
    assert len(drawn[0].triangles) == len(drawn[1].triangles)
    both = plain + bent
    np.testing.assert_array_equal(
        both.between_neighbors, np.append(np.ones(plain.connection_count, bool), bent.between_neighbors)
    )


def test_directions_of_other_names_are_drawn():
    named = msd.sheet((3, 3)).replace(directions=({"layer 2": slice(0, 6), "x2": slice(6, 9)},))
    assert named.between_neighbors is None


SIZE = (320, 180)


def test_a_square_covers_as_much_of_the_picture_as_geometry_says():
    sheet = msd.sheet((5, 5), 0.25).rotate(0.4, axis=(1, 2, 3))
    look = msd.Look(color="#000000", background="#ffffff", gloss=0.0, azimuth=-70, elevation=35)
    renderer = msd.Renderer(msd.Scene(system=sheet, look=look), sheet.position, resolution=SIZE, backend="raster")
    covered = (1 - renderer.image(sheet.position)[..., 0] / 255).sum()
    corners = sheet.position[[0, 4, 24, 20]]
    y, x = renderer.stage.camera.pixels(corners, *SIZE[::-1])
    area = abs(x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2
    around = np.abs(np.diff(x, append=x[0])).sum() + np.abs(np.diff(y, append=y[0])).sum()
    # Each pixel on the outline, of which there are so many, has four points: it is off by 1/4 at most, and by a
    # tenth of that together, since as many are drawn as are not.
    assert covered == pytest.approx(area, abs=0.025 * around)
    assert area > 5000


def test_what_reaches_behind_the_camera_is_drawn_as_by_rays():
    body = msd.box((3, 3, 3), 0.2, mass=0.1).translate((0, 0, 0.5))
    plate = msd.Box((0.0, 0.0, -0.3), (8.0, 8.0, 0.4))
    look = msd.Look(azimuth=-80, elevation=30, obstacle="#4060c0")
    scene, images = msd.Scene(system=body, colliders=[plate], look=look), []
    for backend in ("raster", "raycast"):
        renderer = msd.Renderer(scene, body.position, resolution=SIZE, backend=backend, device="cpu", zoom=4.0)
        camera = renderer.stage.camera
        assert (np.array([4.0, -4.0, -0.1]) - camera.eye) @ camera.forward < 0  # a corner
        images.append(renderer.bare(body.position, shadows=False).astype(int))
    difference = np.abs(images[0] - images[1]).max(axis=2)
    assert (difference > 8).mean() < 0.02  # outlines
    assert images[0].std() > 20  # something is there


def test_threads_change_nothing(monkeypatch):
    body = msd.ball(0.6, 0.15).translate((0.0, 0.0, 0.7))
    scene = msd.Scene(system=body, colliders=[msd.Plane(), msd.Sphere((1.2, 0, 0.4), 0.4)])
    images = []
    for threads in (1, 3):
        monkeypatch.setattr("msdwarp.pictures.warp_renderers.MOST_THREADS", threads)
        monkeypatch.setattr("msdwarp.pictures.warp_renderers.cores", lambda: 8)
        renderer = msd.Renderer(scene, body.position, resolution=SIZE, backend="raster")
        images.append(renderer.image(body.position))
    np.testing.assert_array_equal(*images)
