"""A scene knows its kernels when it is assembled; those that were never compiled compile side by side."""

import _thread
import importlib
import threading
import time
from types import SimpleNamespace
from unittest.mock import patch

import pytest
import warp as wp

from msdwarp import Contact, Ensemble, LinearlyImplicitEuler, Plane, Scene, Simulation, box, chain
from msdwarp.integrators import choose_forced
from msdwarp.kernels.filling import find_depths
from msdwarp.runtime import ImaginedGpu, Kernels, compile_ahead, rehearsing, start_warp
from msdwarp.simulation import SubstepChooser

SCENES = ("cube", "cloth", "tower", "dice", "curtain", "mattress")


@pytest.fixture
def noted(monkeypatch):
    """Return the set of modules, with numbers of threads of a block, that scenes have noted."""
    start_warp()
    found, note = set(), Kernels.note

    def noting(kernels, *given, block=256, **how):
        found.update((one.module, block if kernels._device.is_cuda else 1) for one in given)
        return note(kernels, *given, block=block, **how)

    monkeypatch.setattr(Kernels, "note", noting)
    return found


@pytest.fixture
def launched(monkeypatch):
    """Return the set of modules, with numbers of threads of a block, that are launched on the CPU."""
    found, launch = set(), wp.launch

    def launching(kernel, *args, **named):
        found.add((kernel.module, 1))
        return launch(kernel, *args, **named)

    monkeypatch.setattr(wp, "launch", launching)
    return found


def blocks(apart: float = 0.1):
    """Return two blocks, one above the other."""
    one = box((3, 3, 3), 0.1, stiffness=400.0, damping=0.2)
    return one + one.rotate(0.3, axis=(1, 2, 0)).translate((0.02, 0.0, 0.2 + apart))


MADE = {
    "plain": lambda: Simulation(box((3, 3, 3), 0.1), device="cpu"),
    "in contact": lambda: Simulation(blocks(), contact=Contact(), colliders=[Plane()], device="cpu"),
    "overlapping": lambda: Simulation(blocks(-0.03), contact=Contact(), device="cpu"),
    "shared": lambda: Simulation(blocks(), contact=Contact(), device="cpu", threads=2),
    "implicit": lambda: Simulation(box((3, 3, 3), 0.1), integrator=LinearlyImplicitEuler(), device="cpu"),
    "compensated": lambda: Simulation(blocks(), contact=Contact(), device="cpu", precision="float32-compensated"),
    "worlds": lambda: Ensemble(Scene(system=chain(3)), 2, stiffness=[90.0, 110.0], device="cpu"),
}


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::msdwarp.StartWarning")  # of what overlaps
@pytest.mark.parametrize("name", MADE)
def test_a_frame_needs_no_kernel_that_the_scene_did_not_know(name, noted, launched):
    made = MADE[name]()
    made.step(3)
    assert {module.name for module, _ in launched - noted} <= {find_depths.module.name}  # of a check before


@pytest.mark.parametrize("arch", [80, 90])
@pytest.mark.parametrize("name", SCENES)
@pytest.mark.slow
def test_a_scene_knows_its_kernels_for_a_gpu_that_is_not_there(name, arch, noted):
    scene, gpu, launched = importlib.import_module(f"msdwarp.scenes.{name}").build(), ImaginedGpu(arch), set()
    noted.clear()

    def launch(kernel, *args, device=None, block_dim=256, **named):
        if type(device) is not str:
            launched.add((kernel.module, block_dim))

    def branch(condition, launch_then):
        launch_then()

    with (
        rehearsing(),
        patch.multiple(Kernels, compile=lambda _: None, is_compiled=lambda *_: True),
        patch.object(
            SubstepChooser, "choose", lambda self, rates, *_: choose_forced(rates, self.method, self.fps, 2)
        ),
        patch.multiple(wp, launch=launch, capture_if=branch, capture_while=branch),
    ):
        stepping = Simulation.from_scene(scene, device=gpu).stepping
        stepping.dynamics.begin_frame(0.0)
        if stepping.assembly.body_contact is not None and (planes := stepping.assembly.body_contact.planes):
            planes.awake = True  # as in the middle of a run
        for along in {False, stepping.stepper.may_take_contact_along}:
            stepping.stepper.takes_contact_along = along
            stepping._launch_part(range(stepping.choice.substeps), stepping._tracks.current)
        stepping.balance()
    assert launched
    assert {module.name for module, _ in launched - noted} == set()


class Slow:
    """Stands for a job that takes a while; the second interrupts, as Ctrl-C does."""

    device, begun = None, []  # a GPU that need not be there

    def run(self):
        """Take a while."""
        self.begun.append(threading.current_thread())
        if len(self.begun) == 2:
            _thread.interrupt_main()
        time.sleep(0.3)


def test_ctrl_c_while_kernels_compile_leaves_no_thread(monkeypatch):
    monkeypatch.setenv(compile_ahead.THREADS, "2")
    monkeypatch.setattr(compile_ahead, "cores", lambda: 2)
    monkeypatch.setattr(compile_ahead.Job, "run", Slow.run)
    with pytest.raises(KeyboardInterrupt):
        compile_ahead.compile_all([Slow() for _ in range(50)])
    assert 2 <= len(Slow.begun) < 10  # the queued ones were cancelled
    assert not any(thread.is_alive() for thread in Slow.begun)


def test_what_only_makes_frames_faster_compiles_beside_the_run(monkeypatch):
    kernels = Kernels(type("Gpu", (), {"is_cuda": True, "is_cpu": False, "__hash__": None})())  # as Warp's devices
    needed, beside = (SimpleNamespace(module=name) for name in ("needed", "beside"))
    compiled, may_end = [], threading.Event()

    def run(job):
        if job.module == "beside":
            may_end.wait()
        compiled.append(job.module)

    monkeypatch.setattr(compile_ahead.Job, "run", run)
    monkeypatch.setattr(compile_ahead.Job, "is_missing", lambda job: job.module not in compiled)
    kernels.note(beside, block=512, beside=True)
    kernels.note(needed)
    kernels.compile()
    assert compiled == ["needed"]
    assert not kernels.is_compiled(beside, 512)
    may_end.set()
    for thread in threading.enumerate():
        if thread.name == compile_ahead.BESIDE:
            thread.join()
    assert kernels.is_compiled(beside, 512)
