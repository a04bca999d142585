"""What is done by hand to a view, its recordings and films, and the camera of what is played."""

import time

import numpy as np
import pytest
from test_view import CUBE, Listener, held, played, running

from msdwarp import Contact, Scene, Simulation, Trajectory
from msdwarp.files import TrajectoryWriter
from msdwarp.live import Played, View
from msdwarp.pictures import Stage

pytestmark = pytest.mark.usefixtures("clock")


@pytest.mark.slow
def test_friction_and_restitution_are_set_and_done_again_to_the_last_bit():
    changes = {"contact": Contact(friction=0.1), "gravity": (3.0, 0.0, -9.0)}
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
    due = list(handling.deeds)
    for _ in range(40):
        again.handling.do_due(due)
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
        source.handling.do("contact", side="bodies", name="color", value=1.0)
    source = running()
    with pytest.raises(ValueError, match="restitution"):
        source.handling.do("contact", side="obstacles", name="restitution", value=1.5)
    assert source.handling.contact("obstacles", "restitution") == 0.5
    with pytest.raises(ValueError, match="colliders takes the place"):
        source.handling.simulation.change(colliders=[], set_rest_shape=True)


@pytest.mark.parametrize(
    "ends", [lambda v: v.press("r"), lambda v: v.press("1"), lambda v: v.post("parameters", size=2)]
)
def test_a_recording_ends_where_another_run_begins(tmp_path, ends):
    folder = tmp_path / "kept"
    turns = (lambda v: v.post("record", folder=folder), *[0.03] * 8, ends, 0, 0)
    view, _ = played(*turns, scenes={"one": running}, rebuild=lambda size: running())
    assert view.recording is None
    assert "wrote" in view.notice
    with Trajectory(folder / "trajectory.vtkhdf") as trajectory:
        assert len(trajectory) > 1
        assert (np.diff(trajectory.times) > 0).all()


def test_a_scene_that_is_refused_ends_no_recording(tmp_path):
    seen = []
    turns = [lambda v: v.post("record", folder=tmp_path / "kept"), 0, lambda v: v.post("scene", number=7), 0]
    played(*turns, lambda v: seen.append(v.recording), 0, scenes={"one": running})
    assert seen[0] is not None


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
        *[0.03] * 2,
        lambda v: v.post("film"),
        *[waits] * 400,
    )
    view = View(running(), [screen], renderer="raycast")
    view.run(until=lambda: any("drew a film" in one for one in told))
    assert "no frames were kept" in told[0] or any("no frames were kept" in one for one in told)
    assert [one.suffix for one in folder.iterdir() if one.suffix == ".webp"] == [".webp"], told[-1]


def test_a_hand_beyond_all_numbers_is_refused_and_the_next_one_holds():
    source, again = running(), running()
    hold = {"particles": [3], "to": [[0.3, 0.1, 0.9]], "stiffness": [9.0], "damping": [0.1]}
    source.handling.do("hold", **hold)
    for name, beyond in {"stiffness": [1e39], "damping": [1e39], "to": [[1e39, 0.0, 0.0]]}.items():
        with pytest.raises(ValueError, match=f"{name}.*at most"):
            source.handling.do("hold", **hold | {name: beyond})
        assert held(source) == [3]
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
