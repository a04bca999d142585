"""Functions that a simulation calls: those that call back, return nothing, or depend on a state of the run."""

import math
import re
from typing import Any

import numpy as np
import pytest
import warp as wp

from msdwarp import (
    Ensemble,
    Force,
    Leapfrog,
    Plane,
    PrescribedMotion,
    Scene,
    Simulation,
    SimulationDiverged,
    SymplecticEuler,
    System,
    Wind,
    at,
    box,
)
from msdwarp.simulation.frames import apply_due

BODY = box((3, 3, 3), 0.1, mass=0.02, stiffness=400.0, damping=0.1).translate((0.0, 0.0, 0.2))


@pytest.mark.slow
@pytest.mark.parametrize(
    "call",
    [
        lambda one: one.step(),
        lambda one: one.change(stiffness=100.0),
        lambda one: one.settle(),
        lambda one: one.reset(),
        lambda one: one.restore(*one.checkpoint()),
    ],
    ids=["step", "change", "settle", "reset", "restore"],
)
def test_a_function_of_time_cannot_call_back(call):
    # A step within a step gave a frame more, and a change was lost, without a word.
    heals = []

    def gravity(t):
        if t > 0.03 and not heals:
            call(simulation)
        return (0.0, 0.0, -9.82)

    simulation = Simulation(BODY, gravity=gravity, colliders=[Plane()], device="cpu")
    usual = Simulation(BODY, gravity=lambda t: (0.0, 0.0, -9.82), colliders=[Plane()], device="cpu")
    with pytest.raises(ValueError, match=r"gravity has no value .* RuntimeError: \w+ is called within step"):
        simulation.step(9)
    heals.append(True)
    assert simulation.frame_index < 9
    simulation.step(9 - simulation.frame_index)
    usual.step(9)
    np.testing.assert_array_equal(simulation.frame().position, usual.frame().position)
    simulation.change(stiffness=100.0)  # afterwards it may be called
    assert (simulation.system.stiffness == 100.0).all()


def test_a_function_of_velocities_is_called_when_its_time_has_come():
    # At the start the body is at rest, and has no direction.
    def faster(v):
        return 2.0 * v / np.linalg.norm(v, axis=1, keepdims=True)

    simulation = Simulation(BODY, schedule=[at(0.05, velocity=faster)], device="cpu")
    simulation.step(3)
    apply_due(simulation._run)
    speed = np.linalg.norm(simulation.frame().velocity, axis=1)
    np.testing.assert_allclose(speed, 2.0, rtol=1e-6)  # shifted to the time of the positions and back: rounding
    lonely = System(position=np.zeros((1, 3)), mass=[1.0])
    resting = Simulation(lonely, gravity=0.0, schedule=[at(0.05, velocity=faster)], device="cpu")
    message = re.escape("the change at 0.05 s cannot be made: velocity[0, 0] is nan")
    with np.errstate(invalid="ignore"), pytest.raises(ValueError, match=message):
        resting.step(9)
    assert resting.frame_index == 3


@pytest.mark.parametrize("call", ["restore", "reset", "change"])
def test_what_fails_in_a_function_leaves_everything(call):
    # Restored and reset, it had the time asked for and the state of before, and went on to wrong numbers.
    broken = []

    def force(t):
        if broken:
            raise KeyError("no data")
        return (0.0, 0.0, 0.1)

    one, usual = (Simulation(BODY, loads=[Force(force)], colliders=[Plane()], device="cpu") for _ in range(2))
    one.step(3)
    kept = one.checkpoint()
    one.step(3)
    usual.step(6)
    calls = {
        "restore": lambda: one.restore(*kept),
        "reset": one.reset,
        "change": lambda: one.change(stiffness=300.0),
    }
    broken.append(True)
    with pytest.raises(ValueError, match=r"loads\[0\]\.force has no value .* KeyError: 'no data'"):
        calls[call]()
    broken.clear()
    assert one.frame_index == 6
    for _ in range(3):
        np.testing.assert_array_equal(one.frame().position, usual.frame().position)
        one.step()
        usual.step()
    calls[call]()  # it can be called again
    assert one.frame_index == {"restore": 3, "reset": 0, "change": 9}[call]


