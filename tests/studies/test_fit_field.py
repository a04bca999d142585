"""A field of stiffness from tracked points: its gradient, known fields, and what is refused."""

import numpy as np
import pytest

from msdwarp import Scene, Simulation, TrackedPoints, box, fit_field, sheet

GRAVITY = (3.0, -9.82, 0.0)
NOISE = 1e-4


def hanging(factor: float = 1.0) -> Scene:
    """Return a sheet that hangs from its upper edge, softer on its right by this factor."""
    body = sheet((4, 4), 0.1, mass=0.01, stiffness=40.0, damping=0.05)
    middle = body.position[body.connections].mean(axis=1)[:, 0]
    body = body.replace(stiffness=40.0 * np.where(middle > 0, factor, 1.0))
    return Scene(system=body.pin(np.flatnonzero(body.position[:, 1] > 0.14)), gravity=GRAVITY)


def motion(scene: Scene, frames: int, fps: float = 60.0) -> TrackedPoints:
    """Return the motion of all its particles."""
    simulation = Simulation.from_scene(scene, fps=fps, precision="float64", substeps=12, device="cpu")
    found = []
    for _ in range(frames):
        simulation.step()
        found.append(simulation.frame().position)
    count = scene.system.particle_count
    time = np.repeat(np.arange(1, frames + 1) / fps, count)
    return TrackedPoints(time, np.tile(np.arange(count), frames), np.concatenate(found))


@pytest.fixture(scope="module")
def found():
    return fit_field(hanging(), motion(hanging(0.6), 40), noise=NOISE, iterations=30, device="cpu")


@pytest.mark.slow
def test_a_soft_half_is_found(found):
    wanted = hanging(0.6).system.stiffness
    # The other method and step of the measured motion differ by less than the noise. What the motion does not
    # show is smooth: single springs are off by more than their mean over a half.
    right = wanted < 40.0
    assert found.residual < NOISE
    for half, value in ((right, 24.0), (~right, 40.0)):
        assert found.values[half].mean() == pytest.approx(value, rel=0.1)
    off = np.log(found.values / wanted)
    assert np.sqrt((off**2).mean()) < 0.5 * np.sqrt((np.log(40.0 / wanted) ** 2).mean())
    np.testing.assert_array_equal(found.scene.system.stiffness, found.values)
    assert "values of stiffness" in repr(found)


@pytest.mark.parametrize("name", ["stiffness", "mass", "rest_length"])
def test_the_sum_has_the_gradient_of_its_differences(name):
    # Measured between frames, where a spline is read, and with gaps.
    from msdwarp.studies.fit_field import FieldProblem
    from msdwarp.studies.measured import channels_of

    measured = motion(hanging(0.8), 10, fps=53.0)
    measured.position[7::5, 1] = np.nan
    (channel,) = channels_of(measured, hanging(), 1e-3)
    field = FieldProblem(hanging(), channel, name, 60.0, variation=0.3, reach=2.0, device="cpu")
    random = np.random.default_rng(0)
    theta, way = 0.05 * random.normal(size=(2, field.count))
    end = float(channel.time.max())
    _, by_theta = field.cost(theta, end)
    step = 1e-5  # differences are cut off at 1e-10 of the sum, and rounded at 1e-16/1e-5
    values = [field.cost(theta + sign * step * way, end)[0] for sign in (1, -1)]
    assert by_theta @ way == pytest.approx((values[0] - values[1]) / (2 * step), rel=1e-6)


def test_a_uniform_change_costs_nothing_but_what_it_moves():
    # The prior compares neighbours: a factor for all is free.
    from msdwarp.studies.fit_field import FieldProblem
    from msdwarp.studies.measured import channels_of

    scene = hanging(0.6)
    (channel,) = channels_of(motion(scene, 4), scene, 1e-3)
    for name in ("stiffness", "mass"):
        field = FieldProblem(scene, channel, name, 60.0, variation=0.3, reach=2.0, device="cpu")
        assert field.prior(np.full(field.count, 0.3))[0] == pytest.approx(0.0, abs=1e-12)  # rounding of 40 squares
        assert field.prior(np.arange(field.count) / field.count)[0] > 0


def test_what_cannot_be_fitted_is_told():
    scene, measured = hanging(), motion(hanging(), 2)
    with pytest.raises(ValueError, match="name is 'color'; it must be one of 'stiffness'"):
        fit_field(scene, measured, "color", noise=NOISE)
    with pytest.raises(ValueError, match="noise is 0"):
        fit_field(scene, measured, noise=0.0)
    with pytest.raises(ValueError, match="a field is fitted to tracked points"):
        fit_field(scene, {"energy": ([0.1], [1.0])}, noise=NOISE)
    undamped = Scene(system=box((2, 2, 2), 0.1, stiffness=10.0, mass=0.1))
    with pytest.raises(ValueError, match=r"scene\.system\.damping\[0\] is 0\.0; it must be above 0"):
        fit_field(undamped, motion(undamped, 2), "damping", noise=NOISE)
