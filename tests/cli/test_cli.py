"""The command, and scene scripts: what they write, say and refuse."""

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from runs import without_progress

from msdwarp import Simulation, Trajectory, modes
from msdwarp.cli.options import Options
from msdwarp.cli.process import COMPILING
from msdwarp.cli.scene_files import find_scene
from msdwarp.files import read_restart

ROOT = Path(__file__).parents[2]
SMALL = ["--duration", "0.1", "--resolution", "128x72", "--device", "cpu"]


def test_run_writes_frames_and_a_film_and_says_so(msdwarp, tmp_path):
    code, out, err = msdwarp("run", "cube", "--size", "4", "--stiffness", "300", *SMALL)
    assert (code, err) == (0, "")
    folder = tmp_path / "out" / "cube"
    assert sorted(p.name for p in folder.iterdir()) == [
        "cube.webp",
        *(f"frame_{k:04d}.png" for k in range(7)),
        "restart.h5",
        "trajectory.vtkhdf",
    ]
    with Image.open(folder / "cube.webp") as film:
        assert (film.n_frames, film.size) == (7, (128, 72))
    what, speed, kept, where = out.splitlines()
    # 4³ particles; 3·4²·3 + 6·4·3² + 4·3³ connections
    assert what.startswith("64 particles and 468 connections by symplectic-euler")
    assert "simulated 0.1 s" in speed
    assert kept.startswith("wrote out/cube/trajectory.vtkhdf (")
    assert "out/cube/cube.webp" in where


@pytest.mark.slow
def test_a_trajectory_is_written_described_and_exported(msdwarp, tmp_path):
    keep = ("--frames", "none", "--video", "none", "--duration", "0.1", "--device", "cpu")
    code, out, err = msdwarp("run", "cube", "--size", "3", *keep)
    assert (code, err) == (0, "")
    path = tmp_path / "out" / "cube" / "trajectory.vtkhdf"
    assert "wrote out/cube/trajectory.vtkhdf" in out
    scene = find_scene("cube")._replace(parameters={"size": 3}).scene()
    simulation = Simulation.from_scene(scene, device="cpu")
    with Trajectory(path) as trajectory:
        for k, frame in enumerate(simulation.frames(0.1)):
            np.testing.assert_array_equal(trajectory.frame(k).position, frame.position)
        assert len(trajectory) == 7
        assert trajectory.attributes["substeps"] == simulation.substeps
    code, out, _ = msdwarp("info", str(path))
    assert code == 0
    assert "7 frames from 0 to 0.1 s" in out
    assert "27 particles with 3 coordinates" in out
    assert "integrator: symplectic-euler" in out
    code, out, _ = msdwarp("export", str(path), "--to", "npz", "--out", "cube.npz")
    assert (code, out) == (0, "wrote cube.npz\n")
    code, out, _ = msdwarp("export", str(path), "--to", "obj")
    assert out.endswith("trajectory_0000.obj ... trajectory_0006.obj\n")
    code, _, err = msdwarp("export", str(path), "--to", "obj", "--frame", "3", "--out", "cube.npz")
    assert code == 1
    assert "must end in .obj" in err


def test_without_flags_all_defaults_hold(msdwarp, monkeypatch):
    runs = []
    monkeypatch.setattr("msdwarp.cli.commands.run.run_scene", lambda *arguments: runs.append(arguments))
    assert msdwarp("run", "cube")[0] == 0
    ((origin, scene, options),) = runs
    assert (origin.name, scene.system.particle_count, options) == ("cube", 1000, Options())


@pytest.mark.slow
def test_an_overlay_is_written_beside_the_film_or_alone(msdwarp, tmp_path):
    small = ("run", "cube", "--size", "3", *SMALL)
    code, out, _ = msdwarp(*small, "--overlay", "3", "--frames", "none", "--video", "none")
    assert code == 0
    folder = tmp_path / "out" / "cube"
    assert sorted(p.name for p in folder.iterdir()) == ["cube_overlay.png", "restart.h5", "trajectory.vtkhdf"]
    assert "drew an overlay of 3 poses" in out
    with Image.open(folder / "cube_overlay.png") as picture:
        assert picture.size == (128, 72)
        assert np.asarray(picture.convert("L")).std() > 5  # not blank
    assert msdwarp(*small, "--frames", "none", "--out", "out/cube", "--force")[0] == 0
    assert not (folder / "cube_overlay.png").exists()  # none of an earlier run is left


