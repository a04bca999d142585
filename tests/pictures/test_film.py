"""Frames and films on disk."""

import contextlib
import errno
import io
import itertools
import time
import zlib
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from msdwarp.pictures import film


def pictures(count):
    for k in range(count):
        image = np.full((48, 64, 3), 230, np.uint8)
        image[:, 4 * k % 64 : 4 * k % 64 + 8] = (200, 30, 30)
        yield image


@pytest.mark.parametrize("video", ["webp", "gif"])
def test_every_picture_is_written(tmp_path, video):
    path = film.write_film(pictures(13), tmp_path, name="bar", fps=20, video=video)
    assert path == tmp_path / f"bar.{video}"
    assert sorted(p.name for p in tmp_path.glob("*.png")) == [f"frame_{k:04d}.png" for k in range(13)]
    for k, image in enumerate(pictures(13)):
        np.testing.assert_array_equal(np.asarray(Image.open(tmp_path / f"frame_{k:04d}.png")), image)
    with Image.open(path) as opened:
        assert opened.n_frames == 13
        for k, image in enumerate(pictures(13)):
            opened.seek(k)
            opened.load()
            assert opened.info["duration"] == 50
            # Lossy (WebP) or of few colors (GIF): close on the whole.
            assert np.abs(np.asarray(opened.convert("RGB")).astype(int) - image).mean() < 6


def test_a_gif_leaves_out_frames_that_viewers_cannot_show(tmp_path):
    path = film.write_film(pictures(13), tmp_path, name="bar", fps=60, frames="none", video="gif")
    with Image.open(path) as opened:
        assert opened.n_frames == 7  # every second
        assert opened.info["duration"] == 30  # 1/30 s in whole hundredths
    assert not list(tmp_path.glob("*.png"))


def test_frames_without_a_film(tmp_path):
    assert film.write_film(pictures(3), tmp_path, name="bar", fps=60, video="none") is None
    assert len(list(tmp_path.iterdir())) == 3


def test_a_film_that_fails_leaves_none_and_keeps_the_frames(tmp_path):
    def failing():
        yield from pictures(4)
        raise RuntimeError("no more")

    with pytest.raises(RuntimeError, match="no more"):
        film.write_film(failing(), tmp_path, name="bar", fps=60)
    assert sorted(p.name for p in tmp_path.iterdir()) == [f"frame_{k:04d}.png" for k in range(4)]


def test_a_film_that_cannot_be_written_ends_the_drawing(tmp_path, monkeypatch):
    def fails(images, *others):
        next(images)
        raise OSError("the disk is full")

    monkeypatch.setattr(film, "_write_film", fails)
    endless, drawn = itertools.cycle(pictures(3)), 0

    def counted():
        nonlocal drawn
        for image in endless:
            drawn += 1
            yield image

    with pytest.raises(OSError, match="the disk is full"):
        film.write_film(counted(), tmp_path, name="bar", fps=60, frames="none")
    assert drawn < 1000  # it ends within moments


@pytest.mark.parametrize(
    ("formats", "name"),
    [
        ({"frames": "png", "video": "none"}, r"frame_000\d\.png"),
        ({"frames": "png", "video": "webp"}, r"frame_000\d\.png"),
        ({"frames": "none", "video": "webp"}, r"bar\.webp"),
        ({"frames": "none", "video": "gif"}, r"bar\.gif"),
    ],
)
def test_a_full_disk_is_named_with_the_file(tmp_path, monkeypatch, formats, name):
    def full(*_, **__):
        raise OSError(errno.ENOSPC, "No space left on device")

    for place, what in ((Path, "write_bytes"), (film, "_write_webp"), (film.Image.Image, "save")):
        if what != "_write_webp" or formats == {"frames": "none", "video": "webp"}:
            monkeypatch.setattr(place, what, full)
    if formats["video"] == "webp":  # whose parts are encoded in memory
        monkeypatch.setattr(film, "_changed_part", lambda *_: (b"", b""))
    with pytest.raises(OSError, match=rf"{name} could not be written: No space left on device"):
        film.write_film(pictures(4), tmp_path, name="bar", fps=60, **formats)
    assert not list(tmp_path.iterdir())


