"""What the watch over the energy launches: of a small body on a GPU nothing beside the frame.

A CPU asks for the sums when they are due: what is launched there is done at once. Here it does as a GPU does.
"""

import collections
import math

import numpy as np
import pytest
import warp as wp

from msdwarp import Leapfrog, Simulation, SymplecticEuler, box, chain
from msdwarp.simulation.pace import Pace

WATCHED = {"threads": 1, "gravity": 0.0}
FRAMES = 20
DEVICES = pytest.mark.parametrize("device", ["cpu", pytest.param("cuda:0", marks=pytest.mark.gpu)])


def swinging():
    """Return an undamped block of 4³ particles, stretched by half."""
    body = box((4, 4, 4), 0.1, mass=0.01, stiffness=100.0)
    position = np.array(body.position)
    position[:, 0] *= 1.5
    return body.replace(position=position, rest_length=body.rest_length)


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
    judge = Pace._is_well

    def counted(*args):
        looks["at a balance"] += 1
        return judge(*args)

    monkeypatch.setattr(Pace, "_is_well", counted)
    how = {"integrator": integrator, "device": device, **WATCHED}
    watched, free = (Simulation(whirling(), **how, energy_limit=limit) for limit in (10.0, math.inf))
    for simulation in (watched, free):
        simulation.step(FRAMES)  # records the frame
    looks.clear()
    found = batch(watched, calls)
    assert len(watched.chosen) == 1  # nothing was recorded again
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
    assert len(asked.chosen) > 1  # something had to be decided
    assert told.chosen == asked.chosen
    np.testing.assert_array_equal(told.frame().position, asked.frame().position)
    assert told.checkpoint()[1] == asked.checkpoint()[1]
