"""What the watch over the energy costs a small body on a GPU: nothing beside the frame, no wait within a batch.

A CPU asks for the sums when they are due: what is launched there is done at once. Here it does as a GPU does.
"""

import collections
import math

import numpy as np
import pytest
import warp as wp

from msdwarp import (
    Box,
    Force,
    Leapfrog,
    PrescribedMotion,
    Simulation,
    SimulationDiverged,
    SymplecticEuler,
    at,
    box,
    chain,
)
from msdwarp.engine import DivergenceMonitor
from msdwarp.simulation.run import Run
from msdwarp.simulation.substep_controller import StepController

WATCHED = {"threads": 1, "gravity": 0.0}
FRAMES = 20
DEVICES = pytest.mark.parametrize("device", ["cpu", pytest.param("cuda:0", marks=pytest.mark.gpu)])


def swinging():
    """Return an undamped block of 4³ particles, stretched by half.

    It is no lattice, whose cells would be looked at now and then: are they inside out?
    """
    body = box((4, 4, 4), 0.1, mass=0.01, stiffness=100.0)
    position = np.array(body.position)
    position[:, 0] *= 1.5
    return body.replace(position=position, rest_length=body.rest_length, directions=())


def whirling():
    """Return two particles that whirl with their spring stretched by half: every frame is looked at."""
    speed = math.sqrt(100.0 * 0.5 * 0.75)  # m v²/r = k (l − l0), with r = l/2
    position, velocity = [[-0.75, 0.0], [0.75, 0.0]], [[0.0, -speed], [0.0, speed]]
    pair = chain(2, 1.0, mass=1.0, stiffness=100.0, dim=2)
    return pair.replace(position=position, velocity=velocity, rest_length=1.0)


@pytest.fixture
def as_on_a_gpu(monkeypatch):
    """Have frames tell their balance on a CPU too."""
    monkeypatch.setattr("msdwarp.simulation.stepping.is_told_by_frames", lambda dynamics: True, raising=False)


@pytest.fixture
def calls(monkeypatch):
    """Count what Python has a device do: launches, copies, and waits for it."""
    count = collections.Counter()

    def counted(name, original):
        def call(*args, **kwargs):
            count[name] += 1
            return original(*args, **kwargs)

        return call

    names = ("launch", "copy", "capture_launch", "synchronize_stream", "synchronize_event", "zeros", "empty")
    for name in names:
        monkeypatch.setattr(wp, name, counted(name, getattr(wp, name)))
    for name in ("numpy", "assign", "fill_"):
        monkeypatch.setattr(wp.array, name, counted(name, getattr(wp.array, name)))
    return count


def batch(simulation, calls):
    """Return what a batch of frames has a device do."""
    calls.clear()
    simulation.step(FRAMES)
    return dict(calls)


@DEVICES
@pytest.mark.parametrize("integrator", [SymplecticEuler(), Leapfrog()], ids=["euler", "leapfrog"])
def test_a_frame_that_is_watched_has_a_device_do_no_more_than_one_that_is_not(
    integrator, device, as_on_a_gpu, calls, monkeypatch
):
    looks = collections.Counter()
    judge = StepController._is_acceptable

    def counted(*args):
        looks["at a balance"] += 1
        return judge(*args)

    monkeypatch.setattr(StepController, "_is_acceptable", counted)
    how = {"integrator": integrator, "device": device, **WATCHED}
    watched, free = (Simulation(whirling(), **how, energy_limit=limit) for limit in (10.0, math.inf))
    for simulation in (watched, free):
        simulation.step(FRAMES)  # records the frame
    looks.clear()
    found = batch(watched, calls)
    assert len(watched.substep_history) == 1  # nothing was recorded again
    assert looks["at a balance"] == FRAMES
    assert found == batch(free, calls)
    assert found["capture_launch"] == FRAMES


def test_what_frames_tell_decides_as_what_is_asked_for(monkeypatch):
    runs = []
    for told in (False, True):
        monkeypatch.setattr(
            "msdwarp.simulation.stepping.is_told_by_frames", lambda dynamics, told=told: told, raising=False
        )
        simulation = Simulation(swinging(), device="cpu", **WATCHED)
        simulation.step(5 * FRAMES)
        runs.append(simulation)
    asked, told = runs
    assert len(asked.substep_history) > 1  # something had to be decided
    assert told.substep_history == asked.substep_history
    np.testing.assert_array_equal(told.frame().position, asked.frame().position)
    assert told.checkpoint()[1] == asked.checkpoint()[1]


# Frames that are launched before the one before them is judged


def shaken(time):
    """Return where a support is, moved to and fro."""
    return 0.02 * math.sin(20.0 * time), 0.0, 0.0


