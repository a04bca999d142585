"""Threads of the CPU that share a body: results do not depend on how many they are, and none waits in vain."""

import os
import signal
import subprocess
import sys
import threading

import numpy as np
import pytest

from msdwarp import (
    RK4,
    Contact,
    Leapfrog,
    LinearlyImplicitEuler,
    Plane,
    Probe,
    Simulation,
    Sphere,
    SymplecticEuler,
    System,
    Wind,
    ball,
    box,
    sheet,
)
from msdwarp.engine.collision.body_contact import BodyContact
from msdwarp.engine.stepping.assemble import assemble
from msdwarp.engine.stepping.cpu_partition import LEAST_WORK, THREADS, PartitionedGraph, threads_for
from msdwarp.world import Problem

FORCE_ALGORITHMS = ("scatter", "gather", "stencil")
BODY = box((5, 4, 6), stiffness=1000.0, damping=2.0).translate((0, 0, 2.5))
FLOOR = Plane()
LIFT = Sphere((0, 0, -1.0), 1.0, motion=lambda t: (0 * t, 0 * t, 0.5 * t))
CLOTH = sheet((9, 7), stiffness=900.0, damping=1.0)
LOW = ball(0.5, 0.25, stiffness=500.0, damping=1.0).translate((0, 0, 0.5))
PAIR = LOW + LOW.translate((0, 0, 1.002))


def outcome(system, threads, frames=4, **options):
    """Return what there is of a run by so many threads: positions, velocities and what has changed."""
    simulation = Simulation(system, device="cpu", threads=threads, **options)
    assert simulation.threads == threads
    for _ in range(frames):
        simulation.step()
    frame, changed = simulation.frame(), simulation.assembly.changed_fields()
    return [frame.position, frame.velocity, *changed.values()]


def assert_same(system, several=(3,), **options):
    """Assert that several threads come to what one comes to, bit for bit."""
    alone = outcome(system, 1, **options)
    assert not np.array_equal(alone[0], system.position)
    for threads in several:
        together = outcome(system, threads, **options)
        for one, other in zip(alone, together, strict=True):
            np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize(
    ("force_algorithm", "method", "precision"),
    [
        ("scatter", SymplecticEuler(), "float32"),
        *(
            pytest.param(*one, marks=pytest.mark.slow)
            for one in (
                ("stencil", Leapfrog(damper_extrapolation=0.5), "float64"),
                ("gather", RK4(), "float32-compensated"),
                ("gather", LinearlyImplicitEuler(iterations=3), "float32"),
            )
        ),
    ],
    ids=str,
)
def test_threads_come_to_what_one_comes_to(force_algorithm, method, precision):
    # Each particle's forces are summed in the same order, by the same code.
    options = {"force_algorithm": force_algorithm, "integrator": method, "precision": precision}
    assert_same(BODY.pin([0]), (2, 3), colliders=[FLOOR], substeps=10, fps=360, **options)


# How an algorithm sums forces and what else there is share no code but the loop over particles: each is tried with
# some of the others.


EFFECTS = {
    "tearing in the wind": (CLOTH.pin([0, 8]).replace(break_strain=0.001), {"loads": [Wind((3.0, 1.0, -2.0))]}),
    "touching": (PAIR, {"contact": Contact(), "colliders": [FLOOR], "substeps": 10, "fps": 360}),
    "yielding on a moving sphere in another gravity each frame": (
        BODY.replace(yield_strain=0.001, relaxation_time=0.01),
        {"colliders": [FLOOR, LIFT], "contact_forces": True, "gravity": lambda t: 9.82 + np.sin(60 * t)},
    ),
    "looked at in each substep": (BODY, {"probes": {"top": Probe([0, 7], "velocity", every="substep")}}),
}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("force_algorithm", "name"), [*zip(("stencil", "gather", "scatter", "stencil"), EFFECTS, strict=True)]
)
def test_effects_do_not_matter(force_algorithm, name):
    system, options = EFFECTS[name]
    assert_same(system, force_algorithm=force_algorithm, **options)


GRAINS = System(
    position=0.1 * np.stack(np.meshgrid(*[np.arange(5.0)] * 3), axis=-1).reshape(-1, 3),
    connections=np.zeros((0, 2), dtype=int),
    mass=0.01,
    velocity=np.random.default_rng(4).uniform(-1, 1, (125, 3)),
)
ALL = Contact(self_contact=True, thickness=0.1)
TOUCHING = {
    "a cloth on a ball": (
        LOW
        + sheet((9, 7), 0.2, stiffness=900.0, damping=1.0)
        .translate((-0.8, -0.6, 1.06))
        .with_velocity((0.0, 0.0, -1.0)),
        {"contact": ALL},
    ),
    "grains": (GRAINS, {"contact": Contact(thickness=0.1, stiffness=100.0), "gravity": 0.0, "fps": 240}),
    "and flowing": (
        PAIR.replace(yield_strain=0.001, relaxation_time=0.01),
        {"fps": 30, "contact": Contact(), "colliders": [FLOOR]},
    ),
}


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::msdwarp.StartWarning")
@pytest.mark.parametrize("name", TOUCHING)
def test_threads_share_contacts(name):
    # Forces of contact are whole numbers of a unit: their sums do not depend on the order.
    system, options = TOUCHING[name]
    runs = []
    for threads in (1, 2):
        simulation = Simulation(system, device="cpu", threads=threads, **options)
        body_contact = False
        for _ in range(8 if name == "and flowing" else 4):  # these first fall on each other
            simulation.step()
            (touching,) = (one for one in simulation.assembly.all if isinstance(one, BodyContact))
            body_contact |= touching.deepest > 0
        frame = simulation.frame()
        runs.append([frame.position, frame.velocity, *touching.checkpoint().values()])
        assert body_contact
    for run in runs[1:]:
        for one, other in zip(runs[0], run, strict=True):
            np.testing.assert_array_equal(one, other)


