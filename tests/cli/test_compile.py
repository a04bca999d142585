"""`msdwarp compile` fills the folder of compiled kernels, also for GPUs that are not there."""

import os
import subprocess
import sys

import pytest
import warp as wp

from msdwarp import Contact, Plane, Scene, Simulation, box
from msdwarp.cli.commands.compile import jobs_of
from msdwarp.runtime import start_warp

RUN = "from msdwarp.cli import main; main()"
pytestmark = pytest.mark.slow


def supported():
    """Return the architectures for which this Warp can compile without a GPU."""
    start_warp()
    return wp._src.context.runtime.nvrtc_supported_archs


def said(folder, *words, program=RUN, **environment):
    """Return what a command prints that keeps compiled kernels in a folder."""
    environment = os.environ | {"WARP_CACHE_PATH": str(folder)} | environment
    command = [sys.executable, "-c", program, *words]
    return subprocess.run(command, capture_output=True, text=True, env=environment, check=True).stdout.splitlines()


COUNTED = """
import importlib, sys, msdwarp
from msdwarp.runtime import Compiling
for name in sys.argv[2:]:
    scene = importlib.import_module(f"msdwarp.scenes.{name}").build()
    msdwarp.Simulation.from_scene(scene, device=sys.argv[1]).step(30)
    print(Compiling.modules)
"""
"""Prints how many modules runs of scenes have compiled."""


def test_a_run_finds_what_was_compiled(tmp_path):
    said(tmp_path, "compile", "chain", "--device", "cpu")
    assert said(tmp_path, "cpu", "chain", program=COUNTED) == ["0"]


@pytest.mark.gpu
def test_a_run_on_a_gpu_finds_what_was_compiled_without_it(tmp_path):
    arch = str(wp.get_device("cuda:0").arch)
    said(tmp_path, "compile", "cube", "dice", "--arch", arch, CUDA_VISIBLE_DEVICES="")
    assert said(tmp_path, "cuda:0", "cube", "dice", program=COUNTED) == ["0", "0"]


@pytest.mark.skipif(not supported(), reason="this Warp compiles for no GPU")
def test_kernels_for_a_gpu_compile_where_there_is_none(tmp_path):
    words = ("compile", "chain", "--arch", "80,90")
    lines = said(tmp_path, *words, CUDA_VISIBLE_DEVICES="")
    assert [line.split(":")[0] for line in lines] == ["chain for sm_80", "chain for sm_90"]
    assert not any(line.endswith(" 0 compiled now") for line in lines)
    for arch in (80, 90):  # each advances a chain by one block; what they share has a folder with both files
        assert list(tmp_path.rglob(f"*take_stages*.sm{arch}.cubin"))
    kept = sorted(tmp_path.rglob("*.cubin"))
    assert all(line.endswith(" 0 compiled now") for line in said(tmp_path, *words, CUDA_VISIBLE_DEVICES=""))
    assert sorted(tmp_path.rglob("*.cubin")) == kept


@pytest.mark.parametrize(
    ("words", "named"),
    [
        ((), "scene is missing"),
        (("cube", "--arch", "9.0"), "arch is '9.0'; it must be"),
        (("cube", "--arch", "90", "--device", "cpu"), "arch is 90, and device is 'cpu'"),
        (("cubes",), "scene is 'cubes'"),
    ],
)
def test_what_cannot_be_compiled_is_named(msdwarp, words, named):
    code, _, error = msdwarp("compile", *words)
    assert code == 1
    assert error.startswith(f"error: {named}")


def test_no_later_frame_needs_another_kernel(monkeypatch):
    # Blocks that fall onto a plane, and the upper one onto the lower one: contact begins long after the start.
    one = box((3, 3, 3), 0.1, stiffness=400.0, damping=0.2).translate((0, 0, 0.12))
    system = one + one.rotate(0.3, axis=(1, 2, 0)).translate((0.02, 0.0, 0.3))
    scene = Scene(system=system, colliders=[Plane(friction=0.4)], contact=Contact(friction=0.4))
    rehearsed = {job.module for job in jobs_of(lambda device: Simulation.from_scene(scene, device=device), "cpu")}
    launched, launch = set(), wp.launch

    def noting(kernel, *args, **named):
        launched.add(kernel.module)
        return launch(kernel, *args, **named)

    monkeypatch.setattr(wp, "launch", noting)
    simulation, deepest = Simulation.from_scene(scene, device="cpu"), 0.0
    for _ in range(30):
        simulation.step()
        deepest = max(deepest, simulation.assembly.body_contact.deepest)
    assert deepest > 0.0
    assert launched <= rehearsed


@pytest.mark.skipif(not supported(), reason="this Warp composes for no GPU")
def test_kernels_of_a_gpu_differ_by_what_it_can():
    # From compute capability 9.0 on, a cluster of blocks takes all substeps of 8³ particles; before there is none.
    scene = Scene(system=box((8, 8, 8), 0.1))
    for arch, clusters in ((80, False), (90, True)):
        jobs = jobs_of(lambda device: Simulation.from_scene(scene, device=device), arch)
        assert {(job.device, job.arch) for job in jobs} == {(None, arch)}
        assert any("persistent" in job.module.name for job in jobs) == clusters


def test_a_rehearsal_ends():
    usual = wp.launch, wp.zeros
    jobs_of(lambda device: Simulation(box((3, 3, 3), 0.1), device=device), "cpu")
    assert (wp.launch, wp.zeros) == usual
