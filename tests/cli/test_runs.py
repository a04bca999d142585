"""Runs that keep their frames: gone on with after whatever ended them, and made again."""

import json
import os
import re
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from trajectories import assert_trajectories_match

from msdwarp import Trajectory
from msdwarp.cli.process import alone_in
from msdwarp.files.restart import read_restart
from msdwarp.integrators.catalogue import METHODS

# A body that yields, falls on a floor beside a moving obstacle, and is changed on the way: all that a restart must
# hold. `bang` says at what time something happens to the run, and what.
SCENE = """
import os, shutil, signal
from enum import Enum
from pathlib import Path
from msdwarp import Plane, Scene, Sphere, at, box

def motion(t):
    bang = Path(__file__).with_name("bang")
    if bang.exists() and t > 0.15 and any(Path("out").rglob("trajectory.vtkhdf")):
        what = bang.read_text()
        bang.unlink()
        if what == "lose":
            shutil.rmtree(bang.with_name("out"))
        else:
            os.kill(os.getpid(), getattr(signal, what))
    return (0, 0, 0.1 * t)

class Shade(Enum):
    LIGHT = 1
    DARK = 2

def build(
    *,
    size: int = 3,
    stiffness: float = 300.0,
    where: Path | None = Path("."),
    origin: tuple[float, float, float] = (0, 0, 0),
    shade: Shade = Shade.LIGHT,
):
    body = box((size, size, 3), 0.1, mass=0.01, stiffness=stiffness, damping=0.2).rotate(0.3, (1, 0, 0))
    assert isinstance(where, Path) and isinstance(origin, tuple) and isinstance(shade, Shade)
    body = body.translate((0, 0, 0.2)).replace(yield_strain=0.05)
    ball = Sphere((0, 0, -0.4), 0.5, motion=motion)
    schedule = [at(0.1, stiffness=lambda k: 2 * k), at(0.25, mass=0.02)]
    return Scene(system=body, colliders=[Plane(), ball], schedule=schedule, duration=0.4)
"""
UNDRAWN = ["--frames", "none", "--video", "none", "--device", "cpu"]


@pytest.fixture
def heard():
    """Signals act as in a terminal, whatever the tests inherited: SIGINT is ignored in a script's background."""
    default = {signal.SIGINT: signal.default_int_handler, signal.SIGTERM: signal.SIG_DFL}
    before = {number: signal.signal(number, handler) for number, handler in default.items()}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.fixture
def own(tmp_path):
    """The script of a scene."""
    path = tmp_path / "own.py"
    path.write_text(SCENE)
    return path


def assert_same_run(one: Path, other: Path) -> None:
    """Assert that two folders hold the same to the last bit: the trajectories, and what a run would go on from."""
    with Trajectory(one / "trajectory.vtkhdf") as a, Trajectory(other / "trajectory.vtkhdf") as b:
        assert_trajectories_match(a, b)
    (arrays, about), (others, wanted) = (read_restart(folder / "restart.h5") for folder in (one, other))
    for name, value in wanted["checkpoint"].items():
        # On a GPU the bounds of rates are sums in no fixed order; steps are whole numbers of a frame.
        bound = name == "limit" or name.startswith("rates.")
        assert about["checkpoint"][name] == (pytest.approx(value, rel=1e-12) if bound else value)
    assert arrays.keys() == others.keys()
    for name, values in arrays.items():
        np.testing.assert_array_equal(values, others[name])


# Going on


QUICK = [("leapfrog", "float32"), ("rk4", "float32-compensated")]
EACH = [(name, precision) for name in METHODS for precision in ("float32", "float32-compensated", "float64")]


