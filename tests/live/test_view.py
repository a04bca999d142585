"""A view's loop and what can be asked of it, with a screen that only listens."""

import time

import numpy as np
import pytest

from msdwarp import Force, Plane, Scene, Simulation, Touch, Trajectory, box
from msdwarp.files import TrajectoryWriter
from msdwarp.live import KEYS, Handling, Played, Repeat, Running, View, within_reach
from msdwarp.pictures import Stage

CUBE = box((3, 3, 3), 0.1, mass=0.01, stiffness=200.0, damping=0.1).translate((0, 0, 0.3))


def scene(**changes):
    return within_reach(Scene(**{"system": CUBE, "colliders": [Plane()], "duration": 1.0} | changes))


def running(**changes):
    at = scene(**changes)
    return Running(at, Simulation.of(at, device="cpu"), "cube")


class Listener:
    """A screen that notes what it is told, and does something before each turn of the loop."""

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
            time.sleep(turn)
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


def test_frames_are_simulated_and_shown_as_time_passes():
    view, screen = played(*[0.03] * 20)
    assert view.source.time > 0.1
    assert screen.shown == sorted(screen.shown)
    assert screen.shown[-1] == view.source.time
    np.testing.assert_allclose(
        view.shown.drawing.points.numpy()[:, 2].min(), view.shown.frame.position[:, 2].min()
    )


def test_pause_and_single_frames():
    view, screen = played(0, lambda v: v.press("right"), 0.05, 0, lambda v: v.press("right"), 0.05, 0, paused=True)
    assert view.paused
    assert view.source.time == pytest.approx(2 / 60)
    assert screen.shown[-1] == view.source.time


def test_every_key_has_a_command_that_says_something():
    for name, several in KEYS.items():
        for key in several:
            turns = [0, lambda v, n=name, k=key: v.press(n, shift=k.shift), 0, 0]
            view, _ = played(*turns, paused=True)
            assert view.helps if name == "h" else view.notice, name


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
        lambda v: lifted.append(len(v.source.handling.holds)),
        lambda v: v.post("let_go", holder="me"),
        0,
        0,
    )
    assert lifted[0] > 1.2
    assert lifted[1] > 0
    assert len(view.source.handling.holds) == 0


def test_a_ray_picks_the_surface_and_a_drag_stays_in_its_plane():
    view = View(running(), [])
    view.post("pick", holder=1, origin=(0.1, -5.0, 0.4), direction=(0.0, 1.0, 0.0))
    view.post("drag", holder=1, ray=((0.1, -5.0, 0.4), (0.1, 1.0, 0.0), (0.0, 1.0, 0.0)))
    view._obey()
    # The cube's side is at y = −0.1, 4.9 m on; 1 in 10 aside on the way there. Points are float32.
    np.testing.assert_allclose(view.hand.target, (0.59, -0.1, 0.4), atol=1e-6)
    view.post("let_go")
    view.post("pick", holder=1, origin=(0.1, -5.0, 9.4), direction=(0.0, 1.0, 0.0))  # beside it
    view._obey()
    assert view.hand.grip is None


def test_what_is_pinned_stays():
    view = View(running(), [])
    view.post("grab", holder=1, point=top(view).tolist())
    view.post("pin")
    view._obey()
    pinned = np.isinf(view.source.handling.simulation.system.mass)
    assert pinned.any()
    before = view.source.frame().position[pinned]
    for _ in range(20):
        view.source.advance()
    np.testing.assert_array_equal(view.source.frame().position[pinned], before)


@pytest.mark.parametrize(
    "changes", [{}, {"loads": [Force((0, 0, 0.01))], "touch": Touch()}], ids=["cube", "loads"]
)
def test_what_was_done_by_hand_is_done_again_to_the_last_bit(changes):
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
    repeat = Repeat(again.handling, handling.deeds)
    for _ in range(30):
        repeat.before_frame()
        again.advance()
    np.testing.assert_array_equal(again.frame().position, first.frame().position)
    assert again.handling.deeds == handling.deeds