def test_no_more_pictures_wait_than_a_few(tmp_path, monkeypatch):
    drawn = 0

    def counted():
        nonlocal drawn
        for image in pictures(40):
            drawn += 1
            yield image

    ahead = []

    def slow(images, *others):
        for k, _ in enumerate(images):
            time.sleep(0.002)
            ahead.append(drawn - k)

    monkeypatch.setattr(film, "_write_film", slow)
    with contextlib.suppress(OSError):  # `slow` writes no film that could get its name
        film.write_film(counted(), tmp_path, name="bar", fps=60, frames="none")
    assert len(ahead) == 40
    # Those that are compressed, the one in the film's hands and the one that was just drawn.
    assert max(ahead) <= film.MOST_WRITERS + 2


def test_a_film_shows_what_moves_and_what_has_gone(tmp_path):
    """A spot in an odd-sized picture jumps about, stands still, leaves, and comes back."""
    places = [(0, 0), (31, 50), (31, 50), (7, 3), None, (46, 62)]

    def spots():
        for place in places:
            image = np.full((49, 65, 3), 230, np.uint8)
            if place is not None:
                image[place[0] : place[0] + 9, place[1] : place[1] + 9] = (200, 30, 30)
            yield image

    path = film.write_film(spots(), tmp_path, name="spots", fps=60, frames="none")
    with Image.open(path) as opened:
        durations = []
        for k, image in enumerate(spots()):
            opened.seek(k)
            shown = np.asarray(opened.convert("RGB")).astype(int)
            durations.append(opened.info["duration"])
            # Compression blurs the spot's edges, by less than half of the step from red to grey, 200.
            assert np.abs(shown - image).mean() < 3
            assert ((shown[..., 1] < 130) == (image[..., 1] < 130)).mean() > 0.99
    assert durations == [17, 16, 17, 17, 16, 17]  # whole milliseconds that add up to the film's time


def test_a_film_keeps_no_traces_of_what_moved_on(tmp_path):
    row, column = np.mgrid[:120, :160]

    def discs():
        for k in range(40):
            image = np.full((120, 160, 3), 230, np.uint8)
            image[(row - 30 - k) ** 2 + (column - 30 - 2 * k) ** 2 < 20**2] = (200, 30, 30)
            yield image

    path = film.write_film(discs(), tmp_path, name="disc", fps=60, frames="none")
    with Image.open(path) as opened:
        opened.seek(39)
        shown = np.asarray(opened.convert("RGB")).astype(int)
    away = (row - 69) ** 2 + (column - 108) ** 2 > 50**2
    # A flat grey is rounded only; without a margin the red that WebP smears stays, 20 and more.
    assert np.abs(shown[away] - 230).max() <= 4


@pytest.mark.parametrize("compressor", [film.zlib, zlib], ids=["usual", "fallback"])
def test_pngs_are_what_was_drawn(monkeypatch, compressor):
    monkeypatch.setattr(film, "zlib", compressor)
    image = np.random.default_rng(3).integers(0, 256, (37, 53, 3), dtype=np.uint8)
    with Image.open(io.BytesIO(film.png(image))) as opened:
        assert opened.mode == "RGB"
        np.testing.assert_array_equal(np.asarray(opened), image)


@pytest.mark.parametrize(
    ("formats", "message"),
    [
        (("jpeg", "webp"), "frames is 'jpeg'"),
        (("png", "avi"), "video is 'avi'"),
        (("png", "mp4"), r"msdwarp\[video\]"),  # the extra that it needs
    ],
)
def test_bad_formats_are_named(monkeypatch, formats, message):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(ValueError, match=message):
        film.check_formats(*formats)
