"""Textures: what is painted, how often, and where it meets itself."""

import numpy as np
import pytest
from PIL import Image
from scipy import ndimage

import msdwarp as msd
from msdwarp import textures
from msdwarp.pictures.dressing import atlas


def face(image, k):
    """Return face k of a box's texture: three columns of two rows, the lower one first."""
    rows, columns = image.shape[0] // 2, image.shape[1] // 3
    top = rows * (1 - k // 3)
    return image[top : top + rows, columns * (k % 3) : columns * (k % 3 + 1)]


@pytest.mark.parametrize("wrong", [{"size": 0}, {"count": 0}, {"size": 2.5}])
def test_sizes_and_counts_are_checked(wrong):
    ((name, value),) = wrong.items()
    with pytest.raises(ValueError, match=rf"{name} is {value}"):
        textures.tiles("#e4633f", "#f2b591", **wrong)


def test_what_is_painted_once_is_nobodys_to_spoil():
    first = textures.tiles("#e4633f", "#f2b591", size=16)
    kept = first.copy()
    first[:] = 0
    np.testing.assert_array_equal(textures.tiles("#e4633f", "#f2b591", size=16), kept)
    np.testing.assert_array_equal(textures.tiles.__wrapped__("#e4633f", "#f2b591", size=16), kept)
    counts: list = [3, 4]  # a list is no key to what was painted before
    image = textures.waffle("#dca350", "#b9742a", counts=counts, size=16)  # type: ignore[arg-type]
    np.testing.assert_array_equal(image, textures.waffle("#dca350", "#b9742a", counts=(3, 4), size=16))


def test_a_die_has_one_to_six_dots_and_opposite_faces_sum_to_seven():
    image = textures.pips("#ffffff", "#000000", size=128)
    dark = image.max(axis=2) < 128
    counts = [ndimage.label(face(dark[..., None], k)[..., 0])[1] for k in range(6)]
    assert sorted(counts) == [1, 2, 3, 4, 5, 6]
    minus_x, plus_x, minus_y, plus_y, minus_z, plus_z = counts
    assert minus_x + plus_x == minus_y + plus_y == minus_z + plus_z == 7
    # Seen from the corner where 1, 2 and 3 meet they go round anticlockwise, as x, y, z do.
    assert (plus_z, plus_x, plus_y) == (1, 2, 3)


def test_a_waffle_closes_around_a_cone():
    for diagonal in (False, True):
        image = textures.waffle("#dca350", "#b9742a", counts=(6, 4), diagonal=diagonal).astype(int)
        inside = np.abs(np.diff(image, axis=1)).max()
        assert np.abs(image[:, 0] - image[:, -1]).max() <= inside


def test_a_waffle_has_as_many_hollows_as_were_asked_for():
    for counts in ((5, 4), (3, 7)):
        image = textures.waffle("#ffffff", "#000000", counts=counts)
        _, found = ndimage.label(image.max(axis=2) < 128)
        assert found == counts[0] * counts[1]


def test_a_flat_box_has_a_waffle_above_and_below():
    image = textures.waffle_box("#ffffff", "#000000", counts=(5, 3))
    for k, (across, up) in ((5, (5, 3)), (4, (3, 5))):  # +z spans x × y, −z y × x
        dark = face(image, k).max(axis=2) < 128
        assert ndimage.label(dark[dark.shape[0] // (2 * up)])[1] == across
        assert ndimage.label(dark[:, dark.shape[1] // (2 * across)])[1] == up


def test_rings_close_around_an_upright_box():
    image, body = textures.rings_box("#000000", "#ffffff", 3, size=120), msd.box((2, 2, 13))
    surface = body.surface
    assert surface is not None
    # The ends of the faces, half a texel inside: neighbours in the texture are other faces.
    places = surface.uv * (3, 2)
    side = np.isin(np.arange(len(places)), np.unique(surface.triangles[: 4 * 12 * 2]))
    tile = np.repeat(np.arange(6), [26, 26, 26, 26, 4, 4])
    inside = np.clip(places - np.stack([tile % 3, tile // 3], axis=1), 0.5 / 120, 1 - 0.5 / 120)
    column = ((tile % 3 + inside[:, 0]) * 120).astype(int)
    row = image.shape[0] - 1 - ((tile // 3 + inside[:, 1]) * 120).astype(int)
    height = body.position[surface.particle, 2]
    height = (height - height.min()) / 12
    # A texel is 1/120 of the height; brightness changes by up to 3 pi times as much, and is rounded to 1/255.
    wanted = 0.5 - 0.5 * np.cos(2 * np.pi * 3 * height)
    np.testing.assert_allclose(image[row, column, 0][side] / 255, wanted[side], atol=3 * np.pi / 120 + 1 / 255)


@pytest.mark.slow
def test_the_stripes_of_a_mattress_run_along_it():
    image = textures.ticking("#ffffff", "#000000", shape=(20, 7, 2), stripes=4)
    upper, lower = face(image, 5).mean(axis=2), face(image, 4).mean(axis=2)
    middle = slice(100, 412)
    assert upper[middle, middle].std(axis=0).mean() > 2 * upper[middle, middle].std(axis=1).mean()
    np.testing.assert_allclose(lower, upper[::-1, ::-1].T)  # the same seen from below


def test_a_scoop_has_no_seam_and_follows_its_seed():
    image = textures.scoop("#f4b8c0", "#9d2f47", flecks=0, size=128).astype(int)
    inside = np.abs(np.diff(image, axis=1)).max()
    assert np.abs(image[:, 0] - image[:, -1]).max() <= inside
    assert np.ptp(image[0], axis=0).max() <= 3  # all round the pole it is one place
    one, other = (textures.scoop("#f4b8c0", "#9d2f47", seed=seed, size=64) for seed in (1, 2))
    assert (one != other).any()


@pytest.mark.parametrize("sizes", [[(4, 6), (9, 3)], [(1, 1), (8, 8)]])
def test_an_atlas_shows_each_image_as_if_it_were_alone(sizes):
    random = np.random.default_rng(1)
    images = [random.integers(0, 256, (*size, 3), dtype=np.uint8) for size in sizes]
    whole, places = atlas(images)

    def seen(image, uv):
        """Return what is at (u, v), linear between pixels, as both renderers take it."""
        at = np.stack([(1 - uv[:, 1]) * image.shape[0], uv[:, 0] * image.shape[1]]) - 0.5
        return np.stack(
            [ndimage.map_coordinates(image[..., k].astype(float), at, order=1, mode="nearest") for k in range(3)],
            axis=1,
        )

    uv = np.concatenate([random.random((200, 2)), [(0, 0), (1, 0), (0, 1), (1, 1)]])
    for image, (corner, scale) in zip(images, places, strict=True):
        np.testing.assert_allclose(seen(whole, corner + scale * uv), seen(image, uv), atol=1e-9)


@pytest.mark.parametrize(
    ("paint", "message"),
    [
        (lambda: textures.pips("white", "#000000"), "color is 'white'"),
        (lambda: textures.waffle("#000000", "#ffffff", counts=(5, 0)), r"counts\[1\] is 0"),
        (lambda: textures.ticking("#000000", "#ffffff", shape=(2, 0, 1)), r"shape\[1\] is 0"),
        (lambda: textures.ticking("#000000", "#ffffff", buttons=0), "buttons is 0"),
        (lambda: textures.scoop("#000000", "#ffffff", flecks=-1), "flecks is -1"),
    ],
)
def test_bad_arguments_are_named(paint, message):
    with pytest.raises(ValueError, match=message):
        paint()


def test_a_texture_may_be_the_path_of_an_image(tmp_path):
    image = np.random.default_rng(0).integers(0, 256, (4, 5, 3), dtype=np.uint8)
    Image.fromarray(image).save(tmp_path / "wood.png")
    look = msd.Look(texture=tmp_path / "wood.png", obstacle_texture=str(tmp_path / "wood.png"))
    np.testing.assert_array_equal(look.texture, image)
    np.testing.assert_array_equal(look.obstacle_texture, image)
    with pytest.raises(FileNotFoundError, match=r"texture is .*oak\.png', and there is no such file"):
        msd.Look(texture=tmp_path / "oak.png")
    (tmp_path / "oak.png").write_text("oak")
    with pytest.raises(ValueError, match=r"texture is .*oak\.png', which is no image"):
        msd.Look(texture=tmp_path / "oak.png")
