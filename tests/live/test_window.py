"""The window of a view, on a display of its own, with the keys and the mouse of a person."""

import os
import shutil
import subprocess
import threading
import time
from pathlib import Path

import numpy as np
import pytest
from test_view import held

from msdwarp import Plane, Scene, Simulation, box
from msdwarp.live import Running, View, Window, within_reach
from msdwarp.live.sources import BELOW, surroundings
from msdwarp.live.window import arrow
from msdwarp.pictures import no_display

SIZE = (640, 480)
CUBE = box((5, 5, 5), 0.1, mass=0.01, stiffness=200.0, damping=0.1).translate((0, 0, 0.4))
LONG = 180.0
"""When what is waited for does not come any more [s]: other tests may keep all processors busy."""


@pytest.fixture(scope="module")
def display():
    """The name of a display that these tests have for themselves."""
    if shutil.which("Xvfb") is None:
        pytest.skip("Xvfb is not installed")
    reads, writes = os.pipe()
    command = ["Xvfb", "-displayfd", str(writes), "-screen", "0", "800x600x24", "-nolisten", "tcp", "-noreset"]
    server = subprocess.Popen(command, pass_fds=[writes], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    os.close(writes)
    with os.fdopen(reads) as pipe:
        number = pipe.readline().strip()
    try:
        if not number:
            pytest.skip("Xvfb does not start")
        yield f":{number}"
    finally:
        server.terminate()
        server.wait()


@pytest.fixture
def screen(display, monkeypatch):
    """A display on which windows can be opened."""
    monkeypatch.setenv("DISPLAY", display)
    if (why := no_display()) is not None:
        pytest.skip(why)
    return display


@pytest.fixture
def person(screen):
    """Press keys and move the mouse in the window: words of xdotool."""
    if shutil.which("xdotool") is None:
        pytest.skip("xdotool is not installed")

    def does(*words):
        subprocess.run(["xdotool", *map(str, words)], check=True, timeout=LONG)

    return does


def running(**changes):
    scene = {"system": CUBE, "colliders": [Plane()], "duration": 1.0, "gravity": 1.0} | changes
    at = within_reach(Scene(**scene))
    return Running(at, Simulation.from_scene(at, device="cpu"), "cube")


class Script:
    """A screen that shows nothing, and goes on with what a test does at each turn of the loop."""

    takes_images = False

    watched = False

    def __init__(self, script):
        self._script = script

    def open(self, view):
        self._steps = self._script(view)

    def stage(self):
        pass

    show = tell = close = stage

    def poll(self):
        return next(self._steps, "end") != "end"


def until(condition):
    """Wait for something, turn by turn of the view's loop."""
    end = time.monotonic() + LONG
    while not condition():
        assert time.monotonic() < end, "what was waited for did not come"
        yield


def turns(count):
    for _ in range(count):
        yield


def rests(window):
    """Wait until the window shows the same for some turns, and more than one color."""
    end, before = time.monotonic() + LONG, None
    while before is None or before.std() < 1 or (before != window.image()).any():
        assert time.monotonic() < end, "what the window shows goes on changing"
        before = window.image()
        yield from turns(30)


def played(script, **options):
    """Run a view in a window as the script says: a function of the view and the window that yields each turn."""
    window = Window(SIZE)
    view = View(options.pop("source", None) or running(), [window, Script(lambda v: script(v, window))], **options)
    view.run()
    return view


def at(window, point):
    """Return where a point in space is in the window, as X counts pixels: from the upper left."""
    x, y = window._screen.orbit.pixels(np.array([point]), SIZE[1], SIZE[0])[0]
    return round(x), round(SIZE[1] - y)


def middle(view):
    return view.source.frame().position.astype(float).mean(axis=0)


def test_the_surroundings_hold_the_body_and_the_ground_below_it():
    seen = surroundings(running().scene, CUBE.position)
    assert seen[:, 2].min() == 0.0
    np.testing.assert_array_equal(seen.max(axis=0)[2], CUBE.position.max(axis=0)[2])
    free = surroundings(running(colliders=[]).scene, CUBE.position)
    # The cube is 0.4 wide.
    np.testing.assert_allclose(free[:, 2].min(), CUBE.position[:, 2].min() - BELOW * 0.4)


def test_an_arrow_ends_where_it_points_to():
    triangles = arrow(np.zeros(2), np.array([100.0, 0.0]), 1.0)
    corners = triangles.reshape(-1, 2)
    assert corners[:, 0].max() == 100.0
    np.testing.assert_allclose(corners[:, 1].max(), -corners[:, 1].min())
    assert len(arrow(np.zeros(2), np.array([1.0, 0.0]), 1.0)) < len(triangles)  # too short for a head


def test_where_there_is_no_display_it_is_said(monkeypatch):
    for name in (None, ":12345"):
        if name is None:
            monkeypatch.delenv("DISPLAY", raising=False)
        else:
            monkeypatch.setenv("DISPLAY", name)
        if no_display() is None:
            pytest.skip("windows need no X server here")
        with pytest.raises(RuntimeError, match="display"):
            View(running(), [Window()]).run()


@pytest.mark.slow
def test_a_person_sees_and_handles_a_body(person):
    def script(view, window):
        yield from rests(window)
        before = window.image()
        assert before.shape == (SIZE[1], SIZE[0], 3)
        person("mousemove", 600, 20, "key", "space")
        yield from until(lambda: view.source.time > 0.3)
        # More differs than what is written: in the middle is the cube.
        yield from until(lambda: (before != window.image())[150:400, 200:450].any())

        person("key", "space")
        yield from until(lambda: view.paused)
        yield from rests(window)

        person("key", "s")
        yield from until(lambda: view.source.handling.factors["stiffness"] > 1)
        assert view.source.handling.factors["stiffness"] == 1.25
        person("key", "shift+s")
        yield from until(lambda: view.source.handling.factors["stiffness"] < 1.25)
        person("keydown", "d")  # a key that is held
        yield from until(lambda: view.source.handling.factors["damping"] > 1.25**2)
        person("keyup", "d")
        person("key", "h")
        yield from until(lambda: view.helps)
        person("key", "h", "key", "c")
        yield from until(lambda: view.shown.color == "speed")
        for key in ("e", "t", "j", "3", "u", "i"):  # keys of VTK and PyVista, which would act if they were heard
            person("key", key)
        yield from turns(20)
        assert window.watched

        person("key", "q")
        yield from until(lambda: False)

    played(script, paused=True)


@pytest.mark.slow
def test_a_shadow_lies_on_the_ground(screen):
    def script(view, window):
        yield from rests(window)  # VTK may draw before the first frame is in place
        shown = window._screen
        lit = shown.image().astype(int)
        shown._actors.on_ground.SetVisibility(False)
        shown.redraw()
        darker = shown.image().astype(int) - lit
        assert darker.min() > -10  # to paint the ground twice changes nothing else
        assert (darker.max(axis=2) > 30).sum() > 500  # of 300 000 pixels, a few of which are seen past the cube

    played(script, paused=True)


@pytest.mark.slow
def test_a_drag_that_begins_on_the_body_lifts_it(person):
    def script(view, window):
        yield from until(lambda: view.source.time > 0.05)
        orbit = window._screen.orbit
        near = orbit.distance
        person("mousemove", 320, 240, "click", 5, "click", 5, "click", 5, "click", 5)  # the wheel: room above
        yield from until(lambda: orbit.distance > 1.7 * near)
        x, y = at(window, middle(view))
        eye = window._screen.orbit.camera.eye.copy()
        person("mousemove", x, y, "mousedown", 1)
        yield from until(lambda: view.hand.grip is not None)
        for k in range(1, 6):
            person("mousemove", x, y + (40 - y) * k // 5)
            yield from turns(3)
        yield from until(lambda: middle(view)[2] > 0.7)  # it began at 0.6: without a hand it never gets there
        assert held(view.source)
        np.testing.assert_array_equal(window._screen.orbit.camera.eye, eye)
        person("mouseup", 1)
        yield from until(lambda: not held(view.source))
        height = middle(view)[2]
        yield from until(lambda: middle(view)[2] < height - 0.1)

    played(script)


@pytest.mark.slow
def test_beside_the_body_the_mouse_moves_the_camera(person):
    def script(view, window):
        orbit = window._screen.orbit
        yield from rests(window)
        before = orbit.camera.eye, orbit.target, orbit.distance
        person("mousemove", 600, 300, "mousedown", 1, "key", "w")  # a key tells when all before it was heard
        yield from until(lambda: view.shown.wires)
        person("mousemove", 560, 320)
        yield from until(lambda: not np.array_equal(orbit.camera.eye, before[0]))
        person("mouseup", 1)
        np.testing.assert_array_equal(orbit.target, before[1])
        assert view.hand.grip is None
        turned = window.image()
        person("click", 4)  # the wheel
        yield from until(lambda: orbit.distance < before[2])
        person("mousedown", 2, "mousemove", 500, 320)
        yield from until(lambda: not np.array_equal(orbit.target, before[1]))
        person("mouseup", 2, "mousemove", 400, 320, "key", "w")
        yield from until(lambda: not view.shown.wires)
        at_end = orbit.target.copy()
        person("mousemove", 600, 320, "key", "w")
        yield from until(lambda: view.shown.wires)
        np.testing.assert_array_equal(orbit.target, at_end)
        assert (turned != window.image()).any()  # though the view is paused
        person("key", "r", "key", "c")  # the same source: the camera stays
        yield from until(lambda: view.shown.color == "speed")
        assert window._screen.orbit is orbit

    played(script, paused=True)


@pytest.mark.slow
def test_keys_of_scenes_open_others_and_a_closed_window_ends_the_view(person):
    def script(view, window):
        yield from turns(5)
        first = window._screen.orbit
        person("key", "2")
        yield from until(lambda: view.source.scene.gravity == 2.0)
        yield from until(lambda: window._screen.orbit is not first)
        search = ["xdotool", "search", "--name", "^msdwarp - cube$"]
        yield from until(lambda: subprocess.run(search, capture_output=True, check=False).stdout.split())
        window._screen._interactor.ExitCallback()  # what VTK does when the person closes the window
        yield from until(lambda: False)

    played(script, scenes={"one": running, "two": lambda: running(gravity=2.0)})


@pytest.mark.slow
def test_opening_and_closing_leaks_no_thread(screen):
    def files():
        return len(list(Path("/proc/self/fd").iterdir())) if Path("/proc/self/fd").exists() else 0

    def native():
        return len(list(Path("/proc/self/task").iterdir())) if Path("/proc/self/task").exists() else 0

    def once():
        played(lambda view, window: turns(3), source=source)

    source = running()
    for _ in range(2):  # what is opened once and kept
        once()
    before = threading.active_count(), native(), files()
    for _ in range(4):
        once()
    for _ in until(
        lambda: threading.active_count() <= before[0] and native() <= before[1] and files() <= before[2]
    ):
        time.sleep(0.01)  # a thread takes a while to end
