"""Runs made again: what made them is in their files, and they are the same to the last bit."""

import json
import re

import numpy as np
import pytest
from runs import SCENE, UNDRAWN, assert_same_run

from msdwarp import Trajectory


@pytest.mark.slow
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


@pytest.mark.slow
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


@pytest.mark.slow
def test_a_file_says_all_that_made_it(msdwarp, own):
    METHOD = ("--integrator", "rk4", "--precision", "float32-compensated")
    where = ("--where", "some/place", "--origin", "1", "2.5", "3", "--shade", "dark")
    assert msdwarp("run", str(own), *where, *UNDRAWN, "--duration", "0.1", *METHOD)[0] == 0
    with Trajectory(own.parent / "out" / "own" / "trajectory.vtkhdf") as found:
        about = found.attributes
    assert about["scene"] == str(own)
    wanted = {"size": 3, "stiffness": 300.0, "where": "some/place", "origin": [1.0, 2.5, 3.0], "shade": "DARK"}
    assert about["parameters"] == wanted
    assert about["command"][:2] == ["msdwarp", "run"]
    assert {"msdwarp", "warp-lang", "numpy", "h5py"} <= about["versions"].keys()
    assert (about["integrator"], about["precision"]) == ("rk4", "float32-compensated")
    assert (about["device"], about["force_algorithm"], about["gravity"], about["schedule"]) == (
        "cpu",
        "scatter",
        9.82,
        3,
    )
    assert about["substeps"] > 0
    assert about["options"]["duration"] == 0.1
    assert json.dumps(about)
    code, out, _ = msdwarp("info", "out/own")
    assert code == 0
    for line in (
        "7 frames from 0 to 0.1 s",
        "precision: float32-compensated",
        "parameters: size 3, stiffness 300.0",
    ):
        assert line in out
    assert "`msdwarp resume out/own` goes on from it" in out
    assert msdwarp("rerun", "out/own")[0] == 0  # the path, the tuple and the shade are what they were


@pytest.mark.slow
def test_a_run_goes_on_across_a_tear_and_is_made_again(msdwarp, tmp_path):
    # The cloth tears from 0.77 s on, at many instants.
    flags, ends = ("tear", "--size", "14", "--break-strain", "0.1", *UNDRAWN), (0.7, 0.84, 1.0)
    assert msdwarp("run", *flags, "--out", "whole", "--duration", str(ends[-1]))[0] == 0
    assert msdwarp("run", *flags, "--out", "parts", "--duration", str(ends[0]))[0] == 0
    for end in ends[1:]:
        code, _, err = msdwarp("resume", "parts", "--duration", str(end))
        assert (code, err) == (0, "")
    assert_same_run(tmp_path / "parts", tmp_path / "whole")
    assert msdwarp("rerun", "parts", "--quiet", "--out", "again") == (0, "", "")

    broken_at = []
    for name in ("whole", "parts", "again"):
        with Trajectory(tmp_path / name / "trajectory.vtkhdf") as found:
            broken_at.append(found.broken_at)
    for each in broken_at[1:]:
        np.testing.assert_array_equal(each, broken_at[0])
    torn = broken_at[0][np.isfinite(broken_at[0]) & (broken_at[0] > 0)]
    before, between = (np.count_nonzero(torn <= end) for end in ends[:2])
    assert before == 0 < between < len(torn)  # it begins in the second go, and goes on in the third
