"""A file names a script: it runs only where this user ran it, or where it is allowed to."""

import json
import shutil
from pathlib import Path

import h5py
import numpy as np
import pytest
from PIL import Image
from trajectories import SYSTEMS, write

from msdwarp import Trajectory
from msdwarp.cli import script_signatures as trust
from msdwarp.world import scene_from_stored

SCENE = """
from pathlib import Path
import numpy as np
from msdwarp import Box, Look, Plane, Scene, Sphere, at, box

Path(__file__).with_name("ran").touch()

def motion(t):
    return (0.2 * np.sin(9 * t), 0, 0), (0, 0, 3 * t)

def build(*, size: int = 3):
    body = box((size, size, 3), 0.1, mass=0.01, stiffness=300.0, damping=0.2).translate((0, 0, 0.3))
    texture = np.full((4, 4, 3), (20, 200, 40), np.uint8)
    colliders = [Plane(friction=np.inf), Box((0, 0, 0.1), (0.3, 0.1, 0.1), motion=motion), Sphere((1, 0, 0), 0.2)]
    schedule = [at(0.05, stiffness=lambda k: 2 * k, group=[0, 1, 2, 3]), at(0.1, mass=0.02)]
    return Scene(system=body, colliders=colliders, schedule=schedule, look=Look(texture=texture), duration=0.2)
"""
UNDRAWN = ["--frames", "none", "--video", "none", "--device", "cpu"]
PICTURE = ["--video", "none", "--resolution", "128x72"]


@pytest.fixture
def own(msdwarp, tmp_path):
    """The script of a scene, which has run; `ran` tells when it runs again."""
    path = tmp_path / "own.py"
    path.write_text(SCENE)
    assert msdwarp("run", "own.py", *UNDRAWN)[0] == 0
    (tmp_path / "ran").unlink()
    return path


def forget(folder, *names):
    """Take from a run's trajectory what earlier versions did not write."""
    with h5py.File(folder / "trajectory.vtkhdf", "r+") as file:
        group = file["msdwarp"]
        if "scene" in group:
            del group["scene"]
        about = json.loads(group["attributes"][()])
        for name in names:
            about.pop(name, None)
        del group["attributes"]
        group["attributes"] = json.dumps(about)


@pytest.mark.slow
@pytest.mark.parametrize("command", ["render", "plot", "rerun"])
def test_a_received_file_runs_no_script(msdwarp, tmp_path, command):
    evil = tmp_path / "evil.py"
    evil.write_text("from pathlib import Path\nPath(__file__).with_name('ran').touch()\n")
    digest = trust.hashlib.sha256(evil.read_bytes()).hexdigest()
    sealed = {"sha256": digest, "seal": "0" * 64}
    for k, script in enumerate(({}, {"script": sealed}, {"script": {"sha256": digest}}, {"script": "x"})):
        # Each with each script, by one command at least.
        place = ("evil.py", str(evil))[(k + (command == "plot")) % 2]
        about = {"scene": place, "parameters": {}, "gravity": 9.82, "schedule": 1, **script}
        write(tmp_path / "a.vtkhdf", SYSTEMS["box"], 3, attributes=about, force=True)
        more = [*PICTURE, "--out", "pictures", "--force"] if command == "render" else []
        code, _, err = msdwarp(command, "a.vtkhdf", *more)
        assert code == (0 if command == "render" else 1)
        assert f"scene is {place!r}, a script, and " in err
        assert "--trust" in err
        assert not (tmp_path / "ran").exists()


@pytest.mark.slow
def test_one_s_own_script_runs_as_it_was_where_it_was(msdwarp, own, tmp_path):
    ran = tmp_path / "ran"
    assert msdwarp("rerun", "out/own", "--quiet") == (0, "", "")
    assert ran.exists()
    ran.unlink()
    own.write_text(SCENE + "\n# changed\n")
    for command in (("rerun", "out/own"), ("resume", "out/own", "--duration", "0.3")):
        code, _, err = msdwarp(*command)
        assert code == 1
        assert "has changed since the run began; allow it with --trust, or name another" in err
        assert not ran.exists()
    assert msdwarp("rerun", "out/own", "--quiet", "--trust") == (0, "", "")
    own.unlink()
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "elsewhere" / "own.py").write_text(SCENE)
    assert "own.py', a script that does not exist" in msdwarp("rerun", "out/own")[2]
    assert msdwarp("rerun", "out/own", "--quiet", "--scene", "elsewhere/own.py") == (0, "", "")
    assert msdwarp("resume", "out/own", "--duration", "0.3", "--scene", "elsewhere/own.py")[0] == 0