@pytest.mark.parametrize(
    ("integrator", "precision"),
    [pytest.param(*one, marks=[] if one in QUICK else pytest.mark.slow) for one in EACH],
)
def test_a_run_in_two_goes_ends_as_one_in_one(msdwarp, own, integrator, precision):
    options = [*UNDRAWN, "--integrator", integrator, "--precision", precision]
    if integrator == "rkc2":  # needs a damper beside each spring, and has one
        options += ["--substeps", "40"]
    assert msdwarp("run", "own.py", *options, "--out", "whole")[0] == 0
    assert msdwarp("run", "own.py", *options, "--out", "parts", "--duration", "0.2")[0] == 0
    for duration in ("0.3", "0.4"):
        code, out, err = msdwarp("resume", "parts", "--duration", duration)
        assert (code, err) == (0, "")
        assert "simulated 0.1 s" in out
    assert_same_run(own.parent / "parts", own.parent / "whole")


@pytest.mark.gpu
@pytest.mark.parametrize("route", ["gather", "stencil"])
@pytest.mark.parametrize(("integrator", "precision"), [("leapfrog", "float32"), ("rk4", "float32-compensated")])
def test_a_run_on_a_gpu_goes_on_and_is_made_again(msdwarp, tmp_path, route, integrator, precision):
    options = ("--size", "12", "--route", route, "--integrator", integrator, "--precision", precision)
    options += ("--frames", "none", "--video", "none", "--device", "cuda:0")
    assert msdwarp("run", "cube", *options, "--out", "whole", "--duration", "1.5")[0] == 0
    assert msdwarp("run", "cube", *options, "--out", "parts", "--duration", "0.7")[0] == 0
    assert msdwarp("resume", "parts", "--duration", "1.5")[0] == 0
    assert_same_run(tmp_path / "parts", tmp_path / "whole")
    assert msdwarp("rerun", "whole", "--quiet") == (0, "", "")


@pytest.mark.parametrize("route", ["gather", pytest.param("stencil", marks=pytest.mark.slow)])
def test_other_routes_go_on_too(msdwarp, tmp_path, route):
    options = ("--size", "4", "--route", route, "--every", "3", "--trajectory", "compressed", *UNDRAWN)
    assert msdwarp("run", "cube", *options, "--out", "whole", "--duration", "0.3")[0] == 0
    assert msdwarp("run", "cube", *options, "--out", "parts", "--duration", "0.15")[0] == 0
    assert msdwarp("resume", "parts/restart.h5", "--duration", "0.3")[0] == 0
    assert_same_run(tmp_path / "parts", tmp_path / "whole")
    with Trajectory(tmp_path / "parts" / "trajectory.vtkhdf") as found:
        assert (len(found), found.fps) == (7, 20)


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
def test_what_was_to_be_drawn_is_drawn_in_the_end_and_pictures_are_kept(msdwarp, own, heard):
    folder = own.parent / "out" / "own"
    (own.parent / "bang").write_text("SIGINT")
    drawn = ("--resolution", "64x64", "--duration", "0.2", "--device", "cpu")
    assert msdwarp("run", "own.py", *drawn)[0] == 130
    assert sorted(path.name for path in folder.iterdir()) == ["restart.h5", "trajectory.vtkhdf"]
    code, out, _ = msdwarp("resume", str(folder))
    assert code == 0
    assert "drew 13 frames" in out
    film = (folder / "own.webp").read_bytes()
    code, _, err = msdwarp("resume", str(folder), "--duration", "0.3")
    assert code == 1
    assert "frame_0000.png exists, and would be replaced; move it or add --force" in err
    assert (folder / "own.webp").read_bytes() == film
    assert msdwarp("resume", str(folder), "--duration", "0.3", "--force")[0] == 0
    assert len(list(folder.glob("*.png"))) == 19
    assert (folder / "own.webp").read_bytes() != film


