"""Trajectories: what is written comes back bit for bit, to us and to VTK, whatever happens meanwhile."""

import errno
import io
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from dataclasses import fields

import h5py
import numpy as np
import pytest
import pyvista as pv
from vtkmodules.vtkCommonCore import vtkOutputWindow, vtkStringOutputWindow
from vtkmodules.vtkIOHDF import vtkHDFReader

from msdwarp import (
    CoulombDamper,
    QuadraticDamper,
    Simulation,
    System,
    Trajectory,
    ball,
    box,
    chain,
    sheet,
    trajectory,
    vtkhdf,
)
from msdwarp.dampers import Damper
from msdwarp.trajectory import Frame, TrajectoryWriter

SYSTEMS = {
    "line": System(position=[[0.0], [1.0], [2.5]], connections=[[0, 1], [1, 2]]),
    "plane": sheet((4, 3), dim=2),
    "dust": System(position=np.random.default_rng(1).normal(size=(7, 3))),
    "chain": chain(5, dim=3) if "dim" in chain.__kwdefaults__ else chain(5),
    "box": box((4, 3, 3)),
    "embedded": ball(1.0, 0.4),
    "embedded and box": ball(1.0, 0.5) + box((2, 2, 2)),
}
KINDS = [("float32", False), ("float64", True)]


def frames(system, count, dtype="float32"):
    """Yield frames of a shaken system, the same each time."""
    random = np.random.default_rng(0)
    for k in range(count):
        position = (system.position + 0.05 * random.normal(size=system.position.shape)).astype(dtype)
        yield Frame(k / 60, position, random.normal(size=position.shape).astype(dtype))


def write(path, system, count=5, dtype="float32", **options):
    with TrajectoryWriter(path, system, **{"fps": 60, **options}) as writer:
        for frame in frames(system, count, dtype):
            writer.write(frame)
    return path


def in_space(values):
    """Return coordinates in three dimensions, by hand."""
    result = np.zeros((len(values), 3), values.dtype)
    result[:, {1: [0], 2: [0, 2], 3: [0, 1, 2]}[values.shape[1]]] = values
    return result


def assert_same(frame, expected):
    assert frame.time == expected.time
    for got, wanted in ((frame.position, expected.position), (frame.velocity, expected.velocity)):
        assert got.dtype == wanted.dtype
        np.testing.assert_array_equal(got, wanted)


@pytest.fixture
def vtk_output():
    """What VTK says, which is nothing if all is well."""
    before, window = vtkOutputWindow.GetInstance(), vtkStringOutputWindow()
    vtkOutputWindow.SetInstance(window)
    yield window
    vtkOutputWindow.SetInstance(before)


def vtk_frames(path, which=slice(None)):
    """Yield (time, PolyData) of steps by VTK's own reader."""
    reader = vtkHDFReader()
    reader.SetFileName(str(path))
    reader.UpdateInformation()
    times = reader.GetOutputInformation(0).Get(reader.GetExecutive().TIME_STEPS()) or (None,)
    assert reader.GetNumberOfSteps() in (len(times), 0)
    for k in range(len(times))[which]:
        reader.SetStep(k)
        reader.Update()
        yield times[k], pv.wrap(reader.GetOutput()).copy()


# What is written comes back.


@pytest.mark.parametrize(("dtype", "compress"), KINDS)
@pytest.mark.parametrize("name", SYSTEMS)
def test_frames_and_system_come_back(tmp_path, name, dtype, compress):
    system, attributes = SYSTEMS[name], {"scene": name, "list": [1, 2.5, None], "seed": 1 << 80, "limit": np.inf}
    path = write(tmp_path / "a.vtkhdf", system, 5, dtype, compress=compress, attributes=attributes)
    with Trajectory(path) as found:
        assert len(found) == len(found.positions) == 5
        assert (found.fps, found.attributes) == (60, attributes)
        expected = list(frames(system, 5, dtype))
        np.testing.assert_array_equal(found.times, [frame.time for frame in expected])
        for frame, wanted in zip(found, expected, strict=True):
            assert_same(frame, wanted)
        assert_same(found[-1], expected[-1])
        for frame, wanted in zip(found[4:0:-2], expected[4:0:-2], strict=True):
            assert_same(frame, wanted)
        with pytest.raises(IndexError):
            found.frame(5)
        assert_same_systems(found.system, system)