def test_a_divergence_stops_the_view_and_reset_goes_on():
    at = scene()
    source = Running(at, Simulation.of(at, device="cpu", substeps=1, allow_unstable=True), "wild")

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


def test_nobody_watching_costs_no_drawing():
    screen = Listener(*[0.02] * 10, watched=False)
    view = View(running(), [screen])
    view.run()
    assert view.source.time > 0
    assert not screen.shown


def test_a_thread_of_its_own_ends_when_it_is_closed():
    screen = Listener(*[0.01] * 10_000)
    view = View(running(), [screen])
    view.start()
    time.sleep(0.2)
    view.close()
    view.close()
    assert screen.closed == 1
    assert view.source.time > 0


def test_colours_and_wires_are_drawn_anew():
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


def test_a_hand_is_refused_what_is_no_deed():
    handling = running().handling
    with pytest.raises(ValueError, match="deed"):
        handling.do("explode")
    with pytest.raises(ValueError, match="nothing that is done"):
        Repeat(handling, [{"frame": 0, "deed": "scale", "wrong": 1}]).before_frame()
    assert isinstance(handling, Handling)


def test_friction_and_restitution_are_set_and_done_again_to_the_last_bit():
    changes = {"touch": Touch(friction=0.1), "gravity": (3.0, 0.0, -9.0)}
    first = running(**changes)
    handling = first.handling
    assert handling.contact("obstacles", "friction") == 0.5
    assert handling.contact("bodies", "friction") == 0.1
    for k in range(40):
        if k == 5:
            handling.do("contact", side="obstacles", name="friction", value=0.0)
        if k == 8:
            handling.do("contact", side="bodies", name="restitution", value=0.9)
        first.advance()
    assert handling.contact("obstacles", "friction") == 0.0
    assert handling.contact("bodies", "restitution") == 0.9
    again = running(**changes)
    repeat = Repeat(again.handling, handling.deeds)
    for _ in range(40):
        repeat.before_frame()
        again.advance()
    np.testing.assert_array_equal(again.frame().position, first.frame().position)
    first.reset()
    assert handling.contact("obstacles", "friction") == 0.5
    assert handling.contact("bodies", "restitution") == 0.3


def test_without_friction_a_body_slides_on():
    def slid(friction):
        lying = CUBE.translate((0, 0, -CUBE.position[:, 2].min()))
        source = running(system=lying, gravity=(4.0, 0.0, -10.0))
        source.handling.do("contact", side="obstacles", name="friction", value=friction)
        for _ in range(30):
            source.advance()
        return float((source.frame().position - lying.position)[:, 0].mean())

    # Half a second: ½ a t² = 0.5 m. While a body settles in its own weight it hops; dampers take some per cent.
    # With μ = 2 it may lean, by a part of its spacing of 0.1 m, but does not slide.
    assert slid(0.0) == pytest.approx(0.5, rel=0.05)
    assert abs(slid(2.0)) < 0.05


def test_what_does_not_touch_has_no_friction():
    source = running(colliders=[])
    assert source.handling.contact("obstacles", "friction") is None
    with pytest.raises(ValueError, match="side is 'obstacles'"):
        source.handling.do("contact", side="obstacles", name="friction", value=1.0)
    with pytest.raises(ValueError, match="name"):
        source.handling.do("contact", side="bodies", name="colour", value=1.0)
    source = running()
    with pytest.raises(ValueError, match="restitution"):
        source.handling.do("contact", side="obstacles", name="restitution", value=1.5)
    assert source.handling.contact("obstacles", "restitution") == 0.5
    with pytest.raises(ValueError, match="colliders takes the place"):
        source.handling.simulation.change(colliders=[], freeze=True)


