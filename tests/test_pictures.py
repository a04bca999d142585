"""Pictures: the camera, normals, colours, both renderers, and memory."""

import os
import sys
from pathlib import Path

import numpy as np
import pytest

import msdwarp as msd
from msdwarp.opengl import opengl_window
from msdwarp.picture import SHADOW, VIEW_ANGLE, Camera, Drawing, Ground
from msdwarp.scene import rgb

BACKENDS = [
    pytest.param(
        "opengl", marks=pytest.mark.skipif(opengl_window() is None, reason="no OpenGL library is installed")
    ),
    "raycast",
]
SIZE = (320, 180)


@pytest.fixture
def scene():
    """A cube of 0.4 m that floats half a metre above the floor."""
    cube = msd.box((5, 5, 5), 0.1, mass=0.1).translate((0, 0, 0.7))
    return msd.Scene(system=cube, colliders=[msd.Plane()], look=msd.Look(colour="#c03020"))


def pixel_of(renderer, point):
    """Return (row, column) where a point appears."""
    row, column = renderer.camera.pixels(np.array([point]), renderer.height, renderer.width)
    return int(row[0]), int(column[0])


@pytest.mark.parametrize("aspect", [0.5, 16 / 9])
@pytest.mark.parametrize("azimuth", [-60, 200])
def test_the_camera_is_as_near_as_it_can_be_and_sees_everything(aspect, azimuth):
    points = np.random.default_rng(1).normal(size=(500, 3)) * (3, 1, 2) + (5, 6, 7)
    look = msd.Look(azimuth=azimuth, elevation=25)
    camera = Camera.that_sees(points, look, aspect, margin=1.0)
    offset = points - camera.eye
    depth = offset @ camera.forward
    tan = np.tan(np.radians(VIEW_ANGLE) / 2)
    across = np.abs(offset @ camera.right) / (depth * tan * aspect)
    along = np.abs(offset @ camera.up) / (depth * tan)
    # 1 is the edge of the picture: reached, to rounding, and not crossed.
    assert max(across.max(), along.max()) == pytest.approx(1.0, abs=1e-9)


def test_normals_follow_the_body():
    sheet = msd.sheet((6, 4), 0.5).rotate(0.7, axis=(1, 2, 3))
    drawing = Drawing(msd.Scene(system=sheet), "texture")
    drawing.follow(sheet.position)
    corner, along_x, along_y = sheet.position[[0, 1, 6]]
    normal = np.cross(along_x - corner, along_y - corner) / 0.25
    # float32 unit vectors from float32 differences of coordinates of a few metres
    np.testing.assert_allclose(drawing.normals.numpy(), np.tile(normal, (24, 1)), atol=1e-6)


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


def test_connections_are_green_at_rest_and_red_when_strained():
    body = msd.System(
        position=[[0, 0, 0], [1, 0, 0], [2.2, 0, 0], [3.0, 0, 0], [3.9, 0, 0]],
        connections=[[0, 1], [1, 2], [2, 3], [3, 4]],
        rest_length=1.0,
    )
    drawing = Drawing(msd.Scene(system=body, look=msd.Look(full_strain=0.2)), "strain")
    drawing.follow(body.position)
    rest, stretched, compressed, half = drawing.colours.numpy().reshape(4, 6, 3)[:, 0]
    assert rest[1] > 2 * rest[0]  # green
    assert stretched[0] > 2 * stretched[1]  # red
    np.testing.assert_allclose(stretched, compressed, atol=1e-5)  # float32 lengths of about 1
    np.testing.assert_allclose(half, (0.96, 0.80, 0.23), atol=1e-5)  # yellow, half way


