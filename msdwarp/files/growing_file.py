"""The file of a trajectory while it grows: readers can open it at any moment."""

import errno
import os
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from ..bodies import System
from ..disk import replacing, reserve
from .vtkhdf import Layout, Record, Scene

About = tuple[float, dict, Scene | None]
"""Frames per second, the run's attributes, and the data of its scene."""
_SLACK = 1 << 18
"""Maximal size of HDF5's own records for one frame [bytes]."""


class GrowingFile:
    """The file of a trajectory, to which one thread appends records.

    HDF5 has no journal, so the order of writes matters: a frame's data, the number of frames, then the time. Data
    that readers of earlier frames need are not moved. HDF5 does not recover from a full disk: space is reserved.

    If an existing file is continued, its frames stay while equal frames are written again. The first different
    frame replaces all later frames, once there is space for as many.
    """

    def __init__(self, path: Path, force: bool, layout: Callable[[np.dtype], Layout], about: About):
        self.path, self.force, self._layout_for, self._about = path, force, layout, about
        self.written = 0
        """Number of frames written, or found equal in the existing file."""
        self.frame_count = self.found = 0
        """Number of frames in the file now, and when the file was reopened."""
        self._file: Any = None

    def append(self, record: Record) -> None:
        """Write a record and flush it."""
        if self._file is None:
            self._create(record)
        else:
            self._append(record)
        if record.frame is not None:
            self.written += 1
            self.frame_count = max(self.frame_count, self.written)

    def reopen(self, system: System, found: int, kept: int, until: float) -> None:
        """Open a file of `found` frames; continue after the first `kept`, and after readings up to `until` [s]."""
        _include_all_bytes(self.path)
        self._open(self.path)
        try:
            self._layout = Layout.of(self._file, system)
            self._layout.open(self._file)
            self._layout.continue_after(kept, until)
            self._layout.truncate(found)  # a killed writer may have begun the next frame
        except BaseException:
            self.close()
            raise
        self.written, self._size = kept, os.fstat(self._room).st_size
        self.frame_count = self.found = found

    def sync(self) -> None:
        """Sync the file to disk."""
        if self._file is not None:
            os.fsync(self._room)

    def close(self) -> None:
        """Close the file, and release reserved space that is unused."""
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

    def _create(self, first: Record) -> None:
        """Write a file with one frame under a temporary name, then rename the file."""
        import h5py

        if first.frame is None:
            raise ValueError("readings come before the first frame, which must be kept")
        double = first.frame.position.dtype == np.float64
        self._layout = self._layout_for(np.dtype(np.float64 if double else np.float32))
        with replacing(self.path) as unfinished:
            with h5py.File(unfinished, "w", libver=("earliest", "v108")):
                pass
            self._open(unfinished)
            try:
                arrays = () if self._about[2] is None else self._about[2][1].values()
                scene = sum(len(zlib.compress(values.tobytes(), 1)) for values in arrays)
                self._reserve(self._layout.static_size + scene)
                self._layout.begin(self._file, *self._about)
                self._layout.open(self._file)
                self._append(first)
            finally:
                self.close()
            if self.path.exists() and not self.force:
                raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST), str(self.path))
        self._open(self.path)
        self._layout.open(self._file)

    def _open(self, path: Path) -> None:
        import h5py

        # Unlocked, so that others can read meanwhile. Without a chunk cache each frame is written immediately. New
        # datasets have HDF5's format of 2016, whose chunk indices only grow; older ones move. The file itself
        # was created in the oldest format, since files in newer formats are marked while they are written, and do
        # not open after a crash.
        self._file = h5py.File(path, "r+", locking=False, rdcc_nbytes=0, libver=("v110", "v110"))
        self._at, self._room = path, os.open(path, os.O_RDWR)
        self._size = os.fstat(self._room).st_size

    def _append(self, record: Record) -> None:
        self._check_there()
        kept = record.frame is not None
        if (not kept or self.written < self.frame_count) and self._layout.holds(self.written, record):
            self._layout.append_rows(record.rows)
            return
        if self.written < self.frame_count:  # truncate here, when there is space for all frames of the old file
            later = range(self.written, self.frame_count)
            self._reserve(sum(self._layout.growth(k, record.rows) for k in later))
            self._layout.truncate(self.written)
            self.frame_count = self.written
        self._reserve(self._layout.growth(self.written, record.rows, kept))
        self._layout.append(self.written, record)
        self._size = os.fstat(self._room).st_size

    def _check_there(self) -> None:
        """Raise OSError if the open file has been moved, removed or shortened."""
        try:
            there = os.path.samestat(os.stat(self._at), os.fstat(self._room))
        except FileNotFoundError:
            there = False
        if not there:
            raise OSError("it was moved, removed or replaced meanwhile")
        if os.fstat(self._room).st_size < self._size:
            raise OSError("it was cut short meanwhile")

    def _reserve(self, size: int) -> None:
        """Reserve disk space for `size` more bytes, and for HDF5's own metadata."""
        reserve(self._room, self._file.id.get_filesize(), size + _SLACK, self._at.parent)


def _include_all_bytes(path: Path) -> None:
    """Set the end of file in the superblock to the real end, since a killed process may have written more.

    In version 0 of the superblock the end is an 8-byte number at byte 40.
    """
    with path.open("r+b") as file:
        if file.read(9)[8] == 0:
            end = file.seek(0, os.SEEK_END)
            file.seek(40)
            file.write(end.to_bytes(8, "little"))
