"""`msdwarp sweep`: the runs are those of `msdwarp run`, and a sweep that was killed goes on."""

import contextlib
import csv
import json
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from runs import assert_same_run, without_progress

pytest.importorskip("xarray")
pytest.importorskip("h5netcdf")

SHORT = ["--size", "3", "--duration", "0.05", "--device", "cpu"]
HERE = [*SHORT, "--jobs", "1", "-o", "out"]


def lines(path):
    """Return the lines of the table of a sweep."""
    with (path / "results.csv").open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


@pytest.mark.slow
def test_the_runs_are_those_of_single_commands_and_are_drawn(msdwarp, tmp_path):
    code, out, err = msdwarp("sweep", "cube", "--stiffness", "1e3,1e4", "--damping=1,2", *HERE)
    assert (code, err) == (0, "")
    assert out.startswith("4 points: 4 done\n")
    assert f"wrote {'out/results.nc'}" in out
    (line,) = (one for one in lines(tmp_path / "out") if (one["stiffness"], one["damping"]) == ("10000", "2"))
    flags = ["--frames", "none", "--video", "none", "--stiffness", "1e4", "--damping", "2"]
    assert msdwarp("run", "cube", *flags, *SHORT, "--out", "single", "--log", "energy.csv")[0] == 0
    folder = tmp_path / "out" / "runs" / line["run"]
    assert_same_run(folder, tmp_path / "single")
    log = list(csv.DictReader((tmp_path / "single" / "energy.csv").read_text().splitlines()))[-1]
    for name in ("kinetic_J", "elastic_J", "largest_strain"):
        assert float(line[name]) == pytest.approx(float(log[name]), rel=1e-8)  # nine digits are written there
    assert json.loads((folder / "parameters.json").read_text())["parameters"]["stiffness"] == 10000
    # A wider grid takes the rest from what is there; one parameter is drawn as a line, two as maps.
    before = {path.name: path.stat().st_mtime_ns for path in (tmp_path / "out" / "runs").iterdir()}
    assert msdwarp("plot", "out")[0] == 0
    assert msdwarp("sweep", "cube", "--stiffness", "1e3:1e4:log:3", *HERE)[1].startswith("3 points: 3 done\n")
    after = {path.name: path.stat().st_mtime_ns for path in (tmp_path / "out" / "runs").iterdir()}
    assert before.items() <= after.items()
    assert len(after) == 4 + 3  # the usual damping is 5: none of these were there
    assert msdwarp("plot", "out/results.nc", "--show", "elastic_J", "--out", "line.png")[0] == 0
    for picture in ("out/results.png", "line.png"):
        assert np.asarray(Image.open(picture).convert("L")).std() > 5, picture  # not blank
    assert (
        "show is 'elastic'; it must be one of" in msdwarp("plot", "out", "--show", "elastic", "--out", "a.png")[2]
    )
    assert "results.png, which exists" in msdwarp("plot", "out")[2]


@pytest.mark.slow
def test_a_summary_keeps_no_files_and_a_wrong_scene_is_a_row(msdwarp, tmp_path):
    code, out, _ = msdwarp("sweep", "cube", "--mass", "0.02,-1", "--keep", "summary", *HERE)
    assert code == 0
    assert out.startswith("2 points: 1 done, 1 failed\n  mass is -1")
    (folder,) = (tmp_path / "out" / "runs").iterdir()
    assert {path.name for path in folder.iterdir()} == {"parameters.json", "summary.json"}
    assert [one["status"] for one in lines(tmp_path / "out")] == ["done", "failed"]


@pytest.mark.slow
def test_worlds_of_an_ensemble_leave_what_runs_leave(msdwarp, tmp_path):
    words = ["cube", "--stiffness", "300,400", "--substeps", "60", *SHORT, "--keep", "summary"]
    code, out, err = msdwarp("sweep", *words, "--jobs", "ensemble", "-o", "worlds")
    assert (code, err) == (0, "")
    assert out.startswith("2 points: 2 done\n2 of 2 points were worlds of ensembles\n")
    for one in lines(tmp_path / "worlds"):
        assert (tmp_path / "worlds" / "runs" / one["run"] / "summary.json").exists()


