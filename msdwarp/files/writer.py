"""Writing trajectories: frames go to disk beside the simulation, in a file that opens at any moment."""

import atexit
import os
import queue
import threading
from collections.abc import Callable, Mapping
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
from .stored_system import DAMPERS
from .trajectory import Trajectory
from .vtkhdf import Layout, Scene

SUFFIX = ".vtkhdf"
_QUEUED = 4
"""Frames that wait for the thread at most."""


class Pending(Protocol):
    """A frame that is still on its way to the host."""

    @property
    def substeps(self) -> int:
        """How many it took; 0 where that is unknown."""
        ...

    def arrived(self) -> tuple[Frame, NDArray | None]:
        """Wait for it; return it, and the strains of the connections if they come with it."""
        ...

    def broken_at(self) -> NDArray | None:
        """Wait for it; return when connections broke [s], inf where they are whole, if any can."""
        ...

    def contact_force(self) -> NDArray | None:
        """Wait for it; return what contacts push each particle with [N], if that comes with it."""
        ...

    def release(self) -> None:
        """Have its memory back: the frame is on disk."""
        ...


class TrajectoryWriter:
    """Writes frames while the simulation continues: a thread takes them from a queue and flushes each to disk.

    The file appears with the first frame. From then on it can be opened at any time, even after the process was
    killed, and has every flushed frame.

    Parameters
    ----------
    path
        The file, `*.vtkhdf`; see docs/files.md for what is in it.
    system
        The system at the start.
    fps
        Frames per second of simulated time that are passed to `write`.
    frame_count
        Number of frames, if known; the file is then laid out for this number.
    compress
        Compress losslessly (gzip 1 after shuffling bytes): smaller, and several times slower.
    every
        Keep every Nth frame, starting with the first.
    strain
        Write the strain of every connection. In a lattice these are many more numbers than the positions.
    contact_forces
        Write the contact force on each particle; it must then be given with every frame.
    attributes
        Information about the run: numbers, texts, or lists and mappings of these, as in JSON.
    readings
        For each probe, by name: how often it is read ("frame" or "substep"), and the names of its columns.
        Readings of all frames are written, including frames that are not kept. `Trajectory.readings` returns them.
    scene
        Data of the surroundings for pictures: JSON data, and arrays by name. `Trajectory.scene` returns it.
    force
        Replace an existing file.
    behind
        Continue the existing file after this many frames that were passed to `write`. Later frames in it stay as
        long as the same ones are written again, and are dropped where another one is, once there is room on disk
        for as many. Its layout and attributes stay the same.

    Raises
    ------
    ValueError
        If an argument is out of range, the name does not end in .vtkhdf, or the file to continue has another
        system or lacks frames.
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
        if type(system.damper).__name__ not in DAMPERS:
            raise ValueError(f"damper is {system.damper!r}; a file can hold {', '.join(DAMPERS)}")
        self._every = checks.count("every", every, 1)
        if frame_count is not None:
            frame_count = -(-checks.count("frame_count", frame_count, 1) // self._every)
        scene = None if scene is None else (as_json(scene[0]), scene[1])
        about = (checks.positive("fps", fps) / self._every, as_json(attributes or {}), scene)
        self._system, self._offered = system, checks.count("behind", behind, 0)
        if self.path.exists() and not force and not behind:
            raise FileExistsError(f"path is {self.path}, which exists; name another file or add --force")
        layout = partial(
            Layout,
            system,
            frame_count=frame_count,
            compress=compress,
            strain=strain,
            readings=readings,
            contact_forces=contact_forces,
        )
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
        self._told = self._ended = False
        self._queue: queue.Queue[tuple[Pending | None, Rows] | None] = queue.Queue(_QUEUED)
        self._thread = threading.Thread(target=self._work, name=f"writes {self.path.name}", daemon=True)
        # What is registered last is done first at exit: this file is to end before HDF5, registered on import.
        import h5py  # noqa: F401

        atexit.register(self.close)
        self._thread.start()

    @property
    def frame_count(self) -> int:
        """Frames in the file so far."""
        return self._file.frame_count

    @property
    def has_fewer(self) -> bool:
        """Whether the file has fewer frames than when it was opened to be continued, as others came in between."""
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

        It waits while four frames are queued. Do not change the arrays afterwards. If `strain`, shape
        [connection_count], is not given, it is computed from the positions and the system's rest lengths.
        `broken_at`, of the same shape, is when connections broke [s], inf if they are whole; it is stored if the
        system can tear. `readings` are the new rows of the tables "frame" and "substep": times [s], followed by
        the numbers of all such probes, in order. `contact_force` is the contact force on each particle [N], shape
        [particle_count, d], stored if `contact_forces` is set.

        Raises
        ------
        ValueError
            If an array has the wrong shape, or the writer is closed.
        OSError
            If an earlier frame could not be written.
        """
        frame = Frame(*frame)
        vectors = {"position": frame.position, "velocity": frame.velocity}
        if contact_force is not None:
            vectors["contact_force"] = contact_force
        for name, values in vectors.items():
            _check_shape(name, values, self._system.position.shape)
        for name, given in (("strain", strain), ("broken_at", broken_at)):
            if given is not None:
                _check_shape(name, given, self._system.rest_length.shape)
        if self._contact_forces and contact_force is None:
            raise ValueError(
                "contact_force is None; the file is laid out for what contacts push particles with, which must be "
                "in each frame"
            )
        kept = self.wants_next()
        self._hand_over(_Arrived(frame, strain, broken_at, contact_force) if kept else None, readings)

    def wants_next(self) -> bool:
        """Return whether the next frame will be kept; raise as `write` does."""
        self._tell(again=True)
        if self._ended:
            raise ValueError(f"{self.path} is closed; frames must be written before")
        return self._offered % self._every == 0

    def write_pending(self, frame: Pending | None, readings: Rows = MappingProxyType({})) -> None:
        """Write a frame that is still being copied, or None if `wants_next` is false; else as `write`."""
        kept = self.wants_next()
        if kept and frame is None:
            raise ValueError("frame is None; this frame must be kept")
        self._hand_over(frame if kept else None, readings)

    def _hand_over(self, frame: Pending | None, readings: Rows) -> None:
        """Hand a frame, if it is kept, and its readings to the thread."""
        for every, rows in readings.items():
            checks.one_of("a name in readings", every, tuple(self._widths))
            if np.ndim(rows) != 2 or rows.shape[1] != self._widths[every]:
                width = self._widths[every]
                raise ValueError(f"readings[{every!r}] has shape {np.shape(rows)}; it must be (any, {width})")
        if frame is not None or readings:
            self._queue.put((frame, readings))
        self._offered += 1

    def flush(self) -> None:
        """Wait until all frames so far are synced to disk.

        Raises
        ------
        OSError
            If a frame could not be written.
        """
        self._queue.join()
        self._tell(again=True)
        self._file.sync()

    def close(self) -> None:
        """Wait until all frames are written, and close the file. It may be called again.

        Raises
        ------
        OSError
            If a frame could not be written and `write` has not raised it yet.
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
        while (handed := self._queue.get()) is not None:
            frame, rows = handed
            if self._error is None:
                self._attempt(partial(self._append, frame, rows))
            if frame is not None:
                frame.release()
            self._queue.task_done()
        self._attempt(self._file.close)

    def _append(self, frame: Pending | None, rows: Rows) -> None:
        """Write a frame with its readings, or readings alone."""
        if frame is None:
            self._file.append_rows(rows)
        else:
            self._file.append(*frame.arrived(), frame.substeps, frame.broken_at(), rows, frame.contact_force())

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
        kept = kept if self.path.exists() or not n else "what it held went with it"
        explained = OSError(f"{self.path} could not be written further: {reason}; {kept}")
        explained.__cause__ = error
        return explained


def _check_shape(name: str, values: NDArray, shape: tuple[int, ...]) -> None:
    if np.shape(values) != shape:
        raise ValueError(f"{name} has shape {np.shape(values)}; it must be {shape}")


def _check_continuation(path: Path, system: System, fps: float, kept: int, readings: Columns | None) -> int:
    """Return how many frames a file has; raise ValueError unless so many are of this system, with these probes."""
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


class _Arrived:
    """A frame that was on the host from the start."""

    def __init__(
        self, frame: Frame, strain: NDArray | None, broken_at: NDArray | None, contact_force: NDArray | None
    ) -> None:
        self._both, self.substeps = (frame, strain), 0
        self._broken_at, self._contact_force = broken_at, contact_force

    def arrived(self) -> tuple[Frame, NDArray | None]:
        return self._both

    def broken_at(self) -> NDArray | None:
        return self._broken_at

    def contact_force(self) -> NDArray | None:
        return self._contact_force

    def release(self) -> None:
        pass