def assert_same_systems(found, system):
    for field in fields(System):
        got, wanted = getattr(found, field.name), getattr(system, field.name)
        if isinstance(wanted, np.ndarray):
            assert (got.dtype, got.shape) == (wanted.dtype, wanted.shape)
            assert got.strides[:1] == wanted.strides[:1], "what is the same everywhere is stored once"
            np.testing.assert_array_equal(got, wanted)
        elif field.name == "surface" and wanted is not None:
            for part in fields(wanted):
                np.testing.assert_array_equal(getattr(got, part.name), getattr(wanted, part.name))
        elif field.name == "groups":
            assert list(got) == list(wanted)
            for key in wanted:
                np.testing.assert_array_equal(got[key], wanted[key])
        else:
            assert got == wanted, field.name


def test_everything_a_system_can_have_comes_back(tmp_path):
    first = box((3, 3, 2), damping=2.0).pin([0]).named("a/b").rotate(0.3, (1, 2, 3))
    rest = first.rest_length * np.linspace(0.9, 1.1, first.connection_count)
    first = first.replace(
        rest_length=rest, original_length=first.rest_length, yield_strain=0.1, relaxation_time=0.0
    )
    for damper in (CoulombDamper(0.2), QuadraticDamper(3.0)):
        system = first.replace(damper=damper) + ball(1.0, 0.5).named("")
        path = write(tmp_path / f"{type(damper).__name__}.vtkhdf", system)
        with Trajectory(path) as found:
            assert_same_systems(found.system, system)


def test_every_nth_frame_and_an_unknown_number_of_frames(tmp_path, monkeypatch, vtk_output):
    monkeypatch.setattr(vtkhdf, "_FORESEEN", 3)
    system = SYSTEMS["box"]
    for options in ({}, {"frame_count": 3}, {"frame_count": 20}):  # more and fewer than were foreseen
        path = write(tmp_path / "a.vtkhdf", system, 20, every=2, force=True, **options)
        with Trajectory(path) as found:
            assert (len(found), found.fps) == (10, 30)
            for frame, wanted in zip(found, list(frames(system, 20))[::2], strict=True):
                assert_same(frame, wanted)
        assert [when for when, _ in vtk_frames(path)] == [k / 30 for k in range(10)]
    assert vtk_output.GetOutput() == ""


def test_strain_follows_rest_lengths_that_move(tmp_path):
    system = box((3, 3, 2)).replace(yield_strain=0.01)
    frame = next(frames(system, 1, "float64"))
    length = system.replace(position=frame.position).length
    with TrajectoryWriter(tmp_path / "a.vtkhdf", system, fps=60) as writer:
        writer.write(frame)
        writer.write(frame._replace(time=1.0), rest_length=2 * system.rest_length)
    with Trajectory(writer.path) as found:
        for strain, rest in zip(found.strains[:], (system.rest_length, 2 * system.rest_length), strict=True):
            np.testing.assert_allclose(strain, length / rest - 1, atol=1e-14)


def test_strain_can_be_left_out(tmp_path, vtk_output):
    path = write(tmp_path / "a.vtkhdf", SYSTEMS["box"], strain=False)
    with Trajectory(path) as found, pytest.raises(ValueError, match="without strain"):
        _ = found.strains
    assert all(not mesh.cell_data for _, mesh in vtk_frames(path))
    assert vtk_output.GetOutput() == ""


KEYS = [
    3,
    -1,
    (-1, 5),
    (..., 1),
    (slice(None, None, 7), slice(3, 9), 0),
    (slice(None, None, -3), slice(None, None, -2)),
]
KEYS += [slice(5, 5), (slice(2, 9), 4), (slice(1, 4), ...), [3, 1], (2, 3, 1), (slice(None), slice(5, 5)), ()]
KEYS += [(slice(None, None, 2), 4, slice(0, 2)), np.arange(12) % 5 == 0, np.int64(3), (slice(None, None, -1), 4)]
KEYS += [(slice(None), [5, 2, 2]), (..., 3, slice(None))]