@pytest.mark.slow
def test_a_moving_obstacle_moves_in_the_film(msdwarp, tmp_path):
    (tmp_path / "press.py").write_text(
        "from msdwarp import Plane, Scene, Sphere, box\n"
        "def build() -> Scene:\n"
        "    ball = Sphere((0, 0, 2), 0.5, motion=lambda t: (0, 0, -4 * t))\n"
        "    body = box((2, 2, 2), 0.2).translate((0, 0, 0.2))\n"
        "    return Scene(system=body, colliders=[Plane(), ball], duration=0.1)\n"
    )
    assert msdwarp("run", "press.py", "--video", "none", *SMALL)[0] == 0
    frames = [np.asarray(Image.open(p)).astype(int) for p in sorted((tmp_path / "out" / "press").glob("*.png"))]
    assert np.abs(frames[-1] - frames[0]).max() > 50


@pytest.mark.slow
def test_a_folder_that_holds_something_is_not_touched_without_force(msdwarp, tmp_path):
    folder = tmp_path / "results"
    folder.mkdir()
    (folder / "thesis.txt").write_text("years of work")
    arguments = ("run", "cube", "--size", "3", "--out", str(folder), *SMALL)
    code, out, err = msdwarp(*arguments)
    assert (code, out) == (1, "")
    assert err.startswith("error: out is")
    assert err.count("\n") == 1
    assert "--force" in err
    assert [p.name for p in folder.iterdir()] == ["thesis.txt"]

    (folder / "frame_0099.png").write_text("of an earlier, longer run")
    assert msdwarp(*arguments, "--force")[0] == 0
    assert (folder / "thesis.txt").read_text() == "years of work"
    assert not (folder / "frame_0099.png").exists()


