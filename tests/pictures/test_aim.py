"""Aiming the camera: at a point, from a distance, at a body that moves, and past stragglers."""

import numpy as np
import pytest
from backends import BACKENDS

import msdwarp as msd
from msdwarp.pictures import Stage, framed
from msdwarp.pictures.stage import outermost

CUBE = msd.box((2, 2, 2), 0.1)
SYSTEM = CUBE.named("a") + CUBE.translate((0.3, 0, 0)).named("b") + CUBE.translate((0, 0.3, 0)).named("c")
SIZE = (320, 180)


def scene(**look):
    return msd.Scene(system=SYSTEM, colliders=[msd.Plane()], look=msd.Look(azimuth=-90, elevation=0, **look))


def stage(**look):
    return Stage(scene(**look), SYSTEM.position, SIZE)


def moved(position, group, way):
    position = np.array(position)
    position[SYSTEM.groups[group]] += way
    return position


def test_a_camera_looks_at_its_target_from_its_distance():
    camera = stage(target=(1, 2, 3), distance=5.0).camera
    np.testing.assert_allclose(camera.target, (1, 2, 3))
    np.testing.assert_allclose(camera.eye, (1, -3, 3), atol=1e-12)  # rounding of a cosine
    camera = Stage(scene(distance=5.0), SYSTEM.position, SIZE, zoom=2.0).camera
    assert np.linalg.norm(camera.eye - camera.target) == pytest.approx(2.5)


def test_without_a_distance_all_is_in_view_of_a_camera_with_a_target():
    camera = stage(target=(-1, 0, 0.5)).camera
    row, column = camera.pixels(SYSTEM.position, SIZE[1], SIZE[0])
    inside = min(row.min(), column.min(), SIZE[1] - row.max(), SIZE[0] - column.max())
    # The margin: 12 % of half the width, 160 pixels, is kept free where the view is filled.
    assert inside == pytest.approx(160 * (1 - 1 / 1.12), abs=1e-6)


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_camera_follows_its_body(backend):
    renderer = msd.Renderer(scene(follow="b"), SYSTEM.position, resolution=SIZE, backend=backend, device="cpu")
    at_start = renderer.image(SYSTEM.position).astype(int)
    # Ten tiles of the ground further, everything looks the same.
    way = 20 * renderer.stage.ground.tile * np.array([0.0, 1.0, 0.0])
    there = renderer.image(SYSTEM.position + way).astype(int)
    assert np.abs(there[60:] - at_start[60:]).mean() < 2  # the ground fades elsewhere
    left = renderer.image(moved(SYSTEM.position, "b", way)).astype(int)
    assert np.abs(left - at_start).max() > 100  # the others stay behind
    np.testing.assert_array_equal(renderer.image(SYSTEM.position), at_start)


def test_a_straggler_does_not_widen_the_view():
    steps = np.linspace(0, 1, 11)
    calm = np.array([moved(SYSTEM.position, "a", (0.5 * t, 0, 0)) for t in steps])
    flight = np.array([moved(x, "c", (30 * t, 0, 0)) for x, t in zip(calm, steps, strict=True)])
    for positions, straggles in ((calm, False), (flight, True)):
        _, seen = framed(scene(), positions, steps, range(11), 1.5)
        every = np.concatenate([outermost(x, scene().look, 1.5) for x in positions])
        assert np.array_equal(seen, every) != straggles
    assert seen[:, 0].max() == pytest.approx(calm[:, :, 0].max(), abs=0.01)
    start = moved(SYSTEM.position, "c", (4, 0, 0))  # what is far from the start, and moves a little, is in view
    away = np.array([moved(start, "c", (t, 0, 0)) for t in steps])
    assert framed(scene(), away, steps, range(11), 1.5)[1][:, 0].max() == pytest.approx(
        away[:, :, 0].max(), abs=0.01
    )


PAIR = CUBE + CUBE.translate((0.3, 0, 0))
ROPE = msd.chain(16, 0.02)
TORN = ROPE.replace(broken_at=np.where(np.arange(15) == 7, 0.5, np.inf))


@pytest.mark.parametrize(("system", "leaves"), [(PAIR, True), (TORN, True), (ROPE, False)])
def test_of_two_bodies_the_one_that_leaves_by_ten_times_their_reach_is_left_out(system, leaves):
    """Both are within 0.24 m of their middle: at 1 m the second is in view, at 30 m only at the start."""
    for way in (1.0, 30.0):
        shift = np.where(np.arange(16) < 8, 0, way)[:, None] * (1, 0, 0)
        _, seen = framed(
            msd.Scene(system=system), np.array([system.position, system.position + shift]), [0, 1], range(2), 1.5
        )
        assert (seen.max() < way) == (leaves and way > 2.4)


def filled(camera, position):
    """Return the shares of the width and the height of a picture that particles fill; all must be in it."""
    row, column = camera.pixels(position, SIZE[1], SIZE[0])
    assert min(row.min(), column.min(), SIZE[1] - row.max(), SIZE[0] - column.max()) >= 0
    return np.ptp(column) / SIZE[0], np.ptp(row) / SIZE[1]


def test_obstacles_that_move_are_in_view_and_large_ones_that_do_not_are_not():
    slab = msd.Box((4.0, 0.0, -0.5), (20.0, 20.0, 1.0))
    alone = msd.Scene(system=SYSTEM, colliders=[slab])
    assert max(filled(Stage(alone, SYSTEM.position, SIZE).camera, SYSTEM.position)) > 0.5
    moving = msd.Sphere((0.0, 0.0, 0.0), 0.1, motion=lambda t: (t, 0.0, 0.0))
    stage = Stage(msd.Scene(system=SYSTEM, colliders=[slab, moving], duration=3.0), SYSTEM.position, SIZE)
    filled(stage.camera, np.array([[3.1, 0.0, 0.0], [3.0, 0.0, 0.1]]))
    assert stage.camera.distance > 2


@pytest.mark.parametrize("hops", [0.0, 0.1])
def test_the_camera_follows_what_travels(hops):
    times = np.linspace(0, 4, 121)
    way = np.stack([np.sin(0.3 * times) * 10, 2 * times, hops * np.abs(np.sin(9 * times))], axis=1)
    positions = SYSTEM.position + way[:, None]
    seen_by, seen = framed(msd.Scene(system=SYSTEM), positions, times, range(121), SIZE[0] / SIZE[1])
    stage = Stage(seen_by, seen, SIZE)
    cameras = [stage.camera_at(time, None) for time in times]
    for camera, position in zip(cameras, positions, strict=True):
        assert max(filled(camera, position)) > 0.5 - hops
    eyes = np.array([one.eye for one in cameras])
    assert np.ptp(eyes[:, 2]) < 1e-9  # hops of a quarter of its size move no camera
    # From one frame to the next it is as fast as the bodies, at most 3.6 m/s, to the third that means leave out.
    assert np.linalg.norm(np.diff(eyes, axis=0), axis=1).max() < 1.1 * 3.6 / 30
    near = positions * 0.05  # what goes less far than three times its size is seen by a camera at rest
    assert framed(msd.Scene(system=SYSTEM), near + positions[0], times, range(121), 1.5)[0].look.path == ()
    away = msd.Scene(system=SYSTEM, look=msd.Look(distance=5.0))
    assert framed(away, positions, times, range(121), 1.5)[0] is away
