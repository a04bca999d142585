"""Processes that are forked while threads simulate."""

import os
import subprocess
import sys

import pytest

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")

FORKS = """
import os, signal, threading
import numpy as np
from msdwarp import Plane, Simulation, box

cube = box((3, 3, 3), 0.1, mass=0.01, stiffness=300.0, damping=0.2).translate((0, 0, 0.2))

def falling():
    simulation = Simulation(cube, colliders=[Plane()], device="cpu", threads=1)
    simulation.step(4)
    return simulation.frame().position

usual, end = falling(), threading.Event()

def goes_on():
    while not end.is_set():
        falling()

other = threading.Thread(target=goes_on)
other.start()
ends = []
for _ in range(20):
    child = os.fork()
    if child == 0:
        signal.alarm(60)
        os._exit(0 if np.array_equal(falling(), usual) else 7)
    ends.append(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
end.set()
other.join()
assert not any(ends), ends
"""


def test_a_process_is_forked_between_the_turns_of_other_threads():
    without = os.environ | {"CUDA_VISIBLE_DEVICES": ""}  # a forked process cannot use a GPU
    call = [sys.executable, "-W", "ignore", "-c", FORKS]
    done = subprocess.run(call, timeout=600, capture_output=True, text=True, env=without)
    assert done.returncode == 0, done.stderr[-3000:]


def test_a_process_that_was_forked_in_another_threads_turn_has_turns_of_its_own():
    code = """
import os, signal, threading
from msdwarp.runtime import in_turn, turns
inside, end = threading.Event(), threading.Event()
other = threading.Thread(target=in_turn(lambda: (inside.set(), end.wait())))
other.start()
inside.wait()
turns.PATIENCE = 0.1
child = os.fork()
if child == 0:
    signal.alarm(60)  # a turn that never comes
    in_turn(lambda: os._exit(7))()
code = os.waitpid(child, 0)[1]
end.set()
raise SystemExit(os.waitstatus_to_exitcode(code))
"""
    done = subprocess.run([sys.executable, "-W", "ignore", "-c", code], timeout=600)
    assert done.returncode == 7
