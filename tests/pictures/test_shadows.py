"""Shadows of the ray caster, where geometry says they are, and the ray caster as a renderer of its own."""

import importlib.util

import numpy as np
import pytest
import warp as wp

import msdwarp as msd
from msdwarp.pictures import renderer as renderer_module
from msdwarp.pictures.light import SHADED, SHADOW, SOFTNESS, TONE, across, spread

SIZE = (64, 48)
RADIUS, CENTRE = 0.3, np.array([0.0, 0.0, 1.0])
LOOK = msd.Look(color="#808080", obstacle="#808080", gloss=0.0, obstacle_gloss=0.0, azimuth=-90, elevation=60)
SPECK = msd.box((2, 2, 2), 1e-3, mass=1.0).translate((2.5, -2.0, 0.002))  # too small to be seen
ROOM = np.array([[-1.5, -1.5, 0.0], [2.5, 2.0, 0.0], [0.0, 0.0, 1.5]])


def pictured(colliders, *, size=SIZE, room=ROOM, system=SPECK, look=LOOK, device="cpu", **how):
    """Return a renderer of a scene above the floor, and its picture."""
    scene = msd.Scene(system=system, colliders=[msd.Plane(), *colliders], look=look)
    renderer = msd.Renderer(scene, room, resolution=size, backend="raycast", device=device, **how)
    return renderer, renderer.image(system.position).astype(float)


def pixels_of(renderer, points):
    """Return the pixels, shape [any, 2], in which points [m] are seen."""
    stage = renderer.stage
    return np.stack(stage.camera.pixels(np.asarray(points), stage.height, stage.width), axis=-1).astype(int)


def lit_share(renderer, image, points):
    """Return the share of the key light that reaches points of the ground, by their brightness."""
    ground = renderer.stage.ground
    u, v = ground.uv(points).T
    painted = ground.texture[(v * 2048).astype(int), (u * 2048).astype(int)].mean(axis=1)
    row, column = pixels_of(renderer, points).T
    return (image[row, column].mean(axis=1) / painted - SHADOW) / (1 - SHADOW)


@pytest.fixture(params=["cpu", pytest.param("cuda:0", marks=pytest.mark.gpu)])
def place(request):
    """A device to draw on."""
    if request.param != "cpu" and not wp.is_cuda_available():
        pytest.skip("no CUDA device")
    return request.param


def test_the_shadow_of_a_sphere_has_its_centre_and_its_radius(place):
    ball = msd.Sphere(tuple(CENTRE), RADIUS)
    renderer, image = pictured([ball], size=(320, 240), device=place)
    light = renderer.stage.camera.light
    # Rays along the light through the sphere's outline, a circle across it, meet the floor in an ellipse: of half
    # axis RADIUS across the light's way over the floor, RADIUS / light_z along it.
    foot = CENTRE - CENTRE[2] / light[2] * light
    along = light * (1, 1, 0) / np.linalg.norm(light[:2])
    sideways = np.cross([0, 0, 1], along)
    # Half the light is seen where its middle disappears, to the second order in SOFTNESS; there it rises by
    # 1 / (pi / 2) of all over a distance SOFTNESS · way, which is larger than a pixel (0.02 m).
    way = CENTRE[2] / light[2]
    for axis, half in ((along, RADIUS / light[2]), (sideways, RADIUS)):
        for sign in (1, -1):
            if sign > 0 and axis is along:
                continue  # the sphere stands before it
            inner, rim, outer = (
                foot + sign * (half + shift * SOFTNESS * way / light[2]) * axis for shift in (-1.5, 0, 1.5)
            )
            shares = lit_share(renderer, image, np.array([foot, inner, rim, outer]))
            # 8-bit rounding of a difference of 0.34 · 200: 0.01. Between pixels 0.02 m apart in a width of 0.13 m,
            # at the rim: 0.2.
            np.testing.assert_allclose(shares[[0, 1, 3]], [0, 0, 1], atol=0.03)
            assert shares[2] == pytest.approx(0.5, abs=0.2)