@pytest.mark.parametrize("name", ["line", "plane", "box", "embedded"])
def test_arrays_on_disk_are_indexed_as_those_in_memory(tmp_path, name):
    system = SYSTEMS[name].translate([1.0] * SYSTEMS[name].dim)
    expected = np.array([frame.position for frame in frames(system, 12)])
    with Trajectory(write(tmp_path / "a.vtkhdf", system, 12)) as found:
        view = found.positions
        assert (view.shape, view.dtype, view.ndim) == (expected.shape, expected.dtype, 3)
        np.testing.assert_array_equal(np.asarray(view), expected)
        for key in KEYS:
            try:
                wanted = expected[key]
            except IndexError:
                with pytest.raises(IndexError):
                    view[key]
            else:
                got = view[key]
                assert np.shape(got) == wanted.shape, key
                np.testing.assert_array_equal(got, wanted, str(key))
        several = view[[0, 3], [1, 2, 0]]  # each index for its own axis
        np.testing.assert_array_equal(several, expected[np.ix_([0, 3], [1, 2, 0])])
        with pytest.raises(IndexError, match="4 indices"):
            view[0, 0, 0, 0]
        assert found.strains[2, 1].shape == ()


# VTK reads it.


@pytest.mark.parametrize(("dtype", "compress"), KINDS)
@pytest.mark.parametrize("name", SYSTEMS)
def test_vtk_reads_every_frame_bit_for_bit(tmp_path, name, dtype, compress, vtk_output):
    system = SYSTEMS[name]
    n, lines, surface = system.particle_count, system.connection_count, system.surface
    path = write(tmp_path / "a.vtkhdf", system, 5, dtype, compress=compress, frame_count=5)
    expected = list(frames(system, 5, dtype))
    for (when, mesh), frame in zip(vtk_frames(path), expected, strict=True):
        assert (when, mesh.points.dtype) == (frame.time, dtype)
        np.testing.assert_array_equal(mesh.points[:n], in_space(frame.position))
        np.testing.assert_array_equal(mesh.point_data["velocity"][:n], in_space(frame.velocity))
        np.testing.assert_array_equal(mesh.lines.reshape(-1, 3)[:, 1:], system.connections)
        assert mesh.n_verts == (n if not lines and surface is None else 0)
        if surface is not None:
            corners = mesh.points[mesh.faces.reshape(-1, 4)[:, 1:]]
            wanted = in_space(surface.points(frame.position).astype(dtype))[surface.triangles]
            np.testing.assert_array_equal(corners, wanted)
        if lines:
            strain = mesh.cell_data["strain"]
            moved = system.replace(position=frame.position.astype(np.float64)).strain
            np.testing.assert_allclose(strain[:lines], moved, atol=1e-5 if dtype == "float32" else 1e-14)
            assert np.isnan(strain[lines:]).all()
    reader = pv.get_reader(path)
    for k, frame in enumerate(expected):
        reader.reader.SetStep(k)
        np.testing.assert_array_equal(reader.read().points[:n], in_space(frame.position))
    assert vtk_output.GetOutput() == ""


@pytest.mark.parametrize("precision", ["float32", "float32-compensated", "float64"])
def test_a_simulation_is_read_bit_for_bit(tmp_path, precision, vtk_output):
    simulation = Simulation(box((3, 3, 3)), device="cpu", precision=precision, substeps=40)
    kept = []
    with TrajectoryWriter(tmp_path / "a.vtkhdf", simulation.system, fps=60) as writer:
        for frame in simulation.frames(0.2):
            writer.write(frame)
            kept.append(frame)
    for (when, mesh), frame in zip(vtk_frames(writer.path), kept, strict=True):
        assert when == frame.time
        np.testing.assert_array_equal(mesh.points, frame.position)
    assert vtk_output.GetOutput() == ""


def test_a_file_of_one_frame(tmp_path, vtk_output):
    path = write(tmp_path / "a.vtkhdf", SYSTEMS["box"], 1)
    ((_, mesh),) = vtk_frames(path)
    np.testing.assert_array_equal(mesh.points, next(frames(SYSTEMS["box"], 1)).position)
    assert vtk_output.GetOutput() == ""


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


def until(condition, seconds=10):
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.001)


class Disk(io.RawIOBase):
    """A file that notes what is written to it, in order."""

    def __init__(self, path, log):
        self._file, self._log = path.open("r+b", buffering=0), log

    def readinto(self, buffer):
        return self._file.readinto(buffer)

    def write(self, data):
        self._log.append((self._file.tell(), bytes(data)))
        return self._file.write(data)

    def seek(self, *where):
        return self._file.seek(*where)

    def close(self):
        self._file.close()
        super().close()

    def truncate(self, size):
        self._log.append((size, None))
        return self._file.truncate(size)


