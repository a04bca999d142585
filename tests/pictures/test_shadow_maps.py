"""Shadows by a map: what the key light sees, and what is left dark."""

import numpy as np
import pytest
from backends import BACKENDS

from msdwarp import Box, Look, Plane, Scene, Sphere, ball, box
from msdwarp.pictures import Renderer
from msdwarp.pictures.drawing import Drawing
from msdwarp.pictures.shadow_map import SIZE, ShadowMap

UPWARDS = np.array([0.0, 0.0, 1.0])
SHADOW_MAPS = [BACKENDS[0], BACKENDS[2]]


def lying(height: float = 0.6) -> Scene:
    """Return a cube of 40 cm above a table as wide as 2 m, whose top is at 0."""
    cube = box((3, 3, 3), 0.2).translate((0, 0, height))
    table = Box((0, 0, -0.1), (2, 2, 0.2))
    return Scene(system=cube, colliders=[table], look=Look(color="#808080", obstacle="#c0c0c0", gloss=0.0))


def pictures(
    scene: Scene, backend: str, size: tuple[int, int] = (320, 180)
) -> tuple[np.ndarray, np.ndarray, Renderer]:
    """Return a scene's picture with shadows and without, as brightness, and what drew it."""
    around = [scene.system.position + np.array(shift) for shift in ((-1, -1, 0), (1, 1, 0))]
    renderer = Renderer(scene, np.array(around), resolution=size, backend=backend)
    with_shadows = renderer.bare(scene.system.position)
    without = renderer.bare(scene.system.position, shadows=False)
    return with_shadows.astype(int).sum(axis=2), without.astype(int).sum(axis=2), renderer


def test_the_light_sees_what_is_nearest_to_it():
    scene = Scene(system=box((2, 2, 2), 0.2).translate((0.5, 0, 0)), colliders=[Sphere((0, 0, 0.3), 0.25)])
    drawing = Drawing(scene, "texture")
    drawing.follow(scene.system.position)
    seen = ShadowMap(drawing, UPWARDS)
    seen.follow(drawing.points.numpy())
    u, v, _ = seen.axes
    middle = seen.corner[:2] + seen.texel * (np.arange(SIZE)[:, None] + 0.5)
    place = middle[None, :, 0, None] * u + middle[:, None, 1, None] * v
    from_sphere = np.hypot(place[..., 0], place[..., 1])
    height = seen.depth + seen.corner[2]
    inner = from_sphere < 0.2
    # A sphere of 72 segments lies up to r (1 - cos(pi / 72)) = 2.4e-4 m inside a round one. On a slope of 4/3, as
    # there is at 20 of 25 cm, that is 5/3 of it upwards, and as much again where rings and segments both are.
    np.testing.assert_allclose(height[inner], 0.3 + np.sqrt(0.25**2 - from_sphere[inner] ** 2), atol=8e-4)
    on_cube = np.abs(place - (0.5, 0, 0)).max(axis=2) < 0.09
    np.testing.assert_allclose(height[on_cube], 0.1, atol=1e-6)  # rounding of float32
    outside = (from_sphere > 0.26) & (np.abs(place - (0.5, 0, 0)).max(axis=2) > 0.11)
    assert height[outside].max() < -0.5


def test_shadows_do_not_shimmer_where_little_moves():
    scene = lying()
    drawing = Drawing(scene, "texture")
    drawing.follow(scene.system.position)
    seen = ShadowMap(drawing, np.array([0.6, 0.0, 0.8]))
    widths, corners = set(), []
    for shift in np.linspace(0, 0.03, 7):
        seen.follow(drawing.points.numpy() + np.float32(shift) * np.array([0, 1, 0], np.float32))
        widths.add(seen.width)
        corners.append((seen.corner / seen.texel)[:2])
    assert len(widths) == 1
    moved = np.array(corners) - corners[0]
    np.testing.assert_allclose(moved, np.round(moved), atol=1e-6)  # whole texels, but for rounding of float64


@pytest.mark.parametrize("backend", SHADOW_MAPS)
def test_a_body_shadows_an_obstacle_and_nothing_else_changes(backend):
    lit, bare, renderer = pictures(lying(), backend)
    camera, cube = renderer.stage.camera, np.array([0.0, 0.0, 0.6])
    light = camera.light
    below = cube - cube[2] / light[2] * light  # where the shadow of the cube's middle falls on the table
    away = 2 * np.array([1.0, 1.0, 0.0]) * np.array([0.45, 0.45, 0]) - below
    (row, other), (column, beside) = (
        np.round(a).astype(int) for a in camera.pixels(np.array([below, away]), *lit.shape)
    )
    assert lit[row, column] < 0.85 * bare[row, column]
    assert lit[other, beside] == bare[other, beside]
    assert (lit <= bare).all()