def test_what_cannot_go_on_is_refused_and_left_as_it_is(msdwarp, own):
    folder = own.parent / "out" / "own"
    assert msdwarp("run", "own.py", *UNDRAWN, "--duration", "0.1")[0] == 0
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    code, out, err = msdwarp("resume", str(folder))
    assert (code, err) == (0, "")
    assert out == "all 7 frames are there, 0.1 s: a longer --duration goes on\n"
    assert "duration is 0" in msdwarp("resume", str(folder), "--duration", "0")[2]
    assert msdwarp("resume", "nothing")[2] == "error: nothing does not exist; it must be the folder of a run\n"
    own.write_text(SCENE.replace("0.01", "0.011"))
    longer = ("resume", str(folder), "--duration", "0.2", "--trust")
    assert "own.py' is no longer what it was when the run began" in msdwarp(*longer)[2]
    own.write_text(
        SCENE.replace("    stiffness: float = 300.0,\n", "").replace("stiffness=stiffness", "stiffness=300.0")
    )
    assert "no longer has the parameters ['stiffness']" in msdwarp(*longer)[2]
    own.unlink()
    assert "own.py', a script that is not there" in msdwarp(*longer)[2]
    own.write_text(SCENE)
    whole = (folder / "restart.h5").read_bytes()
    (folder / "restart.h5").write_bytes(whole[:-100])
    assert "restart.h5 is damaged" in msdwarp(*longer)[2]
    (folder / "restart.h5").write_bytes(whole)
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == before
    (folder / "trajectory.vtkhdf").unlink()
    assert "trajectory.vtkhdf" in msdwarp(*longer)[2]
    assert not (folder / "trajectory.vtkhdf").exists()


def test_no_restart_file_where_none_is_wanted(msdwarp, tmp_path):
    small = ("--size", "3", "--duration", "0.1", *UNDRAWN)
    assert msdwarp("run", "cube", *small, "--restart", "0")[0] == 0
    assert [path.name for path in (tmp_path / "out" / "cube").iterdir()] == ["trajectory.vtkhdf"]
    assert "restart is -1" in msdwarp("run", "cube", *small, "--restart", "-1")[2]
    assert "every is 0" in msdwarp("run", "cube", *small, "--every", "0")[2]


def test_a_run_that_diverges_leaves_what_was_good(msdwarp, tmp_path):
    code, _, err = msdwarp("run", "cube", "--size", "5", "--substeps", "1", "--allow-unstable", *UNDRAWN)
    assert code == 1
    assert err.startswith("error: diverged at")
    with Trajectory(tmp_path / "out" / "cube" / "trajectory.vtkhdf") as found:
        assert np.isfinite(found.positions[:]).all()
        last = len(found) - 1
    assert read_restart(tmp_path / "out" / "cube" / "restart.h5")[1]["checkpoint"]["frame_index"] == last
    assert "diverged at" in msdwarp("resume", "out/cube")[2]  # again


