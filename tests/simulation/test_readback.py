"""Reading back: each frame is the one of its own time, whatever the simulation does meanwhile."""

import threading

import numpy as np
import problems
import pytest

from msdwarp import Leapfrog, Simulation, System, Trajectory, TrajectoryWriter, at, box, chain
from msdwarp.runtime import turns
from msdwarp.simulation import readback as readback_module
from msdwarp.simulation.readback import Readback

ROUNDING = {"float32": problems.EPS32, "float32-compensated": problems.EPS32, "float64": 4 * problems.EPS64}
"""Rest lengths on the device, and strains themselves, are rounded to the simulation's numbers, which a strain of
about 0 sees as their rounding of 1; in float64 so are the lengths, here and there."""


def block(**fields) -> System:
    """Return a box of many rest lengths, which swings."""
    body = box((3, 3, 3), 0.1, mass=0.01, stiffness=300.0, damping=0.2).spin((1.0, 2.0, 0.5))
    return body.replace(rest_length=body.rest_length * np.linspace(0.9, 1.1, body.connection_count), **fields)


def start(device: str, system: System | None = None, **options) -> Simulation:
    return Simulation(block() if system is None else system, device=device, **options)


def strain_of(simulation: Simulation) -> np.ndarray:
    """Return length / rest length − 1 of the present frame, in float64."""
    i, j = simulation.system.connections.T
    position = simulation.frame().position.astype(np.float64)
    return np.linalg.norm(position[i] - position[j], axis=1) / simulation.rest_length - 1


def assert_present(readback: Readback, simulation: Simulation) -> None:
    """Check that what is taken now is the simulation's frame."""
    taken = readback.take()
    assert_is(taken, simulation.frame(), strain_of(simulation), ROUNDING[simulation.model.precision])
    assert taken.arrived()[1].dtype == simulation.model.dtype
    taken.release()


def assert_is(taken, frame, strain, rounding) -> None:
    found, strains = taken.arrived()
    assert found.time == frame.time
    for values, expected in zip(found[1:], frame[1:], strict=True):
        assert values.dtype == expected.dtype
        np.testing.assert_array_equal(values, expected)
    np.testing.assert_allclose(strains, strain, rtol=rounding, atol=rounding)


@pytest.mark.parametrize("precision", ROUNDING)
def test_a_frame_is_the_simulations_with_velocities_of_the_same_instant(device, precision):
    simulation = start(device, precision=precision, integrator=Leapfrog())
    if device.startswith("cuda") and simulation.model.force_algorithm == "scatter":
        pytest.skip("scattered sums on the GPU are not repeatable, and the velocities need one each time")
    readback = Readback(simulation)
    assert_present(readback, simulation)
    simulation.step(7)
    assert_present(readback, simulation)
    assert np.ptp(strain_of(simulation)) > 0.1


def test_frames_in_flight_are_each_of_its_own_time(device):
    simulation = start(device)
    readback, taken = Readback(simulation), []
    for _ in range(4):
        simulation.step()
        taken.append((readback.take(), simulation.frame(), strain_of(simulation)))
    simulation.step(3)
    for pending, frame, strain in taken:
        assert_is(pending, frame, strain, problems.EPS32)
    assert len({frame.time for _, frame, _ in taken}) == 4


def test_it_goes_on_after_changes(device):
    # Of constants stored once, and rest lengths that change as it yields.
    system = box((3, 3, 3), 0.1, mass=0.01, stiffness=300.0, damping=0.2).replace(yield_strain=0.02)
    simulation = start(device, system, schedule=[at(0.1, rest_length=lambda length: 0.8 * length)])
    readback = Readback(simulation)
    simulation.step(4)
    checkpoint = simulation.checkpoint()
    simulation.step(4)
    assert simulation.system is not system
    assert_present(readback, simulation)
    simulation.change(stiffness=200.0)
    assert_present(readback, simulation)
    simulation.change(rest_length=np.linspace(0.05, 0.15, system.connection_count))
    simulation.step()
    assert_present(readback, simulation)
    simulation.restore(*checkpoint)
    assert_present(readback, simulation)
    simulation.reset()
    assert_present(readback, simulation)


