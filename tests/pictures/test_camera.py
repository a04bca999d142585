"""The camera's field of view, and its path over time."""

import math

import numpy as np
import pytest
from backends import BACKENDS

import msdwarp as msd
from msdwarp.pictures import exposure
from msdwarp.pictures.stage import Stage, _smooth
from msdwarp.world.stored_scene import scene_as_stored, scene_from_stored

SIZE = (160, 90)


@pytest.fixture(scope="module")
def cube():
    return msd.box((3, 3, 3), 0.1).translate((0, 0, 0.3))


def scene_of(cube, **look):
    return msd.Scene(system=cube, colliders=[msd.Plane()], look=msd.Look(color="#c03020", **look))


def reddish(image):
    """Return the rows and columns of the red body's pixels."""
    red = image.astype(int)
    return np.nonzero(red[..., 0] - red[..., 1] > 40)


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("angle", [10.0, 30.0, 90.0])
def test_a_body_appears_where_its_field_of_view_puts_it(cube, backend, angle):
    """A camera 2 m from the middle of a cube sees 4 m tan(angle / 2) over the picture's height there."""
    centre = tuple(cube.center_of_mass)
    scene = scene_of(cube, azimuth=0, elevation=0, target=centre, distance=2.0, field_of_view=angle)
    renderer = msd.Renderer(scene, cube.position, resolution=SIZE, backend=backend)
    rows, _ = reddish(renderer.image(cube.position))
    near = 2.0 - 0.1  # its face towards the camera, 0.2 m wide
    expected = SIZE[1] * 0.2 / (2 * near * math.tan(math.radians(angle) / 2))
    assert np.ptp(rows) + 1 == pytest.approx(expected, abs=2)  # whole pixels, on either side
    assert rows.mean() == pytest.approx((SIZE[1] - 1) / 2, abs=1.5)


SHEET = msd.sheet((4, 3), 0.1, mass=0.01, stiffness=10.0)
UPRIGHT = SHEET.rotate(math.pi / 2, axis=(1, 0, 0))
PEG = msd.Sphere((0.1, 0.0, -0.5), 0.1)
AHEAD, LOW, ABOVE, OBLIQUE = (-90.0, 0.0), (-90.0, 5.0), (-90.0, 90.0), (-60.0, 16.0)


@pytest.mark.parametrize(
    ("system", "more", "seen_from"),
    [
        (msd.chain(3, dim=1), {}, AHEAD),
        (msd.voxels(np.ones((2, 3), int), 0.1), {}, AHEAD),
        (msd.voxels(np.ones((2, 3), int), 0.1), {"colliders": [msd.Plane()]}, LOW),
        (
            UPRIGHT,
            {
                "colliders": [PEG, msd.Plane((1.0, 0, 1.0), -1.0)],
                "loads": [msd.Force((0.1, 0, 0))],
                "contact": msd.Contact(),
            },
            LOW,
        ),
        (SHEET, {"gravity": (0, -9.8, 0)}, ABOVE),
        (SHEET.rotate(math.pi / 2, axis=(0, 1, 0)), {"colliders": [msd.Plane()]}, (0.0, 5.0)),
        (SHEET, {}, OBLIQUE),
        (UPRIGHT.spin((0, 0, 1.0)), {}, OBLIQUE),
        (UPRIGHT, {"colliders": [msd.Sphere((0.1, 0.01, -0.5), 0.1)]}, OBLIQUE),
        (UPRIGHT, {"colliders": [msd.Plane((0, 0.1, 1.0), -1.0)]}, OBLIQUE),
        (UPRIGHT, {"loads": [msd.Force((0, 0.1, 0))]}, OBLIQUE),
        (UPRIGHT, {"loads": [msd.Wind((1.0, 0, 0))]}, OBLIQUE),
        (UPRIGHT, {"gravity": lambda t: 9.8}, OBLIQUE),
    ],
)
def test_what_stays_in_a_plane_is_seen_from_its_front(system, more, seen_from):
    look = msd.Scene(system=system, **more).look
    assert (look.azimuth, look.elevation) == seen_from
    look = msd.Scene(system=system, look=msd.Look(azimuth=12.0), **more).look
    assert (look.azimuth, look.elevation) == (12.0, seen_from[1])


def path():
    return [
        msd.Viewpoint(time=0.5, azimuth=-60.0),
        msd.Viewpoint(time=1.0, azimuth=20.0, distance=1.0),
        msd.Viewpoint(time=3.0, azimuth=20.0, elevation=60.0, target=(0.1, 0.0, 0.3), distance=4.0),
    ]


