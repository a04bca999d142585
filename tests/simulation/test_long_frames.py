"""Frames that take long are divided into several launches, and signals are heard between them."""

import os
import signal
import threading

import numpy as np
import pytest

from msdwarp import Contact, Ensemble, Leapfrog, Plane, Probe, Simulation, ball, box
from msdwarp.engine.stepping import pace

BODY = box((5, 4, 6), stiffness=1000.0, damping=2.0).translate((0, 0, 2.5))
LOW = ball(0.5, 0.25, stiffness=500.0, damping=1.0).translate((0, 0, 0.5))
TOP = {"top": Probe([0, 7], "velocity", every="substep")}
FLOOR = {"colliders": [Plane()], "substeps": 13, "device": "cpu"}
COMPOSITIONS = {
    "one launch of all stages": (BODY, {}),
    "looked at in each substep": (BODY, {"probes": TOP}),
    "touching, by 2 threads": (
        LOW + LOW.translate((0, 0, 1.002)),
        {"contact": Contact(), "fps": 360, "threads": 2, "contact_forces": True},
    ),
    "lagging, in another gravity each substep": (
        BODY,
        {"integrator": Leapfrog(), "gravity": lambda t: 9.82 + np.sin(60 * t)},
    ),
}


@pytest.fixture
def divided(monkeypatch):
    """Have frames divided into launches of two substeps; the list gets an entry at each division."""
    found, usual = [], pace.stop_if_asked
    monkeypatch.setattr(pace.Pace, "part", lambda self, first, last: range(first, min(first + 2, last)))
    monkeypatch.setattr(pace, "stop_if_asked", lambda: (found.append(True), usual()))
    return found


def outcome(system, options, frames=4):
    """Return what there is of a run."""
    simulation = Simulation(system, **FLOOR, **options)
    for _ in range(frames):
        simulation.step()
    arrays, _ = simulation.checkpoint()
    read = [one for name in options.get("probes", ()) for one in simulation.readings[name]]
    return [*arrays.values(), *simulation.frame()[1:], *read]


@pytest.mark.slow
@pytest.mark.parametrize("name", COMPOSITIONS)
def test_a_frame_in_several_launches_is_the_same_to_the_last_bit(name, request):
    whole = outcome(*COMPOSITIONS[name])
    found = request.getfixturevalue("divided")
    parts = outcome(*COMPOSITIONS[name])
    assert len(found) >= 4 * 6
    for one, other in zip(whole, parts, strict=True):
        np.testing.assert_array_equal(one, other)


def test_worlds_and_gradients_are_the_same_in_several_launches(request):
    def run():
        worlds = Ensemble(BODY, 3, stiffness=[800.0, 1000.0, 1200.0], **FLOOR)
        worlds.step(4)
        simulation = Simulation(BODY, device="cpu", substeps=13)
        found = simulation.gradient(lambda frames: (0.0, np.ones_like(frames.position), None), 3, ["velocity"])
        return [*worlds.frame(), found.value, found["velocity"]]

    whole, found = run(), request.getfixturevalue("divided")
    for one, other in zip(whole, run(), strict=True):
        np.testing.assert_array_equal(one, other)
    assert len(found) == (4 + 3) * 6


@pytest.mark.parametrize("make", [Simulation, lambda body, **options: Ensemble(body, 2, **options)])
@pytest.mark.parametrize("then", [KeyboardInterrupt, TimeoutError])
def test_a_long_frame_that_a_signal_ends_leaves_its_start(make, then, heard, divided, monkeypatch):
    made, usual = make(BODY, **FLOOR), make(BODY, **FLOOR)
    made.step(2)
    usual.step(2)
    note = pace.stop_if_asked

    def comes():
        if then is TimeoutError:  # what the handler of another signal raises
            raise TimeoutError
        signal.raise_signal(signal.SIGINT)
        note()

    monkeypatch.setattr(pace, "stop_if_asked", comes)
    with pytest.raises(then):
        made.step()
    monkeypatch.setattr(pace, "stop_if_asked", note)
    assert made.frame_index == 2
    for _ in range(2):
        for one, other in zip(made.frame(), usual.frame(), strict=True):
            np.testing.assert_array_equal(one, other)
        made.step()
        usual.step()


@pytest.mark.slow
@pytest.mark.parametrize("threads", [1, 2])
@pytest.mark.parametrize("earlier", [0, 1], ids=["first", "later"])
def test_ctrl_c_is_heard_within_a_long_frame(threads, earlier, heard, monkeypatch):
    # Frames of half a second or more, which count as long here. In one launch they are completed, and counted.
    under_way, note = threading.Event(), pace.stop_if_asked
    monkeypatch.setattr(pace, "stop_if_asked", lambda: (under_way.set(), note()))
    monkeypatch.setattr(pace, "LONGEST", 0.1)
    monkeypatch.setattr(pace, "WANTED", 0.05)
    simulation = Simulation(BODY, device="cpu", threads=threads, substeps=100_000, energy_limit=float("inf"))
    if earlier:
        simulation.step()
    start = simulation.frame()
    under_way.clear()

    def interrupt():
        under_way.wait(60)  # until a part of the frame is done
        os.kill(os.getpid(), signal.SIGINT)

    other = threading.Thread(target=interrupt)
    other.start()
    with pytest.raises(KeyboardInterrupt):
        simulation.step()
    other.join()
    assert simulation.frame_index == earlier
    np.testing.assert_array_equal(simulation.frame().position, start.position)


def test_the_first_frame_begins_with_a_small_launch_if_it_may_take_long():
    simulation = Simulation(box((10, 10, 10), stiffness=1000.0), device="cpu", substeps=10_000)
    first = pace.Pace(simulation.assembly, 1, 1).part(0, 10_000)
    assert len(first) * simulation.system.connection_count / pace.ITEMS_A_SECOND[False] < pace.LONGEST
    assert len(first) % 2 == 0


def test_launches_take_half_a_second_once_the_pace_is_known():
    simulation = Simulation(BODY, device="cpu", substeps=4)
    found = pace.Pace(simulation.assembly, 1, 1)
    assert found.part(0, 1001) == range(1001)  # a small body: not even the first frame is divided
    for seconds, launches in ((0.9, 1), (7.0, 16), (5.0, 16), (17.0, 64), (0.2, 1)):
        found.substep = seconds / 1001
        parts = [found.part(0, 1001)]
        while parts[-1].stop < 1001:
            parts.append(found.part(parts[-1].stop, 1001))
        assert len(parts) == pytest.approx(launches, abs=1)
        assert all(len(part) % 2 == 0 for part in parts[:-1])
        assert [k for part in parts for k in part] == list(range(1001))