@pytest.mark.parametrize(
    ("flags", "code", "message"),
    [
        (["--stiffness", "-1"], 1, "stiffness is -1; it must be at least 0"),
        (["--stiffness", "nan"], 1, "stiffness is nan; it must be finite"),
        (["--mass", "0"], 1, "mass is 0; it must be above 0"),
        (["--size", "1"], 1, "size is 1; it must be a whole number of at least 2"),
        (["--size", "3.7"], 1, "size is '3.7'; it must be a whole number"),
        (["--device", "tpu"], 1, "device is 'tpu'; it must be one of"),
        (["--duration", "0"], 1, "duration is 0"),
        (["--fps", "0"], 1, "fps is 0"),
        (["--substeps", "0"], 1, "substeps is 0"),
        (["--substeps", "150.5"], 1, "substeps is '150.5'; it must be a whole number or auto"),
        (["--tolerance", "0"], 1, "tolerance is 0"),
        (["--tolerance", "1e-2", "--integrator", "symplectic-euler"], 1, "tolerance chooses"),
        (["--stiffness", "1e18"], 1, "substeps a frame would be needed"),
        (["--stiffness", "1e300"], 1, "stiffness is 1e+300; it must be finite, and at most 1e+18"),
        (["--mass", "1e-40"], 1, "mass is 1e-40; it must be above 0, and at least 1e-18"),
        (["--log", "frame_0000.csv"], 1, "its plot would have the name of a frame"),
        (["--precision", "float16"], 1, "precision is 'float16'; it must be one of"),
        (["--integrator", "euler"], 1, "integrator is 'euler'; it must be one of"),
        (["--resolution", "huge"], 1, "resolution is 'huge'"),
        (["--resolution", "101x100"], 1, "resolution is '101x100'"),
        (["--out", "/dev/null/deep"], 1, "out is /dev/null/deep, which cannot be written to"),
        (["--log", "/dev/null/e.csv"], 1, "log is /dev/null/e.csv, which cannot be written to"),
        (["--color", "plaid"], 1, "color is 'plaid'; it must be one of"),
        (["--overlay", "1"], 1, "overlay is 1; it must be a whole number of at least 2"),
        (["--overlay", "8"], 1, "overlay is 8; it must be at most the number of frames drawn, 7"),
        (["--overlay", "2.4"], 1, "overlay is '2.4'; it must be a whole number"),
        (["--every", "1.5"], 1, "every is '1.5'; it must be a whole number"),
        (["--log", "deep/down/energy.csv"], 1, "log is deep/down/energy.csv, whose folder does not exist"),
        (["--color", "energy", "--no-strain"], 1, "--color energy needs the strains"),
        (["--azimuth", "400"], 1, "azimuth is 400.0; it must be from -360 to 360"),
        (["--elevation", "nan"], 1, "elevation is nan; it must be from -90 to 90"),
        (["--target", "here"], 1, "target is 'here'; it must be X,Y,Z, such as 0,0,0.5"),
        (
            ["--target", "0,0,1", "--follow", "cube"],
            1,
            "target is (0.0, 0.0, 1.0); it must be None where the camera",
        ),
        (["--follow", "moon"], 1, "look.follow is 'moon'; it must be one of"),
        (["--renderer", "vulkan"], 1, "renderer is 'vulkan'; it must be one of auto, raster, raycast, opengl"),
    ],
)
def test_bad_input_is_named_and_writes_nothing(msdwarp, tmp_path, flags, code, message):
    arguments = [*SMALL, *flags]
    for flag in flags[::2]:  # the last of two equal flags would win only by luck
        if flag in SMALL:
            place = arguments.index(flag)
            del arguments[place : place + 2]
    got, out, err = msdwarp("run", "cube", *arguments)
    assert (got, out) == (code, "")
    assert message in err
    assert err.startswith("error: ")
    assert err.count("\n") == 1
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_too_few_substeps_are_refused_in_one_line_that_says_how_many_would_do(msdwarp, tmp_path):
    code, out, err = msdwarp("run", "cube", "--substeps", "1")
    assert (code, out) == (1, "")
    assert err.count("\n") == 1
    needed = int(re.search(r"at least (\d+) a frame are stable", err)[1])
    assert not list(tmp_path.iterdir())
    assert msdwarp("run", "cube", "--substeps", str(needed), "--size", "10", *SMALL)[0] == 0


@pytest.mark.slow
def test_a_run_that_diverges_leaves_its_good_frames_and_says_why(msdwarp, tmp_path):
    code, out, err = msdwarp("run", "cube", "--substeps", "1", "--allow-unstable", "--resolution", "128x72")
    assert code == 1
    assert err.startswith("error: diverged at")
    assert re.search(r"connection \d+ was at strain", err)
    assert "substeps a frame are stable" in err
    folder = tmp_path / "out" / "cube"
    frames = sorted(folder.glob("*.png"))
    assert len(frames) >= 2  # the start, and what was good
    assert f"drew {len(frames)} frames" in out
    with Image.open(folder / "cube.webp") as film:
        assert film.n_frames == len(frames)
    with Trajectory(folder / "trajectory.vtkhdf") as found:
        assert len(found) == len(frames)
        assert np.isfinite(found.positions[:]).all()
    assert read_restart(folder / "restart.h5")[1]["checkpoint"]["frame_index"] == len(frames) - 1
    assert "diverged at" in msdwarp("resume", "out/cube", "--force")[2]  # again


@pytest.mark.slow
def test_the_log_holds_every_frame_and_its_plot_stands_beside_it(msdwarp, tmp_path):
    arguments = ("run", "cube", "--size", "4", "--log", "energy.csv", "--frames", "none", *SMALL)
    code, out, _ = msdwarp(*arguments)
    assert (code, "wrote out/cube/energy.csv and energy.png" in out) == (0, True)
    table = np.genfromtxt(tmp_path / "out" / "cube" / "energy.csv", delimiter=",", names=True)
    np.testing.assert_allclose(table["time_s"], np.arange(7) / 60, rtol=1e-8)  # nine digits are written
    falling = table["total_J"]  # nothing but gravity acts yet; symplectic Euler's m g v h/2 comes and goes
    assert np.ptp(falling) < 0.01 * table["kinetic_J"].max()
    assert (table["substeps"] > 0).all()
    assert np.asarray(Image.open(tmp_path / "out" / "cube" / "energy.png").convert("L")).std() > 5  # not blank


