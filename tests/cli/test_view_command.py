"""`msdwarp view`, and `rerun` of what was recorded live."""

import os
import signal
import subprocess
import sys
import threading
import time
import urllib.request

import numpy as np
import pytest

pytest.importorskip("viser")

import msdwarp as msd
from msdwarp import checks
from msdwarp.cli.commands.stored_runs import rerun
from msdwarp.cli.commands.view import SHELF, memory_limit, rounded_like, running_scene, view_of
from msdwarp.cli.options import ViewOptions
from msdwarp.cli.scene_files import find_scene, scene_names
from msdwarp.live import View

WAITS = 300.0
"""How long a loaded machine may take to do what is asked [s]."""


def command(*words, **options):
    environment = {name: value for name, value in os.environ.items() if name != "DISPLAY"}
    return subprocess.Popen(
        [sys.executable, "-m", "msdwarp", "view", *words],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=environment,
        **options,
    )


@pytest.mark.slow
def test_a_page_is_served_until_ctrl_c(tmp_path, heard):
    with command("chain", cwd=tmp_path) as process:
        timer = threading.Timer(WAITS, process.kill)
        timer.start()
        address = process.stdout.readline().split()[0]
        assert "ssh -L" in process.stdout.readline()
        assert address.startswith("http://127.0.0.1:")
        assert b"<html" in urllib.request.urlopen(address, timeout=WAITS).read().lower()
        process.send_signal(signal.SIGINT)
        _, error = process.communicate()
        timer.cancel()
    assert process.returncode == 0, error
    assert "Traceback" not in error
    assert not list(tmp_path.iterdir())


def test_what_cannot_be_shown_is_said(msdwarp, tmp_path, monkeypatch):
    monkeypatch.delenv("DISPLAY", raising=False)

    def refused(*words):
        code, out, error = msdwarp("view", *words)
        assert (code, out) == (1, "")
        return error

    assert "nonsense" in refused("nonsense")
    assert "choose one" in refused("chain", "--browser", "--window")
    assert "port is 70000" in refused("chain", "--port", "70000")
    assert "trajectory" in refused(str(tmp_path))


def recorded(folder, *, deeds):
    """Record some frames of a scene by the loop's own commands, with what is done by hand; return the folder."""
    origin = find_scene("cube")._replace(parameters={"size": 4})
    source = running_scene(origin, origin.scene(), ViewOptions(device="cpu"))
    view = View(source, [])
    for k in range(24):
        if k == 6:
            view.post("record", folder=folder)
        if k == 8 and deeds:
            view.post("scale", name="stiffness", factor=1.7)
            view.post("grab", holder=1, point=[-1.2, 0.0, 2.2])
            view.post("drag", holder=1, point=[-1.0, 0.4, 3.0])
        if k == 16 and deeds:
            view.post("let_go", holder=1)
        view._execute_commands()
        view._move_hand()
        source.advance()
    view.post("record")
    view._execute_commands()
    return folder


def again(path):
    with msd.Trajectory(path) as trajectory:
        return rerun(trajectory, device=None, out=None, quiet=True)


@pytest.mark.slow
@pytest.mark.parametrize("deeds", [True, False], ids=["by hand", "alone"])
def test_what_was_recorded_live_is_made_again_to_the_last_bit(tmp_path, deeds):
    folder = recorded(tmp_path / "kept", deeds=deeds)
    path = folder / "trajectory.vtkhdf"
    assert (folder / "deeds.json").exists() == deeds
    assert again(path) is None
    with msd.Trajectory(path) as trajectory:
        assert len(trajectory) == 19
        assert trajectory.times[0] == pytest.approx(6 / 60)
    if deeds:  # without them it is another motion
        (folder / "deeds.json").unlink()
        assert "differs" in again(path)
        (folder / "deeds.json").write_text('[{"frame": 0, "deed": "nothing"}]')
        with pytest.raises(ValueError, match="deed"):
            again(path)
        (folder / "deeds.json").write_text("{")
        with pytest.raises(ValueError, match="damaged"):
            again(path)


def test_the_scenes_on_number_keys_are_there():
    assert set(SHELF) <= set(scene_names())
    assert len(SHELF) == 9


def test_whole_parameters_stay_whole():
    assert rounded_like({"size": 10, "stiffness": 6.0}, {"size": 12.0, "stiffness": 7.0}) == {
        "size": 12,
        "stiffness": 7.0,
    }


@pytest.mark.slow
def test_a_simulation_can_be_viewed_from_python():
    body = msd.box((3, 3, 3), 0.1, mass=0.01, stiffness=200.0, damping=0.1).translate((0, 0, 0.3))
    simulation = msd.Simulation(body, colliders=[msd.Plane()], device="cpu")
    opened = msd.view(simulation, browser=True, block=False)
    opened.post("pause", value=False)  # nobody opens the page, for which it would wait
    end = time.monotonic() + WAITS
    while simulation.time < 0.1:
        assert time.monotonic() < end
        time.sleep(0.01)
    opened.close()
    assert np.isfinite(simulation.frame().position).all()
    with pytest.raises(ValueError, match="shown"):
        msd.view(3, browser=True)
    with pytest.raises(ValueError, match="block"):
        msd.view(simulation, browser=False, block=False)


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="other systems have no such limit")
def test_what_builds_a_scene_may_not_take_more_memory_than_is_free(monkeypatch):
    monkeypatch.setattr(checks, "free_memory", lambda: 1 << 28)
    with memory_limit(), pytest.raises(MemoryError, match=r"2\.00 GiB"):
        np.zeros(1 << 28)
    assert len(np.zeros(1 << 28)) == 1 << 28  # of which no page is touched


@pytest.mark.slow
def test_what_does_not_fit_is_refused_by_the_view_that_is_asked_for_it():
    origin = find_scene("cube")._replace(parameters={"size": 3})
    view = view_of(origin, origin.scene(), ViewOptions(browser=True, device="cpu"))
    before = view.source
    for size, word in ((1500, "GB of memory"), (-1, "size is -1"), (10**9, "GB of memory")):
        view.post("parameters", size=size)
        view._execute_commands()
        assert word in view.notice
        assert view.source is before
    view._step()
    assert view.source.index == 1
    for screen in view.screens:
        screen.close()
