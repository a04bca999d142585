"""Bodies in the colors of values of their particles, and a camera that comes nearer."""

import numpy as np
import pytest
from backends import BACKENDS, pixel_of

import msdwarp as msd
from msdwarp import checks
from msdwarp.kernels.pictures.drawing import STRAIN_STOPS, VALUE_STOPS
from msdwarp.pictures.drawing import ColorScale, Drawing
from msdwarp.pictures.legend import legends, with_legends
from msdwarp.pictures.timelapse import timelapse

SIZE = (320, 180)
SPEED = ColorScale("speed [m/s]", 4.0)


@pytest.fixture
def scene():
    """A cube of 0.4 m, whose texture and color are unlike the scale's, beside a green post."""
    cube = msd.box((5, 5, 5), 0.1, mass=0.1).translate((0, 0, 0.5))
    texture = np.full((2, 2, 3), (0, 255, 0), np.uint8)
    look = msd.Look(texture=texture, obstacle="#20a040", obstacle_texture=255 - texture, azimuth=-80)
    return msd.Scene(system=cube, colliders=[msd.Plane(), msd.Box((0.6, 0, 0.4), (0.2, 0.4, 0.8))], look=look)


def colors_of(values, full):
    """Return the scale's colors of values, shape [any, 3]."""
    at = np.linspace(0, full, len(VALUE_STOPS))
    return np.stack([np.interp(values, at, stops) for stops in np.transpose(VALUE_STOPS)], axis=-1)


def hue_at(renderer, image, point):
    """Return the color at which a point appears, over its greatest component: shade takes part in all alike."""
    color = image[pixel_of(renderer, point)].astype(float)
    return color / color.max()


def assert_hue(renderer, image, point, color):
    """Assert that a point of little specular light appears in this color.

    Up to 8-bit rounding of dark shades, and to a pixel: a fiftieth of the scale, on which 0.15 is an eighth.
    """
    np.testing.assert_allclose(hue_at(renderer, image, point), np.array(color) / np.max(color), atol=0.03)


LEFT, MIDDLE, RIGHT, POST = (-0.15, -0.2, 0.5), (0, -0.2, 0.5), (0.15, -0.2, 0.5), (0.6, -0.2, 0.5)


def halves(system):
    """Return values that are 0 on the left half of the cube, full on its right, and between in its middle."""
    return SPEED.full * np.clip(10 * system.position[:, 0] + 0.5, 0, 1)


@pytest.mark.parametrize("backend", BACKENDS)
def test_the_ends_of_the_scale_are_where_the_values_are(scene, backend):
    system = scene.system
    renderer = msd.Renderer(scene, system.position, resolution=SIZE, coloring=SPEED, backend=backend)
    values = halves(system)
    image = renderer.image(system.position, values=values)
    half = colors_of(0.5 * SPEED.full, SPEED.full)
    for point, color in ((LEFT, VALUE_STOPS[0]), (MIDDLE, half), (RIGHT, VALUE_STOPS[-1])):
        assert_hue(renderer, image, point, color)
    assert_hue(renderer, image, POST, checks.color("", scene.look.obstacle))
    # Its side, which the key light hardly reaches, is nearly as bright as the legend.
    brightest = image[pixel_of(renderer, RIGHT)].max() / (255 * max(VALUE_STOPS[-1]))
    assert 0.75 < brightest < 1.1

    # The next frame has its own values, and the one after depends on neither.
    turned = renderer.image(system.position, values=SPEED.full - values)
    for point, color in ((LEFT, VALUE_STOPS[-1]), (MIDDLE, half), (RIGHT, VALUE_STOPS[0])):
        assert_hue(renderer, turned, point, color)
    assert_hue(renderer, turned, POST, checks.color("", scene.look.obstacle))
    np.testing.assert_array_equal(renderer.image(system.position, values=values), image)


