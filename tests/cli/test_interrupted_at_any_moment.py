"""Ctrl-C at any moment of a run: the command ends with a word and 130, and what it had begun can go on."""

import importlib
import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from runs import without_progress
from trajectories import SYSTEMS, write

from msdwarp import Trajectory
from msdwarp.cli import signals

ROOT = Path(__file__).parents[2]
RUN = ["run", "cube", "--size", "6", "--duration", "0.1", "--resolution", "64x64", "--device", "cpu"]
RUN += ["--log", "energy.csv"]
posix = pytest.mark.skipif(os.name != "posix", reason="needs signals")


def begun(folder, *arguments, **options):
    """Start the command in a folder, hearing SIGINT as in a terminal."""
    return subprocess.Popen(
        [sys.executable, "-P", "-m", "msdwarp", *arguments],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(ROOT), "PYTHONUNBUFFERED": "1", **options.pop("env", {})},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
        **options,
    )


def ended(process, seconds=120):
    """Return what a process ended with: exit code, standard output, standard error."""
    out, err = process.communicate(timeout=seconds)
    return process.returncode, out, without_progress(err)


def resumed(folder):
    """Go on with the run in a folder; return what was said if it could not."""
    code, _, err = ended(begun(folder.parents[1], "resume", str(folder), "--force"))
    return "" if code == 0 else f"resume: {code} {err}"


def interrupted(folder, after):
    """Interrupt a run so many seconds after Python has started; return what of it was not as it must be."""
    folder.mkdir()
    process = begun(folder, *RUN)
    # Until Python has set up its own handler nothing of ours is heard: the system ends it, without a word.
    status = Path("/proc", str(process.pid), "status")
    while status.exists() and not int(status.read_text().partition("SigCgt:")[2].split()[0], 16) & 2:
        time.sleep(0.001)
    time.sleep(after)
    process.send_signal(signal.SIGINT)
    code, out, err = ended(process)
    return judged(folder, code, out, err)


def judged(folder, code, out, err):
    """Return what of an interrupted run was not as it must be."""
    results = folder / "out" / "cube"
    if code == 0 and "drew" in out:
        return "" if err == "" else f"complete: {err}"  # all was told before the signal came
    if "init_import_site" in err or (code, err) == (-signal.SIGINT, ""):
        return "" if not results.exists() else "begun"  # while Python itself starts, before anything of ours
    if code != 130 or not err.startswith("interrupted") or err.count("\n") != 1:
        return f"{code}: {out}{err}"
    if not results.exists() or not any(results.iterdir()):
        return ""  # nothing begun
    if not (results / "restart.h5").exists():
        return f"begun, and no restart file: {sorted(results.iterdir())}"
    with Trajectory(results / "trajectory.vtkhdf") as found:
        if not len(found):
            return "no frames"
    left = [path.name for path in results.iterdir() if ".unfinished" in path.name]
    return f"left: {left}" if left else ""


@posix
@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="needs /proc")
def test_a_run_interrupted_at_any_moment_ends_with_a_word_and_can_go_on(tmp_path):
    assert ended(begun(tmp_path, *RUN, "--out", "first"))[0] == 0  # compiles kernels
    began = time.monotonic()
    assert ended(begun(tmp_path, *RUN, "--out", "whole"))[0] == 0
    whole, chance = time.monotonic() - began, random.Random(2026)
    for k in range(int(os.environ.get("MSDWARP_INTERRUPTIONS", "2"))):
        after = chance.uniform(0.0, whole)
        wrong = interrupted(tmp_path / f"run{k}", after)
        assert not wrong, f"after {after:.3f} s: {wrong}"
        results = tmp_path / f"run{k}" / "out" / "cube"
        if (results / "restart.h5").exists() and k % 3 == 0:
            assert not resumed(results)


@posix
@pytest.mark.slow
def test_a_run_ends_within_a_frame_that_takes_long(tmp_path):
    long = ["--size", "20", "--substeps", "60000", "--frames", "none", "--video", "none"]  # half a minute a frame
    process = begun(tmp_path, "run", "cube", "--duration", "0.1", "--device", "cpu", *long)
    started = tmp_path / "out" / "cube" / "restart.h5"
    while not started.exists() and process.poll() is None:
        time.sleep(0.05)
    time.sleep(1.0)
    process.send_signal(signal.SIGTERM)
    code, _, err = ended(process)
    assert code == 143, err
    assert "at 0 s, after frame 0 of 6: `msdwarp resume out/cube` goes on" in err  # not after frame 1
    with Trajectory(started.parent / "trajectory.vtkhdf") as found:
        assert len(found) == 1