# Whatever happens


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
resource.setrlimit(resource.RLIMIT_FSIZE, (1_500_000, 1_500_000))
sys.argv = ["msdwarp", "run", "cube", "--size", "6", "--frames", "none", "--video", "none", "--device", "cpu"]
from msdwarp.cli import main
main()
"""


@pytest.mark.skipif(sys.platform == "win32", reason="needs a limit to the size of files")
def test_a_full_disk_ends_a_run_with_a_message_and_a_file_that_opens(tmp_path):
    done = subprocess.run([sys.executable, "-c", FULL], cwd=tmp_path, capture_output=True, text=True, timeout=600)
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr.startswith("error: out/cube/trajectory.vtkhdf could not be written further: File too large")
    assert done.stderr.count("\n") == 1
    with Trajectory(tmp_path / "out" / "cube" / "trajectory.vtkhdf") as found:
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
from msdwarp.cli.resume import resume_run
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
random, kills, resumed, seen = np.random.default_rng(), 0, 0, set()
while kills < 20:
    again = (folder / "restart.h5").exists()
    child = os.fork()
    if child == 0:
        if again:
            resume_run(folder, force=True, quiet=True)
        else:
            run(folder, 1e-3, trajectory=compress)
        os._exit(0)
    time.sleep(random.uniform(0, took / 2))
    os.kill(child, signal.SIGKILL)
    if os.waitpid(child, 0)[1] == 0:  # it had ended before
        shutil.rmtree(folder)
        continue
    kills, resumed = kills + 1, resumed + again
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
@pytest.mark.parametrize("kind", ["plain", "compressed"])
def test_a_run_killed_twenty_times_ends_as_if_nothing_had_happened(own, kind):
    done = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", KILLED, kind],
        cwd=own.parent,
        capture_output=True,
        text=True,
        timeout=600,
    )
    assert (done.returncode, done.stderr) == (0, "")
    resumed, seen = map(int, done.stdout.split())
    assert resumed > 3  # of twenty times it was killed
    assert seen > 3  # in different frames
    assert_same_run(own.parent / "killed", own.parent / "whole")


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


@pytest.mark.parametrize("name", ["trajectory.vtkhdf", "restart.h5"])
def test_files_of_two_runs_do_not_go_on_together(msdwarp, tmp_path, name):
    for folder, stiffness in (("one", "600"), ("other", "700")):
        flags = ("--size", "3", "--stiffness", stiffness, "--duration", "0.2", "--out", folder)
        assert msdwarp("run", "cube", *flags, *UNDRAWN)[0] == 0
    shutil.copy(tmp_path / "other" / name, tmp_path / "one" / name)
    before = (tmp_path / "one" / "trajectory.vtkhdf").read_bytes()
    code, out, err = msdwarp("resume", "one", "--duration", "0.4")
    assert (code, out) == (1, "")
    assert err == "error: one/trajectory.vtkhdf is of another run than one/restart.h5\n"
    assert (tmp_path / "one" / "trajectory.vtkhdf").read_bytes() == before


@pytest.mark.parametrize(("old", "new"), [("0.1 * t)", "0.2 * t)"), ("2 * k)", "3 * k)")])
def test_what_a_function_gives_is_part_of_a_scene(msdwarp, own, old, new):
    assert msdwarp("run", "own.py", *UNDRAWN, "--duration", "0.1")[0] == 0
    own.write_text(SCENE.replace(old, new))
    assert "no longer what it was" in msdwarp("resume", "out/own", "--duration", "0.2", "--trust")[2]


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
def test_a_signal_in_the_last_frame_is_heard_and_pictures_are_drawn_later(msdwarp, own, heard):
    (own.parent / "bang").write_text("SIGTERM")
    drawn = ("--resolution", "64x64", "--duration", "0.167", "--frames", "none", "--device", "cpu")
    code, _, err = msdwarp("run", "own.py", *drawn)
    assert (code, "after frame 10 of 10" in err) == (143, True)
    code, out, _ = msdwarp("resume", "out/own")
    assert (code, "drew 11 frames" in out) == (0, True)
    film = (own.parent / "out" / "own" / "own.webp").read_bytes()
    code, out, _ = msdwarp("resume", "out/own")
    assert (code, out) == (0, "all 11 frames are there, 0.1667 s: a longer --duration goes on\n")
    assert (own.parent / "out" / "own" / "own.webp").read_bytes() == film


def test_a_log_that_is_another_file_now_is_kept(msdwarp, own):
    short = ("--log", "./own.csv", "--duration", "0.1", *UNDRAWN)
    assert msdwarp("run", "own.py", *short)[0] == 0
    (own.parent / "own.csv").write_text("years of work")
    code, _, err = msdwarp("resume", "out/own", "--duration", "0.2")
    assert (code, "own.csv, which is not what the run had written there; move it away" in err) == (1, True)
    assert (own.parent / "own.csv").read_text() == "years of work"


@pytest.mark.slow
def test_memory_stays_flat_over_ten_thousand_frames(tmp_path):
    peaks = []
    for frames in (1_000, 10_000):
        flags = f"run cube --size 6 --duration {frames / 60} --substeps 1 --stiffness 1 --damping 0 --device cpu "
        flags += f"--out {frames} --frames none --video none"
        code = f"""
import resource, sys
sys.argv = "msdwarp {flags}".split()
from msdwarp.cli import main
try:
    main()
finally:
    print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
