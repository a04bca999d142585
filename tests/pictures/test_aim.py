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
        seen = framed(scene(), positions, range(11), 1.5)
        every = np.concatenate([outermost(x, scene().look, 1.5) for x in positions])
        assert np.array_equal(seen, every) != straggles
    assert seen[:, 0].max() == pytest.approx(calm[:, :, 0].max(), abs=0.01)
    start = moved(SYSTEM.position, "c", (4, 0, 0))  # what is far from the start, and moves a little, is in view
    away = np.array([moved(start, "c", (t, 0, 0)) for t in steps])
    assert framed(scene(), away, range(11), 1.5)[:, 0].max() == pytest.approx(away[:, :, 0].max(), abs=0.01)
    pair = CUBE + CUBE.translate((0.3, 0, 0))  # of two bodies neither is the rest
    both = np.array([pair.position, pair.position + np.where(np.arange(16) < 8, 0, 30)[:, None]])
    assert framed(msd.Scene(system=pair), both, range(2), 1.5).max() > 30
