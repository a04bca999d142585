"""Several poses in one picture."""

import numpy as np
import pytest
from backends import BACKENDS, pixel_of

import msdwarp as msd
from msdwarp.pictures.light import SHADOW
from msdwarp.pictures.timelapse import FAINTEST, timelapse

SIZE = (320, 180)
PLACES = np.array([(-1.2, 0, 0.6), (0.0, 0, 0.9), (1.2, 0, 0.8)])


@pytest.fixture
def scene():
    cube = msd.box((3, 3, 3), 0.25, mass=0.1)
    post = msd.Box((0.0, 1.5, 0.4), (0.3, 0.3, 0.8))
    look = msd.Look(color="#c03020", gloss=0.0, azimuth=-90)
    return msd.Scene(system=cube, colliders=[msd.Plane(), post], look=look)


def poses(scene):
    return np.array([scene.system.translate(place).position for place in PLACES])


@pytest.mark.slow
@pytest.mark.parametrize("backend", BACKENDS)
def test_early_poses_are_faint_and_the_last_one_is_opaque(scene, backend):
    positions = poses(scene)
    renderer = msd.Renderer(scene, positions, resolution=SIZE, backend=backend)
    picture = timelapse(renderer, positions, [0.0, 0.5, 1.0]).astype(int)
    assert picture.shape == (180, 320, 3)
    stage = renderer.bare(None).astype(float)
    for k, opacity in enumerate((FAINTEST, (1 + FAINTEST) / 2, 1.0)):
        at = pixel_of(renderer, PLACES[k] + (0.05, -0.25, 0.05))
        image = renderer.image(positions[k]).astype(float)
        wanted = stage[at] + opacity * (image[at] - stage[at])
        np.testing.assert_allclose(picture[at], wanted, atol=1)
        # Its shadow too is as dark as it is opaque.
        light = renderer.stage.camera.light
        shaded = pixel_of(renderer, PLACES[k] - PLACES[k][2] / light[2] * light)
        np.testing.assert_allclose(picture[shaded], (1 - opacity * (1 - SHADOW)) * stage[shaded], atol=2)
    at = pixel_of(renderer, (0.0, 1.35, 0.1))  # the post, seen below the second cube
    np.testing.assert_array_equal(picture[at], stage[at])


@pytest.mark.parametrize("backend", BACKENDS)
def test_one_pose_is_its_picture(scene, backend):
    position = poses(scene)[1]
    renderer = msd.Renderer(scene, position, resolution=SIZE, backend=backend)
    image = renderer.image(position).astype(int)
    difference = np.abs(timelapse(renderer, [position], [0.0]).astype(int) - image).max(axis=2)
    assert (difference[difference > 0] < 60).all()
    # Only on the outline, where the share of the body in a pixel is estimated, do they differ.
    assert (difference > 2).mean() < 0.01


@pytest.mark.slow
def test_a_later_pose_covers_an_earlier_one(scene):
    first = scene.system.translate((0, 0, 0.6)).position
    second = scene.system.translate((0.2, -0.6, 0.6)).position  # in front
    renderer = msd.Renderer(scene, np.array([first, second]), resolution=SIZE, backend="raycast")
    at = pixel_of(renderer, (0.2, -0.85, 0.6))
    alone = renderer.image(second)[at]
    np.testing.assert_array_equal(timelapse(renderer, [first, second], [0, 1])[at], alone)


@pytest.mark.slow
def test_moving_obstacles_are_where_they_are_at_the_last_pose():
    body = msd.box((3, 3, 3), 0.2, mass=0.1).translate((0, 0, 0.4))
    ball = msd.Sphere((1, 0, 0.3), 0.3, motion=lambda t: (t, 0, 0))
    look = msd.Look(obstacle="#2040d0", gloss=0.0, obstacle_gloss=0.0)
    scene = msd.Scene(system=body, colliders=[msd.Plane(), ball], look=look, duration=1.0)
    renderer = msd.Renderer(scene, body.position, resolution=SIZE, backend="raycast")
    picture = timelapse(renderer, [body.position] * 2, [0.0, 1.0])
    red, _, blue = picture[pixel_of(renderer, (2.0, 0, 0.3))].astype(int)
    assert blue > 2 * red
    red, _, blue = picture[pixel_of(renderer, (1.0, 0, 0.3))].astype(int)
    assert blue < 1.3 * red


@pytest.mark.slow
@pytest.mark.parametrize("backend", BACKENDS)
def test_without_ground_and_obstacles_poses_lie_on_the_backdrop(backend):
    scene = msd.Scene(system=msd.box((3, 3, 3), 0.25, mass=0.1), look=msd.Look(background="#eef1f4"))
    positions = poses(scene)
    renderer = msd.Renderer(scene, positions, resolution=SIZE, backend=backend)
    assert (renderer.bare(None) == (0xEE, 0xF1, 0xF4)).all()
    picture = timelapse(renderer, positions, [0.0, 0.5, 1.0])
    assert (picture[0, 0] == (0xEE, 0xF1, 0xF4)).all()
    for place in PLACES:
        assert (picture[pixel_of(renderer, place)] != (0xEE, 0xF1, 0xF4)).any()


@pytest.mark.slow
def test_strain_colors_come_with_their_legend(scene):
    positions = poses(scene)
    renderer = msd.Renderer(scene, positions, resolution=(640, 360), coloring="strain", backend="raycast")
    picture = timelapse(renderer, positions, [0, 1, 2])
    on_white, on_black = (renderer.with_legend(np.full((360, 640, 3), c, np.uint8)) for c in (255, 0))
    legend = (on_white == on_black).all(axis=2)
    assert legend.sum() > 500
    np.testing.assert_array_equal(picture[legend], on_black[legend])


@pytest.mark.parametrize(
    ("count", "times", "message"),
    [
        (0, [], "positions has no pose"),
        (2, [0.0, 1.0, 2.0], r"times has shape \(3,\)"),
        (2, [0.0, np.nan], r"times\[1\] is nan"),
    ],
)
def test_bad_arguments_are_named(scene, count, times, message):
    renderer = msd.Renderer(scene, scene.system.position, resolution=SIZE, backend="raycast")
    with pytest.raises(ValueError, match=message):
        timelapse(renderer, poses(scene)[:count], times)
