"""Runs that are gone on with: they end as if they had been made in one go."""

import shutil
import subprocess
import sys

import h5py
import numpy as np
import pytest
from PIL import Image
from runs import SCENE, UNDRAWN, assert_same_run

from msdwarp import Trajectory
from msdwarp.cli.commands import run


@pytest.mark.slow
def test_a_run_in_three_goes_ends_as_one_in_one(msdwarp, own):
    # tests/simulation/test_checkpoint.py has every method, without files; of these, this one has most to keep.
    options = [*UNDRAWN, "--integrator", "rk4", "--precision", "float32-compensated"]
    assert msdwarp("run", "own.py", *options, "--out", "whole")[0] == 0
    assert msdwarp("run", "own.py", *options, "--out", "parts", "--duration", "0.2")[0] == 0
    for duration in ("0.3", "0.4"):
        code, out, err = msdwarp("resume", "parts", "--duration", duration)
        assert (code, err) == (0, "")
        assert "simulated 0.1 s" in out
    assert_same_run(own.parent / "parts", own.parent / "whole")


@pytest.mark.gpu
@pytest.mark.filterwarnings("ignore:.*turned inside out:msdwarp.InvertedWarning")  # of so many cells some are
@pytest.mark.parametrize("force_algorithm", ["gather", "stencil"])
@pytest.mark.parametrize(("integrator", "precision"), [("leapfrog", "float32"), ("rk4", "float32-compensated")])
def test_a_run_on_a_gpu_goes_on_and_is_made_again(msdwarp, tmp_path, force_algorithm, integrator, precision):
    options = ("--size", "12", "--force-algorithm", force_algorithm, "--device", "cuda:0")
    options += ("--integrator", integrator, "--precision", precision, "--frames", "none", "--video", "none")
    assert msdwarp("run", "cube", *options, "--out", "whole", "--duration", "1.5")[0] == 0
    assert msdwarp("run", "cube", *options, "--out", "parts", "--duration", "0.7")[0] == 0
    assert msdwarp("resume", "parts", "--duration", "1.5")[0] == 0
    assert_same_run(tmp_path / "parts", tmp_path / "whole")
    assert msdwarp("rerun", "whole", "--quiet") == (0, "", "")


@pytest.mark.slow
def test_another_route_goes_on_too(msdwarp, tmp_path):
    options = ("--size", "4", "--force-algorithm", "stencil", *UNDRAWN)
    options += ("--every", "3", "--trajectory", "compressed")
    assert msdwarp("run", "cube", *options, "--out", "whole", "--duration", "0.3")[0] == 0
    assert msdwarp("run", "cube", *options, "--out", "parts", "--duration", "0.15")[0] == 0
    assert msdwarp("resume", "parts/restart.h5", "--duration", "0.3")[0] == 0
    assert_same_run(tmp_path / "parts", tmp_path / "whole")
    with Trajectory(tmp_path / "parts" / "trajectory.vtkhdf") as found:
        assert (len(found), found.fps) == (7, 20)


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


@pytest.mark.slow
def test_what_cannot_go_on_is_refused_and_left_as_it_is(msdwarp, own):
    folder = own.parent / "out" / "own"
    assert msdwarp("run", "own.py", *UNDRAWN, "--duration", "0.1")[0] == 0
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    code, out, err = msdwarp("resume", str(folder))
    assert (code, err) == (0, "")
    assert out == "the run is complete (7 frames, 0.1 s); a longer --duration extends it\n"
    assert "duration is 0" in msdwarp("resume", str(folder), "--duration", "0")[2]
    assert msdwarp("resume", "nothing")[2] == "error: nothing does not exist; it must be the folder of a run\n"
    longer = ("resume", str(folder), "--duration", "0.2", "--trust")
    for old, new in (("0.01", "0.011"), ("0.1 * t)", "0.2 * t)"), ("2 * k)", "3 * k)")):  # what functions give too
        own.write_text(SCENE.replace(old, new))
        assert "own.py' has changed since the run began" in msdwarp(*longer)[2]
    own.write_text(
        SCENE.replace("    stiffness: float = 300.0,\n", "").replace("stiffness=stiffness", "stiffness=300.0")
    )
    assert "no longer has the parameters ['stiffness']" in msdwarp(*longer)[2]
    own.unlink()
    assert "own.py', a script that does not exist" in msdwarp(*longer)[2]
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