def test_progress_is_told_in_lines_where_output_is_no_terminal(msdwarp, monkeypatch):
    from msdwarp.cli import process

    monkeypatch.setattr(process, "TELL_EVERY", 1e-3)
    done = ("--device", "cpu", "--frames", "none", "--video", "none", "--duration", "0.5")
    code, _, err = msdwarp("run", "cube", *done)
    told = [int(k) for k in re.findall(r"^simulating: (\d+) of 31 done$", err, re.MULTILINE)]
    assert (code, told, bool(told)) == (0, sorted(told), True)
    assert msdwarp("run", "cube", "--force", "--quiet", *done) == (0, "", "")


@pytest.mark.slow
def test_tune_prints_flags_under_the_tolerance_and_run_takes_them(msdwarp):
    code, out, err = msdwarp("tune", "chain", "--tolerance", "1e-2", "--horizon", "0.1", "--device", "cpu")
    assert code == 0
    told = err.splitlines()
    assert re.match(r"tuning: reference 1 of 2, \d+ substeps a frame", told[0])
    assert any(re.match(r"tuning: method 2 of \d+, leapfrog, float32, stable substeps", one) for one in told)
    flags = re.search(r"cheapest under 0.01: (--integrator \S+ --precision \S+ --substeps \d+)", out)[1]
    error = float(re.search(r"^error ([\d.e-]+),", out, flags=re.MULTILINE)[1])
    assert error <= 1e-2
    assert re.search(
        r"^error \S+, (the default$|\S+ times \(\S+ to \S+\) as fast as the default)", out, re.MULTILINE
    )
    drawn_less = ("--frames", "none", "--video", "none", "--duration", "0.1", "--device", "cpu")
    assert msdwarp("run", "chain", *flags.split(), *drawn_less)[0] == 0


@pytest.mark.slow
def test_modes_are_listed_and_drawn(msdwarp, tmp_path):
    square = ("modes", "block2d", "--modes", "5")
    code, out, _ = msdwarp(*square, "--plot", "shapes.png", "--films", "films")
    assert code == 0
    system = find_scene("block2d").scene().system
    found = modes(system, 5)
    listed = re.findall(r"│ (\d) +│ +(\S+) │ +(\S*) │ +(\S+) │", out)
    assert [float(row[1]) for row in listed] == pytest.approx(found.frequencies, rel=1e-4)
    assert [row[2] for row in listed[:3]] == ["", "", ""]  # in a plane three motions are rigid
    assert float(listed[3][2]) == pytest.approx(found.damping_ratios[3], rel=1e-2)
    assert sorted(path.name for path in (tmp_path / "films").iterdir()) == ["mode_04.webp", "mode_05.webp"]
    with Image.open("shapes.png") as plot, Image.open("films/mode_04.webp") as film:
        assert (plot.size[0], film.n_frames) == (1800, 48)
    for flags in (("--plot", "shapes.png"), ("--films", "films")):
        code, out, err = msdwarp(*square, *flags)
        assert (code, out) == (1, "")
        assert "which exists; name another file or add --force" in err
    code, out, _ = msdwarp("modes", "block2d", "--modes", "3", "--plot", "other.png")
    assert code == 0
    assert "nothing is drawn" in out
    assert not Path("other.png").exists()


@pytest.mark.slow
def test_run_with_a_tolerance_tunes_first(msdwarp):
    # Of the scenes the chain needs the fewest substeps: what is compared with takes many times as many.
    short = ("--frames", "none", "--video", "none", "--duration", "0.1", "--device", "cpu")
    code, out, _ = msdwarp("run", "chain", "--tolerance", "1e-2", *short)
    assert code == 0
    assert "5 particles" in out


