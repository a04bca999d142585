"""What tests of trajectories share: systems, frames, what VTK reads, and a disk that notes what is written."""

import io
import os
import sys
from contextlib import contextmanager
from functools import partial

import h5py
import numpy as np
import pytest

from msdwarp import Scene, System, TrajectoryWriter, ball, box, chain, sheet
from msdwarp.bodies.frame import Frame
from msdwarp.cli.commands.drawn import drawn
from msdwarp.cli.picture_options import Pictures

SYSTEMS = {
    "line": System(position=[[0.0], [1.0], [2.5]], connections=[[0, 1], [1, 2]]),
    "plane": sheet((4, 3), dim=2),
    "dust": System(position=np.random.default_rng(1).normal(size=(7, 3))),
    "chain": chain(5, dim=3),
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


def drawing_of(trajectory, scene=None, **pictures):
    """Return the function that draws frames of a trajectory for `export`."""
    return partial(drawn, scene or Scene(system=trajectory.system), trajectory, Pictures(**pictures))


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


def assert_trajectories_match(a, b):
    """Assert that two open trajectories hold the same frames to the last bit."""
    np.testing.assert_array_equal(a.times, b.times)
    for one, other in zip(a, b, strict=True):
        assert_same(one, other)
    np.testing.assert_array_equal(a.strains[:], b.strains[:])


def vtk_frames(path, which=slice(None)):
    """Yield (time, PolyData) of steps by VTK's own reader."""
    import pyvista as pv
    from vtkmodules.vtkIOHDF import vtkHDFReader

    reader = vtkHDFReader()
    reader.SetFileName(str(path))
    reader.UpdateInformation()
    times = reader.GetOutputInformation(0).Get(reader.GetExecutive().TIME_STEPS()) or (None,)
    assert reader.GetNumberOfSteps() in (len(times), 0)
    for k in range(len(times))[which]:
        reader.SetStep(k)
        reader.Update()
        yield times[k], pv.wrap(reader.GetOutput()).copy()


@contextmanager
def largest_file(size):
    """Let no file grow beyond a size [bytes], as on a disk that is full."""
    resource = pytest.importorskip("resource")
    before, without_bytecode = resource.getrlimit(resource.RLIMIT_FSIZE), sys.dont_write_bytecode
    sys.dont_write_bytecode = True  # of what is imported late: it would be cut off too
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
        sys.dont_write_bytecode = without_bytecode


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


@contextmanager
def recorded_writes(monkeypatch):
    """Note, in order, what is written to files that HDF5 opens to change: (place, bytes), or (size, None)."""
    if not hasattr(os, "posix_fallocate"):
        pytest.skip("needs posix_fallocate")
    log, disks, real, fallocate = [], [], h5py.File, os.posix_fallocate

    def opened(path, mode, **options):
        if mode != "r+":
            return real(path, mode, **options)
        disks.append(Disk(path, log))
        del options["locking"]
        return real(disks[-1], mode, **options)

    def reserve(descriptor, start, size):
        end = os.fstat(descriptor).st_size
        log.append((end, bytes(max(0, start + size - end))))
        fallocate(descriptor, start, size)

    with monkeypatch.context() as patch:
        patch.setattr(os, "posix_fallocate", reserve)
        patch.setattr(h5py, "File", opened)
        yield log
    for disk in disks:
        disk.close()


def beginnings(content, log):
    """Yield what a file held after each of the writes to it, given what it held before."""
    whole = bytearray(content)
    for place, data in log:
        if data is None:
            whole = whole[:place] + bytes(max(0, place - len(whole)))
        else:
            whole += bytes(max(0, place + len(data) - len(whole)))
            whole[place : place + len(data)] = data
        yield whole