@pytest.mark.parametrize(
    "ends",
    [
        lambda v: v.press("r"),
        lambda v: v.press("1"),
        lambda v: v.post("parameters", size=2),
    ],
    ids=["reset", "scene", "parameters"],
)
def test_a_recording_ends_where_another_run_begins(tmp_path, ends):
    folder = tmp_path / "kept"
    view, _ = played(
        lambda v: v.post("record", folder=folder),
        *[0.03] * 8,
        ends,
        0,
        0,
        scenes={"one": running},
        rebuild=lambda size: running(),
    )
    assert view.recording is None
    assert "wrote" in view.notice
    with Trajectory(folder / "trajectory.vtkhdf") as trajectory:
        assert len(trajectory) > 1
        assert (np.diff(trajectory.times) > 0).all()


def test_a_scene_that_is_refused_ends_no_recording(tmp_path):
    view, _ = played(
        lambda v: v.post("record", folder=tmp_path / "kept"),
        0,
        lambda v: v.post("scene", number=7),
        0,
        lambda v: setattr(v, "seen", v.recording),
        0,
        scenes={"one": running},
    )
    assert view.seen is not None


@pytest.mark.slow
def test_a_film_is_drawn_of_what_was_kept(tmp_path):
    told = []

    def waits(view):
        told.append(view.notice)
        time.sleep(0.3)

    folder = tmp_path / "kept"
    screen = Listener(
        lambda v: v.post("film"),
        waits,
        lambda v: v.post("record", folder=folder),
        *[0.03] * 6,
        lambda v: v.post("film"),
        *[waits] * 400,
    )
    view = View(running(), [screen], renderer="raycast")
    view.run(until=lambda: any("drew a film" in one for one in told))
    assert "no frames were kept" in told[0] or any("no frames were kept" in one for one in told)
    assert [one.suffix for one in folder.iterdir() if one.suffix == ".webp"] == [".webp"], told[-1]


@pytest.mark.parametrize("name", ["stiffness", "damping", "to"])
def test_a_hand_beyond_the_precision_is_refused_and_the_next_one_holds(name):
    source, again = running(), running()
    hold = {"particles": [3], "to": [[0.3, 0.1, 0.9]], "stiffness": [9.0], "damping": [0.1]}
    source.handling.do("hold", **hold)
    beyond = [[1e39, 0.0, 0.0]] if name == "to" else [1e39]  # above 3.4e38, the largest float32
    with pytest.raises(ValueError, match=f"{name}.*float32"):
        source.handling.do("hold", **hold | {name: beyond})
    assert source.handling.holds.tolist() == [3]
    again.handling.do("hold", **hold)
    for one in (source, again):
        for k in range(20):
            if k == 10:
                one.handling.do("hold", **hold | {"to": [[0.0, 0.0, 1.2]]})
            one.advance()
    np.testing.assert_array_equal(source.frame().position, again.frame().position)


def test_the_camera_of_a_trajectory_sees_all_frames(tmp_path):
    path = tmp_path / "flies.vtkhdf"
    simulation = Simulation(CUBE.replace(velocity=np.full(3, 5.0)), gravity=0.0, device="cpu")
    with TrajectoryWriter(path, simulation.system, fps=simulation.fps) as writer:
        for _ in range(30):
            simulation.step()
            writer.write(simulation.frame())
    with Trajectory(path) as trajectory:
        source = Played(trajectory, Scene(system=trajectory.system))
        seen, positions = source.seen(), np.asarray(trajectory.positions)
        camera = Stage(source.scene, seen, (1280, 720)).camera
        rows, columns = camera.pixels(positions.reshape(-1, 3).astype(float), 720, 1280)
        assert (rows >= 0).all()
        assert (rows <= 720).all()
        assert (columns >= 0).all()
        assert (columns <= 1280).all()
        assert len(seen) < positions[..., 0].size  # nothing that does not matter
        first = Stage(source.scene, positions[:1], (1280, 720)).camera
        rows, columns = first.pixels(positions[-1].astype(float), 720, 1280)
        assert not ((rows >= 0) & (rows <= 720) & (columns >= 0) & (columns <= 1280)).all()
    assert running().seen() is None