@pytest.mark.slow
def test_files_of_two_runs_do_not_go_on_together(msdwarp, tmp_path):
    for folder, stiffness in (("one", "600"), ("other", "700")):
        flags = ("--size", "3", "--stiffness", stiffness, "--duration", "0.2", "--out", folder)
        assert msdwarp("run", "cube", *flags, *UNDRAWN)[0] == 0
    for name, folder in (("trajectory.vtkhdf", "first"), ("restart.h5", "second")):
        shutil.copytree(tmp_path / "one", tmp_path / folder)
        shutil.copy(tmp_path / "other" / name, tmp_path / folder / name)
        before = (tmp_path / folder / "trajectory.vtkhdf").read_bytes()
        code, out, err = msdwarp("resume", folder, "--duration", "0.4")
        assert (code, out) == (1, "")
        assert err == f"error: {folder}/trajectory.vtkhdf is of another run than {folder}/restart.h5\n"
        assert (tmp_path / folder / "trajectory.vtkhdf").read_bytes() == before


@pytest.mark.slow
def test_a_log_that_is_another_file_now_is_kept(msdwarp, own):
    short = ("--log", "./own.csv", "--duration", "0.1", *UNDRAWN)
    assert msdwarp("run", "own.py", *short)[0] == 0
    (own.parent / "own.csv").write_text("years of work")
    code, _, err = msdwarp("resume", "out/own", "--duration", "0.2")
    assert (code, "own.csv, which is not what the run had written there; move it away" in err) == (1, True)
    assert (own.parent / "own.csv").read_text() == "years of work"


@pytest.mark.slow
def test_a_restart_file_does_not_say_where_a_log_appears(msdwarp, tmp_path):
    flags = ("--size", "3", "--log", "./elsewhere.csv", "--duration", "0.1", *UNDRAWN)
    assert msdwarp("run", "cube", *flags)[0] == 0
    (tmp_path / "elsewhere.csv").unlink()
    code, _, err = msdwarp("resume", "out/cube", "--duration", "0.2")
    assert (code, "elsewhere.csv, outside of out/cube and no longer there; allow it with --trust" in err) == (
        1,
        True,
    )
    assert not (tmp_path / "elsewhere.csv").exists()
    assert msdwarp("resume", "out/cube", "--duration", "0.2", "--trust")[0] == 0
    assert (tmp_path / "elsewhere.csv").exists()


@pytest.mark.slow
@pytest.mark.parametrize("other", [False, True], ids=["the same frames again", "others"])
def test_where_no_restart_file_can_be_written_no_frame_and_no_line_is_lost(msdwarp, own, monkeypatch, other):
    def full(path, *_):
        raise OSError(28, "No space left on device", str(path))

    folder = own.parent / "out" / "own"
    log = folder / "e.csv"
    assert msdwarp("run", "own.py", *UNDRAWN, "--duration", "0.1", "--log", "e.csv")[0] == 0
    early = (folder / "restart.h5").read_bytes()
    assert msdwarp("resume", str(folder), "--duration", "0.3")[0] == 0
    (folder / "restart.h5").write_bytes(early)
    before = log.read_text()
    if other:  # as they are on another device
        with h5py.File(folder / "trajectory.vtkhdf", "r+") as file:
            file["VTKHDF/Points"][-1] += 1e-6
    with monkeypatch.context() as patch:
        patch.setattr(run, "write_restart", full)
        code, _, err = msdwarp("resume", str(folder), "--duration", "0.4")
    assert (code, "No space left on device" in err) == (1, True)
    with Trajectory(folder / "trajectory.vtkhdf") as found:
        assert len(found) >= 19
    assert log.read_text().startswith(before)
    assert msdwarp("resume", str(folder), "--duration", "0.4")[0] == 0
    assert msdwarp("run", "own.py", *UNDRAWN, "--duration", "0.4", "--out", "whole", "--log", "e.csv")[0] == 0
    assert_same_run(folder, own.parent / "whole")
    assert log.read_text() == (own.parent / "whole" / "e.csv").read_text()


@pytest.mark.slow
def test_memory_stays_flat_over_thousands_of_frames(tmp_path):
    flags = "run cube --size 10 --substeps 1 --stiffness 1 --damping 0 --device cpu --frames none --video none"
    code = f"""
import contextlib, resource, sys
from msdwarp.cli.app import app
for frames in (200, 1_000):
    with contextlib.suppress(SystemExit):
        app([*"{flags} --quiet --out".split(), str(frames), "--duration", str(frames / 60)])
    print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
"""
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=True)
    peaks = [int(line) for line in done.stdout.splitlines()[-2:]]
    with Trajectory(tmp_path / "1000" / "trajectory.vtkhdf") as found:
        assert len(found) == 1_001
    assert peaks[1] - peaks[0] < 10_000  # KiB on Linux; the longer file has 19 MB more