@pytest.mark.parametrize("backend", SHADOW_MAPS)
def test_an_obstacle_shadows_a_body(backend):
    scene = lying(0.2)
    scene = Scene(system=scene.system, colliders=[*scene.colliders, Sphere((0, 0, 0.9), 0.25)], look=scene.look)
    light = pictures(scene, backend)[2].stage.camera.light
    # Over the middle of the cube's upper side, in the light's direction.
    above = np.array([0, 0, 0.4]) + 0.5 * light
    scene = Scene(system=scene.system, colliders=[Sphere(tuple(above), 0.1)], look=scene.look)
    lit, bare, renderer = pictures(scene, backend)
    row, column = (round(float(a[0])) for a in renderer.stage.camera.pixels(np.array([[0, 0, 0.4]]), *lit.shape))
    assert lit[row, column] < 0.85 * bare[row, column]


@pytest.mark.parametrize("backend", SHADOW_MAPS)
def test_a_lit_body_shadows_itself_nowhere(backend):
    # A sphere is convex: wherever its faces are turned to the light, nothing is in between.
    scene = Scene(
        system=box((2, 2, 2), 0.1), colliders=[Sphere((1, 0, 0), 0.6)], look=Look(gloss=0.0, obstacle="#ffffff")
    )
    lit, bare, _ = pictures(scene, backend)
    # Where the light grazes facets, one in 48 of a round's 72 is turned away from it though its shading is not;
    # there the key light is below 0.49 sin(pi / 36) = 0.04 of full brightness.
    assert (bare - lit).max() <= 0.05 * 765


@pytest.mark.parametrize("backend", SHADOW_MAPS)
def test_the_ground_takes_soft_shadows(backend):
    body = box((2, 2, 2), 0.4).translate((0, 0, 1.0))
    scene = Scene(system=body, colliders=[Plane()], look=Look(gloss=0.0))
    lit, bare, _ = pictures(scene, backend, (640, 360))
    share = (lit / bare)[lit < bare]
    assert share.min() == pytest.approx(0.66, abs=0.02)  # full shadow; two steps of 255 at most by rounding
    assert np.count_nonzero((share > 0.72) & (share < 0.94)) > 100  # and an edge that fades


@pytest.mark.parametrize("backend", SHADOW_MAPS)
@pytest.mark.parametrize("height", [0.6, 1.0])
def test_a_shadow_far_below_a_small_body_is_as_rays_say(backend, height):
    body = ball(radius=0.1, spacing=0.05).translate((0, 0, height))
    scene = Scene(system=body, colliders=[Plane()])
    seen = np.array([body.position, body.position - (0, 0, height - 0.1)])
    darkness = []
    for one in (backend, "raycast"):
        renderer = Renderer(scene, seen, resolution=(400, 225), backend=one)
        images = [renderer.bare(body.position, shadows=shown).astype(int) for shown in (False, True)]
        darkness.append((images[0] - images[1]).sum(axis=2))
    mapped, cast = darkness
    # In soft edges, most of the shadow, a pixel's light is a mean over 16 points, of which 8 are looked at first:
    # it is known to an eighth, and the whole, in which pixels look at different points, to half of that.
    assert mapped.sum() == pytest.approx(cast.sum(), rel=1 / 16)
    assert np.abs(mapped - cast).sum() < cast.sum() / 8


@pytest.mark.parametrize("backend", SHADOW_MAPS)
def test_highlights_are_white_on_textures_too(backend):
    texture = np.zeros((4, 4, 3), np.uint8)
    texture[..., 0] = 120
    scene = Scene(
        system=box((2, 2, 2), 0.4), colliders=[], look=Look(texture=texture, gloss=1.0, azimuth=-60, elevation=89)
    )
    renderer = Renderer(scene, scene.system.position, resolution=(320, 180), backend=backend)
    image = renderer.image(scene.system.position)
    on_body = np.abs(image.astype(int) - (238, 241, 244)).sum(axis=2) > 60
    assert image[..., 1][on_body].max() > 50  # green, of which the texture has none
