"""Colliders: what they turn about, and which solids and motions are refused."""

import math

import numpy as np
import pytest
from problems import EPS64

from msdwarp import Box, Capsule, Cone, Plane, Simulation, Sphere, System
from msdwarp.world.colliders import Collider


def test_solids_turn_about_their_middles():
    turn = (0.3, -0.2, 0.9)
    for collider, middle in (
        (Sphere((1, 2, 3), motion=lambda t: (np.zeros(3), turn)), (1, 2, 3)),
        (Box((1, 2, 3), motion=lambda t: (np.zeros(3), turn)), (1, 2, 3)),
        (Capsule((1, 2, 3), (3, 2, 1), motion=lambda t: (np.zeros(3), turn)), (2, 2, 2)),
        (Plane((0, 1, 0), 2.0, motion=lambda t: (np.zeros(3), turn)), (0, 2, 0)),
    ):
        R, o = collider.pose(1.0, 3)
        np.testing.assert_allclose(R @ middle + o, middle, rtol=0, atol=16 * EPS64)
        np.testing.assert_allclose(R @ turn, turn, rtol=0, atol=4 * EPS64)  # its own axis
        np.testing.assert_allclose(R.T @ R, np.eye(3), rtol=0, atol=4 * EPS64)
        assert np.trace(R) == pytest.approx(1 + 2 * math.cos(np.linalg.norm(turn)), abs=4 * EPS64)


@pytest.mark.parametrize(
    ("dim", "motion", "message"),
    [
        (3, lambda t: (0.0, 0.0), r"motion\(0\) is \(0.0, 0.0\); it must be 3 finite numbers"),
        (3, lambda t: 0.5 * t, r"motion\(0\) is 0.0; it must be 3 finite numbers"),  # along which axis?
        (3, lambda t: "up", r"motion\(0\) must be an array of numbers, not 'up'"),
        (3, lambda t: (0, 0, math.nan), r"motion\(0\) is \(0, 0, nan\)"),
        (3, lambda t: (np.zeros(3), (0, 0, math.inf)), r"turn of motion\(0\) is \(0, 0, inf\)"),
        (2, lambda t: (np.zeros(2), (0, 0, 1)), r"turn of motion\(0\) is \[\(0, 0, 1\)\]|turn of motion\(0\)"),
        (2, lambda t: (0, 0, 0), r"motion\(0\) is \(0, 0, 0\); it must be 2 finite numbers"),
        (1, lambda t: ((0.0,), 1.0), r"turn of motion\(0\) is 1.0; in one dimension nothing turns"),
    ],
)
def test_bad_motion_is_named(dim, motion, message):
    with pytest.raises(ValueError, match=message):
        Simulation(System(position=np.zeros((1, dim))), colliders=[Plane(motion=motion)], device="cpu")


@pytest.mark.parametrize(
    ("dim", "collider", "message"),
    [
        (3, Plane((0, 1)), r"colliders\[0\].normal is \(0.0, 1.0\); it must have 3 coordinates"),
        (2, Sphere(), r"colliders\[0\].position is \(0.0, 0.0, 0.0\); it must have 2 coordinates"),
        (3, Box((0, 0), (1, 1)), r"colliders\[0\].position is \(0.0, 0.0\); it must have 3 coordinates"),
        (3, Capsule((0, 0), (1, 1)), r"colliders\[0\].start is \(0.0, 0.0\); it must have 3 coordinates"),
        (2, Cone(), r"colliders\[0\].apex is \(0.0, 0.0, 1.0\); it must have 2 coordinates"),
        (1, Cone((0,), (1,)), r"colliders\[0\].apex is \(0.0,\); a cone needs at least 2 coordinates"),
        (1, Capsule((0,), (1,)), r"colliders\[0\].start is \(0.0,\); a capsule needs at least 2 coordinates"),
        (3, Collider(), r"colliders\[0\] is Collider\(.*; it must be a Plane, Sphere, Box, Capsule, Cone"),
    ],
)
def test_solid_that_does_not_fit_is_named(dim, collider, message):
    with pytest.raises(ValueError, match=message):
        Simulation(System(position=np.zeros((1, dim))), colliders=[collider], device="cpu")


@pytest.mark.slow
def test_a_motion_that_fails_on_the_way_is_named():
    body = System(position=[[0.0, 0, 1]])
    fails = Sphere((0, 0, 0), 0.5, motion=lambda t: (0.1 * t + 0.0 * math.sqrt(0.05 - t), 0, 0))
    simulation = Simulation(body, colliders=[Plane(offset=-9), fails], substeps=2, device="cpu")
    with pytest.raises(ValueError, match=r"colliders\[1\] has no place at 0\.0\d* s: .*"):
        simulation.step(9)
