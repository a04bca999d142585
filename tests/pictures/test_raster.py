"""The rasteriser: what it covers, what reaches behind the camera, and its threads."""

import numpy as np
import pytest

import msdwarp as msd

SIZE = (320, 180)


def test_a_square_covers_as_much_of_the_picture_as_geometry_says():
    sheet = msd.sheet((5, 5), 0.25).rotate(0.4, axis=(1, 2, 3))
    look = msd.Look(colour="#000000", background="#ffffff", gloss=0.0, azimuth=-70, elevation=35)
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
