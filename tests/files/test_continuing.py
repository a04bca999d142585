"""Writing goes on behind frames that are there, whatever the writer before left."""

import shutil

import numpy as np
import pytest
from trajectories import SYSTEMS, assert_same, beginnings, frames, largest_file, recorded_writes, vtk_frames, write

from msdwarp import Trajectory, TrajectoryWriter
from msdwarp.files import growing_file, vtkhdf


def go_on(path, system, expected, behind, **options):
    with TrajectoryWriter(path, system, **{"fps": 60, **options}, behind=behind) as writer:
        for frame in expected[behind:]:
            writer.write(frame)


def assert_holds(path, expected):
    with Trajectory(path) as found:
        assert len(found) == len(expected)
        np.testing.assert_array_equal(found.times, [frame.time for frame in expected])
        np.testing.assert_array_equal(found.positions[:], [frame.position for frame in expected])
        np.testing.assert_array_equal(found.velocities[:], [frame.velocity for frame in expected])


@pytest.mark.slow
@pytest.mark.parametrize("name", ["plane", "dust", "box", "embedded"])
@pytest.mark.parametrize(("dtype", "compress"), [("float32", False), ("float64", True), ("float32", True)])
@pytest.mark.parametrize(("before", "behind", "count"), [(7, 7, 30), (7, 3, 30), (25, 10, 12)])
@pytest.mark.each_value
def test_what_is_written_in_two_goes_is_what_is_written_in_one(
    tmp_path, monkeypatch, name, dtype, compress, before, behind, count, vtk_output
):
    monkeypatch.setattr(vtkhdf, "FORESEEN", 10)
    system = SYSTEMS[name]
    # What is dropped was other than what comes in its place.
    wrong = [frame._replace(position=1e6 * frame.position) for frame in frames(system, before, dtype)]
    expected = list(frames(system, count, dtype))
    path = tmp_path / "a.vtkhdf"
    with TrajectoryWriter(path, system, fps=60, compress=compress) as writer:
        for frame in [*expected[:behind], *wrong[behind:]]:
            writer.write(frame)
    go_on(path, system, expected, behind)
    assert_holds(path, expected)
    whole = write(tmp_path / "b.vtkhdf", system, count, dtype, compress=compress)
    with Trajectory(path) as found, Trajectory(whole) as wanted:
        if system.connection_count:
            np.testing.assert_array_equal(found.strains[:], wanted.strains[:])
    for (when, mesh), (time, other) in zip(vtk_frames(path), vtk_frames(whole), strict=True):
        assert when == time
        np.testing.assert_array_equal(mesh.points, other.points)
        np.testing.assert_array_equal(mesh.point_data["velocity"], other.point_data["velocity"])
    assert vtk_output.GetOutput() == ""


def test_every_nth_frame_goes_on_in_step(tmp_path):
    system = SYSTEMS["box"]
    expected = list(frames(system, 20))
    for behind in (1, 2, 3):
        path = tmp_path / f"{behind}.vtkhdf"
        with TrajectoryWriter(path, system, fps=60, every=3) as writer:
            for frame in expected[:9]:
                writer.write(frame)
        go_on(path, system, expected, behind, every=3)
        assert_holds(path, expected[::3])


@pytest.mark.slow
@pytest.mark.parametrize(("compress", "step"), [(False, 41), (True, 53)])
def test_it_goes_on_after_each_single_write_to_disk(tmp_path, monkeypatch, compress, step, vtk_output):
    # A writer that was killed has written what it has written; and one that went on may be killed in turn.
    monkeypatch.setattr(vtkhdf, "FORESEEN", 5)
    system, path, again = SYSTEMS["box"], tmp_path / "a.vtkhdf", tmp_path / "again.vtkhdf"
    expected = list(frames(system, 12))
    with recorded_writes(monkeypatch) as log:
        writer = TrajectoryWriter(path, system, fps=60, compress=compress)
        writer.write(expected[0])
        writer.flush()
        log.clear()
        first = path.read_bytes()
        for frame in expected[1:8]:
            writer.write(frame)
        writer.close()
    for k, content in enumerate(beginnings(first, log)):
        if k % step:
            continue
        path.write_bytes(content)
        with Trajectory(path) as found:
            behind = max(1, len(found) - k % 3)
        go_on(path, system, expected, behind)
        assert_holds(path, expected)
        assert [when for when, _ in vtk_frames(path)] == [frame.time for frame in expected]
        if k == step:  # in the middle: at the end nothing would be left to write
            path.write_bytes(content)
            check_that_it_can_be_killed_too(monkeypatch, path, again, system, expected, behind)
    assert vtk_output.GetOutput() == ""


