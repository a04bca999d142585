"""What somebody new sees of the command: its errors, what `info` says, where a log goes, completion."""

import json
import os
import shutil
import subprocess
import sys
from typing import get_args, get_type_hints

import pytest

from msdwarp import Trajectory
from msdwarp.cli.options import Options
from msdwarp.cli.provenance import restored_options
from msdwarp.files import read_restart
from msdwarp.integrators import METHODS

UNDRAWN = ("--frames", "none", "--video", "none", "--device", "cpu")
CUBE = ("run", "cube", "--size", "3", *UNDRAWN)
SHORT = (*CUBE, "--duration", "0.1")


@pytest.mark.parametrize(
    ("words", "line"),
    [
        ("frobnicate", "command is 'frobnicate'; it must be one of list, info, render, plot, export, resume,"),
        ("run", "SCENE is missing (see `msdwarp run --help`)"),
        ("render", "FILE is missing (see `msdwarp render --help`)"),
        ("export x", "--to is missing (see `msdwarp export --help`)"),
        ("export x --to pdf", "to is 'pdf'; it must be one of glb, usd, obj, ply, stl, npz (see"),
        ("render x --zoom near", "zoom is 'near'; it must be a number (see `msdwarp render --help`)"),
        ("list more", "'more' is one argument too many (see `msdwarp list --help`)"),
        ("run cube --siz 3", "unknown option: --siz. Did you mean --size? (see `msdwarp run cube --help`)"),
        ("run cube --film a.webp", "unknown option: --film. Did you mean --video?"),
        ("fit cube points.csv --fit mass", "unknown option: --fit. Did you mean --parameters?"),
        ("export x --format glb", "unknown option: --format. Did you mean --to?"),
        ("run cube --seconds 2", "unknown option: --seconds. Did you mean --duration? (see `msdwarp run cube"),
        ("run cube --size", "--size needs a value (see `msdwarp run cube --help`)"),
        ("run cube --size 3x", "size is '3x'; it must be a whole number (see `msdwarp run cube --help`)"),
        ("tune cube --horizon far", "horizon is 'far'; it must be a number (see `msdwarp tune cube --help`)"),
        ("info x", "file is x, which does not exist; it must be a trajectory or a run's folder"),
        ("info .", "file is ., a folder without trajectory.vtkhdf; it must be the folder of a run"),
    ],
)
def test_errors_have_one_style_and_one_code(msdwarp, tmp_path, words, line):
    code, out, err = msdwarp(*words.split())
    assert (code, out, err.count("\n")) == (1, "", 1)
    assert err.startswith(f"error: {line}")
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_verbose_lets_warp_speak(tmp_path):
    # That it is silent else, test_a_script_runs_by_itself_and_keeps_libraries_silent in test_cli.py says.
    command = [sys.executable, "-m", "msdwarp", *SHORT, "--verbose"]
    loud = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=True, timeout=120)
    assert "Warp 1." in loud.stdout


# What a file holds


def test_info_says_in_words_and_units_what_a_file_holds(msdwarp, tmp_path):
    (tmp_path / "own.py").write_text(
        "from msdwarp import Scene, at, box\n"
        "def build(*, size: int = 3) -> Scene:\n"
        "    return Scene(system=box((size, 2, 2)).pin(0), schedule=[at(0.05, mass=2.0)], gravity=(0, 0, -1.62))\n"
    )
    flags = ("--substeps", "40", "--every", "2", "--fps", "50", "--duration", "0.2", "--out", "kept folder")
    assert msdwarp("run", "own.py", "--size", "4", *UNDRAWN, *flags)[0] == 0
    code, out, _ = msdwarp("info", "kept folder")
    assert code == 0
    lines = out.splitlines()
    assert lines[0].startswith("kept folder/trajectory.vtkhdf: 6 frames from 0 to 0.2 s, 0.")
    assert [line for line in lines if line and not line.startswith(" ")][1:-1] == [
        "What it is",
        "How it was simulated",
        "Made by",
    ]
    for line in (
        f"scene: {tmp_path / 'own.py'}",
        "parameters: size 4",
        "system: 16 particles with 3 coordinates, 72 connections",
        "pinned: 1 particle",
        "frames: 25 a second of simulated time, 40 ms apart",
        "integrator: symplectic-euler",
        "precision: float32",
        "substeps: 40 for each 1/50 s, 0.5 ms each",
        "forces: summed by scatter",
        "device: cpu",
        "gravity: (0, 0, -1.62) m/s²",
        "schedule: 1 change of parameters on the way",
        "flags: --fps 50.0 --duration 0.2 --out 'kept folder' --every 2 --frames none --video none",
    ):
        assert f"  {line}" in lines
    assert lines[-1].endswith("restart.h5: `msdwarp resume 'kept folder'` goes on from it")


def test_info_says_what_else_a_file_holds(msdwarp, tmp_path):
    from trajectories import SYSTEMS, write

    write(tmp_path / "a.vtkhdf", SYSTEMS["box"], 3, attributes={"seed": 7})
    code, out, _ = msdwarp("info", "a.vtkhdf")
    assert code == 0
    assert out.endswith("\nBeside that\n  seed: 7\n")
    assert "Made by" not in out


# Where a log goes


