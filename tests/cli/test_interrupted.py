"""Runs that end before their time, or in each other's way: what is kept goes on, or is refused."""

import os
import signal
import subprocess
import sys

import numpy as np
import pytest
from runs import UNDRAWN, assert_same_run

from msdwarp import Trajectory
from msdwarp.disk import alone_in
from msdwarp.files.checkpoint_file import read_restart


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "code", "word"),
    [("SIGINT", 130, "interrupted"), pytest.param("SIGTERM", 143, "terminated", marks=pytest.mark.slow)],
)
def test_a_signal_ends_a_run_between_two_frames_and_it_can_go_on(msdwarp, own, heard, name, code, word):
    folder = own.parent
    log = ("--log", "./own.csv")
    assert msdwarp("run", "own.py", *UNDRAWN, "--out", "whole", "--log", "./whole.csv")[0] == 0
    (folder / "bang").write_text(name)
    before = signal.getsignal(signal.SIGINT)
    got, out, err = msdwarp("run", "own.py", *UNDRAWN, *log)
    assert (got, out) == (code, "")
    assert err == f"{word} at 0.1667 s, after frame 10 of 24: `msdwarp resume out/own` goes on\n"
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
    assert (code, "after frame 10 of 10" in err) == (143, True)
    code, out, _ = msdwarp("resume", "out/own")
    assert (code, "drew 11 frames" in out) == (0, True)
    film = (own.parent / "out" / "own" / "own.webp").read_bytes()
    code, out, _ = msdwarp("resume", "out/own")
    assert (code, out) == (0, "the run is complete (11 frames, 0.1667 s); a longer --duration extends it\n")
    assert (own.parent / "out" / "own" / "own.webp").read_bytes() == film


@pytest.mark.slow
def test_it_can_go_on_from_the_first_frame_on(msdwarp, own):
    # Killed before a minute is over: the restart file of the start is there.
    assert msdwarp("run", "own.py", *UNDRAWN, "--out", "whole")[0] == 0
    (own.parent / "bang").write_text("SIGKILL")
    code = "import sys; sys.argv = ['msdwarp', *sys.argv[1:]]; from msdwarp.cli import main; main()"
    killed = subprocess.run([sys.executable, "-c", code, "run", "own.py", *UNDRAWN], cwd=own.parent, check=False)
    assert killed.returncode == -signal.SIGKILL
    assert read_restart(own.parent / "out" / "own" / "restart.h5")[1]["checkpoint"]["frame_index"] == 0
    assert msdwarp("resume", "out/own")[0] == 0
    assert_same_run(own.parent / "out" / "own", own.parent / "whole")


@pytest.mark.slow
def test_a_run_that_diverges_leaves_what_was_good(msdwarp, tmp_path):
    code, _, err = msdwarp("run", "cube", "--size", "5", "--substeps", "1", "--allow-unstable", *UNDRAWN)
    assert code == 1
    assert err.startswith("error: diverged at")
    with Trajectory(tmp_path / "out" / "cube" / "trajectory.vtkhdf") as found:
        assert np.isfinite(found.positions[:]).all()
        last = len(found) - 1
    assert read_restart(tmp_path / "out" / "cube" / "restart.h5")[1]["checkpoint"]["frame_index"] == last
    assert "diverged at" in msdwarp("resume", "out/cube")[2]  # again


def test_a_lost_folder_ends_a_run_with_a_message(msdwarp, own):
    (own.parent / "bang").write_text("lose")
    code, out, err = msdwarp("run", "own.py", *UNDRAWN)
    assert (code, out) == (1, "")
    assert err.startswith(
        "error: out/own/trajectory.vtkhdf could not be written further: it was moved, removed or"
    )
    assert err.count("\n") == 1


