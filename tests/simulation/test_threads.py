"""Several threads of Python: each makes, steps, reads and draws simulations of its own, or another one's."""

import gc
import os
import signal
import subprocess
import sys
import threading
import traceback
import weakref

import numpy as np
import pytest
import warp as wp

from msdwarp import (
    Contact,
    Ensemble,
    Plane,
    Probe,
    Renderer,
    Scene,
    Simulation,
    Trajectory,
    TrajectoryWriter,
    box,
    chain,
    match_stiffness,
)
from msdwarp.runtime import in_turn, record, turns
from msdwarp.simulation import Readback
from msdwarp.simulation.stepping import Stepping
from msdwarp.studies.history import history

HAMMER = """
import sys, threading
import numpy as np
from msdwarp import Plane, Simulation, box, chain
from msdwarp.simulation import Readback
from msdwarp.simulation.stepping import Stepping

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

kinds = [falling, shared, swinging, falling]
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
def test_four_threads_at_a_time_get_what_one_gets_where_nothing_is_compiled(tmp_path, plain_device):
    around = os.environ | {"WARP_CACHE_PATH": str(tmp_path)}
    rounds = "30" if plain_device.startswith("cuda") else "2"  # most of a CPU's time is the compiler's
    code = [sys.executable, "-X", "faulthandler", "-c", HAMMER, plain_device, rounds]
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


SCENE = Scene(system=chain(3), colliders=[Plane()])
HOLDERS = {
    "simulation": lambda scene, device: Simulation.from_scene(scene, device=device),
    "ensemble": lambda scene, device: Ensemble(scene, 2, device=device),
    "readback": lambda scene, device: Readback(Simulation.from_scene(scene, device=device)),
    "frame": lambda scene, device: Readback(Simulation.from_scene(scene, device=device)).take(),
    "renderer": lambda scene, device: Renderer(scene, scene.system.position, backend="raycast", device=device),
}


def test_a_graph_is_whole_though_memory_is_dropped_while_it_is_recorded(plain_device):
    # By the same thread, and by another one whose collection began before: it is freed after the recording.
    array, started, go_on = wp.zeros(3, dtype=float, device=plain_device), threading.Event(), threading.Event()

    class Slow:
        def __init__(self):
            self.held = self, [make(SCENE, plain_device) for make in HOLDERS.values()]

        def __del__(self):
            started.set()
            go_on.wait(60)

    def launch():
        array.fill_(1.0)
        go_on.set()
        collector.join()
        gc.collect()
        array.fill_(2.0)

    Slow(), Slow()
    collector = threading.Thread(target=gc.collect)
    collector.start()
    started.wait()
    wp.capture_launch(in_turn(record)(launch, array.device))
    np.testing.assert_array_equal(array.numpy(), 2.0)


@pytest.mark.slow
@pytest.mark.parametrize("kind", HOLDERS)
def test_what_is_dropped_in_anothers_turn_is_freed_when_that_ends(plain_device, kind, monkeypatch):
    # Memory that is freed while another thread records a graph can spoil the recording on a GPU.
    started, go_on, freed, free = threading.Event(), threading.Event(), [], wp.array.__del__

    @turns.in_turn
    def take_long():
        started.set()
        go_on.wait()

    holder = HOLDERS[kind](SCENE, plain_device)
    gc.collect()
    monkeypatch.setattr(wp.array, "__del__", lambda array: (freed.append(array.ptr), free(array)))
    other = threading.Thread(target=take_long)
    other.start()
    started.wait()
    del holder
    gc.collect()
    freed_meanwhile = len(freed)
    go_on.set()
    other.join()
    gc.collect()
    assert freed
    assert not freed_meanwhile


@pytest.mark.parametrize("kind", HOLDERS)
def test_what_is_dropped_in_nobodys_turn_is_freed_in_a_turn(plain_device, kind, monkeypatch):
    # Another thread could begin to record a graph meanwhile.
    owned, free = [], wp.array.__del__
    holder = HOLDERS[kind](SCENE, plain_device)
    gc.collect()
    monkeypatch.setattr(wp.array, "__del__", lambda array: (owned.append(turns._turn._is_owned()), free(array)))
    del holder
    monkeypatch.undo()
    assert owned
    assert all(owned)


CUBES = box((2, 2, 2)) + box((2, 2, 2)).translate((0, 0, 3))
SIMULATED = {
    "a chain": (chain(3), {}),
    "a probe in each substep": (chain(3), {"probes": {"end": Probe([2], "velocity", every="substep")}}),
    "functions of time": (
        chain(3),
        {"gravity": lambda t: (0, 0, -9.8), "colliders": [Plane(motion=lambda t: (0, 0, -t))]},
    ),
    "bodies in contact": (CUBES, {"contact": Contact()}),
    "bodies for two threads": (CUBES, {"contact": Contact(), "threads": 2}),
}


@pytest.mark.parametrize("kind", [*SIMULATED, "gradient"])
def test_what_is_dropped_in_nobodys_turn_is_freed_at_once(plain_device, kind):
    """Arrays of a device are freed with the last reference, not at some collection of garbage."""
    body, options = SIMULATED.get(kind, (chain(3), {}))
    if plain_device != "cpu":
        options = {name: value for name, value in options.items() if name != "threads"}
    gc.disable()
    try:
        simulation = Simulation(body, device=plain_device, **options)
        simulation.step(2)
        if kind == "gradient":
            simulation.gradient(lambda frames: (0.0, np.zeros(frames.position.shape), None), 2)
        model = weakref.ref(simulation.model)
        del simulation
        assert model() is None
    finally:
        gc.enable()


def is_taken():
    """Tell whether it is this thread's turn, or that of the one that it draws for."""
    free = not turns._turn._is_owned() and turns._turn.acquire(blocking=False)
    if free:
        turns._turn.release()
    return not free