def test_a_sphere_that_looks_smaller_than_the_light_hides_its_share(place):
    covers = 0.8  # of the light's radius, seen from the floor
    light = pictured([], device=place)[0].stage.camera.light
    way = CENTRE[2] / light[2]
    ball = msd.Sphere(tuple(CENTRE), covers * SOFTNESS * way)
    renderer, image = pictured([ball], size=(640, 480), device=place)
    foot = CENTRE - way * light
    # On a CPU a pixel samples 16 points of the light, of which two may be on either side of the rim. Bytes: 0.01.
    np.testing.assert_allclose(lit_share(renderer, image, foot[None]), 1 - covers**2, atol=2 / 16 + 0.01)


def test_nothing_is_dark_where_nothing_hides_the_light():
    renderer, image = pictured([], size=(160, 120))
    along = np.linspace(-1.3, 1.5, 8)  # not on the edges of the floor's squares, of 1 m
    points = np.array([[x, y, 0.0] for x in along for y in along])
    # 8-bit rounding, and the pattern of the floor between its pixels.
    np.testing.assert_allclose(lit_share(renderer, image, points), 1.0, atol=0.1)


@pytest.mark.slow
def test_an_obstacle_s_shadow_falls_on_another_as_dark_as_the_light_says():
    slab = msd.Box((0.0, 0.0, 0.1), (2.4, 2.4, 0.2))
    block = msd.Box((0.0, 0.0, 0.9), (0.5, 0.5, 0.1))  # above its middle
    (renderer, both), (_, alone) = (pictured(solids, size=(160, 120)) for solids in ([slab, block], [slab]))
    camera = renderer.stage.camera
    shaded = np.array([0.0, 0.0, 0.9]) - (0.9 - 0.2) / camera.light[2] * camera.light
    (row, column), (far_row, far_column) = pixels_of(renderer, [shaded, [0.9, -0.9, 0.2]])
    sky, _, key, head, fill = camera.lights(even=False)
    always, key = sky - head * camera.forward[2] + fill * camera.fill[2], key * camera.light[2]
    shade, light = (0x80 * (one + TONE * one * (1 - one)) for one in (always + SHADED * key, always + key))
    # In full shadow SHADED of the key light is left; bytes are rounded, and float32 colors too.
    np.testing.assert_allclose(both[row, column], shade, atol=1)
    np.testing.assert_allclose(alone[row, column], light, atol=1)
    np.testing.assert_allclose(both[far_row, far_column], light, atol=1)


@pytest.mark.slow
def test_a_body_has_the_shadow_of_an_obstacle_and_no_acne_elsewhere():
    body = msd.ball(0.6, 0.15).translate((0.0, 0.0, 0.7))
    block = msd.Box((-0.5, 0.4, 1.9), (0.7, 0.7, 0.1))
    _, alone = pictured([], size=(160, 120), system=body, look=LOOK)
    renderer, both = pictured([block], size=(160, 120), system=body, look=LOOK)
    camera = renderer.stage.camera
    towards_block = block.position - 1.2 * camera.light  # where light through the block's middle goes
    landed = towards_block + np.linspace(-0.6, 0.6, 241)[:, None] * camera.light
    on_body = landed[np.argmin(np.abs(np.linalg.norm(landed - (0, 0, 0.7), axis=1) - 0.6))]
    assert abs(np.linalg.norm(on_body - (0, 0, 0.7)) - 0.6) < 0.05  # the light does meet the body
    row, column = pixels_of(renderer, [on_body])[0]
    assert both[row, column].mean() < 0.9 * alone[row, column].mean()
    # A ball alone shades its own far side only, which faces away from the light: towards the light its brightness
    # changes from pixel to pixel by no more than its slope does, a hundredth of it and rounding.
    middle = pixels_of(renderer, [np.array([0, 0, 0.7]) + 0.55 * (camera.light - camera.forward) / 2])[0]
    spot = alone[middle[0] - 4 : middle[0] + 5, middle[1] - 4 : middle[1] + 5].mean(axis=2)
    assert np.abs(np.diff(spot, axis=0)).max() < 4
    assert np.abs(np.diff(spot, axis=1)).max() < 4


def test_a_lattice_in_strain_colors_has_no_shadows_on_itself_but_casts_one():
    body = msd.box((5, 5, 5), 0.2, mass=1.0).translate((0.0, 0.0, 0.6))
    renderer, image = pictured([], size=(160, 120), system=body, coloring="strain")
    plain = renderer.bare(body.position, shadows=False).astype(float)
    darker = (image.mean(axis=2) < plain.mean(axis=2) - 1).nonzero()
    assert len(darker[0]) > 50  # on the floor
    stage = renderer.stage
    rows, columns = stage.camera.pixels(body.position, stage.height, stage.width)
    inside = (np.abs(darker[0] - rows.mean()) < 3) & (np.abs(darker[1] - columns.mean()) < 3)
    assert not inside.any()