def check_that_it_can_be_killed_too(monkeypatch, path, again, system, expected, behind):
    with recorded_writes(monkeypatch) as log:
        writer = TrajectoryWriter(path, system, fps=60, behind=behind)
        # By a mark in the log the state from which it went on can be told: all that is in the file.
        first, start = path.read_bytes(), len(log)
        for frame in expected[behind : behind + 3]:
            writer.write(frame)
        writer.close()
    expected = expected[: behind + 4]
    for k, content in enumerate(beginnings(first, log[start:])):
        if k % 3:  # a frame takes as many writes as the one before, 14 or 20: in three frames each comes by
            continue
        again.write_bytes(content)
        with Trajectory(again) as found:
            assert len(found) >= behind
            assert_same(found[-1], expected[len(found) - 1])
        go_on(again, system, expected, behind)
        assert_holds(again, expected)


def test_room_that_a_killed_writer_had_reserved_is_used_or_given_back(tmp_path):
    system = SYSTEMS["box"]
    expected, whole = list(frames(system, 20)), write(tmp_path / "b.vtkhdf", SYSTEMS["box"], 20)
    writer = TrajectoryWriter(tmp_path / "a.vtkhdf", system, fps=60)
    for frame in expected[:10]:
        writer.write(frame)
    writer.flush()
    killed = tmp_path / "killed.vtkhdf"
    shutil.copy(writer.path, killed)  # as it is, with its reserve
    writer.close()
    for k in range(10, 13):
        go_on(killed, system, expected[: k + 1], k)
    go_on(killed, system, expected, 13)
    assert_holds(killed, expected)
    # One reserve stays where a kill left it; what follows is laid behind.
    assert killed.stat().st_size < 1.2 * whole.stat().st_size + growing_file._SLACK


def test_what_cannot_go_on_is_refused_and_left_as_it_is(tmp_path):
    system, path = SYSTEMS["box"], write(tmp_path / "a.vtkhdf", SYSTEMS["box"], 5)
    before = path.read_bytes()
    for wrong, said in [
        ({"behind": 6}, "has 5 frames; to go on"),
        ({"behind": -1}, "behind is -1"),
        ({"behind": 2, "fps": 30}, "fps is 30; .* has 60 frames per second"),
        ({"behind": 2, "system": SYSTEMS["chain"]}, "of another system"),
    ]:
        options = {"system": system, "fps": 60} | wrong
        with pytest.raises(ValueError, match=said):
            TrajectoryWriter(path, options.pop("system"), **options)
    with pytest.raises(FileNotFoundError):
        TrajectoryWriter(tmp_path / "none.vtkhdf", system, fps=60, behind=2)
    assert path.read_bytes() == before


@pytest.mark.parametrize("compress", [False, True])
@pytest.mark.parametrize("shift", [0.0, 1.0], ids=["the same frames again", "others"])
@pytest.mark.parametrize("room", [0, pytest.param(600_000, marks=pytest.mark.slow)])
def test_on_a_full_disk_there_are_never_fewer_frames_than_before(tmp_path, compress, shift, room):
    system = SYSTEMS["box"]
    path = write(tmp_path / "a.vtkhdf", system, 12, compress=compress)
    shifted = [frame._replace(position=frame.position + shift) for frame in frames(system, 20_000)]
    with largest_file(path.stat().st_size + room), pytest.raises(OSError, match="File too large") as told:
        go_on(path, system, shifted, 4)
    with Trajectory(path) as found:
        assert f"its first {len(found)} frames are kept" in str(told.value)
        assert len(found) > 12 if room else len(found) == 12
        moved = np.array(
            [(found.positions[k] != frame.position).any() for k, frame in enumerate(frames(system, 12))]
        )
        # Others come in their place where there is room for them all, and else none.
        assert moved.tolist() == [shift > 0 and room > 0 and k >= 4 for k in range(12)]


def test_frames_stay_until_others_come_in_their_place(tmp_path):
    system = SYSTEMS["box"]
    path, expected = write(tmp_path / "a.vtkhdf", system, 12), list(frames(system, 12))
    go_on(path, system, [], 4)
    go_on(path, system, expected[:7], 4)
    assert_holds(path, expected)
    with TrajectoryWriter(path, system, fps=60, behind=4) as writer:
        writer.write(expected[4])
        writer.flush()
        assert (writer.frame_count, writer.has_fewer) == (12, False)
        other = expected[5]._replace(position=expected[5].position + 1)
        writer.write(other)
        writer.flush()
        assert (writer.frame_count, writer.has_fewer) == (6, True)
        for frame in expected[6:]:
            writer.write(frame)
        writer.flush()
        assert (writer.frame_count, writer.has_fewer) == (12, False)
    assert_holds(path, [*expected[:5], other, *expected[6:]])