@pytest.mark.slow
def test_what_runs_is_what_was_looked_at(msdwarp, own, monkeypatch, tmp_path):
    looked = trust.reason_for_distrust

    def look_and_change(place, *rest):
        found = looked(place, *rest)
        Path(place).write_text("from pathlib import Path\nPath('evil').touch()\n" + SCENE)
        return found

    monkeypatch.setattr(trust, "reason_for_distrust", look_and_change)
    assert msdwarp("rerun", "out/own", "--quiet") == (0, "", "")
    assert not (tmp_path / "evil").exists()


@pytest.mark.slow
def test_what_another_user_ran_is_asked_for(msdwarp, own, monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "other"))
    assert "the run was not made here by you" in msdwarp("rerun", "out/own")[2]
    (tmp_path / "file").touch()
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "file"))  # where no key can be
    assert "the run was not made here by you" in msdwarp("rerun", "out/own")[2]
    assert not (tmp_path / "ran").exists()
    assert msdwarp("rerun", "out/own", "--quiet", "--trust")[0] == 0


@pytest.mark.slow
def test_a_compiled_file_beside_a_script_is_not_run(msdwarp, own, tmp_path):
    import importlib.util
    import py_compile

    evil = tmp_path / "evil.txt"
    evil.write_text("from pathlib import Path\nPath('evil').touch()\n" + SCENE)
    cached = importlib.util.cache_from_source(str(own))
    py_compile.compile(str(evil), cfile=cached, invalidation_mode=py_compile.PycInvalidationMode.UNCHECKED_HASH)
    assert msdwarp("rerun", "out/own", "--quiet") == (0, "", "")
    assert not Path("evil").exists()


@pytest.mark.slow
def test_files_of_the_version_before_need_trust_for_scripts_alone(msdwarp, own, tmp_path):
    assert msdwarp("run", "cube", "--size", "3", "--duration", "0.1", *UNDRAWN)[0] == 0
    for name in ("own", "cube"):
        forget(tmp_path / "out" / name, "script")
    assert msdwarp("rerun", "out/cube", "--quiet") == (0, "", "")
    assert msdwarp("render", "out/cube", *PICTURE)[::2] == (0, "")
    assert "the file does not say what was in it" in msdwarp("rerun", "out/own")[2]
    assert "the file does not say what was in it" in msdwarp("plot", "out/own")[2]
    assert not (tmp_path / "ran").exists()
    assert msdwarp("plot", "out/own", "--trust")[0] == 0
    assert msdwarp("rerun", "out/own", "--quiet", "--trust")[0] == 0


@pytest.mark.slow
def test_pictures_and_plots_need_no_script(msdwarp, own, tmp_path):
    assert msdwarp("render", "out/own", *PICTURE, "--trust", "--out", "by_script")[0] == 0
    assert msdwarp("plot", "out/own", "--trust", "--out", "by_script.csv")[0] == 0
    shutil.move(own, tmp_path / "gone")
    (tmp_path / "ran").unlink()
    assert msdwarp("render", "out/own", *PICTURE, "--out", "by_file")[::2] == (0, "")
    assert msdwarp("plot", "out/own", "--out", "by_file.csv")[0] == 0
    assert not (tmp_path / "ran").exists()
    assert (tmp_path / "by_file.csv").read_bytes() == (tmp_path / "by_script.csv").read_bytes()
    for k in (0, 7, 12):
        pictures = [np.asarray(Image.open(tmp_path / f / f"frame_{k:04d}.png")) for f in ("by_file", "by_script")]
        np.testing.assert_array_equal(*pictures)


@pytest.mark.slow
def test_a_run_made_longer_says_that_obstacles_stand_still(msdwarp, own, tmp_path):
    assert msdwarp("resume", "out/own", "--duration", "0.3")[0] == 0
    assert msdwarp("render", "out/own", *PICTURE)[::2] == (0, "")  # by the script, which is there
    own.unlink()
    code, _, err = msdwarp("render", "out/own", *PICTURE)
    assert code == 0
    assert err.startswith("drawn with moving obstacles that stand still from 0.2 s on: scene is")


def test_a_damaged_stored_scene_is_told(msdwarp, own):
    path = Path("out/own/trajectory.vtkhdf")
    with Trajectory(path) as found:
        described, arrays = found.scene
        described["colliders"][2]["radius"] = -1.0
        with pytest.raises(ValueError, match="the stored scene is damaged: radius is -1"):
            scene_from_stored(found.system, described, arrays)
        with pytest.raises(ValueError, match="the stored scene is damaged"):
            scene_from_stored(found.system, {"look": {"azimuth": 0}}, {})