LONG = [(True, 80, True), (False, 80, False)]


@pytest.mark.parametrize(
    ("compress", "count", "known"),
    [(False, 14, True), (True, 14, False), *(pytest.param(*one, marks=pytest.mark.slow) for one in LONG)],
)
def test_after_each_single_write_to_disk_every_frame_is_there(
    tmp_path, monkeypatch, compress, count, known, vtk_output
):
    # A killed process has written what it has written: each beginning of the series of its writes must open.
    monkeypatch.setattr(vtkhdf, "_FORESEEN", 10)
    log, disks, real, system = [], [], h5py.File, SYSTEMS["box"]

    def opened(path, mode, **options):
        if mode == "r+":
            disks.append(Disk(path, log))
            del options["locking"]
        return real(disks[-1] if mode == "r+" else path, mode, **options)

    def reserve(descriptor, start, size):
        end = os.fstat(descriptor).st_size
        log.append((end, bytes(max(0, start + size - end))))
        fallocate(descriptor, start, size)

    fallocate = os.posix_fallocate
    monkeypatch.setattr(os, "posix_fallocate", reserve)
    monkeypatch.setattr(h5py, "File", opened)
    options = {"frame_count": count} if known else {}
    writer = TrajectoryWriter(tmp_path / "a.vtkhdf", system, fps=60, compress=compress, **options)
    expected = list(frames(system, count))
    writer.write(expected[0])
    until(lambda: writer.frame_count == 1)
    log.clear()  # until here it had another name
    whole = bytearray(writer.path.read_bytes())
    for frame in expected[1:]:
        writer.write(frame)
    writer.close()
    monkeypatch.setattr(h5py, "File", real)
    for disk in disks:
        disk.close()
    assert len(log) > 4 * count
    seen = 1
    for k, (place, data) in enumerate(log):
        if data is None:
            whole = whole[:place] + bytes(max(0, place - len(whole)))
        else:
            whole += bytes(max(0, place + len(data) - len(whole)))
            whole[place : place + len(data)] = data
        path = tmp_path / f"{k}.vtkhdf"
        path.write_bytes(whole)
        with Trajectory(path) as found:
            assert len(found) >= seen
            seen = len(found)
            steps = found._file["VTKHDF/Steps"]
            assert len(steps["Values"]) <= steps.attrs["NSteps"]  # or VTK writes past its memory
            for number in {0, seen // 2, seen - 1}:
                assert_same(found[number], expected[number])
        if known and k % 50 == 0:
            for number, (_, mesh) in enumerate(vtk_frames(path)):
                np.testing.assert_array_equal(mesh.points, expected[number].position)
        path.unlink()
    assert seen == count
    assert vtk_output.GetOutput() == ""


WRITE_FOR_EVER = """
import os, signal, sys, time
import h5py, numpy as np
from msdwarp import box
from msdwarp.trajectory import TrajectoryWriter
system, children = box((6, 6, 6)), {}
for k in range(20):
    child = os.fork()
    if child == 0:
        with TrajectoryWriter(f"{sys.argv[1]}/{k}.vtkhdf", system, fps=60, compress=k % 2 == 1) as writer:
            for n in range(1_000_000):
                position = (system.position * (1 + n / 1024)).astype(np.float32)
                writer.write((n / 60, position, -position))
    children[child] = k
random = np.random.default_rng()
for child in children:
    time.sleep(random.uniform(0, 0.1))
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
"""


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")
def test_killed_at_random_twenty_times(tmp_path, vtk_output):
    subprocess.run([sys.executable, "-W", "ignore", "-c", WRITE_FOR_EVER, tmp_path], check=True, timeout=120)
    system, paths = box((6, 6, 6)), list(tmp_path.glob("[0-9]*.vtkhdf"))
    assert len(paths) > 10  # a file appears with its first frame
    for path in paths:
        with Trajectory(path) as found:
            assert len(found) > 0
            factors = 1 + np.arange(len(found)) / 1024
            expected = (system.position * factors[:, None, None]).astype(np.float32)
            np.testing.assert_array_equal(found.times, np.arange(len(found)) / 60)
            np.testing.assert_array_equal(found.positions[:], expected)
            np.testing.assert_array_equal(found.velocities[:], -expected)
        for when, mesh in vtk_frames(path, slice(None, None, -10)):
            k = round(when * 60)
            np.testing.assert_array_equal(mesh.points, expected[k])
    assert vtk_output.GetOutput() == ""


FILL_THE_DISK = """
import resource, sys
import numpy as np
from msdwarp import box
from msdwarp.trajectory import TrajectoryWriter
resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[2]), int(sys.argv[2])))
system = box((10, 10, 10))
random = np.random.default_rng(0)
try:
    with TrajectoryWriter(sys.argv[1], system, fps=60, compress=sys.argv[3] == "True") as writer:
        for n in range(10_000):
            writer.write((n / 60, (n * system.position).astype(np.float32), random.normal(size=(1000, 3))))
except OSError as error:
    print(error)
    sys.exit(3)
"""


@pytest.mark.skipif(sys.platform == "win32", reason="needs a limit to the size of files")
@pytest.mark.parametrize(("limit", "compress"), [(3_000_000, True), (100_000, False)])
def test_a_full_disk_ends_with_a_message_and_a_file_that_opens(tmp_path, limit, compress):
    path = tmp_path / "a.vtkhdf"
    arguments = [sys.executable, "-W", "error", "-c", FILL_THE_DISK, path, str(limit), str(compress)]
    done = subprocess.run(arguments, capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stderr) == (3, "")
    assert done.stdout.startswith(f"{path} could not be written further: File too large; ")
    if limit < 1_000_000:
        assert "nothing was kept" in done.stdout
        assert not list(tmp_path.iterdir())
        return
    with Trajectory(path) as found:
        assert f"its first {len(found)} frames are kept" in done.stdout
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
        until(lambda: writer._error is not None)
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
    until(lambda: writer._error is not None)
    with pytest.raises(OSError, match="moved, removed or replaced meanwhile; its first 1 frame is kept"):
        writer.write(third)
    writer.close()  # which says nothing twice


def test_a_writer_that_is_never_closed_loses_nothing(tmp_path):
    code = """
import sys
from msdwarp import chain
from msdwarp.trajectory import TrajectoryWriter
system = chain(5)
writer = TrajectoryWriter(sys.argv[1], system, fps=60)
for k in range(9):
    writer.write((k / 60, system.position, system.velocity))
"""
    path = tmp_path / "a.vtkhdf"
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", code, path], capture_output=True, text=True, timeout=60
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    with Trajectory(path) as found:
        assert len(found) == 9


# The thread.


def test_a_few_frames_wait_and_no_more(tmp_path, monkeypatch):
    go, system = threading.Event(), SYSTEMS["chain"]
    monkeypatch.setattr(trajectory._File, "append", lambda *_: go.wait())
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

    monkeypatch.setattr(trajectory._File, "append", broken)
    with pytest.raises(ZeroDivisionError, match="by hand"), write_one(tmp_path / "a.vtkhdf"):
        pass
    with write_one(tmp_path / "b.vtkhdf") as writer:
        until(lambda: writer._error is not None)
        with pytest.raises(ZeroDivisionError):
            writer.write(next(frames(SYSTEMS["chain"], 1)))


def write_one(path):
    writer = TrajectoryWriter(path, SYSTEMS["chain"], fps=60)
    writer.write(next(frames(SYSTEMS["chain"], 1)))
    return writer


@pytest.mark.slow
def test_memory_stays_flat_over_ten_thousand_frames(tmp_path):
    code = """
import resource, sys
import numpy as np
from msdwarp import box
from msdwarp.trajectory import Trajectory, TrajectoryWriter
system, peak = box((10, 10, 10)), []
with TrajectoryWriter(sys.argv[1], system, fps=60, frame_count=10_000) as writer:
    for n in range(10_000):
        position = (system.position * (1 + n / 1024)).astype(np.float32)
        writer.write((n / 60, position, -position))
        if n in (999, 9999):
            peak.append(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
with Trajectory(sys.argv[1]) as found:
    for frame in found[::10]:
        pass
    path = found.positions[:, 5]
    peak.append(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
print(*peak)
"""
    arguments = [sys.executable, "-c", code, tmp_path / "a.vtkhdf"]
    done = subprocess.run(arguments, capture_output=True, text=True, timeout=300, check=True)
    early, late, read = map(int, done.stdout.split())  # in KiB on Linux; the file has 500 MB
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
    own = system.replace(damper=type("Own", (Damper,), {})())
    for wrong, said in [
        ({"path": tmp_path / "a.h5"}, r"path is .*a\.h5; its name must end in \.vtkhdf"),
        ({"fps": 0}, "fps is 0"),
        ({"every": 0}, "every is 0"),
        ({"frame_count": 0}, "frame_count is 0"),
        ({"attributes": {"what": object()}}, r"attributes\['what'\] is <object"),
        ({"system": own}, "damper is .*Own"),
    ]:
        with pytest.raises(ValueError, match=said):
            TrajectoryWriter(**({"path": path, "system": system, "fps": 60} | wrong))
    (tmp_path / "file").write_text("")
    with pytest.raises(OSError, match="cannot be written to: it is a file"):
        TrajectoryWriter(tmp_path / "file" / "a.vtkhdf", system, fps=60)
    with TrajectoryWriter(path, system, fps=60) as writer:
        time, position, velocity = next(frames(system, 1))
        with pytest.raises(ValueError, match=r"position has shape \(5, 3\); it must be \(36, 3\)"):
            writer.write((time, position[:5], velocity))
        with pytest.raises(ValueError, match=r"velocity has shape \(36,\)"):
            writer.write((time, position, velocity[:, 0]))
        with pytest.raises(ValueError, match="rest_length has shape"):
            writer.write((time, position, velocity), rest_length=position)
    with pytest.raises(ValueError, match="is closed"):
        writer.write((time, position, velocity))


def test_other_files_are_refused_by_what_is_wrong(tmp_path):
    path = write(tmp_path / "good.vtkhdf", SYSTEMS["box"])
    with pytest.raises(FileNotFoundError):
        Trajectory(tmp_path / "none.vtkhdf")
    for content in (b"", b"\x89HDF", b"solid box"):
        (tmp_path / "bad").write_bytes(content)
        with pytest.raises(ValueError, match="it is no HDF5 file"):
            Trajectory(tmp_path / "bad")
    whole = path.read_bytes()
    for size in (len(whole) // 2, len(whole) - 1):
        (tmp_path / "bad").write_bytes(whole[:size])
        with pytest.raises(ValueError, match="cannot be read: it is cut short"):
            Trajectory(tmp_path / "bad")
    for change, said in [
        (lambda file: file.move("VTKHDF", "other"), "it has no group VTKHDF"),
        (lambda file: file.move("msdwarp", "other"), "VTKHDF of another program"),
        (
            lambda file: file["msdwarp"].attrs.modify("msdwarp_format", 2),
            r"format 2; this version reads 1: install a n",
        ),
        (lambda file: file["msdwarp"].attrs.modify("msdwarp_format", 0), r"format 0; this version reads 1$"),
        (lambda file: file["VTKHDF"].move("Points", "other"), "damaged.*Points"),
        (lambda file: file["msdwarp"].move("attributes", "other"), "damaged.*attributes"),
    ]:
        shutil.copy(path, tmp_path / "bad")
        with h5py.File(tmp_path / "bad", "r+") as file:
            change(file)
        with pytest.raises(ValueError, match=said):
            Trajectory(tmp_path / "bad")


def test_a_damaged_system_is_refused_when_it_is_asked_for(tmp_path):
    path = write(tmp_path / "a.vtkhdf", SYSTEMS["box"])
    with h5py.File(path, "r+") as file:
        file["msdwarp/system/mass"][()] = -1.0
    with Trajectory(path) as found:
        assert len(found) == 5
        with pytest.raises(ValueError, match="damaged trajectory: its system cannot be read: mass"):
            _ = found.system


def test_the_file_in_plain_h5py(tmp_path):
    system = SYSTEMS["box"]
    path = write(tmp_path / "a.vtkhdf", system, 3)
    with h5py.File(path) as file:
        n = file["msdwarp"].attrs["particle_count"]
        points = file["VTKHDF/Points"][:].reshape(len(file["VTKHDF/Steps/Values"]), -1, 3)[:, :n]
        np.testing.assert_array_equal(points, [frame.position for frame in frames(system, 3)])
    assert path.read_bytes()[8] == 0  # the oldest superblock: a newer one does not open after a crash


def test_signals_reach_python(tmp_path):
    # Writing must not install handlers of its own.
    before = [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)]
    write(tmp_path / "a.vtkhdf", SYSTEMS["chain"])
    assert [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)] == before
