"""A view's loop and what can be asked of it, with a screen that only listens."""

import sys
import time
from dataclasses import replace

import numpy as np
import pytest
from cyclopts import App

from msdwarp import Contact, Force, Look, Plane, Scene, Simulation, Trajectory, box
from msdwarp.cli.file_commands import PICTURES, Pictures
from msdwarp.live import KEYS, Handling, Played, Running, View, within_reach
from msdwarp.live.commands import camera_flags
from msdwarp.live.shown import EASE, Following
from msdwarp.pictures import Stage
from msdwarp.world import MouseSpring

pytestmark = pytest.mark.usefixtures("clock")
CUBE = box((3, 3, 3), 0.1, mass=0.01, stiffness=200.0, damping=0.1).translate((0, 0, 0.3))


def held(source):
    """Return the particles that the mouse holds."""
    (hand,) = (one for one in source.handling.simulation.loads if isinstance(one, MouseSpring))
    return list(hand.on)


def scene(**changes):
    return within_reach(Scene(**{"system": CUBE, "colliders": [Plane()], "duration": 1.0} | changes))


def running(**changes):
    at = scene(**changes)
    return Running(at, Simulation.from_scene(at, device="cpu"), "cube")


class Listener:
    """A screen that notes what it is told, and does or waits for something before each turn of the loop."""

    takes_images = False

    def __init__(self, *turns, watched=True):
        self.turns, self.watched = list(turns), watched
        self.shown, self.stages, self.told, self.closed, self.opened = [], 0, [], 0, 0

    def open(self, view):
        self.view, self.opened = view, self.opened + 1

    def stage(self):
        self.stages += 1

    def show(self):
        self.shown.append(self.view.shown.frame.time)

    def tell(self):
        self.told.append((self.view.notice, *self.view.lines))

    def poll(self):
        if not self.turns:
            return False
        turn = self.turns.pop(0)
        if callable(turn):
            turn(self.view)
        elif turn:
            sys.modules["msdwarp.live.view"].time.sleep(turn)  # by the view's clock
        return True

    def close(self):
        self.closed += 1


def played(*turns, source=None, **options):
    """Run a view for these turns; return it and its listener."""
    screen = Listener(*turns)
    view = View(source or running(), [screen], **options)
    view.run()
    assert (screen.opened, screen.closed) == (1, 1)
    return view, screen


def test_frames_are_simulated_and_shown_as_time_passes(clock):
    view, screen = played(*[0.03] * 20)
    # It begins as somebody looks, after the first wait, takes whole frames, and rests 1/240 s behind the last.
    assert 0 <= clock.now - 0.03 - 1 / 240 - view.source.time < 1 / 60
    assert screen.shown == sorted(screen.shown)
    assert screen.shown[-1] == view.source.time
    np.testing.assert_allclose(
        view.shown.drawing.points.numpy()[:, 2].min(), view.shown.frame.position[:, 2].min()
    )


def test_the_first_pictures_already_tell_how_fast_it_runs():
    for seconds, told in ((0.25, "4 pictures a second"), (1.0, "1 picture a second")):
        view, _ = played(*[seconds] * 4)
        assert view.lines[0].endswith(f" of real time, {told}")


def test_pause_and_single_frames():
    view, screen = played(0, lambda v: v.press("right"), 0.05, 0, lambda v: v.press("right"), 0.05, 0, paused=True)
    assert view.paused
    assert view.source.time == pytest.approx(2 / 60)
    assert screen.shown[-1] == view.source.time


@pytest.mark.slow
def test_every_key_has_a_command_that_says_something():
    for key in KEYS:
        view, _ = played(0, lambda v, k=key: v.press(k.name, shift=k.shift), 0, 0, paused=True)
        assert view.helps if key.name == "h" else view.notice, key


def test_a_key_scales_a_parameter_and_shift_undoes_it():
    view, _ = played(lambda v: v.press("s"), lambda v: v.press("s"), 0, 0, paused=True)
    assert view.source.handling.factors["stiffness"] == 1.25**2
    np.testing.assert_allclose(view.source.handling.simulation.system.stiffness, 200 * 1.25**2)
    view, _ = played(lambda v: v.press("s"), 0, lambda v: v.press("s", shift=True), 0, 0, paused=True)
    np.testing.assert_allclose(view.source.handling.simulation.system.stiffness, 200, rtol=1e-15)


def test_what_is_refused_is_said_and_changes_nothing():
    view, _ = played(lambda v: v.post("scale", name="stiffness", factor=-1.0), 0, 0, paused=True)
    assert "factor" in view.notice
    assert view.source.handling.factors["stiffness"] == 1.0
    assert not view.source.handling.deeds
    view, _ = played(lambda v: v.post("nonsense"), lambda v: v.post("pause", no="such"), 0, 0, paused=True)
    assert view.notice


def top(view):
    """Return the highest point of the body [m]."""
    position = view.source.frame().position
    return position[position[:, 2].argmax()].astype(float)


