"""Tuning: the error it reports is the error, and the reference knows how far it can be trusted."""

import numpy as np
import pytest

import msdwarp as msd
from msdwarp.studies import accuracy


def oscillator():
    """Return a scene of two particles of 1 kg, 1 m apart at rest, that start 0.1 m too far apart, and its ω."""
    system = msd.chain(2, 1.0, mass=1.0, stiffness=50.0).replace(position=[[-0.55, 0, 0], [0.55, 0, 0]])
    return msd.Scene(system=system, gravity=0.0, duration=2.0), np.sqrt(2 * 50.0)


def test_the_reference_is_as_good_as_it_says():
    scene, omega = oscillator()
    reference = accuracy.make_reference(scene, 2.0, "cpu")
    time = np.arange(121) / 60
    exact = 0.5 + 0.05 * np.cos(omega * time)
    error = np.abs(reference.position[:, 1, 0] - exact) / reference.size
    # The start rounded to float32 is off by up to 3e-8 of the metre: what it is said to be uncertain by.
    assert error.max() <= reference.error.max() < 1e-6


@pytest.mark.slow
def test_the_error_reported_is_that_of_the_closed_form():
    scene, omega = oscillator()
    found, horizon = accuracy.tune(scene, 1e-3, device="cpu", horizon=1.0)
    assert horizon == 1.0
    for one in found:
        _, position = accuracy.simulate(
            scene,
            horizon,
            integrator=accuracy.METHODS[one.method],
            substeps=one.substeps,
            precision=one.precision,
            device="cpu",
        )
        exact = 0.5 + 0.05 * np.cos(omega * np.arange(61) / 60)
        error = np.abs(position[:, 1, 0] - exact).max() / 1.1
        assert one.error == pytest.approx(error, abs=1e-6)  # the reference's own error
    best = accuracy.cheapest(found, 1e-3)
    assert best.error <= 1e-3
    assert best.seconds_between[0] <= best.seconds <= best.seconds_between[1]
    assert best.seconds == min(one.seconds for one in found if one.error <= 1e-3)
    assert "rkc2" not in {one.method for one in found}  # nothing is damped


@pytest.mark.slow
def test_a_body_that_forgets_its_past_is_measured_only_while_it_knows_it():
    # A bar pressed endwise buckles to a side that nothing but rounding chooses.
    bar = msd.chain(12, 0.1, mass=0.01, stiffness=200.0).pin([0, 11])
    squeezed = bar.replace(position=bar.position * (0.8, 1, 1) + np.random.default_rng(0).normal(0, 1e-9, (12, 3)))
    scene = msd.Scene(system=squeezed, gravity=0.0, duration=3.0)
    _, horizon = accuracy.tune(scene, 1e-2, device="cpu", horizon=3.0)
    assert 1 / 60 <= horizon < 2.0


@pytest.mark.parametrize(("tolerance", "message"), [(0, "tolerance is 0"), (1e-14, "must be more than the error")])
def test_bad_tolerances_are_named(tolerance, message):
    scene, _ = oscillator()
    with pytest.raises(ValueError, match=message):
        accuracy.tune(scene, tolerance, device="cpu", horizon=0.2)


def test_methods_that_the_clock_cannot_tell_apart_are_named():
    def one(name, error, seconds, low, high):
        return accuracy.Measurement(name, "float32", 4, error, seconds, (low, high))

    best, near = one("leapfrog", 1e-3, 0.10, 0.09, 0.12), one("rk4", 1e-4, 0.13, 0.11, 0.16)
    far, poor = one("rkc2", 1e-3, 0.2, 0.18, 0.3), one("symplectic-euler", 1e-1, 0.1, 0.09, 0.12)
    assert accuracy.as_fast([far, near, best, poor], 1e-2) == [near]


def test_no_method_good_enough_is_said():
    one = accuracy.Measurement("rk4", "float32", 4, 1e-3, 0.1)
    with pytest.raises(ValueError, match=r"the least error that was reached is 0\.001"):
        accuracy.cheapest([one], 1e-6)


def test_a_scene_that_diverges_by_every_method_is_named(monkeypatch):
    monkeypatch.setattr(accuracy, "_measure_method", lambda *_: iter(()))
    with pytest.raises(ValueError, match=r"every run of every method diverged before 0\.1 s"):
        accuracy.tune(oscillator()[0], 1e-2, device="cpu", horizon=0.1)


def test_a_scene_that_changes_on_its_way_is_not_tuned():
    body = msd.chain(3, stiffness=100.0)
    scene = msd.Scene(system=body, schedule=[msd.at(0.5, stiffness=1e4)])
    with pytest.raises(ValueError, match="the scene has a schedule"):
        accuracy.tune(scene, 1e-2, device="cpu")
