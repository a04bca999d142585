"""Several threads of Python: each makes, steps, reads and draws simulations of its own, or another one's."""

import os
import subprocess
import sys
import threading

import numpy as np
import pytest

from msdwarp import Simulation, chain
from msdwarp.quiet import in_turn

HAMMER = """
import sys, threading
import numpy as np
from msdwarp import Plane, Simulation, box, chain
from msdwarp.simulation import Readback

cube = box((3, 3, 3), 0.1, mass=0.01, stiffness=300.0, damping=0.2).translate((0, 0, 0.2))
rope = chain(5)
device = sys.argv[1]

def falling(threads="auto"):
    simulation = Simulation(cube, colliders=[Plane()], device=device, threads=threads)
    readback = Readback(simulation)
    for _ in range(4):
        simulation.step()
        taken = readback.take()
        strain = taken.arrived()[1].copy()
        taken.release()
    simulation.change(velocity=(1, 0, 0))
    simulation.step(3)
    return [*simulation.frame()[1:], strain]

def shared():
    return falling(threads=2 if device == "cpu" else "auto")

def swinging():
    simulation = Simulation(rope, device=device)
    simulation.step(5)
    return list(simulation.frame()[1:])

kinds = [falling, shared, swinging, falling, shared, swinging, falling, swinging]
together, found, errors = threading.Barrier(len(kinds)), {}, []

def work(k):
    try:
        together.wait()
        for n in range(int(sys.argv[2])):
            found[k, n] = kinds[(k + n) % len(kinds)]()
    except BaseException as error:
        errors.append(error)
        raise

threads = [threading.Thread(target=work, args=(k,)) for k in range(len(kinds))]
for one in threads:
    one.start()
for one in threads:
    one.join()
expected = {kind: kind() for kind in dict.fromkeys(kinds)}
for (k, n), got in found.items():
    for one, other in zip(got, expected[kinds[(k + n) % len(kinds)]], strict=True):
        np.testing.assert_array_equal(one, other)
sys.exit(len(errors))
"""


@pytest.mark.slow
def test_eight_threads_at_a_time_get_what_one_gets_where_nothing_is_compiled(tmp_path, plain_device):
    around = os.environ | {"WARP_CACHE_PATH": str(tmp_path)}
    code = [sys.executable, "-X", "faulthandler", "-c", HAMMER, plain_device, "2"]
    done = subprocess.run(code, env=around, capture_output=True, text=True, timeout=600)
    assert (done.returncode, done.stderr) == (0, "")


def in_a_thread(function):
    """Return what a function returns in a thread of its own."""
    found = []
    thread = threading.Thread(target=lambda: found.append(function()))
    thread.start()
    thread.join()
    return found[0]


def test_a_simulation_made_in_one_thread_is_stepped_in_another(plain_device):
    def made():
        return Simulation(chain(5), device=plain_device)

    here, there = made(), in_a_thread(made)
    in_a_thread(lambda: here.step(2))
    there.step(2)
    for simulation in (here, there):
        in_a_thread(simulation.step)
        simulation.step()
    expected = made()
    expected.step(4)
    for simulation in (here, there):
        for one, other in zip(in_a_thread(simulation.frame), expected.frame(), strict=True):
            np.testing.assert_array_equal(one, other)


def test_turns_are_taken_one_after_the_other():
    inside, seen, go_on = [], [], threading.Event()

    @in_turn
    def once(n):
        inside.append(n)
        seen.append(len(inside))
        within(n)
        go_on.wait(60)
        inside.remove(n)

    @in_turn
    def within(n):  # who has the turn has it within, too
        assert n in inside

    threads = [threading.Thread(target=once, args=(n,)) for n in range(8)]
    for one in threads:
        one.start()
    go_on.set()
    for one in threads:
        one.join()
    assert seen == [1] * 8


def test_after_an_error_others_have_their_turn():
    @in_turn
    def fails():
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        fails()
    assert in_a_thread(in_turn(lambda: 1)) == 1


def test_a_process_that_was_forked_meanwhile_has_turns_of_its_own():
    if not hasattr(os, "fork"):
        pytest.skip("needs fork")
    code = """
import os, signal, threading
from msdwarp.quiet import in_turn
inside, end = threading.Event(), threading.Event()
other = threading.Thread(target=in_turn(lambda: (inside.set(), end.wait())))
other.start()
inside.wait()
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