TRAY = Box((0, 0, -0.5), (2, 2, 1), motion=shaken)
CHANGES = [at(0.1, damping=0.1), at(0.1, gravity=3.0), at(0.4, velocity=(0, 0, 1.0))]
SCENES = {
    "refined": (swinging(), {"gravity": 0.0}),
    "pushed and driven, on what moves": (
        swinging().translate((3.0, 0, 0)) + box((3, 3, 3), 0.1, damping=1.0).translate((0, 0, 0.1)),
        {
            "colliders": [TRAY],
            "loads": [Force(lambda t: (math.sin(9.0 * t), 0.0, 0.5)), PrescribedMotion([64, 65], shaken)],
        },
    ),
    "torn": (swinging().replace(break_strain=0.52), {}),
    "changed on the way": (swinging(), {"schedule": CHANGES}),
    "refreshed": (swinging(), {"refresh": True}),
    "with given substeps": (box((3, 3, 3), 0.1).spin((0.0, 0.0, 9.0)), {"substeps": 20}),
}


def one_by_one(simulation, frames):
    """Advance by frames that are batches of their own."""
    for _ in range(frames):
        simulation.step()


def same(one, other):
    """Assert that two runs are where they are to the last bit, and go on alike."""
    for run in (one, other):
        run.step(3)
    (arrays, numbers), (others, other_numbers) = one.checkpoint(), other.checkpoint()
    assert numbers == other_numbers
    for name, values in arrays.items():
        np.testing.assert_array_equal(values, others[name], err_msg=name)


@pytest.mark.slow
@pytest.mark.parametrize("name", SCENES)
def test_a_batch_of_frames_is_those_frames_one_by_one(name, as_on_a_gpu, monkeypatch):
    body, around = SCENES[name]
    batch, single = (Simulation(body, device="cpu", threads=1, **around) for _ in "bs")
    assert batch.stepping.runs_ahead
    batch.step(3 * FRAMES)
    one_by_one(single, 3 * FRAMES)
    same(batch, single)


def test_the_host_waits_for_a_frame_when_the_next_one_is_under_way(as_on_a_gpu, monkeypatch):
    simulation, order = Simulation(whirling(), device="cpu", **WATCHED), list[str]()
    simulation.step(FRAMES)
    launch, judge = wp.capture_launch, DivergenceMonitor.finds_trouble
    monkeypatch.setattr(wp, "capture_launch", lambda graph: (order.append("launch"), launch(graph)))
    monkeypatch.setattr(DivergenceMonitor, "finds_trouble", lambda *args: (order.append("wait"), judge(*args))[1])
    simulation.step(4)
    assert order == ["launch", *3 * ["launch", "wait"], "wait"]


@pytest.mark.parametrize("limit", [10.0, math.inf], ids=["energy", "numbers"])
def test_what_diverges_in_a_batch_is_named_as_in_single_frames(limit, as_on_a_gpu):
    how = {"device": "cpu", "substeps": 4, "allow_unstable": True, "gravity": 0.0, "energy_limit": limit}
    runs = [Simulation(swinging(), **how) for _ in range(2)]
    with pytest.raises(SimulationDiverged) as in_batch:
        runs[0].step(300)
    with pytest.raises(SimulationDiverged) as alone:
        one_by_one(runs[1], 300)
    assert str(in_batch.value) == str(alone.value)
    same_frame(*runs)
    if limit < math.inf:  # where numbers end, positions are beyond those that a system may have
        for run in runs:
            run.change(stiffness=1.0)
        same(*runs)


def same_frame(one, other):
    """Assert that two runs have the same frame, and are past the first."""
    assert one.frame_index == other.frame_index > 1
    for found, expected in zip(one.frame(), other.frame(), strict=True):
        np.testing.assert_array_equal(found, expected)


def test_what_a_function_of_time_raises_ends_the_batch_where_it_begins(as_on_a_gpu):
    def fails(time):
        if time > 0.1:
            raise RuntimeError("no more")
        return math.sin(time), 0.0, 0.0

    runs = [Simulation(swinging(), loads=[Force(fails)], **WATCHED, device="cpu") for _ in range(2)]
    for call in (lambda: runs[0].step(60), lambda: one_by_one(runs[1], 60)):
        with pytest.raises(ValueError, match="no more"):
            call()
    same_frame(*runs)


def test_what_is_raised_between_frames_leaves_none_on_its_way(as_on_a_gpu, monkeypatch):
    runs = [Simulation(swinging(), **WATCHED, device="cpu") for _ in range(2)]
    advance = Run.advance

    def interrupted(run, next_time):
        if run is runs[0]._run and run.frame_index == 5:
            raise KeyboardInterrupt
        advance(run, next_time)

    monkeypatch.setattr(Run, "advance", interrupted)
    with pytest.raises(KeyboardInterrupt):
        runs[0].step(FRAMES)
    monkeypatch.undo()
    runs[1].step(5)
    same_frame(*runs)
