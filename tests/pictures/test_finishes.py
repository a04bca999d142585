"""What bodies are made of, as pictures show it: finishes against the formulas of `msdwarp/pictures/light.py`."""

import numpy as np
import pytest
from backends import BACKENDS

import msdwarp as msd
from msdwarp import checks
from msdwarp.kernels.pictures.shading import (
    BRIGHT_ABOVE,
    DARK_BELOW,
    MIRRORED_GROUND,
    MIRRORED_SKY,
    MIRRORS,
    ZENITH,
)
from msdwarp.live.patches import patches
from msdwarp.pictures import Drawing
from msdwarp.pictures.light import TONE, shininess
from msdwarp.world import FINISHES

SIZE = (320, 160)
BOX = msd.box((3, 3, 3), 0.2).translate((0, 0, -0.2))


def mirrored(direction, normal):
    return 2 * (direction @ normal) * normal - direction


def lit(name, gloss, color, behind, normal, view, camera):
    """Return the color, 0 … 255, of a surface above no ground, seen from the direction `view`."""
    made_of = FINISHES[name]
    sky, bounce, key, headlight, fill = camera.lights(even=False)
    lights = ((key, camera.light), (headlight, -camera.forward))
    up, edge = normal[2], 1 - normal @ view
    diffuse = sky * (1 + up) / 2 + bounce * (1 - up) / 2 + fill * max(normal @ camera.fill, 0)
    diffuse += sum(strength * max(normal @ light, 0) for strength, light in lights)
    diffuse += TONE * diffuse * (1 - diffuse)
    exponent = shininess(made_of.roughness)
    # What cannot be seen from a face is not mirrored by it; cloth has no highlights.
    glint = gloss * sum(
        strength * max(mirrored(light, normal) @ view, 0) ** exponent
        for strength, light in lights
        if normal @ light > 0 and name != "cloth"
    )
    height = mirrored(view, normal)[2]
    share = np.clip((height - DARK_BELOW) / (BRIGHT_ABOVE - DARK_BELOW), 0, 1)
    heaven = MIRRORED_SKY - ZENITH * max(height, 0)
    around = MIRRORED_GROUND + (heaven - MIRRORED_GROUND) * share**2 * (3 - 2 * share)
    if name == "metal":
        return 255 * color * ((1 - made_of.metallic) * diffuse + made_of.metallic * around + glint)
    if name == "glass":
        fresnel = MIRRORS + (1 - MIRRORS) * edge**5
        passes = (1 - made_of.opacity) * (1 - fresnel) * (1 - glint)
        return 255 * (made_of.opacity * diffuse * color + fresnel * around + glint + passes * behind)
    return 255 * (color * (diffuse + made_of.sheen * edge**2) + glint)


@pytest.mark.parametrize("backend", BACKENDS)
def test_each_finish_is_as_bright_as_its_formula_says(backend):
    boxes = [BOX.rotate(0.5).translate((0.7 * k, 0, 0)).named(name) for k, name in enumerate(FINISHES)]
    color, gloss, background = "#605040", 0.5, "#202830"
    scene = msd.Scene(
        system=sum(boxes[1:], boxes[0]),
        look=msd.Look(background=background, azimuth=-85, elevation=35),
        looks={name: msd.Look(color=color, gloss=gloss, finish=name, smooth=False) for name in FINISHES},
    )
    x = scene.system.position
    renderer = msd.Renderer(scene, x, resolution=SIZE, backend=backend, device="cpu")
    image, camera = renderer.bare(x, shadows=False).astype(int), renderer.stage.camera
    turn = np.array([[np.cos(0.5), -np.sin(0.5), 0], [np.sin(0.5), np.cos(0.5), 0], [0, 0, 1]])
    rgb, behind = (np.array(checks.color("", one)) for one in (color, background))
    for k, name in enumerate(FINISHES):
        for normal in turn @ [0, -1, 0], np.array([0.0, 0.0, 1.0]):
            spot = boxes[k].position.mean(axis=0) + 0.2 * normal
            row, column = (int(one[0]) for one in camera.pixels(spot[None], *SIZE[::-1]))
            view = (camera.eye - spot) / np.linalg.norm(camera.eye - spot)
            wanted = lit(name, gloss, rgb, behind, normal, view, camera)
            assert wanted.max() < 255
            # Bytes are rounded, twice in glass; a pixel off the middle has another ray, 0.4° off.
            np.testing.assert_allclose(image[row, column], wanted, atol=3, err_msg=name)


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("elevation", [16, 90])
def test_at_full_light_a_color_is_as_given(backend, elevation):
    ball, color = msd.ball(0.5, 0.1), np.array([0x20, 0x60, 0xD0])
    look = msd.Look(color="#2060d0", gloss=0.0, background="#000000", elevation=elevation)
    renderer = msd.Renderer(
        msd.Scene(system=ball, look=look), ball.position, resolution=SIZE, backend=backend, device="cpu"
    )
    brightest = renderer.image(ball.position).reshape(-1, 3).max(axis=0)
    # Normals of all directions towards the camera are there, up to those of its 32 meridians.
    np.testing.assert_allclose(brightest, color, atol=1)


