"""Moments between the frames of a run, and the pictures that show them."""

import numpy as np
import pytest

from msdwarp import Look, Renderer, Scene, Trajectory, TrajectoryWriter, box
from msdwarp.cli.commands.moments import Moments, exposed
from msdwarp.pictures import exposure

CUBE = box((3, 3, 3), 0.1)


@pytest.fixture
def thrown(tmp_path):
    """Yield a run of a cube that flies: its position is x + v t + g t²/2."""
    velocity, gravity = np.array([2.0, 0.0, 3.0]), np.array([0.0, 0.0, -9.81])
    with TrajectoryWriter(tmp_path / "a.vtkhdf", CUBE, fps=10) as writer:
        for k in range(4):
            t = k / 10
            writer.write(
                (t, CUBE.position + velocity * t + gravity * t**2 / 2, 0 * CUBE.position + velocity + gravity * t)
            )
    with Trajectory(writer.path) as found:
        yield found, lambda t: CUBE.position + velocity * t + gravity * t**2 / 2


def test_between_frames_a_body_flies_on(thrown):
    trajectory, exact = thrown
    speeds = [np.full(CUBE.particle_count, 2.0 * k) for k in range(4)]
    run = Moments(trajectory, speeds.__getitem__, None)
    for moment in (0.0, 0.3, 1.0, 2.75, 3.0):
        position, time, values, forces = run.at(moment)
        assert time == pytest.approx(moment / 10)
        np.testing.assert_allclose(position, exact(moment / 10), atol=1e-6)  # stored in float32
        np.testing.assert_allclose(values, 2.0 * moment)
        assert forces is None
    np.testing.assert_array_equal(run.at(2)[0], trajectory.positions[2])
    assert exposed(1.0, 0.5, 2, range(4)) == pytest.approx([0.875, 1.125])
    assert exposed(0.0, 0.5, 2, range(4)) == pytest.approx([0.0, 0.125])  # nothing is before the first frame


def test_motion_blur_is_the_mean_of_pictures(thrown):
    trajectory, _ = thrown
    look = Look(elevation=0.0, azimuth=-90.0, floor="none", gloss=0.0)
    scene, run = Scene(system=CUBE, look=look), Moments(trajectory, None, None)
    how = {"resolution": (160, 90), "backend": "raster", "transparent": True}
    renderer = Renderer(scene, trajectory.positions[:], **how)
    still, blurred = (
        exposure(renderer, map(run.at, [1.0 + step * k for k in range(16)]))[..., 3] / 255
        for step in (0.0, 1 / 16)
    )
    assert still.sum() == pytest.approx(
        blurred.sum(), rel=0.02
    )  # the cube is as large wherever it is; perspective
    assert blurred.max(initial=0.0) <= 1
    soft = ((blurred > 0.1) & (blurred < 0.9)).sum()
    assert soft > 3 * ((still > 0.1) & (still < 0.9)).sum()
