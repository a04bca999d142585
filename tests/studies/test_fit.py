"""Fits find the parameters that made a motion, say how certain they are, and which cannot be seen."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from measurements import BOUNDS, DAMPING, HOW, METHOD, STIFFNESS, SUBSTEPS, dropped, hung, tracked

import msdwarp as msd
from msdwarp import Contact, FitWarning, Probe, Scene, Simulation, TrackedPoints, TrajectoryWriter, fit
from msdwarp.studies.least_squares import Problem

BOTH = ["stiffness", "damping"]
NEAR = {"stiffness": (0.5, 2.0), "damping": (0.5, 2.0)}
"""Bounds of factors."""
FAR = (1.6 * STIFFNESS, 0.5 * DAMPING)
"""Where searches start."""


def assert_found(found, tolerance):
    assert found.values["stiffness"] == pytest.approx(STIFFNESS, rel=tolerance)
    assert found.values["damping"] == pytest.approx(DAMPING, rel=tolerance)


# Without noise the same method with the same substeps leaves residuals of rounding only: 1e-16 m against some
# mm that parameters make. 1e-6 is what is promised; steps end below 1e-9.
EXACT = 1e-6


@pytest.mark.slow
def test_a_hung_block_tells_its_stiffness_and_damping():
    found = fit(hung(*FAR), tracked(hung(), 0.5), BOTH, **HOW)
    assert_found(found, EXACT)
    assert found.converged
    assert found.substeps == SUBSTEPS
    assert not found.alone
    assert found.unseen == ()
    assert found.residual_size["points"] < 1e-9  # m
    np.testing.assert_array_equal(found.scene.system.stiffness, found.values["stiffness"])
    assert "stiffness 200" in repr(found)


def test_a_material_is_told_with_its_cells():
    # Another modulus is another material, whose springs and cells `Material` makes itself; dampers go as its root.
    def held(modulus, **own):
        material = msd.Material(1000.0, modulus, 0.05, poissons_ratio=0.45)
        body = msd.box((4, 2, 2), 0.05, material=material)
        return Scene(system=body.pin(body.position[:, 0] < -0.07), **own)

    start, true = held(6e4), held(8e4)
    found = fit(start, tracked(true, 0.1), BOTH, horizon="whole", substeps=SUBSTEPS, bounds=NEAR, device="cpu")
    assert found.values == pytest.approx({"stiffness": 4 / 3, "damping": (4 / 3) ** 0.5}, rel=EXACT)
    assert "cells" in found.alone
    assert start.system.cells is not None
    assert true.system.cells is not None
    assert found.scene.system.cells is not None
    np.testing.assert_allclose(found.scene.system.cells.modulus, true.system.cells.modulus, rtol=EXACT)
    np.testing.assert_allclose(found.scene.system.cells.damping, true.system.cells.damping, rtol=EXACT)


@pytest.mark.parametrize(("jumps", "jagged"), [((), False), ((3e-4,), True), ((5e-7, -3e-4), True)])
def test_jumps_are_seen_wherever_they_are(jumps, jagged):
    # Of the two jumps of the last case one lies within the difference that a derivative is taken over, which is
    # far too large for it; and to both sides of θ = 0 all changes alike.
    def residuals(theta, end):
        return np.sin(theta) * [1.0, 2.0, 3.0] + 2e-3 * sum(np.sign(theta - at) for at in jumps)

    made_up: Any = SimpleNamespace(count=1, high=np.ones(1), floor=lambda end: 1e-9, residuals=residuals)
    linear = Problem.linear(made_up, np.zeros((1, 1)), 1.0, 1e-6)[0]
    assert Problem.is_jagged(made_up, np.zeros(1), 1.0, linear) is jagged


@pytest.mark.slow
def test_other_precisions_come_close():
    # In float32 forces are rounded by 1e-7 of themselves, and differences over 1e-4 see that as 1e-3 at most;
    # over 1 s it leaves some 1e-4 of the damping, which is seen ten times less than the stiffness.
    measured = tracked(hung())
    assert_found(fit(hung(*FAR), measured, BOTH, precision="float32-compensated", **HOW), 1e-3)


@pytest.mark.slow
@pytest.mark.parametrize(("scene", "seeds"), [(hung, 2), (dropped, 1)])
def test_with_noise_values_lie_within_three_standard_deviations(scene, seeds):
    # Of normal numbers 0.27 % lie outside three standard deviations: of 3 x 2 none in 98 of 100 cases.
    outside = 0
    for seed in range(seeds):
        found = fit(scene(*FAR), tracked(scene(), noise=1e-3, seed=seed), BOTH, **HOW)
        deviations = found.standard_deviations
        true = {"stiffness": STIFFNESS, "damping": DAMPING}
        outside += any(abs(found.values[name] - true[name]) > 3 * deviations[name] for name in BOTH)
        assert found.residual_size["points"] == pytest.approx(1e-3, rel=0.1)  # 1600 numbers tell it to 2 %
    assert outside == 0


@pytest.mark.slow
def test_what_cannot_be_seen_is_named_and_stays():
    # In free fall no spring is stretched.
    falling = Scene(system=hung().system.replace(mass=0.05))
    with pytest.warns(FitWarning, match="stiffness and damping cannot be told apart, or seen"):
        found = fit(falling, tracked(falling, 0.2, noise=1e-3), BOTH, **HOW)
    assert found.unseen == ("stiffness", "damping")
    assert not np.isfinite(found.standard_deviations["stiffness"])
    # What rounding makes of derivatives pulls at it a thousand times less than what holds it.
    assert_found(found, 1e-2)


@pytest.mark.slow
def test_stiffness_and_mass_cannot_be_told_apart_without_a_force_that_is_known():
    # Springs alone accelerate by k/m: only the ratios count.
    body = hung().system
    stretched = body.replace(position=body.position * [1.1, 1.0, 0.9], mass=0.05)
    afloat = Scene(system=stretched, gravity=0.0)
    with pytest.warns(FitWarning, match="cannot be told apart"):
        found = fit(afloat, tracked(afloat, 0.2, noise=1e-4), ["stiffness", "damping", "mass"], device="cpu")
    assert {"stiffness", "mass"} <= set(found.unseen)


def test_bounds_hold_and_say_so():
    with (
        pytest.warns(FitWarning, match="stiffness ends at its bound, 250"),
        pytest.warns(FitWarning, match="residuals of points are alike"),
    ):
        found = fit(
            hung(*FAR), tracked(hung(), 0.3), ["stiffness"], bounds={"stiffness": (250, 1000)}, device="cpu"
        )
    assert found.values["stiffness"] == pytest.approx(250)


@pytest.mark.slow
def test_a_robust_loss_bears_points_that_are_wrong():
    points = tracked(hung(), 0.4, noise=1e-3)
    wrong = points.position.copy()
    wrong[::20] += 0.1  # m: every twentieth was tracked badly
    measured, how = TrackedPoints(points.time, points.particle, wrong), _only("stiffness", HOW)
    start = hung(FAR[0], DAMPING)
    squares = fit(start, measured, ["stiffness"], **how)
    robust = fit(start, measured, ["stiffness"], loss="soft_l1", noise=1e-3, **how)
    # The noise allows some 0.5 %; a wrong point counts 100 of its deviations linearly, which is ten times as much
    # as all others of its 20, instead of 10^4 of them squared.
    assert robust.values["stiffness"] == pytest.approx(STIFFNESS, rel=0.05)
    off = [abs(one.values["stiffness"] - STIFFNESS) for one in (robust, squares)]
    assert off[0] < off[1]


def _only(name, how):
    return how | {"bounds": {name: BOUNDS[name]}}


@pytest.mark.slow
def test_a_probe_and_the_energy_tell_as_well():
    scene = hung()
    low = scene.system.position[:, 2] < scene.system.position[:, 2].min() + 1e-6
    probes = {"foot": Probe(low, "position")}
    true = Simulation.from_scene(
        Scene(system=scene.system, probes=probes),
        integrator=METHOD,
        precision="float64",
        substeps=32,
        device="cpu",
    )
    energy = []
    for _ in range(30):
        true.step()
        measures = true.measure()
        energy.append(measures.energy)
    times, foot = true.readings["foot"]
    height = np.where([False, False, True], foot, np.nan)  # its height alone
    start = Scene(system=hung(*FAR).system, probes=probes)
    found = fit(start, {"foot": (times, height), "energy": (times, energy)}, BOTH, **HOW)
    assert_found(found, EXACT)
    assert set(found.residual_size) == {"foot", "energy"}
    assert found.residual_units == {"foot": "m", "energy": "J"}


@pytest.mark.slow
def test_a_trajectory_is_measured_motion(tmp_path):
    simulation = Simulation.from_scene(hung(), integrator=METHOD, precision="float64", substeps=32, device="cpu")
    with TrajectoryWriter(tmp_path / "run.vtkhdf", simulation.system, fps=60.0) as writer:
        for frame in simulation.frames(0.4):
            writer.write(frame)
    # Files hold float32: 1e-8 m at 0.3 m, against mm that are told by hundreds of points.
    for measured in (tmp_path / "run.vtkhdf", msd.Trajectory(tmp_path / "run.vtkhdf")):
        assert_found(fit(hung(*FAR), measured, BOTH, **HOW), 1e-3)


def test_times_between_frames_are_told_by_a_spline():
    points = tracked(hung(), 0.4, fps=240.0, substeps=8)
    k = np.flatnonzero(np.round(points.time * 240) % 7 == 3)  # no frame's end at 60
    measured = TrackedPoints(points.time[k] + 1e-4, points.particle[k], points.position[k])
    found = fit(hung(*FAR), measured, ["stiffness"], fps=60.0, **_only("stiffness", HOW))
    assert found.fps == 60.0
    # Times are 0.1 ms late, the damping is half; a wrong fps or time would be off by far more.
    assert found.values["stiffness"] == pytest.approx(STIFFNESS, rel=0.1)


@pytest.mark.slow
def test_bodies_that_touch_are_simulated_together():
    def pair(stiffness):
        lower = msd.box((2, 2, 2), 0.1, mass=0.05, stiffness=stiffness, damping=DAMPING)
        upper = lower.translate((0.03, 0.02, 0.2))
        lower = lower.pin(lower.position[:, 2] < lower.position[:, 2].min() + 1e-6)
        return Scene(system=lower + upper, contact=Contact())

    true = pair(STIFFNESS)
    found = fit(pair(1.2 * STIFFNESS), tracked(true, 0.3), ["stiffness"], **_only("stiffness", HOW))
    assert not found.alone
    assert found.values["stiffness"] == pytest.approx(STIFFNESS, rel=EXACT)


@pytest.mark.slow
def test_what_an_ensemble_refuses_is_simulated_one_after_the_other():
    def tilted(*parameters):
        return Scene(system=hung(*parameters).system, schedule=[msd.at(0.1, gravity=(2.0, 0.0, -9.82))])

    found = fit(tilted(1.2 * STIFFNESS, DAMPING), tracked(tilted(), 0.3), ["stiffness"], **_only("stiffness", HOW))
    assert "the scene has a schedule, which worlds of an ensemble cannot have yet" in found.alone
    assert "one after the other" in repr(found)
    assert found.values["stiffness"] == pytest.approx(STIFFNESS, rel=EXACT)


@pytest.mark.slow
def test_several_starts_find_what_one_misses():
    # From a fifth of the stiffness, all at once, the phases of 0.5 s wrap.
    measured = tracked(hung(), 0.5)
    found = fit(hung(STIFFNESS / 3, DAMPING), measured, BOTH, starts=6, horizon="whole", **HOW)
    assert_found(found, EXACT)


@pytest.mark.slow
def test_other_parameters_too():
    body = dropped().system.replace(velocity=(1.0, 0.0, 0.0))
    true = Scene(system=body, colliders=[msd.Plane(restitution=0.3, friction=0.4)], gravity=9.0)
    start = Scene(system=body, colliders=[msd.Plane(restitution=0.3, friction=0.3)], gravity=9.82)
    found = fit(start, tracked(true, 0.4), {"friction": None, "gravity": 9.5}, substeps=32, device="cpu")
    assert found.values["gravity"] == pytest.approx(9.0, rel=EXACT)
    assert found.values["friction"] == pytest.approx(0.4, rel=EXACT)
    assert found.units == {"friction": "", "gravity": "m/s²"}


def test_what_differs_in_the_scene_is_multiplied():
    body = hung().system
    uneven = np.linspace(0.5, 1.5, body.connection_count) * STIFFNESS
    true = Scene(system=body.replace(stiffness=uneven))
    start = Scene(system=body.replace(stiffness=uneven / 1.25))
    found = fit(start, tracked(true, 0.4, substeps=48), ["stiffness"], substeps=48, device="cpu")
    assert found.values["stiffness"] == pytest.approx(1.25, rel=EXACT)
    assert found.units["stiffness"] == "times the scene's own"