"""
        command = [sys.executable, "-c", code]
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=True)
        peaks.append(int(done.stdout.splitlines()[-1]))
    with Trajectory(tmp_path / "10000" / "trajectory.vtkhdf") as found:
        assert len(found) == 10_001
    assert peaks[1] - peaks[0] < 10_000  # KiB on Linux; the longer file has 120 MB more


# Making again


def test_a_rerun_is_the_same_or_says_in_what_it_differs(msdwarp, own, tmp_path):
    assert msdwarp("run", "own.py", "--stiffness", "250", *UNDRAWN)[0] == 0
    path = tmp_path / "out" / "own" / "trajectory.vtkhdf"
    code, out, err = msdwarp("rerun", "out/own")
    assert (code, err) == (0, "")
    assert out == "out/own/trajectory.vtkhdf was made again: the same to the last bit\n"
    assert sorted(p.name for p in path.parent.iterdir()) == ["restart.h5", "trajectory.vtkhdf"]
    own.write_text(SCENE.replace("(0, 0, -0.4), 0.5", "(0, 0, -0.4), 0.51"))
    code, out, err = msdwarp("rerun", str(path), "--out", "again", "--trust")
    assert (code, out) == (1, "")
    assert "was not made again: it differs from frame" in err
    assert "digest was" in err
    with Trajectory(path) as before, Trajectory(tmp_path / "again" / "trajectory.vtkhdf") as now:
        assert len(before) == len(now)
        apart = np.linalg.norm(before.positions[:].astype(float) - now.positions[:], axis=2).max()
        # Two digits are told: half a unit of the second is 5 % at most.
        said = float(re.search(r"by at most (\S+) m", err)[1])
        assert said == pytest.approx(apart, rel=0.0501)
        assert now.attributes["parameters"]["stiffness"] == 250.0


def test_a_part_of_a_run_is_made_again_as_far_as_it_goes(msdwarp, own, heard, tmp_path):
    (tmp_path / "bang").write_text("SIGINT")
    assert msdwarp("run", "own.py", "--every", "4", "--no-strain", *UNDRAWN)[0] == 130
    assert msdwarp("rerun", "out/own", "--quiet") == (0, "", "")


def test_what_does_not_say_what_made_it_cannot_be_made_again(msdwarp, tmp_path):
    from trajectories import SYSTEMS, write

    write(tmp_path / "a.vtkhdf", SYSTEMS["box"])
    code, _, err = msdwarp("rerun", "a.vtkhdf")
    assert code == 1
    assert "the file lacks 'scene'" in err


def test_a_file_says_all_that_made_it(msdwarp, own):
    where = ("--where", "some/place", "--origin", "1", "2.5", "3", "--shade", "dark")
    assert msdwarp("run", str(own), *where, *UNDRAWN, "--duration", "0.1", "--precision", "float64")[0] == 0
    with Trajectory(own.parent / "out" / "own" / "trajectory.vtkhdf") as found:
        about = found.attributes
    assert about["scene"] == str(own)
    wanted = {"size": 3, "stiffness": 300.0, "where": "some/place", "origin": [1.0, 2.5, 3.0], "shade": "DARK"}
    assert about["parameters"] == wanted
    assert about["command"][:2] == ["msdwarp", "run"]
    assert {"msdwarp", "warp-lang", "numpy", "h5py"} <= about["versions"].keys()
    assert (about["integrator"], about["precision"]) == ("symplectic-euler", "float64")
    assert (about["device"], about["route"], about["gravity"], about["schedule"]) == ("cpu", "scatter", 9.82, 2)
    assert about["substeps"] > 0
    assert about["options"]["duration"] == 0.1
    assert json.dumps(about)
    code, out, _ = msdwarp("info", "out/own")
    assert code == 0
    for line in ("7 frames from 0 to 0.1 s", "precision: float64", "parameters: size 3, stiffness 300.0"):
        assert line in out
    assert "`msdwarp resume out/own` goes on from it" in out
    assert msdwarp("rerun", "out/own")[0] == 0  # the path, the tuple and the shade are what they were
