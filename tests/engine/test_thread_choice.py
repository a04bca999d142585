"""How many threads share a body is chosen as frames are taken, and results do not depend on it."""

import itertools

import numpy as np
import pytest

from msdwarp import Contact, Plane, Simulation, ball, box
from msdwarp.engine.stepping import pace
from msdwarp.engine.stepping.assemble import assemble
from msdwarp.engine.stepping.pace import Pace
from msdwarp.world import Problem

ASSEMBLY = assemble(Problem(system=box((3, 3, 3))), device="cpu")
LOW = ball(0.5, 0.25, stiffness=500.0, damping=1.0).translate((0, 0, 0.5))


class Machine:
    """A clock: a substep takes so long by so many threads [s], and they compute in a fraction of that time."""

    def __init__(self, monkeypatch):
        self.wall = self.computing = 0.0
        self.takes = {1: (0.02, 1.0), 2: (0.01, 1.0), 4: (0.005, 1.0)}
        monkeypatch.setattr(pace, "perf_counter", lambda: self.wall)
        monkeypatch.setattr(pace, "process_time", lambda: self.computing)

    def run(self, choice, frames):
        """Return the number of threads in each of some frames of ten substeps."""
        return [self.frame(choice) for _ in range(frames)]

    def frame(self, choice):
        threads = choice.threads()

        def take():
            seconds, computes = self.takes[threads]
            self.wall += 10 * seconds
            self.computing += 10 * seconds * computes * threads

        choice.take(10, range(10), take, lambda first: (range(first, first), take), lambda: False)
        return threads


def test_fewer_threads_share_while_others_need_the_cores(monkeypatch):
    machine, choice = Machine(monkeypatch), Pace(ASSEMBLY, 1, 4)
    assert set(machine.run(choice, 100)) == {4}  # alone nothing else is tried
    free, machine.takes = machine.takes, {1: (0.05, 0.4), 2: (0.3, 0.1), 4: (0.9, 0.05)}
    busy = machine.run(choice, 100)
    assert busy[-90:] == [1] * 90
    machine.takes = free
    assert machine.run(choice, 200)[-100:] == [4] * 100


def test_trials_that_fail_become_rare(monkeypatch):
    machine, choice = Machine(monkeypatch), Pace(ASSEMBLY, 1, 2)
    machine.takes = {1: (0.02, 1.0), 2: (0.05, 0.6)}  # one neighbour on two cores
    taken = machine.run(choice, 1000)
    assert taken.count(2) < 25
    machine.takes = {1: (0.02, 0.7), 2: (0.01, 0.7)}  # two are faster, even if they do not get all of the time
    assert machine.run(choice, 1000).count(2) > 900


def test_a_number_that_is_asked_for_stays(monkeypatch):
    machine, choice = Machine(monkeypatch), Pace(ASSEMBLY, 2, 2)
    machine.takes = {2: (0.3, 0.1)}
    assert set(machine.run(choice, 50)) == {2}
    body = box((5, 4, 6), stiffness=1000.0, damping=2.0)
    chosen = [Simulation(body, device="cpu", threads=n).stepping.dynamics.pace for n in (2, 1)]
    assert [(one._least, one._most) for one in chosen] == [(2, 2), (1, 1)]


@pytest.mark.slow
@pytest.mark.parametrize("algorithm", ["scatter", "gather"])
def test_results_do_not_depend_on_when_the_number_changes(algorithm, monkeypatch):
    options = {"device": "cpu", "contact": Contact(), "colliders": [Plane()], "substeps": 10, "fps": 360}
    options |= {"force_algorithm": algorithm}
    runs, used = [], set()
    for changes in (False, True):
        simulation = Simulation(LOW + LOW.translate((0, 0, 1.002)), threads=3 if changes else 1, **options)
        if changes:
            numbers = itertools.cycle((3, 1, 2, 1))
            monkeypatch.setattr(Pace, "threads", lambda self, numbers=numbers: next(numbers))
        for _ in range(9):
            simulation.step()
            used.add(simulation.threads)
        arrays, _ = simulation.checkpoint()
        runs.append([*arrays.values(), *simulation.frame()[1:]])
    assert used == {1, 2, 3}
    for one, other in zip(*runs, strict=True):
        np.testing.assert_array_equal(one, other)
