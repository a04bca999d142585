"""Runs that end before their time, or in each other's way: what is kept goes on, or is refused."""

import os
import signal
import subprocess
import sys

import pytest
from runs import UNDRAWN, assert_same_run
from trajectories import largest_file

from msdwarp import Trajectory
from msdwarp.disk import alone_in


@pytest.mark.slow
def test_a_signal_ends_a_run_between_two_frames_and_it_can_go_on(msdwarp, own, heard):
    folder = own.parent
    log = ("--log", "./own.csv")
    assert msdwarp("run", "own.py", *UNDRAWN, "--out", "whole", "--log", "./whole.csv")[0] == 0
    (folder / "bang").write_text("SIGINT")
    before = signal.getsignal(signal.SIGINT)
    code, out, err = msdwarp("run", "own.py", *UNDRAWN, *log)
    assert (code, out) == (130, "")
    assert err == "interrupted at 0.1667 s, after frame 10 of 24: `msdwarp resume out/own` goes on\n"
    assert signal.getsignal(signal.SIGINT) is before
    with Trajectory(folder / "out" / "own" / "trajectory.vtkhdf") as found:
        assert len(found) == 11
    assert msdwarp("resume", "out/own")[0] == 0
    assert_same_run(folder / "out" / "own", folder / "whole")
    assert (folder / "own.csv").read_text() == (folder / "whole.csv").read_text()
    assert (folder / "own.png").exists()


@pytest.mark.slow
def test_a_signal_in_the_last_frame_is_heard_and_pictures_are_drawn_later(msdwarp, own, heard):
    (own.parent / "bang").write_text("SIGTERM")
    drawn = ("--resolution", "64x64", "--duration", "0.167", "--frames", "none", "--device", "cpu")
    code, _, err = msdwarp("run", "own.py", *drawn)
    assert (code, err[:22], "after frame 10 of 10" in err) == (143, "terminated at 0.1667 s", True)
    code, out, _ = msdwarp("resume", "out/own")
    assert (code, "drew 11 frames" in out) == (0, True)
    film = (own.parent / "out" / "own" / "own.webp").read_bytes()
    code, out, _ = msdwarp("resume", "out/own")
    assert (code, out) == (0, "the run is complete (11 frames, 0.1667 s); a longer --duration extends it\n")
    assert (own.parent / "out" / "own" / "own.webp").read_bytes() == film


def test_a_lost_folder_ends_a_run_with_a_message(msdwarp, own):
    (own.parent / "bang").write_text("lose")
    code, out, err = msdwarp("run", "own.py", *UNDRAWN)
    assert (code, out) == (1, "")
    assert err.startswith(
        "error: out/own/trajectory.vtkhdf could not be written further: it was moved, removed or"
    )
    assert err.count("\n") == 1


@pytest.mark.slow
def test_a_full_disk_ends_a_run_with_a_message_and_a_file_that_opens(msdwarp, tmp_path):
    run = ("run", "cube", "--size", "6", *UNDRAWN)
    assert msdwarp(*run, "--out", "free", "--duration", "0.1")[0] == 0  # compiles kernels: larger files
    with largest_file(1_500_000):
        code, out, err = msdwarp(*run, "--out", "full")
    assert (code, out, err.count("\n")) == (1, "", 1)
    assert err.startswith("error: full/trajectory.vtkhdf could not be written further: File too large")
    with Trajectory(tmp_path / "full" / "trajectory.vtkhdf") as found:
        assert len(found) > 3
        assert f"its first {len(found)} frames are kept" in err


KILLED = """
import os, shutil, signal, sys, time
from pathlib import Path
import numpy as np
from msdwarp import Trajectory
from msdwarp.cli.options import Options
from msdwarp.cli.commands.draw import Pictures
from msdwarp.cli.scene_files import find_scene
from msdwarp.cli.process import start_warp
from msdwarp.cli.commands.stored_runs import resume_run
from msdwarp.cli.commands.run import run_scene

start_warp(False)

def run(folder, restart, **options):
    origin = find_scene("own.py")._replace(parameters={"size": 5})
    pictures = Pictures(frames="none", video="none")
    run_scene(origin, origin.scene(), Options(out=folder, pictures=pictures, quiet=True, device="cpu",
        duration=1.5, restart=restart, force=True, **options))

compress = sys.argv[1]
whole, folder = Path("whole"), Path("killed")
began = time.perf_counter()
run(whole, 1000.0, trajectory=compress)
took = time.perf_counter() - began
with Trajectory(whole / "trajectory.vtkhdf") as found:
    expected = found.positions[:]
random, kills, resumed, seen, patience = np.random.default_rng(), 0, 0, set(), took / 2
while kills < int(sys.argv[2]) or not (resumed and seen):
    again = (folder / "restart.h5").exists()
    child = os.fork()
    if child == 0:
        if again:
            resume_run(folder, force=True, quiet=True)
        else:
            run(folder, 1e-3, trajectory=compress)
        os._exit(0)
    time.sleep(random.uniform(0, patience))
    os.kill(child, signal.SIGKILL)
    if os.waitpid(child, 0)[1] == 0:  # it had ended before: what was timed compiled kernels too
        shutil.rmtree(folder)
        patience *= 0.8
        continue
    kills, resumed = kills + 1, resumed + again
    if not (folder / "restart.h5").exists():  # as where the machine has more to do than when it was timed
        patience *= 1.5
    if (folder / "trajectory.vtkhdf").exists():
        with Trajectory(folder / "trajectory.vtkhdf") as found:
            np.testing.assert_array_equal(found.positions[:], expected[: len(found)])
            seen.add(len(found))
if (folder / "restart.h5").exists():
    resume_run(folder, force=True, quiet=True)
else:
    run(folder, 1e-3, trajectory=compress)
"""


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")
@pytest.mark.parametrize(("kind", "kills"), [("plain", 6), ("compressed", 3)])
def test_a_run_killed_again_and_again_ends_as_if_nothing_had_happened(own, kind, kills):
    done = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", KILLED, kind, str(kills)],
        cwd=own.parent,
        capture_output=True,
        text=True,
        timeout=600,
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert_same_run(own.parent / "killed", own.parent / "whole")


@pytest.mark.slow
def test_two_runs_do_not_write_in_one_folder(msdwarp, tmp_path):
    small = ("run", "cube", "--size", "3", "--duration", "0.1", *UNDRAWN, "--out", "here")
    assert msdwarp(*small)[0] == 0
    before = {path.name: path.read_bytes() for path in (tmp_path / "here").iterdir()}
    with alone_in(tmp_path / "here"):
        for words in (("resume", "here", "--duration", "0.2"), (*small, "--force")):
            said = "error: another run is writing in here; wait for it, or name another folder\n"
            assert msdwarp(*words) == (1, "", said)
    assert {path.name: path.read_bytes() for path in (tmp_path / "here").iterdir()} == before
    assert msdwarp("resume", "here", "--duration", "0.2")[0] == 0