FULL = """
import resource, sys
sys.dont_write_bytecode = True  # of what is imported late: it would be cut off too
if "limited" in sys.argv:
    resource.setrlimit(resource.RLIMIT_FSIZE, (1_500_000, 1_500_000))
sys.argv = ["msdwarp", "run", "cube", "--size", "6", "--frames", "none", "--video", "none", "--device", "cpu"]
from msdwarp.cli import main
main()
"""


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="needs a limit to the size of files")
def test_a_full_disk_ends_a_run_with_a_message_and_a_file_that_opens(tmp_path):
    free, folder = tmp_path / "free", tmp_path / "full"
    for where in (free, folder):
        where.mkdir()
    how = {"capture_output": True, "text": True, "timeout": 600}
    # The first run compiles kernels: a compiler writes larger files.
    subprocess.run([sys.executable, "-c", FULL], cwd=free, check=True, **how)
    done = subprocess.run([sys.executable, "-c", FULL, "limited"], cwd=folder, **how)
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr.startswith("error: out/cube/trajectory.vtkhdf could not be written further: File too large")
    assert done.stderr.count("\n") == 1
    with Trajectory(folder / "out" / "cube" / "trajectory.vtkhdf") as found:
        assert len(found) > 3
        assert f"its first {len(found)} frames are kept" in done.stderr


KILLED = """
import os, shutil, signal, sys, time
from pathlib import Path
import numpy as np
from msdwarp import Trajectory
from msdwarp.cli.options import Options
from msdwarp.cli.draw import Pictures
from msdwarp.cli.scene_files import find_scene
from msdwarp.cli.process import start_warp
from msdwarp.cli.stored_runs import resume_run
from msdwarp.cli.run import run_scene

start_warp(False)

def run(folder, restart, **options):
    origin = find_scene("own.py")._replace(parameters={"size": 5})
    pictures = Pictures(frames="none", video="none")
    run_scene(origin, origin.scene(), Options(out=folder, pictures=pictures, quiet=True, device="cpu",
        duration=1.5, restart=restart, force=True, **options))

compress = sys.argv[1]
whole, folder = Path("whole"), Path("killed")
run(folder, 1000.0, trajectory=compress)  # compiles kernels: what is timed below is what will be killed
shutil.rmtree(folder)
began = time.perf_counter()
run(whole, 1000.0, trajectory=compress)
took = time.perf_counter() - began
with Trajectory(whole / "trajectory.vtkhdf") as found:
    expected = found.positions[:]
random, kills, resumed, seen, patience = np.random.default_rng(), 0, 0, set(), took / 2
while kills < int(sys.argv[2]):
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
    if os.waitpid(child, 0)[1] == 0:  # it had ended before
        shutil.rmtree(folder)
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
print(resumed, len(seen))
"""


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")
@pytest.mark.parametrize(("kind", "kills"), [("plain", 12), ("compressed", 6)])
def test_a_run_killed_again_and_again_ends_as_if_nothing_had_happened(own, kind, kills):
    done = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", KILLED, kind, str(kills)],
        cwd=own.parent,
        capture_output=True,
        text=True,
        timeout=600,
    )
    assert (done.returncode, done.stderr) == (0, "")
    resumed, seen = map(int, done.stdout.split())
    # How many of the kills came while it ran, and in how many frames, is up to the machine.
    assert resumed > 0
    assert seen > 0
    assert_same_run(own.parent / "killed", own.parent / "whole")


@pytest.mark.slow
def test_two_runs_do_not_write_in_one_folder(msdwarp, tmp_path):
    small = ("run", "cube", "--size", "3", "--duration", "0.1", *UNDRAWN, "--out", "here")
    assert msdwarp(*small)[0] == 0
    before = (tmp_path / "here" / "trajectory.vtkhdf").read_bytes()
    with alone_in(tmp_path / "here"):
        code, out, err = msdwarp("resume", "here", "--duration", "0.2")
    assert (code, out) == (1, "")
    assert err == "error: another run is writing in here; wait for it, or name another folder\n"
    assert (tmp_path / "here" / "trajectory.vtkhdf").read_bytes() == before
    assert msdwarp("resume", "here", "--duration", "0.2")[0] == 0


def test_force_does_not_touch_the_folder_of_a_run_that_is_going(msdwarp, tmp_path):
    small = ("run", "cube", "--size", "3", "--duration", "0.1", *UNDRAWN, "--out", "here")
    assert msdwarp(*small)[0] == 0
    before = {path.name: path.read_bytes() for path in (tmp_path / "here").iterdir()}
    with alone_in(tmp_path / "here"):
        assert "another run is writing in here" in msdwarp(*small, "--force")[2]
    assert {path.name: path.read_bytes() for path in (tmp_path / "here").iterdir()} == before
