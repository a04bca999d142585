"""A hand that holds particles, lets go and takes hold of others while a simulation runs."""

import numpy as np
import pytest

from msdwarp import Attachment, Plane, Simulation, box
from msdwarp.world import MouseSpring

CUBE = box((3, 3, 3), 0.1, mass=0.01, stiffness=200.0, damping=0.1).translate((0, 0, 0.1))


def moved(loads, **options):
    how = {"colliders": [Plane()], "device": "cpu", "substeps": 20} | options
    return Simulation(CUBE, loads=loads, **how)


def test_a_hand_holds_as_an_attachment_does(device):
    held, points = [20, 4], np.array([[0.3, 0, 0.4], [0, 0.2, 0.5]])
    by_hand = moved([MouseSpring(on=held, to=points, stiffness=30, damping=0.2)], device=device)
    attached = Attachment(on=sorted(held), to=points[::-1], stiffness=30, damping=0.2)
    by_spring = moved([attached], device=device)
    if device.startswith("cuda") and by_hand.model.force_algorithm == "scatter":
        pytest.skip("scattered sums on the GPU are not repeatable")
    for one in (by_hand, by_spring):
        one.step(10)
    np.testing.assert_array_equal(by_hand.frame().position, by_spring.frame().position)
    # The same numbers, summed in the same order.
    assert by_hand.measure().energy == by_spring.measure().energy


def test_a_hand_takes_hold_and_lets_go_without_building_anew():
    simulation = moved([MouseSpring()], substeps="auto")
    simulation.step(5)
    model = simulation.model
    hold = MouseSpring(on=[26], to=[[0.2, 0.2, 0.8]], stiffness=100, damping=1.0)
    simulation.change(loads=[hold])
    assert simulation.model is model
    low = simulation.frame().position[26, 2]
    simulation.step(60)
    assert simulation.frame().position[26, 2] > low + 0.2
    assert simulation.model is model
    simulation.change(loads=[MouseSpring()])
    before = simulation.frame().velocity[:, 2].mean()
    simulation.step(6)
    # Let go, it falls freely as a whole: inner forces cancel but for rounding of some 1e-6 of speeds of 1 m/s.
    assert simulation.frame().velocity[:, 2].mean() - before == pytest.approx(-9.82 * 6 / 60, abs=1e-5)


def test_energy_that_a_hand_brings_in_is_no_divergence():
    for substeps in ("auto", 20):
        simulation = moved([MouseSpring()], substeps=substeps)
        for k in range(40):
            to = [[0.5 * (-1) ** (k // 10), 0.0, 0.6]] * 9
            simulation.change(loads=[MouseSpring(on=range(9, 18), to=to, stiffness=3.0, damping=0.1)])
            simulation.step(3)
        assert np.isfinite(simulation.frame().position).all()
        if substeps == "auto":  # nothing was refined for what is no fault of the step
            assert simulation.choice.refinement == 1.0


def test_a_hand_is_in_the_stability_limit():
    soft = moved([MouseSpring(on=[0], to=[[0, 0, 0]], stiffness=1.0)], substeps="auto").choice.least
    stiff = moved([MouseSpring(on=[0], to=[[0, 0, 0]], stiffness=1e6)], substeps="auto").choice.least
    # One particle alone: omega = sqrt(k / m) = 1e4 rad/s, and symplectic Euler is stable to omega h = 2.
    assert stiff > np.sqrt(1e6 / 0.01) / 2 / 60 > soft


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"on": [1, 1], "to": np.zeros((2, 3))}, "twice"),
        ({"on": [27], "to": np.zeros((1, 3))}, r"on\[0\] is 27"),
        ({"on": [1], "to": np.zeros((1, 2))}, "coordinates"),
        ({"on": [1], "to": np.zeros((1, 3)), "stiffness": -1.0}, "stiffness"),
        ({"on": range(9), "to": np.zeros((9, 3)), "room": 8}, "room"),
        ({"on": [1], "to": [[np.nan] * 3]}, "to"),
    ],
)
def test_what_a_hand_cannot_hold_is_named(wrong, said):
    with pytest.raises(ValueError, match=said):
        moved([MouseSpring(**wrong)])