@pytest.mark.slow
def test_a_drag_moves_the_body_and_lets_go():
    lifted = []

    def lift(view):
        view.post("grab", holder="me", point=top(view).tolist())
        view.post("drag", holder="me", point=(0.1, 0.1, 1.5))

    view, _ = played(
        lift,
        *[0.03] * 60,
        lambda v: lifted.append(top(v)[2]),
        lambda v: v.post("let_go", holder="someone else"),
        0,
        lambda v: lifted.append(len(held(v.source))),
        lambda v: v.post("let_go", holder="me"),
        0,
        0,
    )
    assert lifted[0] > 1.2
    assert lifted[1] > 0
    assert held(view.source) == []


def test_a_ray_picks_the_surface_and_a_drag_stays_in_its_plane():
    view = View(running(), [])
    view.post("pick", holder=1, origin=(0.1, -5.0, 0.4), direction=(0.0, 1.0, 0.0))
    view.post("drag", holder=1, ray=((0.1, -5.0, 0.4), (0.1, 1.0, 0.0), (0.0, 1.0, 0.0)))
    view._execute_commands()
    # The cube's side is at y = −0.1, 4.9 m on; 1 in 10 aside on the way there. Points are float32.
    np.testing.assert_allclose(view.hand.target, (0.59, -0.1, 0.4), atol=1e-6)
    view.post("let_go")
    view.post("pick", holder=1, origin=(0.1, -5.0, 9.4), direction=(0.0, 1.0, 0.0))  # beside it
    view._execute_commands()
    assert view.hand.grip is None


def test_what_is_pinned_stays():
    view = View(running(), [])
    view.post("grab", holder=1, point=top(view).tolist())
    view.post("pin")
    view._execute_commands()
    pinned = np.isinf(view.source.handling.simulation.system.mass)
    assert pinned.any()
    before = view.source.frame().position[pinned]
    for _ in range(20):
        view.source.advance()
    np.testing.assert_array_equal(view.source.frame().position[pinned], before)


@pytest.mark.slow
def test_what_was_done_by_hand_is_done_again_to_the_last_bit():
    changes = {"loads": [Force((0, 0, 0.01))], "contact": Contact()}
    first = running(**changes)
    handling = first.handling
    for k in range(30):
        if k == 5:
            handling.do("scale", name="stiffness", factor=1.5)
        if 8 <= k < 20:
            handling.do(
                "hold", particles=[3, 26], to=[[0.3, 0.1 * k, 0.5]] * 2, stiffness=[9.0, 4.0], damping=[0.1, 0.1]
            )
        if k == 20:
            handling.do("hold", particles=[], to=[], stiffness=[], damping=[])
        if k == 22:
            handling.do("gravity", value=[0.0, 1.0, -5.0])
        if k == 25:
            handling.do("freeze")
        first.advance()
    again = running(**changes)
    due = list(handling.deeds)
    for _ in range(30):
        again.handling.do_due(due)
        again.advance()
    np.testing.assert_array_equal(again.frame().position, first.frame().position)
    assert again.handling.deeds == handling.deeds


@pytest.mark.slow
def test_a_divergence_stops_the_view_and_reset_goes_on():
    at = scene()
    source = Running(at, Simulation.from_scene(at, device="cpu", substeps=1, allow_unstable=True), "wild")

    def stiffer(view):
        view.post("scale", name="stiffness", factor=1000.0)

    told = []
    view, _ = played(
        stiffer,
        *[0.02] * 40,
        lambda v: told.append((v.paused, v.notice)),
        lambda v: v.press("r"),
        0,
        0,
        source=source,
    )
    assert told[0][0]
    assert "diverged" in told[0][1] or "particle" in told[0][1]
    assert view.source.time == 0.0
    assert view.source.handling.factors["stiffness"] == 1.0


@pytest.mark.slow
def test_a_recording_can_be_played(tmp_path):
    folder = tmp_path / "kept"
    view, _ = played(
        lambda v: v.post("record", folder=folder),
        *[0.03] * 15,
        lambda v: v.press("s"),
        *[0.03] * 5,
        lambda v: v.post("record"),
        0,
    )
    with Trajectory(folder / "trajectory.vtkhdf") as trajectory:
        assert len(trajectory) > 3
        source = Played(trajectory, Scene(system=trajectory.system), "kept")
        view, screen = played(
            *[0.03] * 10, lambda v: v.post("seek", k=1), 0, 0, lambda v: v.press("m"), 0, source=source
        )
        assert "recording" in view.notice
        assert trajectory.times[1] in screen.shown


def test_it_waits_for_the_first_viewer_and_draws_for_nobody():
    times = []

    def look(view):
        times.append(view.source.time)
        screen.watched = not screen.watched

    screen = Listener(*[0.02] * 10, watched=False)
    view = View(running(), [screen])
    view.run()
    assert view.source.time == 0.0
    screen.turns = [0.02] * 5 + [look] + [0.02] * 5 + [look] + [0.02] * 5
    view.run()
    assert times[0] == 0.0 < times[1] < view.source.time  # it goes on when the viewer leaves
    assert max(screen.shown) <= times[1]