def test_it_can_simulate_without_drawing(msdwarp, tmp_path):
    nothing = ("--frames", "none", "--video", "none", "--trajectory", "none")
    code, out, _ = msdwarp("run", "cube", *nothing, "--duration", "0.1")
    assert code == 0
    assert len(out.splitlines()) == 2
    assert not list(tmp_path.iterdir())


def test_list_names_every_scene_with_its_first_line(msdwarp):
    code, out, _ = msdwarp("list")
    assert code == 0
    scenes = {p.stem for p in (ROOT / "scenes").glob("[!_]*.py")}
    assert {line.split()[0] for line in out.splitlines()} == scenes
    assert all(len(line.split()) > 4 for line in out.splitlines())


def test_help_shows_the_scene_s_own_flags_and_the_common_ones(msdwarp):
    code, out, _ = msdwarp("run", "worm", "--help")
    assert code == 0
    for flag in ("--length", "--stiffness", "--device", "--color", "--out"):
        assert flag in out


def test_help_describes_a_common_parameter_unless_the_scene_does(msdwarp, tmp_path):
    described = '"""Return it.\n\n    Parameters\n    ----------\n    mass\n        Mass of all.\n    """'
    (tmp_path / "own.py").write_text(f"def build(*, mass=1.0, damping=2.0):\n    {described}\n")
    code, out, _ = msdwarp("run", "own.py", "--help")
    assert code == 0
    assert "Mass of all." in out
    assert "Mass of each particle" not in out
    assert "Damper constant of each connection" in out


def test_unknown_scenes_are_named(msdwarp):
    code, _, err = msdwarp("run", "dragon")
    assert code == 1
    assert "scene is 'dragon'" in err
    assert "cube" in err


@pytest.mark.parametrize(
    ("script", "message"),
    [
        ("x = 1", "scene is 'own.py', whose script has no function `build`"),
        ("def build():\n    return None", "build of scene 'own' returned None; it must return a Scene"),
        (
            "def build(*, duration: float = 1.0):\n    pass",
            "build of scene 'own' has parameters with the names of common flags: ['duration']",
        ),
        (
            "from msdwarp import box\ndef build():\n    return box((2, 2, 2), -1)",
            "spacing is -1; it must be a number above 0, and finite",
        ),
        (
            'def build(*, size: "Nobody" = 3):\n    return None',
            "build of scene 'own' has a wrong annotation: name 'Nobody' is not defined",
        ),
    ],
)
def test_a_script_that_gives_no_scene_is_told_so(msdwarp, tmp_path, script, message):
    (tmp_path / "own.py").write_text(f"{script}\n")
    assert msdwarp("run", "own.py") == (1, "", f"error: {message}\n")


def test_a_scene_s_script_may_use_what_stands_beside_it(msdwarp, tmp_path):
    (tmp_path / "sub").mkdir()
    (tmp_path / "sub" / "lengths_beside.py").write_text("LINKS = 4\n")
    (tmp_path / "sub" / "own.py").write_text(
        "from __future__ import annotations\n"
        "from dataclasses import dataclass\n"
        "from lengths_beside import LINKS\n"
        "from msdwarp import Scene, chain\n"
        "@dataclass\nclass Rope:\n    links: int = LINKS\n"
        "def build(*, more: int = 1) -> Scene:\n    return Scene(system=chain(Rope().links + more, 0.2).pin(0))\n"
    )
    code, out, _ = msdwarp("run", "sub/own.py", "--more", "3", "--frames", "none", "--video", "none", *SMALL)
    assert code == 0
    assert "7 particles and 6 connections" in out


@pytest.mark.slow
def test_a_script_runs_by_itself_and_keeps_libraries_silent(tmp_path):
    script = ROOT / "scenes" / "cloth.py"
    done = subprocess.run(
        [sys.executable, str(script), "--size", "6", *SMALL], cwd=tmp_path, capture_output=True, text=True
    )
    assert (done.returncode, without_progress(done.stderr).removeprefix(f"{COMPILING}\n")) == (0, "")
    assert len(done.stdout.splitlines()) == 4
    assert "Warp" not in done.stdout
    assert (tmp_path / "out" / "cloth" / "cloth.webp").stat().st_size > 0
