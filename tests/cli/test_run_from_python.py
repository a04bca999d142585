"""`msdwarp.run` from Python: what the command does, with Python's errors and signals."""

import signal

import numpy as np
import pytest

import msdwarp as msd

UNDRAWN = {"frames": None, "film": None, "quiet": True, "device": "cpu"}
SCRIPT = """from msdwarp import Plane, Scene, box

def build():
    body = box((3, 3, 3), 0.1, mass=0.01, stiffness=300.0, damping=0.3).translate((0, 0, 0.2))
    return Scene(system=body, colliders=[Plane()], duration=0.1)
"""


def fall() -> msd.Scene:
    names: dict = {}
    exec(SCRIPT, names)
    return names["build"]()


def test_a_run_is_that_of_the_command(msdwarp, tmp_path):
    (tmp_path / "own.py").write_text(SCRIPT)
    flags = ["--frames", "none", "--video", "none", "--device", "cpu", "--integrator", "rk4", "--every", "2"]
    assert msdwarp("run", "own.py", *flags)[0] == 0
    how = UNDRAWN | {"integrator": msd.RK4(), "every": 2}
    with (
        msd.Trajectory("out/own/trajectory.vtkhdf") as commanded,
        msd.run(fall(), "out/called", **how) as called,
        msd.run("own.py", "out/named", **how) as named,
    ):
        assert len(called) == 4
        for k in range(4):
            np.testing.assert_array_equal(called.positions[k], commanded.positions[k])
            np.testing.assert_array_equal(named.positions[k], commanded.positions[k])
    # A scene that was made in Python cannot be made again.
    assert not (tmp_path / "out/called/restart.h5").exists()
    assert (tmp_path / "out/named/restart.h5").exists()
    code, _, err = msdwarp("resume", "out/called")
    assert code == 1
    assert "has no restart.h5" in err
    code = msdwarp("render", "out/called", "--frames", "none", "--video", "gif", "--resolution", "96x64")[0]
    assert code == 0
    assert (tmp_path / "out/called/render/called.gif").exists()  # named as `run` does


def test_a_run_draws_and_tells(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    drawn = UNDRAWN | {"frames": "png", "film": "gif", "quiet": False, "color": "strain", "cut": (0, -1, 0)}
    msd.run(fall(), "out/fall", duration=0.05, resolution=(96, 64), target=(0, 0, 0.1), **drawn).close()
    assert {one.name for one in (tmp_path / "out/fall").iterdir()} == {
        *(f"frame_{k:04d}.png" for k in range(4)),
        "fall.gif",
        "trajectory.vtkhdf",
    }
    assert "wrote out/fall/trajectory.vtkhdf" in capsys.readouterr().out.replace("\\", "/")


@pytest.mark.parametrize(
    ("how", "kind", "told"),
    [
        ({"films": 3}, TypeError, r"run\(\) got an unexpected keyword argument 'films'. Did you mean film\?"),
        ({"colour": "strain"}, TypeError, r"Did you mean color\?"),
        ({"video": "mp4"}, TypeError, r"Did you mean film\?"),
        ({"film": "avi"}, ValueError, "film is 'avi'; it must be one of webp, mp4, gif, none"),
        ({"fps": "x"}, ValueError, "fps is 'x'; it must be a number"),
        ({"integrator": "rk5"}, ValueError, "integrator is 'rk5'; it must be one of symplectic-euler"),
        ({"integrator": msd.ExplicitEuler()}, ValueError, r"integrator is ExplicitEuler\(\); it must be one of"),
        ({"resolution": (3, 4)}, ValueError, "resolution is '3x4'"),
        ({"duration": -1.0}, ValueError, "duration is -1"),
        ({"azimuth": 400.0}, ValueError, "azimuth is 400"),
        ({"trajectory": "none"}, ValueError, "trajectory is 'none'"),
        ({"scene": 3}, ValueError, "scene is 3; it must be a Scene"),
        ({"scene": "cubee"}, ValueError, r"Did you mean cube\?"),
        ({"out": "full"}, FileExistsError, "out is full, which is not empty; name another folder or give force=T"),
    ],
    ids=lambda one: next(iter(one)) if isinstance(one, dict) else "",
)
def test_wrong_arguments_are_named_and_nothing_is_written(tmp_path, monkeypatch, how, kind, told):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "mine.txt").touch()
    with pytest.raises(kind, match=told):
        msd.run(**({"scene": fall(), "out": "new"} | UNDRAWN | how))
    assert [one.name for one in tmp_path.rglob("*")] == ["full", "mine.txt"]


def test_an_interrupt_is_python_s_own_and_keeps_frames(tmp_path, monkeypatch, heard):
    monkeypatch.chdir(tmp_path)
    real = msd.Simulation.step

    def step(simulation, frames=1):
        real(simulation, frames)
        if simulation.frame_index == 3:
            signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr(msd.Simulation, "step", step)
    before = signal.getsignal(signal.SIGINT)
    with pytest.raises(KeyboardInterrupt):
        msd.run(fall(), "out", **UNDRAWN)
    assert signal.getsignal(signal.SIGINT) is before
    with msd.Trajectory("out/trajectory.vtkhdf") as kept:
        assert len(kept) == 4


def test_an_interrupt_before_the_first_frame_does_not_end_python(tmp_path, monkeypatch, heard):
    # The command ends at once then; a notebook must not.
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(msd.Simulation, "reset", lambda simulation: signal.raise_signal(signal.SIGINT))
    with pytest.raises(KeyboardInterrupt):
        msd.run(fall(), "out", **UNDRAWN)
    assert not (tmp_path / "out").exists()