def test_what_is_imported_late_is_let_come_to_its_end(tmp_path, monkeypatch, heard):
    (tmp_path / "heard_late.py").write_text("import signal\nsignal.raise_signal(signal.SIGINT)\nwhole = True\n")
    monkeypatch.syspath_prepend(tmp_path)
    signal.signal(signal.SIGINT, signals.ask)

    def sleep_behind():
        importlib.import_module("heard_late")
        time.sleep(30)

    with pytest.raises(KeyboardInterrupt):
        sleep_behind()
    assert sys.modules.pop("heard_late").whole


def test_what_h5py_calls_back_is_let_come_to_its_end(heard):
    # Out of its C code an exception comes as a SystemError.
    signal.signal(signal.SIGINT, signals.ask)
    names = {"signal": signal}
    called_back = "def iter_cb():\n    signal.raise_signal(signal.SIGINT)\n    return True\n"
    exec(compile(called_back, str(Path("h5py", "_hl", "attrs.py")), "exec"), names)
    assert names["iter_cb"]()
    with pytest.raises(KeyboardInterrupt):
        time.sleep(60)


def test_what_python_lets_not_out_is_heard_again(monkeypatch, heard):
    class Deaf:
        def __del__(self):
            signal.raise_signal(signal.SIGTERM)

    monkeypatch.setattr(sys, "unraisablehook", signals.lost)
    signal.signal(signal.SIGTERM, signals.ask)

    def let_go():
        deaf = Deaf()
        del deaf
        time.sleep(30)

    with pytest.raises(signals.Terminated):
        let_go()


# Where it is interrupted, by the module that is being imported: the scene's script does it.
HEARD = """
import importlib.abc, os, signal, sys

class Finder(importlib.abc.MetaPathFinder):
    def find_spec(self, name, path, target=None):
        if name == {module!r}:
            sys.meta_path.remove(self)
            os.kill(os.getpid(), signal.{name})

sys.meta_path.insert(0, Finder())
"""


@pytest.mark.slow
@posix
@pytest.mark.parametrize(("module", "resumable"), [("warp.config", False), ("h5py._hl", True)])
def test_an_import_is_a_safe_moment(tmp_path, module, resumable):
    # A module that Python imports as it starts sends the signal in the midst of another import.
    (tmp_path / "own").mkdir()
    (tmp_path / "own" / "sitecustomize.py").write_text(HEARD.format(module=module, name="SIGINT"))
    path = os.pathsep.join([str(tmp_path / "own"), str(ROOT)])
    code, out, err = ended(begun(tmp_path, *RUN, env={"PYTHONPATH": path}))
    assert (code, out) == (130, "")
    assert err.startswith("interrupted")
    assert err.count("\n") == 1
    assert (tmp_path / "out" / "cube" / "restart.h5").exists() == resumable
    assert ("resume out/cube` goes on" in err) == resumable


@posix
def test_sigterm_while_the_command_is_imported_has_its_word(tmp_path):
    (tmp_path / "own").mkdir()
    (tmp_path / "own" / "sitecustomize.py").write_text(HEARD.format(module="cyclopts", name="SIGTERM"))
    path = os.pathsep.join([str(tmp_path / "own"), str(ROOT)])
    assert ended(begun(tmp_path, "list", env={"PYTHONPATH": path})) == (143, "", "terminated\n")


@posix
@pytest.mark.slow
def test_an_import_of_export_is_a_safe_moment(tmp_path):
    write(tmp_path / "a.vtkhdf", SYSTEMS["box"], 200)  # which takes longer than a signal is put off
    (tmp_path / "own").mkdir()
    (tmp_path / "own" / "sitecustomize.py").write_text(HEARD.format(module="pyvista.core", name="SIGINT"))
    path = os.pathsep.join([str(tmp_path / "own"), str(ROOT)])
    code, out, err = ended(begun(tmp_path, "export", "a.vtkhdf", "--to", "ply", env={"PYTHONPATH": path}))
    assert (code, out) == (130, "")
    assert err.splitlines()[1:] == ["interrupted"]  # after what is said of a file without a scene
    assert not [found for found in tmp_path.iterdir() if ".unfinished" in found.name]