@pytest.mark.slow
@pytest.mark.parametrize("backend", BACKENDS)
def test_at_its_viewpoints_a_moving_camera_draws_what_one_there_draws(cube, backend):
    moving = msd.Renderer(scene_of(cube, path=path()), cube.position, resolution=SIZE, backend=backend)
    for point in path():
        views = {"azimuth": 20.0, "elevation": 16.0} | {
            name: value for name, value in vars(point).items() if value is not None and name != "time"
        }
        still = Stage(scene_of(cube, **views), cube.position, SIZE).camera
        moving.image(cube.position, point.time)
        there = moving.stage.camera_at(point.time, None)
        for name in ("eye", "target", "right", "up"):
            np.testing.assert_allclose(getattr(there, name), getattr(still, name), atol=1e-12)  # rounding
    first = msd.Renderer(scene_of(cube, azimuth=-60.0), cube.position, resolution=SIZE, backend=backend)
    np.testing.assert_array_equal(moving.image(cube.position, 0.0), first.image(cube.position, 0.0))
    # The lights stay where they were: only where the body appears is compared.
    rows, columns = reddish(moving.image(cube.position, 3.0))
    row, column = moving.stage.camera_at(3.0, None).pixels(cube.position, SIZE[1], SIZE[0])
    assert [rows.min(), rows.max()] == pytest.approx([row.min(), row.max()], abs=1.5)  # pixels
    assert [columns.min(), columns.max()] == pytest.approx([column.min(), column.max()], abs=1.5)


def test_a_path_is_smooth_monotone_and_at_rest_at_its_ends():
    times, values = np.array([0.5, 1.0, 3.0, 3.5]), np.array([[0.0, 5.0], [1.0, 5.0], [4.0, 2.0], [3.0, 2.0]])
    dense = np.linspace(0, 4, 4001)
    found = np.array([_smooth(times, values, time) for time in dense])
    np.testing.assert_allclose([_smooth(times, values, time) for time in times], values, atol=1e-14)
    speed = np.diff(found, axis=0) / 1e-3
    # A cubic's second derivative is at most 6 |difference| / step² here: speeds change by that in a millisecond.
    assert np.abs(np.diff(speed, axis=0)).max() < 12 * 1e-3 * (1 / 0.5**2) * 2
    assert not speed[dense[1:] <= 0.5].any()
    assert not speed[dense[:-1] >= 3.5].any()
    assert (np.diff(found[dense <= 3.0, 0]) >= -1e-15).all()
    assert (np.diff(found[:, 1]) <= 1e-15).all()


def test_a_camera_on_a_path_follows_its_body(cube):
    points = [msd.Viewpoint(time=0.0, azimuth=0.0), msd.Viewpoint(time=1.0, azimuth=90.0)]
    named, way = cube.named("cube"), np.array([3.0, 0.0, 0.0])
    stage = Stage(scene_of(named, path=points, follow="cube"), named.position, SIZE)
    for time, azimuth in ((0.0, 0.0), (1.0, 90.0)):
        camera = stage.camera_at(time, named.position + way)
        np.testing.assert_allclose(camera.target, named.center_of_mass + way, atol=1e-12)  # rounding
        away = camera.eye - camera.target
        assert math.degrees(math.atan2(away[1], away[0])) == pytest.approx(azimuth)


def test_a_stored_scene_keeps_its_camera(cube):
    scene = scene_of(cube, path=path(), field_of_view=45.0)
    look = scene_from_stored(cube, *scene_as_stored(scene, [0.0])).look
    assert look.field_of_view == 45.0
    assert [vars(one) for one in look.path] == [vars(one) for one in path()]
    assert not {"path", "field_of_view"} & scene_as_stored(scene_of(cube), [0.0])[0]["look"].keys()


def test_looks_of_groups_in_older_files_name_fields_of_the_whole_picture(cube):
    scene = msd.Scene(system=cube.named("cube"), looks={"cube": msd.Look(color="#c03020")})
    described, arrays = scene_as_stored(scene, [0.0])
    described["looks"][0]["look"] |= {"azimuth": -60.0, "elevation": 16.0}
    again = scene_from_stored(scene.system, described, arrays)
    assert again.looks["cube"].color == "#c03020"
    assert (again.look.azimuth, again.look.elevation) == OBLIQUE


@pytest.mark.slow
@pytest.mark.parametrize("backend", BACKENDS)
def test_a_still_is_the_mean_of_shifted_views(cube, backend):
    """It is close to a picture of eight times the size, reduced, and nothing moves."""
    scene = scene_of(cube, azimuth=20.0)
    coarse = msd.Renderer(scene, cube.position, resolution=SIZE, backend=backend)
    fine = msd.Renderer(scene, cube.position, resolution=(8 * SIZE[0], 8 * SIZE[1]), backend=backend)
    exact = fine.image(cube.position).reshape(SIZE[1], 8, SIZE[0], 8, 3).mean(axis=(1, 3))
    plain = coarse.image(cube.position)
    smooth = exposure(coarse, [(cube.position, 0.0, None, None)] * 32)
    near = np.ptp(exact[1:-1, 1:-1], axis=2) > 40  # the body and its edges; shadows on the ground are grey
    # Samples may lie half a pixel beside their pixel: at edges, a tenth of these pixels, that is a slight blur.
    assert np.abs(smooth - exact)[1:-1, 1:-1][near].mean() < 1.0  # of 255
    middles = (np.array(reddish(image)).mean(axis=1) for image in (smooth, plain))
    np.testing.assert_allclose(*middles, atol=0.25)  # pixels
    np.testing.assert_array_equal(coarse.image(cube.position), plain)  # the camera is where it was
