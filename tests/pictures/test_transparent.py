"""Transparent pictures: laid over a background they are the pictures before it; and pictures of some bodies."""

import numpy as np
import pytest
from backends import BACKENDS
from PIL import Image

import msdwarp as msd
from msdwarp.pictures import film
from msdwarp.pictures.legend import VEIL

SKY = np.array([0xEE, 0xF1, 0xF4])
CUBE = msd.box((4, 4, 4), 0.1).translate((0, 0, 0.3)).named("cube")
JELLY = msd.ball(radius=0.2, spacing=0.1).translate((0.6, 0, 0.2)).named("jelly")


def picture(backend, bodies=(), *, transparent=True, **look):
    looks = {"jelly": msd.Look(finish="glass", color="#3366cc")}
    step = msd.Box((-0.5, 0.0, 0.1), (0.2, 0.2, 0.2))
    scene = msd.Scene(
        system=CUBE + JELLY, colliders=[msd.Plane(), step], looks=looks, look=msd.Look(azimuth=-90.0, **look)
    )
    position = scene.system.position
    how = {"resolution": (160, 90), "backend": backend, "device": "cpu"}
    return msd.Renderer(scene, position, bodies=bodies, transparent=transparent, **how).image(position)


def over(image, background):
    share = image[..., 3:] / 255
    return share * image[..., :3] + (1 - share) * background


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("floor", ["chequered", "shadows", "none"])
def test_laid_over_the_background_it_is_the_picture_before_it(backend, floor):
    image = picture(backend, floor=floor)
    opaque = picture(backend, floor=floor, transparent=False)
    assert (image.shape, image.dtype) == ((90, 160, 4), np.uint8)
    # Colors and opacities are rounded to 1/255, which adds up to 2. A ray caster refines pixels where its rays
    # differ, which depends on the background: some edges are a few steps apart.
    apart = np.abs(over(image, SKY) - opaque)
    assert (apart > 2.5).mean() < (0.03 if backend == "raycast" else 1e-9)
    assert apart.max() < 16
    opacity = image[..., 3]
    assert opacity.max() == 255
    assert (opacity == 0).mean() > 0.05  # the sky
    shadow = (opacity > 0) & (image[..., :3].max(axis=2) == 0)
    assert shadow.any() == (floor == "shadows")


@pytest.mark.parametrize("backend", BACKENDS)
def test_sections_seen_by_a_camera_on_its_way_can_be_transparent(backend):
    way = [msd.Viewpoint(time=t, target=(t, 0.0, 0.3)) for t in (0.0, 1.0)]
    look = msd.Look(azimuth=-90.0, distance=2.0, path=way, cut=msd.Plane((0, -1, 0)), floor="none")
    scene, coloring = msd.Scene(system=CUBE + JELLY, look=look), msd.ColorScale("x [m]", 1.0)
    position = scene.system.position
    how = {"resolution": (160, 90), "backend": backend, "device": "cpu", "coloring": coloring}
    image, opaque = (
        msd.Renderer(scene, position, transparent=one, **how).image(position, 0.6, values=position[:, 0])
        for one in (True, False)
    )
    apart = np.abs(over(image, SKY) - opaque)
    assert (apart > 2.5).mean() < (0.03 if backend == "raycast" else 1e-9)  # for reasons see above
    assert apart.max() < 16
    assert (image[..., 3] == 255).mean() > 0.01
    assert image[2, -2, 3] == VEIL[3]  # the legend's background


def test_only_chosen_bodies_are_drawn():
    empty = picture("raster", ["obstacles"], floor="none")[..., 3]
    assert (empty > 0).any()
    for bodies, others in ((["cube"], ["jelly", "obstacles"]), (["jelly"], ["cube", "obstacles"])):
        alone = picture("raster", bodies, floor="none")[..., 3] > 0
        rest = picture("raster", others, floor="none")[..., 3] > 0
        both = picture("raster", floor="none")[..., 3] > 0
        np.testing.assert_array_equal(alone | rest, both)
        assert not (alone & rest).any()  # they stand side by side
    with pytest.raises(ValueError, match="body is 'cat'; it must be one of 'cube', 'jelly', 'obstacles'"):
        picture("raster", ["cat"])


def test_files_keep_opacity(tmp_path):
    rows, columns = np.mgrid[:48, :64]
    images = []
    for k in range(4):
        inside = (np.abs(columns - 12 - 8 * k) < 8) & (np.abs(rows - 24) < 8)
        images.append(np.where(inside[..., None], np.uint8([200, 30, 30, 160]), np.uint8(0)))
    path = film.write_film(iter(images), tmp_path, name="bar", fps=20)
    with Image.open(path) as opened:
        assert opened.n_frames == 4
        for k, image in enumerate(images):
            np.testing.assert_array_equal(np.asarray(Image.open(tmp_path / f"frame_{k:04d}.png")), image)
            opened.seek(k)
            np.testing.assert_array_equal(np.asarray(opened.convert("RGBA"))[..., 3], image[..., 3])
    with pytest.raises(
        ValueError, match="video is 'gif'; with a transparent background it must be 'webp' or 'none'"
    ):
        film.check_formats("png", "gif", True)
