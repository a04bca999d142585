"""What has torn is no longer in the way: segments of ropes, and triangles of sheets."""

import numpy as np
import pytest

from msdwarp import Contact, Ensemble, Simulation, System, chain, sheet

SPACING, THICKNESS = 0.1, 0.02
STIFF = {"mass": 1e-3, "stiffness": 1e3, "damping": 0.1}


def rope() -> tuple[System, list[int]]:
    """Return a rope of seven segments with pinned ends, and the segment in its middle."""
    return chain(8, SPACING, **STIFF).pin([0, 7]), [3]


def cloth() -> tuple[System, list[int]]:
    """Return a sheet of nine squares with a pinned border, and the springs of the square in its middle."""
    body = sheet((4, 4), SPACING, **STIFF)
    inner = np.flatnonzero(
        (np.abs(body.position[:, :2] - body.position[:, :2].mean(axis=0)) < SPACING).all(axis=1)
    )
    own = np.isin(body.connections, inner).all(axis=1)
    return body.pin(np.setdiff1d(np.arange(16), inner)), np.flatnonzero(own).tolist()


def scene(make, limits) -> tuple[System, dict]:
    """Return a grain above a body whose middle has these limits, and what a simulation of both needs."""
    body, middle = make()
    for name, value in limits.items():
        each = np.full(body.connection_count, np.inf)
        each[middle] = value
        body = body.replace(**{name: each})
    at = body.position.mean(axis=0) + np.array([0.01, 0.0, 0.05])  # on the rope, and on no diagonal of the sheet
    grain = System(position=[at], mass=1e-3)
    touch = Contact(thickness=THICKNESS, stiffness=100.0)
    return body + grain, {"contact": touch, "substeps": 64}


def dropped_on(make, limits, device, **options) -> Simulation:
    """Return a simulation of the grain, which falls onto the middle of the body."""
    system, needed = scene(make, limits)
    return Simulation(system, device=device, **needed, **options)


TORN = {"cut": {"broken_at": 0.0}, "weak": {"break_force": 1e-6}}


@pytest.mark.parametrize("limits", TORN.values(), ids=TORN)
@pytest.mark.parametrize("make", [rope, cloth])
def test_a_grain_falls_through_what_has_torn_and_lies_on_what_has_not(make, limits, device):
    whole = dropped_on(make, dict.fromkeys(limits, np.inf), device)
    torn = dropped_on(make, limits, device)
    for simulation in (whole, torn):
        simulation.step(30)  # half a second: a free fall of 1.2 m
    assert whole.frame().position[-1, 2] > -0.5 * SPACING
    assert torn.snapshot().broken.any()
    start, time = 0.05, 0.5
    assert torn.frame().position[-1, 2] == pytest.approx(start - 0.5 * 9.82 * time**2, abs=0.02)


def test_after_a_reset_it_is_whole_again(device):
    simulation = dropped_on(rope, {"break_force": 0.03}, device)
    simulation.step(30)
    first = simulation.frame().position
    assert simulation.snapshot().broken.any()
    simulation.reset()
    simulation.step(30)
    np.testing.assert_array_equal(simulation.frame().position, first)


def test_threads_and_worlds_leave_out_the_same(device):
    given = dropped_on(cloth, TORN["weak"], device)
    if device.startswith("cuda") and given.model.force_algorithm == "scatter":
        pytest.skip("scattered sums on the GPU are not repeatable")
    given.step(10)  # the grain reaches the cloth in the sixth frame
    expected = given.frame().position
    if device == "cpu":
        divided = dropped_on(cloth, TORN["weak"], device, threads=2)
        divided.step(10)
        np.testing.assert_array_equal(divided.frame().position, expected)
    system, options = scene(cloth, TORN["weak"])
    # In the second world all springs are stiffer, so that the middle tears at another time.
    worlds = Ensemble(system, 2, stiffness=[1e3, 2e3], device=device, **options)
    worlds.step(10)
    for world in range(2):
        alone = worlds.simulation_of(world)
        alone.step(10)
        np.testing.assert_array_equal(worlds.system_of(world).position, alone.frame().position)
        assert alone.snapshot().broken.any()


@pytest.mark.parametrize("lone", [1, 2])  # the triangles share the diagonal from 0 to 3
def test_what_is_left_beside_a_torn_triangle_passes_through_nothing(lone, device):
    # A square of two triangles loses all springs of a corner. The rest flies at a plate with a corner ahead.
    square = sheet((2, 2), SPACING, **STIFF)
    square = square.replace(broken_at=np.where((square.connections == lone).any(axis=1), 0.0, np.inf))
    plate = sheet((2, 2), 1.0, mass=1.0, stiffness=3e3).pin(slice(None))
    plate = plate.translate(-plate.position.mean(axis=0))
    across, rest = square.position - square.position.mean(axis=0), np.setdiff1d(range(4), lone)
    for tip in rest:
        down = across[tip] / np.linalg.norm(across[tip])
        upright = np.stack([across @ np.cross([0.0, 0.0, 1.0], down), np.zeros(4), -(across @ down)], axis=1)
        above = np.array([0.11, 0.07, 0.05]) - [0.0, 0.0, upright[:, 2].min()]
        thrown = square.replace(position=upright + above).with_velocity((0.0, 0.0, -100.0))
        simulation = Simulation(
            thrown + plate, contact=Contact(thickness=THICKNESS), fps=1e3, gravity=0.0, device=device
        )
        simulation.step(3)
        assert simulation.frame().position[rest, 2].min() > 0.0, tip