def test_positions_on_the_device_give_the_same_picture(place):
    body = msd.box((4, 4, 4), 0.1, mass=0.1).translate((0, 0, 0.6))
    scene = msd.Scene(system=body, colliders=[msd.Plane()])
    simulation = msd.Simulation.from_scene(scene, device=place)
    simulation.step(5)
    renderer = msd.Renderer(scene, body.position, resolution=SIZE, backend="raycast", device=place)
    np.testing.assert_array_equal(
        renderer.image(simulation.positions), renderer.image(simulation.frame().position)
    )


@pytest.mark.slow
@pytest.mark.parametrize("dim", [1, 2])
def test_positions_on_the_device_are_lifted_into_space(dim):
    body = msd.chain(5, dim=1) if dim == 1 else msd.sheet((4, 4), dim=2)
    simulation = msd.Simulation(body, device="cpu", precision="float64")
    renderer = msd.Renderer(
        msd.Scene(system=body), body.position, resolution=SIZE, backend="raycast", device="cpu"
    )
    np.testing.assert_array_equal(renderer.image(simulation.positions), renderer.image(body.position))


def test_a_search_tree_made_anew_draws_the_same(monkeypatch):
    monkeypatch.setattr("msdwarp.pictures.warp_renderers.REFITS", 2)
    body = msd.ball(0.6, 0.15).translate((0.0, 0.0, 0.7))
    scene = msd.Scene(system=body, colliders=[msd.Plane()], look=LOOK)
    renderer = msd.Renderer(scene, ROOM, resolution=SIZE, backend="raycast")
    first, *others = (renderer.image(body.position) for _ in range(6))
    for other in others:
        np.testing.assert_array_equal(first, other)


def test_points_of_the_light_are_spread_evenly():
    points = spread(64)
    assert (np.linalg.norm(points, axis=1) <= 1).all()
    for some in (points, *points.reshape(4, 16, 2)):  # in an even disc the mean of r² is 1/2
        assert (some**2).sum(axis=1).mean() == pytest.approx(0.5, abs=0.05)
        np.testing.assert_allclose(some.mean(axis=0), 0, atol=0.1)
    direction = np.array([0.6, 0.0, 0.8])
    axes = np.array([*across(direction), direction])
    np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=1e-15)


class TestChoice:
    """What draws, where, and what is refused."""

    scene = msd.Scene(system=msd.box((3, 3, 3), 0.1), colliders=[msd.Plane()])

    def made(self, **how):
        return msd.Renderer(self.scene, self.scene.system.position, resolution=SIZE, **how)

    @pytest.mark.parametrize("gone", ["window", "pyvista"])
    def test_where_there_is_no_opengl_it_is_refused_and_pictures_are_drawn_without(self, gone, monkeypatch):
        if gone == "window":
            monkeypatch.setattr(renderer_module, "opengl_window", lambda: None)
        else:
            find = importlib.util.find_spec
            monkeypatch.setattr(
                importlib.util, "find_spec", lambda name: None if name == "pyvista" else find(name)
            )
        assert self.made().backend == "raster"
        message = "'opengl', which cannot draw here; it must be 'raster' or 'raycast'"
        with pytest.raises(RuntimeError, match=message):
            self.made(backend="opengl")

    @pytest.mark.parametrize(("card", "backend"), [(True, "opengl"), (False, "raster")])
    def test_opengl_draws_by_default_where_there_is_a_graphics_card(self, card, backend, monkeypatch):
        monkeypatch.setattr(renderer_module, "no_opengl", lambda: None)
        monkeypatch.setattr(renderer_module, "has_card", lambda: card)
        assert renderer_module._chosen("auto", None) == backend

    @pytest.mark.gpu
    def test_what_is_on_a_gpu_is_drawn_there(self):
        if not wp.is_cuda_available():
            pytest.skip("no CUDA device")
        renderer = self.made(device="cuda:0")
        assert renderer.backend == "raycast"
        assert renderer.drawing.device == "cuda:0"
