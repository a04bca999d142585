"""Writing trajectories: a thread writes frames to disk while a simulation continues."""

import atexit
import os
import queue
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import Any, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from .. import checks, disk
from ..bodies import Frame, System
from .growing_file import GrowingFile
from .names import as_json
from .reading_tables import Columns, ReadingTables, Rows
from .trajectory import Trajectory
from .vtkhdf import Layout, Record, Scene

SUFFIX = ".vtkhdf"
_QUEUED = 4
"""Maximal number of frames in the queue of the thread."""


class _Pending(Protocol):
    """A frame in transfer to the host, from `Readback.take`; the methods wait for its arrival."""

    @property
    def substeps(self) -> int: ...
    def arrived(self) -> tuple[Frame, NDArray | None]: ...  # with strains, if requested
    def broken_at(self) -> NDArray | None: ...
    def contact_force(self) -> NDArray | None: ...
    def release(self) -> None: ...  # called once the frame is on disk


class TrajectoryWriter:
    """Writes frames while a simulation continues: a thread flushes each frame to disk.

    The file appears with the first frame. From then on it can be opened at any time, even after the process is
    killed, and has every flushed frame.

    Parameters
    ----------
    path, force
        The file, `*.vtkhdf` (see docs/files.md); whether an existing file is replaced.
    system
        The system at the start.
    fps
        Frames passed to `write` per second of simulated time.
    frame_count
        Number of frames, if known; the file is then laid out for this number.
    compress
        Compress losslessly (gzip 1 after shuffling bytes): smaller, and several times slower.
    every
        Keep every Nth frame, starting with the first.
    strain, contact_forces
        Whether to write the strain of every connection (in a lattice far more values than positions), and the
        contact force on each particle, which `write` then requires with every frame.
    attributes
        Information about the run: numbers, texts, or lists and mappings of these, as in JSON.
    readings
        For each probe, by name: how often it is read ("frame" or "substep"), and the names of its columns.
        Readings are also written for frames that are not kept.
    scene
        Data of the surroundings for pictures: JSON data, and arrays by name.
    behind
        Continue the existing file, with its layout and attributes, after this many frames passed to `write`. Later
        frames are kept while equal frames are written again. The first different frame replaces all later frames,
        once there is space on disk for as many.

    Raises
    ------
    ValueError
        If an argument is out of range, or the file to continue has another system or lacks frames.
    FileExistsError
        If the file exists and `force` is False.
    OSError
        If the file cannot be written. Later failures, such as a full disk, are raised by the next `write` or by
        `close`, with the number of frames kept.
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
        contact_forces: bool = False,
        attributes: Mapping[str, Any] | None = None,
        readings: Columns | None = None,
        scene: Scene | None = None,
        force: bool = False,
        behind: int = 0,
    ) -> None:
        self.path = Path(path)
        if self.path.suffix != SUFFIX:
            raise ValueError(f"path is {self.path}; its name must end in {SUFFIX}")
        self._every = checks.count("every", every, 1)
        if frame_count is not None:
            frame_count = -(-checks.count("frame_count", frame_count, 1) // self._every)
        scene = None if scene is None else (as_json(scene[0]), scene[1])
        about = (checks.positive("fps", fps) / self._every, as_json(attributes or {}), scene)
        self._system, self._offered = system, checks.count("behind", behind, 0)
        if self.path.exists() and not force and not behind:
            raise FileExistsError(f"path is {self.path}, which exists; name another file or add --force")
        stored: dict[str, Any] = {"compress": compress, "strain": strain, "contact_forces": contact_forces}
        layout = partial(Layout, system, frame_count=frame_count, readings=readings, **stored)
        self._contact_forces = contact_forces
        self._widths = ReadingTables(readings or {}).widths
        self._file = GrowingFile(self.path, force, layout, about)
        if behind:
            kept = -(-behind // self._every)
            found = _check_continuation(self.path, system, about[0], kept, readings)
            self._file.reopen(system, found, kept, (behind - 1) / fps)
        else:
            disk.writable_folder("path", self.path, self.path.parent)
        self._error: Exception | None = None
        self._raised = self._ended = False
        self._queue: queue.Queue[tuple[_Pending | None, Record] | None] = queue.Queue(_QUEUED)
        self._thread = threading.Thread(target=self._work, name=f"writes {self.path.name}", daemon=True)
        # At exit the last registered function runs first: this file must close before HDF5, registered on import.
        import h5py  # noqa: F401

        atexit.register(self.close)
        self._thread.start()

    @property
    def frame_count(self) -> int:
        """Number of frames in the file so far."""
        return self._file.frame_count

    @property
    def has_fewer(self) -> bool:
        """Whether the file has fewer frames than when reopened, because new frames replace the old."""
        return self.frame_count < self._file.found

    def write(
        self,
        frame: tuple[float, NDArray, NDArray],
        strain: NDArray | None = None,
        broken_at: NDArray | None = None,
        readings: Rows = MappingProxyType({}),
        contact_force: NDArray | None = None,
    ) -> None:
        """Write a frame: time [s], positions [m] and velocities [m/s], shape [particle_count, d] each.

        The call waits while four frames are queued. Do not change the arrays afterwards. If `strain`, shape
        [connection_count], is not given, it is computed from the positions and the system's rest lengths.
        `broken_at`, of the same shape, has the times at which connections broke [s], inf if unbroken; it is stored
        if the system can tear. `readings` are new rows of the tables "frame" and "substep": times [s], followed by
        the values of all probes read that often, in order. `contact_force` [N] has shape [particle_count, d].

        Raises ValueError if the time is not finite, an array has the wrong shape or the writer is closed, and
        OSError if an earlier frame could not be written.
        """
        frame, system = Frame(*frame), self._system
        checks.between("time", frame.time, -checks.LARGEST, checks.LARGEST)
        given = {"position": frame.position, "velocity": frame.velocity}
        optional = {"contact_force": contact_force, "strain": strain, "broken_at": broken_at}
        given |= {name: values for name, values in optional.items() if values is not None}
        for name, values in given.items():
            shape = (system.rest_length if name in ("strain", "broken_at") else system.position).shape
            if np.shape(values) != shape:
                raise ValueError(f"{name} has shape {np.shape(values)}; it must be {shape}")
        if self._contact_forces and contact_force is None:
            raise ValueError("contact_force is None; the file is laid out for contact forces in each frame")
        kept = self.wants_next()
        self._enqueue(None, Record(frame if kept else None, strain, 0, broken_at, contact_force, readings))

    def wants_next(self) -> bool:
        """Return whether the next frame will be kept; raise as `write` does."""
        self._raise_error(again=True)
        if self._ended:
            raise ValueError(f"{self.path} is closed; frames must be written before")
        return self._offered % self._every == 0

    def write_pending(self, frame: _Pending | None, readings: Rows = MappingProxyType({})) -> None:
        """Write a frame in transfer, or None if `wants_next` is false; otherwise as `write`."""
        kept = self.wants_next()
        if kept and frame is None:
            raise ValueError("frame is None; this frame must be kept")
        self._enqueue(frame if kept else None, Record(None, rows=readings))

    def _enqueue(self, pending: _Pending | None, record: Record) -> None:
        """Queue readings and, if it is kept, the frame for the thread."""
        for every, rows in record.rows.items():
            checks.one_of("a name in readings", every, tuple(self._widths))
            if np.ndim(rows) != 2 or rows.shape[1] != self._widths[every]:
                width = self._widths[every]
                raise ValueError(f"readings[{every!r}] has shape {np.shape(rows)}; it must be (any, {width})")
        if pending is not None or record.frame is not None or record.rows:
            self._queue.put((pending, record))
        self._offered += 1

    def flush(self) -> None:
        """Wait until all frames so far are synced to disk; raise OSError if a frame could not be written."""
        self._queue.join()
        self._raise_error(again=True)
        self._file.sync()

    def close(self) -> None:
        """Wait until all frames are written, and close the file; raise an OSError that `write` has not raised."""
        if not self._ended:
            self._queue.put(None)
            self._ended = True  # not earlier, since an interrupt may come while the queue is full
        self._thread.join()
        atexit.unregister(self.close)
        self._raise_error(again=False)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _raise_error(self, *, again: bool) -> None:
        """Raise the writing thread's error, if any; an error that was raised before only if `again`."""
        if self._error is not None and (again or not self._raised):
            self._raised = True
            raise self._error

    def _work(self) -> None:
        """Write queued records; after an error, only release their memory."""
        while (queued := self._queue.get()) is not None:
            pending, record = queued
            with self._error_kept():
                if pending is not None and self._error is None:
                    arrived = (*pending.arrived(), pending.substeps, pending.broken_at(), pending.contact_force())
                    record = Record(*arrived, rows=record.rows)
                if self._error is None:
                    self._file.append(record)
            if pending is not None:
                pending.release()
            self._queue.task_done()
        with self._error_kept():
            self._file.close()

    @contextmanager
    def _error_kept(self) -> Iterator[None]:
        """Store the first error, which `write` or `close` will raise."""
        try:
            yield
        except Exception as error:
            self._error = self._error or self._explained(error)

    def _explained(self, error: Exception) -> Exception:
        """Return an error that names the file and the number of kept frames."""
        if not isinstance(error, OSError | RuntimeError):  # HDF5's errors are of these types
            return error
        n, number = self.frame_count, getattr(error, "errno", None)
        reason = os.strerror(number) if number else str(error)
        kept = f"its first {n} frame{'s are' if n > 1 else ' is'} kept" if n else "nothing was kept"
        kept = kept if self.path.exists() or not n else "what it held went with it"
        explained = OSError(f"{self.path} could not be written further: {reason}; {kept}")
        explained.__cause__ = error
        return explained


def _check_continuation(path: Path, system: System, fps: float, kept: int, readings: Columns | None) -> int:
    """Return a file's number of frames; raise ValueError if less than `kept`, or for other systems or probes."""
    with Trajectory(path) as found:
        if len(found) < kept:
            raise ValueError(
                f"{path} has {len(found)} frames; to go on behind frame {kept - 1}, it must have {kept}"
            )
        if found.fps != fps:
            raise ValueError(f"fps is {fps:g}; {path} has {found.fps:g} frames per second")
        own = found.system
        if own.position.shape != system.position.shape or not np.array_equal(own.connections, system.connections):
            raise ValueError(f"{path} is of another system")
        if found.probes is not None and found.probes != ReadingTables(readings or {}).columns:
            raise ValueError(f"{path} has readings of other probes: {', '.join(found.probes)}")
        return len(found)