@pytest.mark.parametrize("backend", BACKENDS)
def test_what_is_behind_glass_is_seen_and_what_is_before_it_hides_it(backend):
    def pictures(obstacle, y):
        plate = msd.Box((0, y, 0), (3, 0.1, 3))
        look = msd.Look(finish="glass", gloss=0, smooth=False, azimuth=-90, elevation=0, obstacle=obstacle)
        scene = msd.Scene(system=BOX, colliders=[plate], look=look)
        renderer = msd.Renderer(scene, BOX.position, resolution=SIZE, backend=backend, device="cpu")
        row, column = SIZE[1] // 2, SIZE[0] // 2
        drawn = [renderer.bare(x, shadows=False) for x in (BOX.position, None)]
        return [image.astype(float)[row, column] for image in drawn]

    (red, bare_red), (blue, bare_blue) = pictures("#a02010", 0.8), pictures("#1020a0", 0.8)
    assert np.abs(bare_red - bare_blue).max() > 100
    passes = (1 - FINISHES["glass"].opacity) * (1 - MIRRORS)
    # Each of the four is rounded to bytes.
    np.testing.assert_allclose(red - blue, passes * (bare_red - bare_blue), atol=2)
    before, bare = pictures("#a02010", -0.8)
    np.testing.assert_array_equal(before, bare)


@pytest.mark.parametrize("backend", BACKENDS)
def test_of_two_glass_bodies_the_nearer_is_seen_wherever_it_is_in_the_system(backend):
    images = []
    for order in (1, -1):
        near, far = BOX.named("red"), BOX.translate((0, 1.0, 0)).named("blue")
        first, second = (near, far)[::order]
        looks = {
            name: msd.Look(color=color, finish="glass", gloss=0, smooth=False)
            for name, color in (("red", "#e02020"), ("blue", "#2020e0"))
        }
        scene = msd.Scene(system=first + second, looks=looks, look=msd.Look(azimuth=-90, elevation=0))
        x = scene.system.position
        renderer = msd.Renderer(scene, x, resolution=SIZE, backend=backend, device="cpu")
        images.append(renderer.bare(x, shadows=False).astype(int)[SIZE[1] // 2, SIZE[0] // 2])
    assert images[0][0] > images[0][2]
    np.testing.assert_array_equal(*images)


def test_a_browser_sees_through_glass_alone():
    scene = msd.Scene(system=BOX, colliders=[msd.Sphere((1, 0, 0), 0.2)], look=msd.Look(finish="glass"))
    assert {one.opacity for one in patches(Drawing(scene, "texture"))} == {FINISHES["glass"].opacity, None}


def test_where_colors_show_quantities_all_is_matt():
    scene = msd.Scene(system=BOX, look=msd.Look(finish="glass"))
    assert Drawing(scene, "texture").finish.all()
    assert not Drawing(scene, "strain").finish.any()