@pytest.mark.parametrize("smooth", [True, False])
def test_vertices_take_the_colors_of_their_particles(smooth):
    sheet = msd.sheet((6, 4), 0.5)
    drawing = Drawing(msd.Scene(system=sheet, look=msd.Look(smooth=smooth)), SPEED)
    values = np.linspace(-2.0, 7.0, 24)  # below the scale, all along it, and above
    drawing.follow(sheet.position, values=values)
    vertices = sheet.surface.particle if smooth else sheet.surface.particle[sheet.surface.triangles.ravel()]
    # float32 colors
    np.testing.assert_allclose(drawing.colors.numpy(), colors_of(values, 4.0)[vertices], atol=1e-6)
    assert drawing.texture is None


def test_mixtures_take_the_colors_of_mixed_values():
    random = np.random.default_rng(5)
    body = msd.box((3, 3, 3), 0.3)
    particle, weights = random.integers(0, 27, (12, 2)), random.uniform(-0.2, 1, (12, 2))
    weights /= weights.sum(axis=1, keepdims=True)
    surface = msd.Surface(
        particle=particle, weights=weights, uv=np.zeros((12, 2)), triangles=np.arange(12).reshape(-1, 3)
    )
    drawing = Drawing(msd.Scene(system=body.replace(surface=surface)), SPEED)
    values = random.uniform(0, 5, 27)
    drawing.follow(body.position, values=values)
    mixed = (weights * values[particle]).sum(axis=1)
    assert mixed.min() < 2 < 4 < mixed.max()
    np.testing.assert_allclose(drawing.colors.numpy(), colors_of(mixed, 4.0), atol=1e-5)  # float32 sums


def test_tubes_take_a_color_at_either_end_and_balls_their_own():
    body = msd.System(position=[[0, 0, 0], [1, 0, 0], [3, 0, 0]], connections=[[0, 1], [2, 1]], rest_length=1.0)
    drawing = Drawing(msd.Scene(system=body.pin(0)), SPEED)
    drawing.follow(body.position, values=np.array([0.0, 1.3, 3.9]))
    colors, points = drawing.colors.numpy(), drawing.points.numpy()
    assert len(points) > 12 + 3 * 12
    particle = np.abs(points[:, :1] - body.position[:, 0]).argmin(axis=1)
    np.testing.assert_allclose(colors, colors_of(np.array([0.0, 1.3, 3.9]), 4.0)[particle], atol=1e-6)


def with_bar(image, scale, stops):
    """Return a picture with the bar of a scale."""
    return with_legends(image, legends((image.shape[1], len(image)), scale, stops))


def test_the_legend_shows_the_scale():
    image = np.full((720, 1280, 3), 200, np.uint8)
    drawn = with_bar(image, SPEED, VALUE_STOPS)
    changed = np.argwhere((drawn != image).any(axis=2))
    strain = np.argwhere((with_bar(image, ColorScale("strain", 0.2), STRAIN_STOPS) != image).any(axis=2))
    np.testing.assert_array_equal(changed.min(axis=0), strain.min(axis=0))  # the same corner
    # The bar is the row with most of the scale's first color's kin: it starts and ends with the stops.
    first, last = (np.round(255 * np.array(VALUE_STOPS[k])) for k in (0, -1))
    row, column = np.argwhere((drawn == first).all(axis=2))[0]
    shown = drawn[row, column : column + 260].astype(int)
    np.testing.assert_array_equal(shown[-1], last)
    np.testing.assert_allclose(shown / 255, colors_of(np.linspace(0, 1, 260), 1.0), atol=0.5 / 255 + 1e-9)
    for other in (SPEED._replace(label="energy [J]"), SPEED._replace(full=3.0)):
        assert (with_bar(image, other, VALUE_STOPS) != drawn).any()


@pytest.mark.parametrize("size", [(1280, 720), (320, 180), (400, 900), (160, 120)])
def test_legends_do_not_overlap(size):
    scale = ColorScale("strain (below 0: shorter than at rest)", 0.2, signed=True)
    left, right = legends(size, scale, STRAIN_STOPS, 12.5)
    assert left.width + right.width <= size[0]
    body = msd.box((3, 3, 3), 0.2)
    renderer = msd.Renderer(
        msd.Scene(system=body), body.position, resolution=size, coloring="strain", arrows=12.5, backend="raster"
    )
    rows, _ = renderer.stage.camera.pixels(body.position, *size[::-1])
    assert rows.min() >= min(right.height, 0.3 * size[1])


