"""Trajectories: frames on disk, which ParaView opens as they are, and the system that moves in them."""

import atexit
import errno
import json
import os
import queue
import shutil
import threading
from collections.abc import Callable, Iterator, Mapping
from functools import cached_property, partial
from pathlib import Path
from typing import Any, NamedTuple, Self, overload

import numpy as np
from numpy.typing import NDArray

from . import checks
from .system import AXES, System
from .vtkhdf import (
    DAMPERS,
    KINDS,
    OWN,
    POINTS,
    ROOT,
    STRAIN,
    VELOCITY,
    FrameArray,
    Layout,
    as_json,
    fault,
    read_system,
    read_times,
)

SUFFIX = ".vtkhdf"
_QUEUED = 4
"""Frames that wait for the thread at most."""
_SLACK = 1 << 18
"""Bytes that HDF5's own records of one frame can take."""


class Frame(NamedTuple):
    """One recorded instant, on the host."""

    time: float
    """Simulated time [s]."""
    position: NDArray
    """Particle positions [m], shape [particle_count, d]."""
    velocity: NDArray
    """Particle velocities [m/s], shape [particle_count, d]."""


class TrajectoryWriter:
    """Writes frames beside the simulation: a thread takes them from a queue and flushes each to disk.

    The file appears, whole, with the first frame, and can be opened at any moment from then on, also after the
    process was killed: every frame that was flushed is in it.

    Parameters
    ----------
    path
        The file, `*.vtkhdf`; see docs/files.md for what is in it.
    system
        What moves in it, as it is at the start.
    fps
        Frames per second of simulated time that are handed to `write`.
    frame_count
        How many there will be, if that is known: the file is then laid out for it.
    compress
        Compress losslessly (gzip 1 after shuffling bytes): smaller, and several times slower.
    every
        Keep the first frame and each `every`-th after it.
    strain
        Write the strain of every connection: one number each, of which a lattice has many more than positions.
    attributes
        What made the run: names, numbers, texts, or lists and mappings of those, as JSON has them.
    force
        Replace a file that is there.

    Raises
    ------
    ValueError
        If an argument is out of its range, or the name does not end in .vtkhdf.
    FileExistsError
        If the file exists and `force` is False.
    OSError
        If nothing can be written there. What goes wrong later, such as a full disk, is raised by the next
        `write` or by `close`; it says how many frames were kept.
    """

    def __init__(
        self,
        path: str | Path,
        system: System,
        *,
        fps: float,
        frame_count: int | None = None,
        compress: bool = False,
        every: int = 1,
        strain: bool = True,
        attributes: Mapping[str, Any] | None = None,
        force: bool = False,
    ) -> None:
        self.path = Path(path)
        if self.path.suffix != SUFFIX:
            raise ValueError(f"path is {self.path}; its name must end in {SUFFIX}")
        if type(system.damper).__name__ not in DAMPERS:
            raise ValueError(f"damper is {system.damper!r}; a file can hold {', '.join(DAMPERS)}")
        self._every = checks.count("every", every, 1)
        if frame_count is not None:
            frame_count = -(-checks.count("frame_count", frame_count, 1) // self._every)
        about = (checks.positive("fps", fps) / self._every, as_json(attributes or {}))
        if self.path.exists() and not force:
            raise FileExistsError(f"path is {self.path}, which exists; name another file or add --force")
        checks.writable_folder("path", self.path, self.path.parent)
        self._system, self._offered = system, 0
        layout = partial(Layout, system, frame_count=frame_count, compress=compress, strain=strain)
        self._file = _File(self.path, force, layout, about)
        self._error: Exception | None = None
        self._told = self._ended = False
        self._queue: queue.Queue[tuple[Frame, NDArray | None] | None] = queue.Queue(_QUEUED)
        self._thread = threading.Thread(target=self._work, name=f"writes {self.path.name}", daemon=True)
        self._thread.start()
        atexit.register(self.close)

    @property
    def frame_count(self) -> int:
        """Frames in the file so far."""
        return self._file.written

    def write(self, frame: tuple[float, NDArray, NDArray], rest_length: NDArray | None = None) -> None:
        """Hand over a frame: time [s], positions [m] and velocities [m/s], shape [particle_count, d] each.

        It waits while four frames are ahead. The arrays are the writer's from here on: nobody may write to them.
        `rest_length` [m], shape [connection_count], is that of the strain where it is no longer the system's.

        Raises
        ------
        ValueError
            If an array has another shape, or the writer is closed.
        OSError
            If an earlier frame could not be written.
        """
        self._tell(again=True)
        if self._ended:
            raise ValueError(f"{self.path} is closed; frames must be written before")
        frame = Frame(*frame)
        for name, values in zip(("position", "velocity"), frame[1:], strict=True):
            _check_shape(name, values, self._system.position.shape)
        if rest_length is not None:
            _check_shape("rest_length", rest_length, self._system.rest_length.shape)
        if self._offered % self._every == 0:
            self._queue.put((frame, rest_length))
        self._offered += 1

    def close(self) -> None:
        """Wait until all frames are written and close the file; it may be called again.

        Raises
        ------
        OSError
            If a frame could not be written, and `write` has not said so.
        """
        if not self._ended:
            self._queue.put(None)
            self._ended = True  # not before: an interrupt may come while the queue is full
        self._thread.join()
        atexit.unregister(self.close)
        self._tell(again=False)

    def __enter__(self) -> Self:
        """Return itself."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close the file."""
        self.close()

    def _tell(self, *, again: bool) -> None:
        """Raise the thread's error, if there is one, and if it was raised before only where that is wanted."""
        if self._error is not None and (again or not self._told):
            self._told = True
            raise self._error

    def _work(self) -> None:
        """Write what comes; after an error, only let go of it."""
        while (item := self._queue.get()) is not None:
            if self._error is None:
                self._attempt(lambda item=item: self._file.append(*item))
        self._attempt(self._file.close)

    def _attempt(self, action: Callable[[], None]) -> None:
        try:
            action()
        except Exception as error:
            self._error = self._error or self._explained(error)

    def _explained(self, error: Exception) -> Exception:
        """Return an error that names the file and says what was kept."""
        if not isinstance(error, OSError | RuntimeError):  # HDF5's errors are of these two kinds
            return error
        n, number = self.frame_count, getattr(error, "errno", None)
        reason = os.strerror(number) if number else str(error)
        kept = f"its first {n} frame{'s are' if n > 1 else ' is'} kept" if n else "nothing was kept"
        explained = OSError(f"{self.path} could not be written further: {reason}; {kept}")
        explained.__cause__ = error
        return explained


def _check_shape(name: str, values: NDArray, shape: tuple[int, ...]) -> None:
    if np.shape(values) != shape:
        raise ValueError(f"{name} has shape {np.shape(values)}; it must be {shape}")


class _File:
    """The file, which one thread fills.

    HDF5 keeps no journal, so that order is all: a frame's data reach the file first, then the number of frames,
    then the frame's time; and nothing moves that a reader of earlier frames needs. Room on disk is reserved
    before HDF5 learns of a frame, as HDF5 does not recover from a disk that is full.
    """

    def __init__(self, path: Path, force: bool, layout: Callable[[np.dtype], Layout], about: tuple[float, dict]):
        self.path, self.force, self._layout_for, self._about = path, force, layout, about
        self.written = 0
        self._file: Any = None

    def append(self, frame: Frame, rest_length: NDArray | None) -> None:
        """Write a frame and flush it."""
        if self._file is None:
            self._create(frame, rest_length)
        else:
            self._append(frame, rest_length)
        self.written += 1

    def close(self) -> None:
        """Close the file, and give back what was reserved and not used."""
        if self._file is None:
            return
        file, self._file = self._file, None
        try:
            end = file.id.get_filesize()
            file.close()
            if os.fstat(self._room).st_size > end:
                os.ftruncate(self._room, end)
        finally:
            os.close(self._room)

    def _create(self, frame: Frame, rest_length: NDArray | None) -> None:
        """Write a file of one frame, and only then give it its name."""
        import h5py

        double = frame.position.dtype == np.float64
        self._layout = self._layout_for(np.dtype(np.float64 if double else np.float32))
        unfinished = self.path.with_name(f".{self.path.name}.unfinished")
        try:
            with h5py.File(unfinished, "w", libver=("earliest", "v108")):
                pass
            self._open(unfinished)
            try:
                self._reserve(self._layout.static_size)
                self._layout.begin(self._file, *self._about)
                self._layout.open(self._file)
                self._append(frame, rest_length)
            finally:
                self.close()
            if self.path.exists() and not self.force:
                raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST), str(self.path))
            os.replace(unfinished, self.path)
        except BaseException:
            unfinished.unlink(missing_ok=True)
            raise
        self._open(self.path)
        self._layout.open(self._file)

    def _open(self, path: Path) -> None:
        import h5py

        # Unlocked, so that others can read meanwhile. Without a cache of chunks a frame goes to its place at once.
        # What is created from here on has HDF5's format of 2016, whose indices of chunks only grow, where the
        # older ones move. The file itself was created in the oldest: newer ones are marked while they are being
        # written, and do not open after a crash.
        self._file = h5py.File(path, "r+", locking=False, rdcc_nbytes=0, libver=("v110", "v110"))
        self._at, self._room = path, os.open(path, os.O_RDWR)

    def _append(self, frame: Frame, rest_length: NDArray | None) -> None:
        try:
            there = os.path.samestat(os.stat(self._at), os.fstat(self._room))
        except FileNotFoundError:
            there = False
        if not there:
            raise OSError("it was moved, removed or replaced meanwhile")
        self._reserve(self._layout.growth(self.written))
        self._layout.append(self.written, frame, rest_length)

    def _reserve(self, size: int) -> None:
        """Make sure that the disk has room for so many more bytes, and for HDF5's own records."""
        size += _SLACK
        try:
            os.posix_fallocate(self._room, self._file.id.get_filesize(), size)
            return
        except AttributeError:
            pass  # a system that cannot reserve
        except OSError as error:
            if error.errno not in (errno.EOPNOTSUPP, errno.ENOSYS, errno.EINVAL):  # a disk that cannot
                raise
        if shutil.disk_usage(self._at.parent).free < size:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


