"""Writing trajectories: whatever happens meanwhile, there is a file that opens."""

import errno
import os
import shutil
import subprocess
import sys
import threading
import time

import h5py
import numpy as np
import pytest
from trajectories import SYSTEMS, assert_same, beginnings, frames, largest_file, recorded_writes, vtk_frames, write

from msdwarp import Trajectory, TrajectoryWriter, box
from msdwarp.files import growing_file, vtkhdf

# It can be opened while it is written, and after the writer was killed.


def test_it_is_read_while_it_is_written(tmp_path, vtk_output):
    system, path = SYSTEMS["box"], tmp_path / "a.vtkhdf"
    expected = list(frames(system, 8))
    with TrajectoryWriter(path, system, fps=60) as writer:
        assert not path.exists()  # before there is a frame
        for k, frame in enumerate(expected):
            writer.write(frame)
            until(lambda k=k: writer.frame_count == k + 1)
            with Trajectory(path) as found:
                assert len(found) == k + 1
                assert_same(found[-1], frame)
            assert sum(1 for _ in vtk_frames(path)) == k + 1
    assert vtk_output.GetOutput() == ""


def until(condition, seconds=100):
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.001)


@pytest.mark.slow
# Of 40 frames the tables grow several times.
@pytest.mark.parametrize(("compress", "count", "known"), [(False, 8, True), (True, 40, False)])
def test_after_each_single_write_to_disk_every_frame_is_there(
    tmp_path, monkeypatch, compress, count, known, vtk_output
):
    # A killed process has written what it has written: each beginning of the series of its writes must open.
    monkeypatch.setattr(vtkhdf, "FORESEEN", 10)
    system, expected = SYSTEMS["box"], list(frames(SYSTEMS["box"], count))
    options = {"frame_count": count} if known else {}
    with recorded_writes(monkeypatch) as log:
        writer = TrajectoryWriter(tmp_path / "a.vtkhdf", system, fps=60, compress=compress, **options)
        writer.write(expected[0])
        writer.flush()
        log.clear()  # until here it had another name
        first = writer.path.read_bytes()
        for frame in expected[1:]:
            writer.write(frame)
        writer.close()
    assert len(log) > 4 * count
    seen = 1
    for k, content in enumerate(beginnings(first, log)):
        # A frame takes 14 or 20 writes, as the one before did, and 49 where the file grows: in a long run every
        # 23rd of them comes by all in time.
        if (k > 100 or count > 8) and k % 23 and k < len(log) - 1:
            continue
        path = tmp_path / f"{k}.vtkhdf"
        path.write_bytes(content)
        with Trajectory(path) as found:
            assert len(found) >= seen
            seen = len(found)
            with h5py.File(path, locking=False) as file:
                steps = file["VTKHDF/Steps"]
                assert len(steps["Values"]) <= steps.attrs["NSteps"]  # or VTK writes past its memory
            for number in {0, seen // 2, seen - 1}:
                assert_same(found[number], expected[number])
        if known and k % 161 == 0:
            for number, (_, mesh) in enumerate(vtk_frames(path)):
                np.testing.assert_array_equal(mesh.points, expected[number].position)
        path.unlink()
    assert seen == count
    assert vtk_output.GetOutput() == ""


WRITE_FOR_EVER = """
import os, signal, sys, time
import h5py, numpy as np
from msdwarp import box
from msdwarp.files.writer import TrajectoryWriter
system, children = box((6, 6, 6)), {}
for k in range(8):
    child = os.fork()
    if child == 0:
        with TrajectoryWriter(f"{sys.argv[1]}/{k}.vtkhdf", system, fps=60, compress=k % 2 == 1) as writer:
            for n in range(1_000_000):
                position = (system.position * (1 + n / 1024)).astype(np.float32)
                writer.write((n / 60, position, -position))
    children[child] = k
random = np.random.default_rng()
for child, k in children.items():
    while k % 4 < 2 and not os.path.exists(f"{sys.argv[1]}/{k}.vtkhdf"):
        time.sleep(0.001)  # half of them have a frame, on however slow a machine
    time.sleep(random.uniform(0, 0.1))
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
"""


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")
def test_killed_at_random_it_has_its_frames(tmp_path, vtk_output):
    subprocess.run([sys.executable, "-W", "ignore", "-c", WRITE_FOR_EVER, tmp_path], check=True, timeout=600)
    system, paths = box((6, 6, 6)), list(tmp_path.glob("[0-9]*.vtkhdf"))
    assert len(paths) >= 4  # a file appears with its first frame
    for path in paths:
        with Trajectory(path) as found:
            assert len(found) > 0
            factors = 1 + np.arange(len(found) + 1) / 1024
            expected = (system.position * factors[:, None, None]).astype(np.float32)
            np.testing.assert_array_equal(found.times, np.arange(len(found)) / 60)
            np.testing.assert_array_equal(found.positions[:], expected[:-1])
            np.testing.assert_array_equal(found.velocities[:], -expected[:-1])
        for number, (when, mesh) in enumerate(vtk_frames(path, slice(None, None, -10))):
            k = round((when or 0.0) * 60)  # a file of one frame has no times for VTK
            if number == 0 and when == 0:  # killed between a frame and its time, which VTK then takes for 0
                k = len(found.times)
            np.testing.assert_array_equal(mesh.points, expected[k])
    assert vtk_output.GetOutput() == ""


@pytest.mark.slow
@pytest.mark.parametrize(("limit", "compress"), [(3_000_000, True), (100_000, False)])
def test_a_full_disk_ends_with_a_message_and_a_file_that_opens(tmp_path, limit, compress):
    system, random, path = box((10, 10, 10)), np.random.default_rng(0), tmp_path / "a.vtkhdf"
    said = r"a\.vtkhdf could not be written further: File too large; "

    def fill_the_disk():
        with TrajectoryWriter(path, system, fps=60, compress=compress) as writer:
            for n in range(10_000):
                writer.write((n / 60, (n * system.position).astype(np.float32), random.normal(size=(1000, 3))))

    with largest_file(limit), pytest.raises(OSError, match=said) as told:
        fill_the_disk()
    if limit < 1_000_000:
        assert "nothing was kept" in str(told.value)
        assert not list(tmp_path.iterdir())
        return
    with Trajectory(path) as found:
        assert f"its first {len(found)} frames are kept" in str(told.value)
        assert len(found) > 10
        assert len(found.system.connections) == found.strains.shape[1]
        for k, frame in enumerate(found):
            np.testing.assert_array_equal(frame.position, (k * found.system.position).astype(np.float32))


@pytest.mark.parametrize("reserves", [True, False])
def test_a_full_disk_is_noticed_before_hdf5_knows(tmp_path, monkeypatch, reserves):
    def full(*_):
        raise OSError(errno.ENOSPC, "no")

    system = SYSTEMS["box"]
    expected = list(frames(system, 6))
    with TrajectoryWriter(tmp_path / "a.vtkhdf", system, fps=60) as writer:
        for frame in expected[:3]:
            writer.write(frame)
        until(lambda: writer.frame_count == 3)
        if reserves:
            monkeypatch.setattr(os, "posix_fallocate", full, raising=False)
        else:
            monkeypatch.delattr(os, "posix_fallocate", raising=False)
            monkeypatch.setattr(shutil, "disk_usage", lambda _: shutil._ntuple_diskusage(1, 1, 0))
        writer.write(expected[3])
        with pytest.raises(OSError, match="No space left"):
            writer.flush()
        for frame in expected[4:]:
            with pytest.raises(
                OSError, match=r"a\.vtkhdf could not be written further: No space left.* 3 frames are"
            ):
                writer.write(frame)
    with Trajectory(writer.path) as found:
        assert len(found) == 3


def test_a_lost_folder_is_noticed(tmp_path):
    folder = tmp_path / "gone"
    writer = TrajectoryWriter(folder / "a.vtkhdf", SYSTEMS["box"], fps=60)
    first, second, third = frames(SYSTEMS["box"], 3)
    writer.write(first)
    until(lambda: writer.frame_count == 1)
    shutil.rmtree(folder)
    writer.write(second)
    with pytest.raises(OSError, match="moved, removed or replaced"):
        writer.flush()
    with pytest.raises(OSError, match="moved, removed or replaced meanwhile; what it held went with it"):
        writer.write(third)
    writer.close()  # which says nothing twice


def test_a_file_cut_short_meanwhile_is_noticed(tmp_path):
    with TrajectoryWriter(tmp_path / "a.vtkhdf", SYSTEMS["box"], fps=60) as writer:
        first, second = frames(SYSTEMS["box"], 2)
        writer.write(first)
        writer.flush()
        os.truncate(writer.path, 1000)
        writer.write(second)
        with pytest.raises(OSError, match="it was cut short meanwhile"):
            writer.flush()


@pytest.mark.slow
def test_a_writer_that_is_never_closed_loses_nothing(tmp_path):
    code = """
import sys
from msdwarp import chain
from msdwarp.files.writer import TrajectoryWriter
system = chain(5)
writer = TrajectoryWriter(sys.argv[1], system, fps=60)
for k in range(9):
    writer.write((k / 60, system.position, system.velocity))
"""
    path = tmp_path / "a.vtkhdf"
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", code, path], capture_output=True, text=True, timeout=600
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    with Trajectory(path) as found:
        assert len(found) == 9


# The thread.


def test_a_few_frames_wait_and_no_more(tmp_path, monkeypatch):
    go, system = threading.Event(), SYSTEMS["chain"]
    monkeypatch.setattr(growing_file.GrowingFile, "append", lambda *_: go.wait())
    writer = TrajectoryWriter(tmp_path / "a.vtkhdf", system, fps=60)
    handed = []

    def hand_over():
        for frame in frames(system, 10):
            writer.write(frame)
            handed.append(frame)

    thread = threading.Thread(target=hand_over)
    thread.start()
    until(lambda: len(handed) == 5)  # one is being written, four wait
    time.sleep(0.05)
    assert len(handed) == 5
    go.set()
    thread.join()
    writer.close()
    assert len(handed) == 10


def test_an_error_in_the_thread_is_raised_once_where_it_can_be_caught(tmp_path, monkeypatch):
    def broken(*_):
        raise ZeroDivisionError("by hand")

    monkeypatch.setattr(growing_file.GrowingFile, "append", broken)
    with pytest.raises(ZeroDivisionError, match="by hand"), write_one(tmp_path / "a.vtkhdf"):
        pass
    with write_one(tmp_path / "b.vtkhdf") as writer:
        with pytest.raises(ZeroDivisionError):
            writer.flush()
        with pytest.raises(ZeroDivisionError):
            writer.write(next(frames(SYSTEMS["chain"], 1)))


def write_one(path):
    writer = TrajectoryWriter(path, SYSTEMS["chain"], fps=60)
    writer.write(next(frames(SYSTEMS["chain"], 1)))
    return writer


@pytest.mark.slow
def test_memory_stays_flat_over_thousands_of_frames(tmp_path):
    code = """
import resource, sys
import numpy as np
from msdwarp import box
from msdwarp import Trajectory
from msdwarp.files.writer import TrajectoryWriter
system, peak = box((10, 10, 10)), []
with TrajectoryWriter(sys.argv[1], system, fps=60, frame_count=1_000) as writer:
    for n in range(1_000):
        position = (system.position * (1 + n / 1024)).astype(np.float32)
        writer.write((n / 60, position, -position))
        if n in (249, 999):
            peak.append(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
with Trajectory(sys.argv[1]) as found:
    for frame in found[::10]:
        pass
    path = found.positions[:, 5]
    peak.append(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
print(*peak)
"""
    arguments = [sys.executable, "-c", code, tmp_path / "a.vtkhdf"]
    done = subprocess.run(arguments, capture_output=True, text=True, timeout=600, check=True)
    early, late, read = map(int, done.stdout.split())  # in KiB on Linux; the file has 25 MB
    assert late - early < 10_000
    assert read - late < 30_000


# What is refused.


def test_an_existing_file_is_replaced_by_force_alone_and_not_before_there_is_a_frame(tmp_path):
    path = write(tmp_path / "a.vtkhdf", SYSTEMS["box"], 2)
    with pytest.raises(FileExistsError, match=r"path is .*a\.vtkhdf, which exists; .*--force"):
        TrajectoryWriter(path, SYSTEMS["box"], fps=60)
    TrajectoryWriter(path, SYSTEMS["box"], fps=60, force=True).close()
    with Trajectory(path) as found:
        assert len(found) == 2
    write(path, SYSTEMS["box"], 3, force=True)
    with Trajectory(path) as found:
        assert len(found) == 3
    assert [one.name for one in tmp_path.iterdir()] == ["a.vtkhdf"]


def test_what_appears_meanwhile_is_not_replaced(tmp_path):
    writer = TrajectoryWriter(tmp_path / "a.vtkhdf", SYSTEMS["chain"], fps=60)
    writer.path.write_text("another's")
    writer.write(next(frames(SYSTEMS["chain"], 1)))
    with pytest.raises(OSError, match="File exists; nothing was kept"):
        writer.close()
    assert writer.path.read_text() == "another's"


def test_wrong_arguments_are_named(tmp_path):
    system, path = SYSTEMS["box"], tmp_path / "a.vtkhdf"
    for wrong, said in [
        ({"path": tmp_path / "a.h5"}, r"path is .*a\.h5; its name must end in \.vtkhdf"),
        ({"fps": 0}, "fps is 0"),
        ({"every": 0}, "every is 0"),
        ({"frame_count": 0}, "frame_count is 0"),
        ({"attributes": {"what": object()}}, r"attributes\['what'\] is <object"),
    ]:
        with pytest.raises(ValueError, match=said):
            TrajectoryWriter(**({"path": path, "system": system, "fps": 60} | wrong))
    (tmp_path / "file").write_text("")
    with pytest.raises(OSError, match="cannot be written to: it is no folder"):
        TrajectoryWriter(tmp_path / "file" / "a.vtkhdf", system, fps=60)
    with TrajectoryWriter(path, system, fps=60) as writer:
        time, position, velocity = next(frames(system, 1))
        with pytest.raises(ValueError, match=r"position has shape \(5, 3\); it must be \(36, 3\)"):
            writer.write((time, position[:5], velocity))
        with pytest.raises(ValueError, match="time is nan; it must be from"):
            writer.write((np.nan, system.position, system.position))
        with pytest.raises(ValueError, match=r"velocity has shape \(36,\)"):
            writer.write((time, position, velocity[:, 0]))
        with pytest.raises(ValueError, match="strain has shape"):
            writer.write((time, position, velocity), strain=position)
    with pytest.raises(ValueError, match="is closed"):
        writer.write((time, position, velocity))