def test_a_long_label_is_not_cut_off():
    image = np.zeros((720, 1280, 3), np.uint8)
    drawn = with_bar(
        image, ColorScale("kinetic energy of a particle and of all that it is joined to [J]", 1.0), VALUE_STOPS
    )
    rows, columns = np.nonzero(drawn.any(axis=2))
    veil = drawn[rows.max(), columns.min()]
    upper = drawn[rows.min() : rows.min() + 20, columns.min() : columns.max() + 1]
    ink = (upper != veil).any(axis=(0, 2))
    assert ink.sum() > 260
    assert not ink[0]
    assert not ink[-1]


def test_poses_of_a_timelapse_have_values_of_their_own(scene):
    first = scene.system.position
    positions = np.array([first, scene.system.translate((-0.9, 0, 0)).position])
    renderer = msd.Renderer(scene, positions, resolution=SIZE, coloring=SPEED, backend="raycast")
    values = np.stack([np.full(125, 4.0), np.zeros(125)])
    picture = timelapse(renderer, positions, [0, 1], values)
    assert_hue(renderer, picture, np.array(LEFT) - (0.9, 0, 0), VALUE_STOPS[0])
    early = hue_at(renderer, picture, RIGHT)
    assert early[2] < 0.95 * early[0]  # yellow, and faint
    for wrong, message in (
        (values[:1], r"values has shape \(1, 125\); it must be \(2, 125\)"),
        (values[:, :9], r"values has shape \(2, 9\); it must be \(2, 125\)"),
        (values[0], r"values has shape \(125,\)"),
        (np.diag([1, np.nan]) @ values, r"values\[1, 0\] is nan"),
        (None, r"values is None"),
    ):
        with pytest.raises(ValueError, match=message):
            timelapse(renderer, positions, [0, 1], wrong)


@pytest.mark.parametrize(
    ("coloring", "values", "message"),
    [
        (SPEED, None, r"values is None; it must have the shape \(125,\)"),
        (SPEED, np.zeros(124), r"values has shape \(124,\); it must be \(125,\)"),
        (SPEED, np.full(125, np.nan), r"values\[0\] is nan; it must be finite"),
        (SPEED, "fast", "values must be an array of numbers"),
        ("texture", np.zeros(125), "values is given; it must be None unless"),
    ],
)
def test_bad_values_are_named(scene, coloring, values, message):
    position = scene.system.position
    renderer = msd.Renderer(scene, position, resolution=SIZE, coloring=coloring, backend="raycast")
    for draw in (renderer.image, renderer.bare):
        with pytest.raises(ValueError, match=message):
            draw(position, values=values)
    assert renderer.bare(None).shape == (180, 320, 3)  # without a body there are no values


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"coloring": ColorScale("speed [m/s]", 0.0)}, r"coloring.full is 0; it must be a number above 0"),
        ({"coloring": ColorScale("speed [m/s]", np.inf)}, "coloring.full is inf"),
        ({"coloring": ("speed [m/s]", 4.0)}, "coloring is"),
        ({"zoom": 0.0}, "zoom is 0"),
        ({"zoom": np.nan}, "zoom is nan"),
        ({"resolution": (0, 100)}, "resolution is 0"),
        ({"backend": "vulkan"}, "backend is 'vulkan'; it must be one of 'auto', 'raster'"),
        ({"backend": "raycast", "device": "cuda:99"}, "device is 'cuda:99'; it must be one of cpu"),
        ({"coloring": "rainbow"}, "coloring is 'rainbow'"),
    ],
)
def test_bad_arguments_are_named(scene, arguments, message):
    with pytest.raises(ValueError, match=message):
        msd.Renderer(scene, scene.system.position, **arguments)