class Trajectory:
    """A trajectory on disk: its frames, which are read when they are asked for, and the system that moves in them.

    It can be opened while it is being written, and then has the frames that are there so far.

    Parameters
    ----------
    path
        The file.

    Raises
    ------
    FileNotFoundError
        If there is none.
    ValueError
        If it is no trajectory, is cut short or damaged, or is of a format that is not known.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        self._file = _opened(self.path)
        try:
            own, root = self._file[OWN], self._file[ROOT]
            self._particles, self._dim = int(own.attrs["particle_count"]), int(own.attrs["dim"])
            self._points, self._lines = int(root["NumberOfPoints"][0]), int(root["Lines/NumberOfCells"][0])
            self._cells = sum(int(root[kind]["NumberOfCells"][0]) for kind in KINDS)
            whole = min(len(root[name]) // self._points for name in (POINTS, VELOCITY))
            self.times: NDArray[np.float64] = read_times(root)[:whole]
            """Time of each frame [s], shape [frame_count]."""
            self.fps = float(own.attrs["fps"])
            """Frames per second of simulated time."""
            self.attributes: dict[str, Any] = json.loads(own["attributes"][()])
            """What made the run."""
        except (KeyError, OSError, RuntimeError, TypeError, ValueError) as error:
            self.close()
            raise ValueError(f"{self.path} is a damaged trajectory: {error}") from error

    def close(self) -> None:
        """Close the file; nothing can be read then."""
        self._file.close()

    def __enter__(self) -> Self:
        """Return itself."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close the file."""
        self.close()

    def __len__(self) -> int:
        """Return the number of frames."""
        return len(self.times)

    @cached_property
    def system(self) -> System:
        """The system as it was at the start; ValueError if that part of the file is damaged."""
        try:
            return read_system(self._file)
        except (KeyError, OSError, TypeError, ValueError) as error:
            raise ValueError(f"{self.path} is a damaged trajectory: its system cannot be read: {error}") from error

    @property
    def positions(self) -> FrameArray:
        """Particle positions [m], shape [frame_count, particle_count, d], read where they are indexed."""
        return FrameArray(self._file[ROOT][POINTS], len(self), self._points, self._particles, AXES[self._dim])

    @property
    def velocities(self) -> FrameArray:
        """Particle velocities [m/s], shape [frame_count, particle_count, d], read where they are indexed."""
        return FrameArray(self._file[ROOT][VELOCITY], len(self), self._points, self._particles, AXES[self._dim])

    @property
    def strains(self) -> FrameArray:
        """Strain of each connection, shape [frame_count, connection_count], read where it is indexed.

        Raises
        ------
        ValueError
            If the trajectory was written without it.
        """
        if STRAIN not in self._file[ROOT]:
            raise ValueError(f"{self.path} was written without strain")
        return FrameArray(self._file[ROOT][STRAIN], len(self), self._cells, self._lines)

    def frame(self, k: int) -> Frame:
        """Return frame k, from the end where k is negative; raise IndexError if there is none."""
        return Frame(float(self.times[k]), self.positions[k], self.velocities[k])

    @overload
    def __getitem__(self, k: int) -> Frame: ...
    @overload
    def __getitem__(self, k: slice) -> Iterator[Frame]: ...
    def __getitem__(self, k: int | slice) -> Frame | Iterator[Frame]:
        """Return a frame, or an iterator over those of a slice."""
        return (self.frame(i) for i in range(len(self))[k]) if isinstance(k, slice) else self.frame(k)

    def __iter__(self) -> Iterator[Frame]:
        """Return an iterator over all frames."""
        return self[:]


def _opened(path: Path) -> Any:
    """Return a trajectory's open file; raise ValueError that says what is wrong with another one."""
    import h5py

    with path.open("rb") as file:
        if file.read(8) != b"\x89HDF\r\n\x1a\n":
            raise ValueError(f"{path} is no trajectory: it is no HDF5 file")
    try:
        file = h5py.File(path, "r", locking=False)
    except OSError as error:
        reason = "it is cut short" if "truncated" in str(error) else error
        raise ValueError(f"{path} cannot be read: {reason}") from error
    wrong = fault(file)
    if wrong is not None:
        file.close()
        raise ValueError(f"{path} is no trajectory: {wrong}")
    return file