@pytest.mark.slow
@pytest.mark.parametrize("changes", [{"stiffness": 300.0}, {"velocity": (0.0, 0.0, 1.0)}], ids=str)
def test_a_change_that_fails_at_any_call_of_a_function_is_undone(changes):
    # Velocities stayed, and the energies to compare with did not: the next step diverged.
    calls, last = [0], [math.inf]

    def counted(t):
        calls[0] += 1
        if calls[0] > last[0]:
            raise KeyboardInterrupt
        return (4.0, 0.0, -9.82 + 0.1 * math.sin(5 * float(np.max(t))))

    around = {"gravity": counted, "colliders": [Plane()]} if "stiffness" in changes else {"loads": [Wind(counted)]}
    one, usual = (Simulation(BODY, integrator=Leapfrog(), device="cpu", **around) for _ in range(2))
    for each in (one, usual):
        each.step(2)
    kept = one.checkpoint()
    calls[0] = 0
    one.change(**changes)
    needed = calls[0]
    assert needed > 1
    one.restore(*kept)
    for last[0] in sorted({0, 1, needed // 4, needed // 2, needed - 2, needed - 1}):
        calls[0] = 0
        with pytest.raises(KeyboardInterrupt):
            one.change(**changes)
        assert one.snapshot().stiffness.max() == 400.0
        np.testing.assert_array_equal(one.frame().velocity, usual.frame().velocity)
    last[0] = math.inf
    for each in (one, usual):
        each.step(2)
    np.testing.assert_array_equal(one.frame().velocity, usual.frame().velocity)


@wp.func
def broken_late(x: Any, v: Any, t: Any, i: int):
    if t > type(t)(0.07):
        return x * wp.log(type(t)(-1.0))
    return x * type(t)(0.0)


@pytest.mark.slow
def test_a_frame_that_diverges_leaves_the_state_and_the_substeps_of_the_last():
    # Velocities of symplectic Euler belong to the middle of a substep: with more substeps they were others.
    one = Simulation(BODY, loads=[Force(broken_late)], integrator=SymplecticEuler(), device="cpu")
    one.step(4)
    before, substeps = one.frame(), one.substeps
    for _ in range(2):
        with pytest.raises(SimulationDiverged, match="so a force or a law is not finite there"):
            one.step()
        assert (one.frame_index, one.substeps) == (4, substeps)
        np.testing.assert_array_equal(one.frame().position, before.position)
        np.testing.assert_array_equal(one.frame().velocity, before.velocity)


def test_a_motion_may_be_an_empty_container_too():
    class Path(list):
        def __call__(self, t):
            return 0.0, 0.0, 0.5 * t

    one = Simulation(BODY, loads=[PrescribedMotion([0], Path())], device="cpu")
    start = one.frame().position[0, 2]
    one.step(6)
    assert one.frame().position[0, 2] - start == pytest.approx(0.05, rel=1e-5)  # rounding to float32


def test_worlds_stay_where_they_are_when_a_function_of_time_fails():
    broken = []

    def force(t):
        if broken:
            broken[0]()
        return (0.0, 0.0, 0.1)

    worlds = Ensemble(Scene(system=BODY, loads=[Force(force)]), 2, device="cpu")
    worlds.step(3)
    before = worlds.frame()
    for call, said in ((worlds.reset, "no data"), (worlds.step, "RuntimeError: step is called within step")):
        broken[:] = [worlds.step if call == worlds.step else lambda: {}["no data"]]
        with pytest.raises(ValueError, match=said):
            call()
        assert worlds.frame_index == 3
        np.testing.assert_array_equal(worlds.frame().position, before.position)


def observed(what, name="low"):
    return Ensemble(Scene(system=BODY), 2, device="cpu").run(0.1, observe={name: what})


def test_what_is_observed_may_be_the_same_array_again():
    out = np.zeros(2)

    def lowest(x, v):
        x[:, :, 2].min(axis=1, out=out)
        return out

    again, other = observed(lowest), observed(lambda x, v: x[:, :, 2].min(axis=1))
    np.testing.assert_array_equal(again["low"].values, other["low"].values)
    assert np.ptp(other["low"].values[0]) > 0


@pytest.mark.parametrize("wrong", [[[1.0], [1.0, 2.0]], "ab", None, [None, None]])
def test_what_is_observed_must_be_numbers(wrong):
    with pytest.raises(ValueError, match=r"observe\['low'\] returned .*; it must be numbers in an array"):
        observed(lambda x, v: wrong)


def test_what_is_observed_must_keep_its_shape():
    shapes = iter([(2,), (2, 1), (2, 1)])
    message = re.escape("observe['low'] returned shape (2, 1), and (2,) before; it must always be the same")
    with pytest.raises(ValueError, match=message):
        observed(lambda x, v: np.zeros(next(shapes)))


@pytest.mark.parametrize("name", ["time", "world", "status"])
def test_what_is_observed_may_not_have_the_name_of_a_coordinate(name):
    with pytest.raises(ValueError, match=f"a name in observe is '{name}'; the result has"):
        observed("energy", name)


def test_an_observer_and_a_loss_cannot_step():
    worlds = Ensemble(Scene(system=BODY), 2, device="cpu")
    with pytest.raises(RuntimeError, match="step is called within run"):
        worlds.run(0.1, observe={"t": lambda x, v: (worlds.step(), np.zeros(2))[1]})
    simulation = Simulation(BODY, integrator=Leapfrog(), device="cpu")
    with pytest.raises(RuntimeError, match="step is called within gradient"):
        simulation.gradient(lambda frames: simulation.step(), frames=2, by=("stiffness",))
    assert simulation.frame_index == 0


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ([[0.1, 0.2], [0.3]], "whose rows differ in length"),
        (np.ma.masked_array([0.1, 2.0, 0.3], [0, 1, 0]), "masked"),
    ],
)
def test_ragged_and_masked_values_are_refused(given, message):
    with pytest.raises(ValueError, match=rf"loads\[0\]\.force has no value .*{message}"):
        Simulation(BODY, loads=[Force(lambda t: given)], device="cpu")
