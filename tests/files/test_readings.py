"""What a trajectory's file holds of what probes told."""

import h5py
import numpy as np
import pytest
from trajectories import SYSTEMS, beginnings, frames, recorded_writes, vtk_frames, write

from msdwarp import Trajectory, TrajectoryWriter
from msdwarp.files import vtkhdf

COLUMNS = {
    "foot": ("frame", ["force_x_N", "force_y_N"]),
    "hand": ("substep", ["x_m"]),
    "head": ("frame", ["strain_mean"]),
}
SYSTEM = SYSTEMS["box"]


def told(k):
    """Return what probes told of frame k: a row by frame, and one for each of 2 or 3 substeps."""
    if k == 0:
        return {}
    count = 2 + k % 2
    steps = k / 60 - np.arange(count - 1, -1, -1) / (60 * count)
    return {
        "frame": np.array([[k / 60, k, -k, 0.5 * k]]),
        "substep": np.column_stack([steps, 100 * k + np.arange(count)]),
    }


def record(path, first, last, **options):
    """Write frames with what probes told, those behind the first ones."""
    with TrajectoryWriter(
        path, SYSTEM, fps=60, readings=COLUMNS, **options, **({"behind": first} if first else {})
    ) as writer:
        for k, frame in enumerate(frames(SYSTEM, last)):
            if k >= first:
                writer.write(frame, readings=told(k))
    return path


def assert_tells(path, last):
    """Assert that a file has readings up to the frame `last`, no less and no more."""
    with Trajectory(path) as found:
        assert found.probes == {name: (every, list(names)) for name, (every, names) in COLUMNS.items()}
        rows = [told(k) for k in range(1, last + 1)]
        by_frame = np.concatenate([np.empty((0, 4)), *(one["frame"] for one in rows)])
        by_substep = np.concatenate([np.empty((0, 2)), *(one["substep"] for one in rows)])
        for name, times, values in (
            ("foot", by_frame[:, 0], by_frame[:, 1:3]),
            ("hand", by_substep[:, 0], by_substep[:, 1:]),
            ("head", by_frame[:, 0], by_frame[:, 3:]),
        ):
            np.testing.assert_array_equal(found.readings[name].times, times)
            np.testing.assert_array_equal(found.readings[name].values, values)


@pytest.mark.parametrize("every", [1, 3])
def test_they_are_given_back_as_they_were_told(tmp_path, monkeypatch, every, vtk_output):
    monkeypatch.setattr(vtkhdf, "FORESEEN", 5)
    path = record(tmp_path / "a.vtkhdf", 0, 13, every=every)
    assert_tells(path, 12)
    assert [when for when, _ in vtk_frames(path)] == [k / 60 for k in range(0, 13, every)]
    assert vtk_output.GetOutput() == ""  # VTK does not see them


@pytest.mark.parametrize("every", [1, 3])
@pytest.mark.parametrize("behind", [1, 3, 5, 9])
def test_they_go_on_behind_the_frame_that_a_run_goes_on_from(tmp_path, every, behind):
    # Frames that are not kept have readings too.
    path = record(tmp_path / "a.vtkhdf", 0, 9, every=every)
    record(path, behind, 13, every=every)
    assert_tells(path, 12)


@pytest.mark.slow
def test_each_single_write_to_disk_leaves_those_of_the_frames_there_are(tmp_path, monkeypatch):
    monkeypatch.setattr(vtkhdf, "FORESEEN", 5)
    path = tmp_path / "a.vtkhdf"
    all_frames = list(frames(SYSTEM, 10))
    with recorded_writes(monkeypatch) as log:
        writer = TrajectoryWriter(path, SYSTEM, fps=60, readings=COLUMNS)
        writer.write(all_frames[0])
        writer.flush()
        log.clear()
        first = path.read_bytes()
        for k, frame in enumerate(all_frames[1:], 1):
            writer.write(frame, readings=told(k))
        writer.close()
    for n, content in enumerate(beginnings(first, log)):
        if n % 31:
            continue
        path.write_bytes(content)
        with Trajectory(path) as found:
            count = len(found)
        assert_tells(path, count - 1)
        record(path, max(1, count - n % 3), 12)
        assert_tells(path, 11)


def test_files_of_before_have_none_and_go_on(tmp_path):
    path = write(tmp_path / "a.vtkhdf", SYSTEM, 5)
    record(path, 5, 8)
    with Trajectory(path) as found:
        assert (len(found), found.probes, found.readings) == (8, None, {})


def test_those_of_other_probes_are_not_gone_on_with(tmp_path):
    path = record(tmp_path / "a.vtkhdf", 0, 4)
    with pytest.raises(ValueError, match="has readings of other probes: foot, hand, head"):
        TrajectoryWriter(path, SYSTEM, fps=60, behind=4)


def test_rows_are_refused_by_name(tmp_path):
    frame = next(frames(SYSTEM, 1))
    with TrajectoryWriter(tmp_path / "a.vtkhdf", SYSTEM, fps=60, readings=COLUMNS) as writer:
        with pytest.raises(ValueError, match=r"readings\['frame'\] has shape \(1, 3\); it must be \(any, 4\)"):
            writer.write(frame, readings={"frame": np.zeros((1, 3))})
        with pytest.raises(ValueError, match="a name in readings is 'second'; it must be one of"):
            writer.write(frame, readings={"second": np.zeros((1, 3))})
    with pytest.raises(ValueError, match=r"every of readings\['foot'\] is 'second'; it must be one of"):
        TrajectoryWriter(tmp_path / "b.vtkhdf", SYSTEM, fps=60, readings={"foot": ("second", ["x_m"])})


@pytest.mark.parametrize(
    ("damage", "said"),
    [
        (lambda group: group["ends"].__setitem__((3, 0), 99), "its frames 99"),
        (
            lambda group: group["by_frame"].__setitem__((1, 0), np.nan),
            "times of its readings by frame do not rise",
        ),
        (lambda group: group.__delitem__("by_substep"), "its readings"),
        (lambda group: group["description"].attrs.__setitem__("crc32", np.uint32(1)), "checksum"),
    ],
    ids=["ends", "times", "missing", "checksum"],
)
def test_damage_is_told(tmp_path, damage, said):
    path = record(tmp_path / "a.vtkhdf", 0, 4)
    with h5py.File(path, "r+") as file:
        damage(file["msdwarp/readings"])
    with Trajectory(path) as found, pytest.raises(ValueError, match=f"a.vtkhdf is a damaged trajectory.*{said}"):
        _ = found.readings