PROBED = """
from msdwarp import Plane, Probe, Scene, box

def build(*, size: int = 2):
    system = box((size, 2, 2), 0.1, stiffness=200.0, damping=1.0).named("block")
    probes = {"foot": Probe("block", "contact force"), "body": Probe("block", "strain")}
    probes |= {"top": Probe("block", "velocity", every="substep")}
    return Scene(system=system, colliders=[Plane(offset=-0.06)], probes=probes, duration=0.4)
"""


@pytest.fixture
def probed(tmp_path):
    """A scene with probes."""
    path = tmp_path / "own.py"
    path.write_text(PROBED)
    return path


@pytest.mark.slow
def test_a_run_writes_what_probes_tell_and_goes_on_with_it(msdwarp, probed):
    options = UNDRAWN
    code, out, _ = msdwarp("run", "own.py", *options, "--out", "whole")
    assert (code, "wrote whole/probes.csv and whole/probes_by_substep.csv" in out) == (0, True)
    table = np.genfromtxt(probed.parent / "whole" / "probes.csv", delimiter=",", names=True)
    assert table.dtype.names == (
        "time_s",
        *(f"foot_contact_force_{axis}_N" for axis in "xyz"),
        "body_strain_mean",
        "body_strain_largest",
    )
    # A frame and its line each 1/60 s; numbers have nine digits.
    np.testing.assert_allclose(table["time_s"], np.arange(1, 25) / 60, rtol=1e-8)
    assert table["foot_contact_force_z_N"].max() > 0
    assert msdwarp("run", "own.py", *options, "--out", "parts", "--duration", "0.2")[0] == 0
    assert msdwarp("resume", "parts", "--duration", "0.4")[0] == 0
    for name in ("probes.csv", "probes_by_substep.csv"):
        whole, parts = ((probed.parent / folder / name).read_text() for folder in ("whole", "parts"))
        assert parts == whole
    series = []
    for folder in ("whole", "parts"):  # the trajectory has them too
        with Trajectory(probed.parent / folder / "trajectory.vtkhdf") as found:
            series.append(found.readings)
    for name in ("foot", "body", "top"):
        np.testing.assert_array_equal(series[1][name].times, series[0][name].times)
        np.testing.assert_array_equal(series[1][name].values, series[0][name].values)
    np.testing.assert_allclose(series[0]["foot"].values[:, 2], table["foot_contact_force_z_N"], rtol=1e-8)
    code, out, _ = msdwarp("info", "parts/trajectory.vtkhdf")
    assert "probe body: strain_mean, strain_largest, 24 readings by frame" in out
    steps = np.genfromtxt(probed.parent / "whole" / "probes_by_substep.csv", delimiter=",", names=True)
    assert steps.dtype.names == ("time_s", *(f"top_velocity_{axis}_m_s" for axis in "xyz"))
    assert len(steps) >= 2 * len(table)
    np.testing.assert_allclose(steps["time_s"][-1], 0.4, rtol=1e-8)


@pytest.mark.slow
def test_flags_of_pictures_change_what_is_drawn(msdwarp, tmp_path):
    short, folder = ("--size", "4", "--device", "cpu", "--duration", "0.05", "--out", "run"), tmp_path / "run"
    assert msdwarp("run", "cube", *short, "--resolution", "64x64", "--frames", "none", "--video", "none")[0] == 0
    drawn = ("--frames", "png", "--transparent", "--overlay", "2")
    assert msdwarp("resume", "run", *drawn)[2].startswith(
        "error: overlay is given; it must not be with a transparent"
    )
    code, _, err = msdwarp("resume", "run", "--frames", "png", "--arrows")
    assert (code, "which only a run with --contact-forces stores" in err) == (1, True)
    assert not list(folder.glob("*.png"))
    code, out, _ = msdwarp("resume", "run", "--duration", "0.1", "--frames", "png", "--transparent")
    assert (code, "drew 7 frames" in out) == (0, True)
    with Image.open(folder / "frame_0006.png") as picture:
        assert (picture.mode, picture.size) == ("RGBA", (64, 64))  # the size is that of the run
    assert "the run is complete" in msdwarp("resume", "run")[1]
    code, _, err = msdwarp("resume", "run", "--azimuth", "40")
    assert (code, "frame_0000.png exists, and would be replaced" in err) == (1, True)
    before = {(folder / "frame_0006.png").read_bytes()}
    for flags in (("--azimuth", "40"), ("--cut", "0,-1,0"), ("--cut", "0,-1,0", "--floor", "none")):
        assert msdwarp("resume", "run", *flags, "--force")[0] == 0
        before.add((folder / "frame_0006.png").read_bytes())
    assert len(before) == 4