@pytest.mark.parametrize("colouring", ["texture", "strain"])
@pytest.mark.parametrize("backend", BACKENDS)
def test_the_body_its_shadow_and_the_backdrop_are_where_they_belong(scene, backend, colouring):
    system = scene.system
    wide = np.concatenate([system.position, [[-1, -1, 0], [2, 2, 0]]])  # leave room around
    renderer = msd.Renderer(scene, wide, resolution=SIZE, colouring=colouring, backend=backend)
    assert renderer.uses_opengl == (backend == "opengl")
    image = renderer.image(system.position).astype(int)
    assert image.shape == (180, 320, 3)

    centre = system.centre_of_mass
    red, green, _ = image[pixel_of(renderer, centre)]
    assert (red > 2 * green) if colouring == "texture" else (green > red)

    np.testing.assert_allclose(image[2, 2], 255 * np.array(rgb("", scene.look.background)), atol=1)

    light = renderer.camera.light
    ground = Ground(scene, wide)
    lit, shaded = np.array([0.9, -0.9, 0.0]), centre - centre[2] / light[2] * light

    def painted(point):
        u, v = ground.uv(point)
        return ground.texture[int(v * 2048), int(u * 2048)].astype(int)

    # 8-bit rounding, and the texture between its pixels. The shadow of connections has gaps: not looked at.
    np.testing.assert_allclose(image[pixel_of(renderer, lit)], painted(lit), atol=3)
    if colouring == "texture":
        np.testing.assert_allclose(image[pixel_of(renderer, shaded)], SHADOW * painted(shaded), atol=3)


@pytest.mark.skipif(opengl_window() is None, reason="no OpenGL library is installed")
def test_both_renderers_draw_the_same_picture(scene):
    images = [
        msd.Renderer(scene, scene.system.position, resolution=SIZE, backend=backend)
        .image(scene.system.position)
        .astype(int)
        for backend in ("opengl", "raycast")
    ]
    difference = np.abs(images[0] - images[1]).max(axis=2)
    # Only pixels on outlines, averaged over different points, may differ by more than rounding.
    assert np.median(difference) <= 1
    assert (difference > 8).mean() < 0.02


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


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"resolution": (0, 100)}, "resolution is 0"),
        ({"backend": "vulkan"}, "backend is 'vulkan'"),
        ({"colouring": "rainbow"}, "colour is 'rainbow'"),
    ],
)
def test_bad_renderer_arguments_are_named(scene, arguments, message):
    with pytest.raises(ValueError, match=message):
        msd.Renderer(scene, scene.system.position, **arguments)


@pytest.mark.parametrize("wrong", [lambda p: p[:20], lambda p: p[:, :2], lambda p: p * np.nan])
def test_positions_of_another_system_are_refused(scene, wrong):
    position = scene.system.position
    renderer = msd.Renderer(scene, np.array([position, position]), resolution=SIZE, backend="raycast")
    with pytest.raises(ValueError, match="position"):
        renderer.image(wrong(position))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"colour": "red"}, "colour is 'red'"),
        ({"texture": np.zeros((4, 4), np.uint8)}, r"texture has shape \(4, 4\)"),
        ({"full_strain": 0}, "full_strain is 0"),
    ],
)
def test_bad_looks_are_named(arguments, message):
    with pytest.raises(ValueError, match=message):
        msd.Look(**arguments)


def test_a_scene_of_nothing_to_draw_is_refused():
    with pytest.raises(ValueError, match="neither a surface nor connections"):
        msd.Scene(system=msd.System(position=[[0, 0, 0]]))


@pytest.mark.slow
@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="reads /proc")
@pytest.mark.parametrize("backend", BACKENDS)
def test_memory_stays_flat_over_a_thousand_frames(scene, backend):
    def resident():
        return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")

    positions = [scene.system.rotate(0.01 * k, (1, 1, 0)).position for k in range(10)]
    renderer = msd.Renderer(scene, np.array(positions), resolution=SIZE, backend=backend)
    for k in range(100):
        renderer.image(positions[k % 10])
    before = resident()
    for k in range(1000):
        renderer.image(positions[k % 10])
    # A picture is 173 kB: keeping as much as one in ten would show.
    assert resident() - before < 17e6