def test_the_camera_follows_the_body_once_it_leaves_what_was_in_view():
    def at(time, way):
        return frame._replace(time=time, position=frame.position + np.array(way, frame.position.dtype))

    source = running()
    frame, room = source.frame(), 0.2 * 0.5  # the cube is 0.2 wide, and what is in view 1.5 times as much
    following = Following(source)
    following.follow(at(0.1, (room, 0, -0.2)), held=False)
    np.testing.assert_allclose(following.shift, 0, atol=1e-6)
    following.follow(at(9.0, (3, 0, 0)), held=True)
    np.testing.assert_allclose(following.shift, 0, atol=1e-6)
    following.follow(at(9.0 + EASE, (3, 0, 0)), held=False)  # float32 positions
    np.testing.assert_allclose(following.shift, ((3 - room) * (1 - np.exp(-1)), 0, 0), rtol=1e-5, atol=1e-6)
    following.follow(at(0.0, (0, 0, 0)), held=False)  # restarted: at once
    np.testing.assert_allclose(following.shift, 0, atol=1e-6)
    still = Following(running(look=Look(target=(0, 0, 0))))
    still.follow(at(9.0, (3, 0, 0)), held=False)
    assert not still.shift.any()


@pytest.mark.parametrize("eye", [(3.0, -4.0, 2.0), (-1e-3, 2e-3, 5e-4), (-200.0, 0.0, 1.0)])
def test_printed_flags_place_the_camera_of_render_there(eye):
    target = np.array(eye)[::-1] / 3
    command, at = App(), scene()

    @command.default
    def parsed(*, pictures: Pictures = PICTURES):
        return pictures

    options = command(camera_flags(np.array(eye), target, 72.5), result_action="return_value")
    camera = Stage(replace(at, look=options.aimed(at.look)), CUBE.position, (1280, 720)).camera
    # Of the distance a thousandth is kept or less, of angles five digits: up to 0.005 degrees.
    near = 1e-3 * np.linalg.norm(eye - target)
    np.testing.assert_allclose([*camera.target, camera.field_of_view], [*target, 72.5], atol=near)
    np.testing.assert_allclose(camera.eye, eye, atol=2 * near)


def test_a_thread_of_its_own_ends_when_it_is_closed():
    screen = Listener(*[0.01] * 100_000)
    view = View(running(), [screen])
    view.start()
    end = time.monotonic() + 180.0
    while view.source.time == 0 and time.monotonic() < end:
        time.sleep(0.01)
    assert view.source.time > 0
    view.close()
    view.close()
    assert screen.closed == 1
    assert screen.turns  # it has not ended by itself


def test_colors_and_wires_are_drawn_anew():
    stages = []
    view, screen = played(
        lambda v: v.press("c"),
        0.05,
        lambda v: stages.append(v.shown.drawing.by_value),
        lambda v: v.press("c"),
        lambda v: v.press("w"),
        0.05,
        0,
    )
    assert stages == [True]
    assert view.shown.wires
    assert screen.stages >= 4


def test_scenes_lie_on_number_keys():
    view, _ = played(lambda v: v.press("2"), 0, 0, scenes={"one": running, "two": lambda: running(gravity=1.0)})
    assert view.source.scene.gravity == 1.0
    assert "two" in view.keys()  # noqa: SIM118
    view, _ = played(lambda v: v.press("3"), 0, 0, scenes={"one": running})
    assert "no scene 3" in view.notice


def test_a_scene_is_rebuilt_by_the_function_that_built_it():
    built = []

    def other():
        source = running(gravity=1.0)
        source.rebuild = lambda **parameters: built.append(("other", parameters)) or running(gravity=2.0)
        return source

    def first(**parameters):
        built.append(("first", parameters))
        return running()

    options = {"scenes": {"one": running, "two": other}, "rebuild": first}
    view, _ = played(
        lambda v: v.post("parameters", size=3),
        lambda v: v.press("2"),
        lambda v: v.post("parameters", width=4),
        lambda v: v.post("parameters", width=5),
        0,
        **options,
    )
    assert built == [("first", {"size": 3}), ("other", {"width": 4}), ("other", {"width": 5})]
    assert view.source.scene.gravity == 2.0
    view, _ = played(lambda v: v.press("1"), lambda v: v.post("parameters", size=3), 0, **options)
    assert "not built by a function" in view.notice
    assert view.rebuild is None


def test_a_hand_is_refused_what_is_no_deed():
    handling = running().handling
    with pytest.raises(ValueError, match="deed"):
        handling.do("explode")
    with pytest.raises(ValueError, match="nothing that is done"):
        handling.do_due([{"frame": 0, "deed": "scale", "wrong": 1}])
    assert isinstance(handling, Handling)