def model(shape):
    return assemble(Problem(system=box(shape, stiffness=100.0)), device="cpu")


def test_automatic_threads_go_by_the_body(monkeypatch):
    monkeypatch.delenv(THREADS, raising=False)
    monkeypatch.setattr("msdwarp.engine.stepping.cpu_partition.cores", lambda: 4)
    assert threads_for(model((3, 3, 3)), "auto") == 1
    middle = model((11, 11, 11))
    assert 2 * LEAST_WORK < middle.model.connection_count < 3 * LEAST_WORK
    assert threads_for(middle, "auto") == 2
    assert threads_for(model((20, 20, 20)), "auto") == 4
    small = box((10, 9, 10), stiffness=100.0)
    assert LEAST_WORK < small.connection_count < 2 * LEAST_WORK
    assert threads_for(assemble(Problem(system=small), device="cpu"), "auto") == 1
    assert (
        threads_for(assemble(Problem(system=small, contact=Contact()), device="cpu"), "auto") == 2
    )  # its points are shared, too
    flowing = small.replace(yield_strain=0.1, relaxation_time=0.1)
    assert threads_for(assemble(Problem(system=flowing, contact=Contact()), device="cpu"), "auto") == 1
    monkeypatch.setenv(THREADS, "3")
    assert threads_for(model((20, 20, 20)), "auto") == 3
    assert threads_for(model((3, 3, 3)), 5) == 5  # asked for


@pytest.mark.parametrize("threads", [0, -1, 1.5, "two", None])
def test_wrong_threads_are_told(threads):
    with pytest.raises(ValueError, match="threads"):
        Simulation(BODY, device="cpu", threads=threads)


def test_a_wrong_variable_is_told(monkeypatch):
    monkeypatch.setenv(THREADS, "many")
    with pytest.raises(ValueError, match=f"{THREADS} is 'many'; it must be a whole number"):
        Simulation(BODY, device="cpu")


@pytest.mark.gpu
def test_a_gpu_has_its_own_threads():
    with pytest.raises(ValueError, match="threads is 2; it must be 1 or 'auto' on a GPU"):
        Simulation(BODY, device="cuda:0", threads=2)
    assert Simulation(BODY, device="cuda:0").threads == 1


def test_what_a_thread_raises_is_raised_and_nobody_waits():
    simulation = Simulation(BODY, device="cpu", threads=3)
    simulation.step()
    frame, x = simulation.stepping.graph.__self__, simulation.frame().position
    good, frame._graphs[2] = frame._graphs[2], None
    with pytest.raises(AttributeError):
        frame.replay()
    frame._graphs[2] = good
    simulation.reset()  # the pool is as good as before
    simulation.step()
    np.testing.assert_array_equal(simulation.frame().position, x)


@pytest.mark.slow
def test_ctrl_c_leaves_a_whole_frame(heard, monkeypatch):
    under_way, caught, replay = threading.Event(), [], PartitionedGraph.replay
    monkeypatch.setattr(PartitionedGraph, "replay", lambda frame: (under_way.set(), replay(frame)))

    def run(is_over):
        simulation = Simulation(BODY, device="cpu", threads=2, substeps=10_000, energy_limit=float("inf"))
        while not is_over(simulation.frame_index):
            try:
                simulation.step()
            except KeyboardInterrupt:
                caught.append(simulation.frame_index)
        return simulation.frame_index, simulation.frame().position

    def interrupt():
        under_way.wait(60)  # the frame's only launch takes some 60 ms
        os.kill(os.getpid(), signal.SIGINT)

    other = threading.Thread(target=interrupt)
    other.start()
    frames, position = run(lambda frames: caught and frames >= caught[0] + 2)
    other.join()
    # The frame that was under way is finished, but not counted.
    wholes = [run(lambda count, end=end: count >= end)[1] for end in (frames, frames + 1)]
    assert any(np.array_equal(position, whole) for whole in wholes)


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(os, "fork"), reason="there is no fork")
def test_a_forked_process_has_a_pool_of_its_own():
    code = """
import os
import msdwarp
body = msdwarp.box((4, 4, 4), stiffness=100.0, damping=1.0).translate((0, 0, 2.0))
simulation = msdwarp.Simulation(body, device="cpu", threads=2, colliders=[msdwarp.Plane()])
simulation.step()
child = os.fork()
simulation.step()
if child:
    assert os.waitpid(child, 0)[1] == 0
else:
    os._exit(0)
"""
    subprocess.run([sys.executable, "-W", "ignore", "-c", code], check=True, timeout=60)