@pytest.mark.slow
def test_all_that_is_done_with_warp_is_done_in_turn(tmp_path, monkeypatch, plain_device):
    outside = []

    def watched(name, function):
        def call(*arguments, **options):
            if not is_taken():
                outside.append((name, "".join(traceback.format_stack(limit=6))))
            return function(*arguments, **options)

        return call

    for name in ("launch", "copy", "capture_begin", "zeros", "empty", "full"):
        monkeypatch.setattr(wp, name, watched(name, getattr(wp, name)))
    monkeypatch.setattr(wp.array, "numpy", watched("numpy", wp.array.numpy))

    body = box((3, 3, 3), 0.1, mass=0.01, stiffness=300.0, damping=0.2).translate((0, 0, 0.2))
    scene = Scene(system=body, colliders=[Plane()], probes={"top": Probe(slice(0, 3), "position")})
    simulation = Simulation.from_scene(scene, device=plain_device, contact_forces=True)
    readback = Readback(simulation, contact_forces=True)
    with TrajectoryWriter(tmp_path / "a.vtkhdf", body, fps=60, contact_forces=True) as writer:
        for _ in simulation.frames(0.05):
            writer.write_pending(readback.take())
    kept = simulation.checkpoint()
    simulation.change(gravity=1.0)
    simulation.change(velocity=(1, 0, 0))
    simulation.change(stiffness=200.0)
    simulation.step()
    _ = simulation.measure(), simulation.contact_force(), simulation.snapshot(), simulation.rest_length
    simulation.reset()
    simulation.restore(*kept)
    _ = repr(simulation), simulation.readings["top"]

    ensemble = Ensemble(scene, 3, stiffness=[100.0, 200.0, 300.0], device=plain_device)
    ensemble.run(0.05, observe={"top": Probe(slice(0, 3), "position"), "energy": "energy"})
    _ = ensemble.system_of(1), ensemble.status, ensemble.diverged_at, ensemble.diverged_particle
    ensemble.simulation_of(1, start=False).step()
    match_stiffness(body, body)

    for backend in ("raster", "raycast"):
        device = plain_device if backend == "raycast" else None
        Renderer(scene, body.position[np.newaxis], resolution=(32, 32), backend=backend, device=device).image(
            simulation.positions
        )
    with Trajectory(tmp_path / "a.vtkhdf") as trajectory:
        list(history(trajectory, gravity=9.82))
    assert not outside, "\n".join(outside[0])


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


@pytest.mark.parametrize("make", [Simulation, lambda body, **options: Ensemble(body, 2, **options)])
def test_ctrl_c_waits_for_the_end_of_a_frame(make, device, heard, monkeypatch):
    """The state is that of the frame that is told, however often Ctrl-C is pressed."""
    made, usual, advance = make(chain(5), device=device), make(chain(5), device=device), Stepping.advance

    def interrupted(stepping, *times):
        fine = advance(stepping, *times)  # the frame is made, but not yet counted
        signal.raise_signal(signal.SIGINT)
        return fine

    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    monkeypatch.setattr(Stepping, "advance", interrupted)
    for k in range(3):
        with pytest.raises(KeyboardInterrupt):
            made.step(4)  # in such a row the next frame may have been launched
        assert made.frame_index == k + 1
    monkeypatch.undo()
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    made.step(2)
    usual.step(5)
    np.testing.assert_array_equal(made.frame().position, usual.frame().position)


@pytest.mark.parametrize(("of", "where"), [(wp, "capture_launch"), (Stepping, "_is_fine")], ids=["launch", "wait"])
def test_what_a_handler_raises_in_a_frame_leaves_its_start(device, monkeypatch, of, where):
    made, usual = (Simulation(chain(5), device=device) for _ in range(2))
    for one in (made, usual):
        one.step(4)  # later frames are launched as graphs
    call = getattr(of, where)

    def interrupted(*arguments):
        call(*arguments)
        raise TimeoutError

    monkeypatch.setattr(of, where, interrupted)
    with pytest.raises(TimeoutError):
        made.step(3)
    monkeypatch.undo()
    assert made.frame_index == 4
    for _ in range(3):
        np.testing.assert_array_equal(made.frame().position, usual.frame().position)
        made.step()
        usual.step()