@pytest.mark.parametrize(
    ("flags", "said"),
    [
        (["--stiffness", "1:2:lg:3"], "stiffness is '1:2:lg:3'; it must be a value, a list such as 1,2,5"),
        (["--stifness", "1,2"], "--stifness"),
        (["--size", "3,3.5"], "size is '3.5'; it must be a whole number"),
        (["--integrator", "rk4,rk5"], "integrator is 'rk5'; it must be one of"),
        (["--jobs", "1,2", "--size", "3,4"], "jobs is '1,2'; it is the same for the whole sweep"),
        (["--size", "3,4", "--size", "5,6"], "size is swept twice"),
        (["--size", "3"], "nothing is swept"),
        (["--size", "3,4", "--jobs", "0"], "jobs is 0; it must be a whole number of at least 1"),
        (["--size", "3,4", "--log", "deep/a.csv"], "log is deep/a.csv; in a sweep it must be a bare name"),
    ],
)
def test_what_is_wrong_is_said_before_a_file_is_touched(msdwarp, tmp_path, flags, said):
    code, out, err = msdwarp("sweep", "cube", *flags)
    assert (code, out) == (1, "")
    assert err.startswith("error: ")
    assert said in err
    assert not list(tmp_path.iterdir())


def test_the_help_shows_the_flags_of_scene_run_and_sweep(msdwarp):
    code, out, _ = msdwarp("sweep", "cube", "--help")
    assert code == 0
    assert all(flag in out for flag in ("--stiffness", "--substeps", "--jobs", "--keep", "--out"))
    assert "Simulate a scene for many values" in msdwarp("sweep", "--help")[1]


def is_alive(pid):
    """Tell whether a process runs; one that has ended and was not asked for its code is none."""
    with contextlib.suppress(OSError):
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    return False


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="looks into /proc")
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGINT])
def test_a_sweep_that_was_ended_goes_on_and_leaves_no_process(msdwarp, tmp_path, heard, number):
    # However late this is to end it, it is not done: the second half of the points waits.
    hold = tmp_path / "hold"
    hold.touch()
    (tmp_path / "own.py").write_text(
        "import os, time\nfrom pathlib import Path\nfrom msdwarp import Scene, box\n\n"
        "def build(*, stiffness: float = 100.0):\n"
        "    Path(__file__).with_name(f'pid-{os.getpid()}').touch()\n"
        "    while stiffness >= 104 and Path(__file__).with_name('hold').exists():\n"
        "        time.sleep(0.01)\n"
        "    return Scene(system=box((3, 3, 3), 0.1, stiffness=stiffness), duration=0.2)\n"
    )
    words = ["own.py", "--stiffness", "100:108", "--keep", "summary", "--device", "cpu", "-o", "out"]
    command = [sys.executable, "-m", "msdwarp", "sweep", *words, "--jobs", "2"]
    with subprocess.Popen(command, cwd=tmp_path, stderr=subprocess.PIPE, text=True) as process:
        while len(list(tmp_path.glob("out/runs/[0-9a-f]*"))) < 3 and process.poll() is None:
            time.sleep(0.02)
        process.send_signal(number)
        try:
            said = process.communicate(timeout=300)[1]  # whoever is left has it open
        finally:
            hold.unlink()
    assert process.returncode == (-number if number == signal.SIGKILL else 128 + number)
    if number != signal.SIGKILL:
        assert without_progress(said) == "interrupted: done points are kept; the same command continues\n"
        assert {one["status"] for one in lines(tmp_path / "out")} == {"done", "missing"}
    workers = [int(path.name.partition("-")[2]) for path in tmp_path.glob("pid-*")]
    assert workers
    end = time.monotonic() + 300.0  # for ending a process on a busy machine
    while any(map(is_alive, workers)):
        assert time.monotonic() < end
        time.sleep(0.02)
    there = {path.name: path.stat().st_mtime_ns for path in tmp_path.glob("out/runs/[0-9a-f]*")}
    assert 3 <= len(there) < 8
    code, out, err = msdwarp("sweep", *words, "--jobs", "1")
    assert (code, err) == (0, "")
    assert out.startswith("8 points: 8 done\n")
    after = {path.name: path.stat().st_mtime_ns for path in (tmp_path / "out" / "runs").iterdir()}
    assert there.items() <= after.items()
    assert len(after) == 8
    assert len(lines(tmp_path / "out")) == 8
