"""Signals at any moment: what their handlers raise, and what these do, leaves simulations between two frames."""

import os
import signal
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pytest
import warp as wp

import msdwarp
from msdwarp import Plane, Simulation, box
from msdwarp.runtime import record, turns

HERE = str(Path(msdwarp.__file__).parent)
needs_signals = pytest.mark.skipif(not hasattr(signal, "SIGUSR1"), reason="needs signals of POSIX")


class Late(Exception):
    """What the handler raises."""


def raises(number, frame):
    raise Late


@pytest.fixture
def usr1():
    """A handler that raises, as for a time limit."""
    before = signal.signal(signal.SIGUSR1, raises)
    yield
    signal.signal(signal.SIGUSR1, before)


def signalled(call, nth, set_trace=sys.settrace, events=("line",), within=HERE):
    """Call, and send a signal at the nth event in files `within`; return how many there were, or None if it ended.

    Python calls handlers when a function begins and after a call; a line may begin with neither.
    """
    count = 0

    def trace(frame, event, argument):
        nonlocal count
        if not frame.f_code.co_filename.startswith(within):
            return None
        if event in events:
            count += 1
            if count == nth:
                os.kill(os.getpid(), signal.SIGUSR1)
        return trace

    set_trace(trace)
    try:
        call()
    except Late:
        return None
    finally:
        set_trace(None)
    return count


def thrown():
    """Return a block just before its first impact, which needs more substeps: the frame is repeated."""
    block = box((6, 4, 4), spacing=0.05, mass=0.01, stiffness=400.0, damping=0.3)
    block = block.translate((0.0, 0.0, 0.3)).spin((1.0, 2.0, 0.0))
    simulation = Simulation(block, colliders=[Plane(restitution=0.3, friction=0.6)], device="cpu")
    simulation.step(11)
    return simulation


@needs_signals
@pytest.mark.slow
def test_a_frame_that_is_repeated_can_end_at_any_line(usr1):
    usual, states = thrown(), {}
    substeps = usual.substeps
    for k in range(11, 15):
        states[k] = usual.frame()
        usual.step()
    assert usual.substeps > substeps
    first = thrown()
    lines = signalled(first.step, 0)
    assert lines is not None
    ended = 0
    for line in range(1, lines, lines // 40):
        simulation = thrown()
        ended += signalled(simulation.step, line) is None
        while True:
            now, expected = simulation.frame(), states[simulation.frame_index]
            np.testing.assert_array_equal(now.position, expected.position)
            np.testing.assert_array_equal(now.velocity, expected.velocity)
            if simulation.frame_index == 14:
                break
            simulation.step()
    assert ended > 20  # the others came while a graph was recorded, or after the frame had been counted


@needs_signals
@pytest.mark.parametrize("call", ["frame", "step"])
def test_a_turn_ends_and_ctrl_c_is_handled_as_before_whenever_a_signal_comes(call, usr1):
    simulation = thrown()
    where = sys.setprofile, ("call", "c_return"), turns.__file__
    count = signalled(getattr(simulation, call), 0, *where)
    assert count > 4
    for nth in range(1, count + 1):
        signalled(getattr(simulation, call), nth, *where)
        assert signal.getsignal(signal.SIGINT) is signal.default_int_handler, f"after event {nth} of {count}"
        found = []
        other = threading.Thread(target=lambda found=found: found.append(simulation.frame()), daemon=True)
        other.start()
        other.join(60)
        assert len(found) == 1, f"the turn was kept after event {nth} of {count}"


COLLECTS = """
import gc, signal, time
import msdwarp.runtime

class Late(Exception):
    pass

def raises(number, frame):
    raise Late

signal.signal(signal.SIGALRM, raises)
kept = [[k] for k in range(200_000)]
raised = 0
for _ in range(3):
    try:
        signal.setitimer(signal.ITIMER_REAL, 1e-3)
        gc.collect()
        time.sleep(0.5)  # if the collection took less
    except Late:
        raised += 1
assert raised == 3, raised
"""


@needs_signals
def test_no_signal_is_lost_in_a_collection():
    # What a handler raises within a callback of the collector written in Python is printed, and forgotten. Alone:
    # other libraries have such callbacks.
    subprocess.run([sys.executable, "-c", COLLECTS], check=True, timeout=100)


@needs_signals
def test_a_handler_is_called_after_a_recording(usr1):
    # What is raised while Warp begins or ends a recording would leave it open for ever.
    array = wp.zeros(3, dtype=float, device="cpu")
    launched = []

    def launch():
        signal.raise_signal(signal.SIGUSR1)
        array.fill_(2.0)
        launched.append(True)

    for k in range(2):
        with pytest.raises(Late):
            record(launch, array.device)
        assert len(launched) == k + 1
    assert signal.getsignal(signal.SIGUSR1) is raises
    wp.capture_launch(record(lambda: array.fill_(3.0), array.device))
    np.testing.assert_array_equal(array.numpy(), 3.0)


@needs_signals
def test_a_handler_is_called_though_another_raises_before_signals_are_deferred(monkeypatch, usr1):
    called, set_handler = [], turns._signal.signal
    before = signal.signal(signal.SIGINT, lambda *_: called.append(True))

    def sends_both(number, handler):
        told = set_handler(number, handler)
        if number == signal.SIGINT and not called:
            monkeypatch.undo()
            signal.raise_signal(signal.SIGINT)  # is deferred already
            signal.raise_signal(signal.SIGUSR1)  # not yet
        return told

    monkeypatch.setattr(turns._signal, "signal", sends_both)
    try:
        with pytest.raises(Late), turns.deferring_signals():
            pytest.fail("the block began")
        assert called == [True]
        assert signal.getsignal(signal.SIGUSR1) is raises
    finally:
        signal.signal(signal.SIGINT, before)


READS = """
import signal, threading
from msdwarp.runtime import in_turn

inside, go_on = threading.Event(), threading.Event()
other = threading.Thread(target=in_turn(lambda: (inside.set(), go_on.wait())))
other.start()
inside.wait()
called = []

def reads(number, frame):
    go_on.set()
    in_turn(lambda: called.append(number))()

signal.signal(signal.SIGALRM, reads)
signal.setitimer(signal.ITIMER_REAL, 0.2)
in_turn(lambda: None)()  # waits for its turn until the handler lets the other one go on
other.join()
assert called == [signal.SIGALRM]
"""


@needs_signals
def test_a_handler_may_read_while_its_thread_waits_for_a_turn():
    subprocess.run([sys.executable, "-c", READS], check=True, timeout=100)