@pytest.mark.slow
@pytest.mark.parametrize(
    ("given", "place"),
    [("e.csv", "here/e.csv"), ("./e.csv", "e.csv"), ("sub/e.csv", "sub/e.csv"), ("{}/a/e.csv", "a/e.csv")],
)
def test_a_bare_name_of_a_log_is_one_in_the_run_s_folder(msdwarp, tmp_path, given, place):
    (tmp_path / place).parent.mkdir(exist_ok=True)  # which a log does not make
    code, out, err = msdwarp(*SHORT, "--out", "here", "--log", given.format(tmp_path))
    assert (code, err) == (0, "")
    found = sorted(path.relative_to(tmp_path).as_posix() for path in tmp_path.rglob("e.*"))
    assert found == [place, place.replace(".csv", ".png")]
    assert f"{place} and e.png" in out


@pytest.mark.slow
def test_a_log_alone_makes_a_folder_and_the_next_run_another(msdwarp, tmp_path):
    for folder in ("cube", "cube-2"):
        assert msdwarp(*SHORT, "--trajectory", "none", "--log", "e.csv")[0] == 0
        assert sorted(p.name for p in (tmp_path / "out" / folder).iterdir()) == ["e.csv", "e.png"]


@pytest.mark.slow
def test_a_log_goes_on_where_its_folder_is(msdwarp, tmp_path):
    assert msdwarp(*CUBE, "--log", "e.csv", "--out", "whole", "--duration", "0.2")[0] == 0
    assert msdwarp(*SHORT, "--log", "e.csv", "--out", "parts")[0] == 0
    (tmp_path / "parts").rename(tmp_path / "moved")
    assert msdwarp("resume", "moved", "--duration", "0.2")[0] == 0
    assert (tmp_path / "moved" / "e.csv").read_text() == (tmp_path / "whole" / "e.csv").read_text()
    assert not (tmp_path / "parts").exists()


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("e.txt", "its name must end in .csv"),
        ("cube_overlay.csv", "its plot would have the name of the overlay"),
        ("probes.csv", "it would have the name of the probes' readings"),
    ],
)
def test_a_log_that_cannot_be_is_refused_before_a_folder_is_made(msdwarp, tmp_path, name, message):
    code, out, err = msdwarp(*SHORT, "--log", name)
    assert (code, out) == (1, "")
    assert err == f"error: log is out/cube/{name}; {message}\n"
    assert not list(tmp_path.iterdir())


# Completion


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("bash") is None, reason="needs bash")
def test_a_shell_completes_commands_flags_and_scenes(tmp_path):
    home = {**os.environ, "HOME": str(tmp_path)}
    install = [sys.executable, "-m", "msdwarp", "--install-completion", "--shell", "bash"]
    done = subprocess.run(install, env=home, capture_output=True, text=True, check=True, timeout=120)
    (script,) = [path for path in tmp_path.rglob("msdwarp*") if path.is_file()]
    assert str(script) in done.stdout

    def completed(*words):
        code = f"source {script}; COMP_WORDS=({' '.join(words)}); COMP_CWORD={len(words) - 1}; _msdwarp; "
        shell = subprocess.run(
            ["bash", "-c", code + 'echo "${COMPREPLY[@]}"'], env=home, capture_output=True, text=True, check=True
        )
        return sorted(shell.stdout.split())

    assert completed("msdwarp", "re") == ["render", "rerun", "resume"]
    assert completed("msdwarp", "run", "cl") == ["cloth"]
    assert completed("msdwarp", "render", "x", "--az") == ["--azimuth"]


# Files of an earlier version


@pytest.mark.slow
def test_runs_of_an_earlier_version_go_on_and_are_made_again(msdwarp, tmp_path):
    # Its stored options lacked flags of today or had other names (route, colour); its log was an absolute path.
    from msdwarp.cli import options

    old = json.loads(
        """{"device": "cpu", "precision": null, "route": "auto", "integrator": null, "substeps": "auto",
        "allow_unstable": false, "tolerance": null, "duration": 0.1, "fps": 60.0, "out": "parts", "pictures":
        {"frames": "none", "video": "none", "overlay": null, "resolution": "1280x720", "colour": null},
        "trajectory": "plain", "every": 1, "strain": true, "restart": 60.0, "force": false, "quiet": false,
        "verbose": false}"""
    ) | {"log": str(tmp_path / "e.csv")}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(options.Options, "as_stored", lambda self: old)
        assert msdwarp(*SHORT, "--out", "parts", "--log", "./e.csv")[0] == 0
    assert read_restart(tmp_path / "parts" / "restart.h5")[1]["run"]["options"] == old
    assert msdwarp("info", "parts")[0] == 0
    assert msdwarp("resume", "parts", "--duration", "0.2")[0] == 0
    assert len((tmp_path / "e.csv").read_text().splitlines()) == 14  # a head, and 13 frames
    assert msdwarp("rerun", "parts", "--quiet") == (0, "", "")
    with Trajectory(tmp_path / "parts" / "trajectory.vtkhdf") as found:
        assert (len(found), found.attributes["options"]) == (13, old)


@pytest.mark.parametrize("where", ["options", "pictures"])
def test_options_of_a_later_version_are_refused(where):
    stored = Options().as_stored()
    (stored if where == "options" else stored["pictures"])["wind"] = 3.0
    with pytest.raises(ValueError, match=r"those of a later version of msdwarp: \['wind'\]"):
        restored_options(stored)


def test_every_method_there_is_can_be_asked_for():
    (names,) = [one for one in get_args(get_type_hints(Options)["integrator"]) if one is not type(None)]
    assert set(get_args(names)) == METHODS.keys()