def test_it_waits_where_all_are_taken(plain_device):
    simulation = start(plain_device)
    readback = Readback(simulation, depth=2)
    first, second = readback.take(), readback.take()
    kept = simulation.frame()
    simulation.step()
    released = threading.Event()

    def unpin():
        released.set()
        first.release()

    threading.Timer(0.1, unpin).start()
    third = readback.take()
    assert released.is_set()
    strain = strain_of(simulation)
    assert_is(third, simulation.frame(), strain, problems.EPS32)
    np.testing.assert_array_equal(second.arrived()[0].position, kept.position)
    first.release()  # again: the third keeps its memory
    second.release()
    fourth = readback.take()
    assert not np.shares_memory(third.arrived()[0].position, fourth.arrived()[0].position)


def test_without_strain_and_without_connections(plain_device):
    taken = Readback(start(plain_device), strain=False).take()
    assert taken.arrived()[1] is None
    dust = start(plain_device, System(position=np.eye(3)))
    frame, strain = Readback(dust).take().arrived()
    np.testing.assert_array_equal(frame.position, np.eye(3))
    assert strain.shape == (0,)
    with pytest.raises(ValueError, match="depth is 0"):
        Readback(dust, depth=0)
    with pytest.raises(ValueError, match="simulation is None; it must be a Simulation"):
        Readback(None)


@pytest.mark.parametrize("every", [1, 3])
def test_what_is_written_on_the_way_is_what_is_written(tmp_path, device, every):
    options = {"schedule": [at(0.1, stiffness=200.0)]}  # a frame is recorded anew while others are on their way
    if device.startswith("cuda"):
        options["force_algorithm"] = "gather"  # which is repeatable
    path, other, count = tmp_path / "a.vtkhdf", tmp_path / "b.vtkhdf", 10
    simulation, twin = start(device, **options), start(device, **options)
    readback, wanted = Readback(simulation), []
    with TrajectoryWriter(path, simulation.system, fps=60, every=every) as writer:
        for k in range(count):
            if k:
                simulation.step()
            wanted.append(writer.wants_next())
            writer.write_pending(readback.take() if wanted[-1] else None)
    with TrajectoryWriter(other, twin.system, fps=60, every=every) as writer:
        for frame in twin.frames((count - 1) / 60):
            writer.write(frame)
    assert wanted == [k % every == 0 for k in range(count)]
    with Trajectory(path) as found, Trajectory(other) as expected:
        assert len(found) == sum(wanted)
        np.testing.assert_array_equal(found.times, expected.times)
        np.testing.assert_array_equal(found.positions, expected.positions)
        np.testing.assert_array_equal(found.velocities, expected.velocities)
        # The host computes strains in float32 throughout, so that lengths are rounded too, several times.
        np.testing.assert_allclose(found.strains, expected.strains, rtol=0, atol=4 * problems.EPS32)


def test_a_dropped_frame_makes_room_and_its_arrays_stay(plain_device):
    simulation = Simulation(chain(3), device=plain_device)
    readback = Readback(simulation, depth=2)
    kept, expected = [], []
    for _ in range(4):  # more than the depth
        simulation.step()
        kept.append(readback.take().arrived()[0].position)
        expected.append(simulation.frame().position)
    np.testing.assert_array_equal(kept, expected)


def test_a_frame_is_given_its_time_in_the_turn_that_copies_it(device, monkeypatch):
    # Read after the turn, the time could be that of a frame which another thread has stepped to.
    simulation, owned = start(device), []

    class Watched(readback_module.Taken):
        def __init__(self, *arguments):
            owned.append(turns._turn._is_owned())
            super().__init__(*arguments)

    monkeypatch.setattr(readback_module, "Taken", Watched)
    Readback(simulation).take().release()
    assert owned == [True]
