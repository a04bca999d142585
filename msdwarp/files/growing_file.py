"""The file of a trajectory while it grows: it opens at any moment."""

import errno
import os
import zlib
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..bodies import Frame, System
from ..disk import replacing, reserve
from .reading_tables import Rows
from .vtkhdf import Layout, Scene

About = tuple[float, dict, Scene | None]
"""Frames per second, what made the run, and what pictures need of its scene."""
_SLACK = 1 << 18
"""Bytes that HDF5's own records of one frame can take."""


class GrowingFile:
    """The file, which one thread fills.

    HDF5 keeps no journal, so that order is all: a frame's data reach the file first, then the number of frames,
    then the frame's time; and nothing moves that a reader of earlier frames needs. Room on disk is reserved
    before HDF5 learns of a frame, as HDF5 does not recover from a disk that is full.

    Where it goes on, frames that come again as they are there already are left as they are. From the first one on
    that does not, others come in their place, once there is room for as many.
    """

    def __init__(self, path: Path, force: bool, layout: Callable[[np.dtype], Layout], about: About):
        self.path, self.force, self._layout_for, self._about = path, force, layout, about
        self.written = 0
        """Frames that were written, or found to be there."""
        self.frame_count = self.found = 0
        """Frames in the file, and those that it was reopened with."""
        self._file: Any = None

    def append(
        self,
        frame: Frame,
        strain: NDArray | None,
        substeps: int,
        broken_at: NDArray | None,
        rows: Rows,
        contact_force: NDArray | None = None,
    ) -> None:
        """Write a frame, and what probes told since the one before, and flush it."""
        one = partial(self._append, frame, strain, substeps, broken_at, rows, contact_force)
        if self._file is None:
            self._create(frame.position.dtype == np.float64, one)
        else:
            one()
        self.written += 1
        self.frame_count = max(self.frame_count, self.written)

    def append_rows(self, rows: Rows) -> None:
        """Write what probes told in a frame that is not kept, and flush it."""
        if self._file is None:
            raise ValueError("readings come before the first frame, which must be kept")
        self._check_there()
        if self._layout.holds_rows(rows):
            self._layout.append_rows(rows)
            return
        self._drop_what_follows(rows)
        self._reserve(self._layout.growth_by(rows))
        self._layout.append_rows(rows)
        self._size = os.fstat(self._room).st_size

    def reopen(self, system: System, found: int, kept: int, until: float) -> None:
        """Open the file of so many frames, to go on behind the first of them, and readings up to a time [s]."""
        _count_in_all(self.path)
        self._open(self.path)
        try:
            self._layout = Layout.of(self._file, system)
            self._layout.open(self._file)
            self._layout.go_on_behind(kept, until)
            self._layout.truncate(found)  # a killed writer may have begun another
        except BaseException:
            self.close()
            raise
        self.written, self._size = kept, os.fstat(self._room).st_size
        self.frame_count = self.found = found

    def sync(self) -> None:
        """Have the system put on the disk what it was given."""
        if self._file is not None:
            os.fsync(self._room)

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

    def _create(self, double: bool, append_first: Callable[[], None]) -> None:
        """Write a file of one frame, and only then give it its name."""
        import h5py

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
                append_first()
            finally:
                self.close()
            if self.path.exists() and not self.force:
                raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST), str(self.path))
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
        self._size = os.fstat(self._room).st_size

    def _append(
        self,
        frame: Frame,
        strain: NDArray | None,
        substeps: int,
        broken_at: NDArray | None,
        rows: Rows,
        contact_force: NDArray | None,
    ) -> None:
        self._check_there()
        what = self.written, frame, strain, substeps, broken_at, rows, contact_force
        if self.written < self.frame_count and self._layout.holds(*what):
            self._layout.append_rows(rows)
            return
        self._drop_what_follows(rows)
        self._reserve(self._layout.growth(self.written, rows))
        self._layout.append(*what)
        self._size = os.fstat(self._room).st_size

    def _drop_what_follows(self, rows: Rows) -> None:
        """Let the file end here, once there is room for as many frames as it has."""
        if self.written < self.frame_count:
            behind = range(self.written, self.frame_count)
            self._reserve(sum(self._layout.growth(k, rows) for k in behind))
            self._layout.truncate(self.written)
            self.frame_count = self.written

    def _check_there(self) -> None:
        """Raise OSError unless the file is where it was, and as long."""
        try:
            there = os.path.samestat(os.stat(self._at), os.fstat(self._room))
        except FileNotFoundError:
            there = False
        if not there:
            raise OSError("it was moved, removed or replaced meanwhile")
        if os.fstat(self._room).st_size < self._size:
            raise OSError("it was cut short meanwhile")

    def _reserve(self, size: int) -> None:
        """Make sure that the disk has room for so many more bytes, and for HDF5's own records."""
        reserve(self._room, self._file.id.get_filesize(), size + _SLACK, self._at.parent)


def _count_in_all(path: Path) -> None:
    """Make HDF5 count in all bytes that a file has, so that what comes next is laid behind them.

    A process that was killed may have written beyond what the file's first record, its superblock of version 0,
    says is its end: HDF5 would lay something else there. The end is the number of 8 bytes at byte 40.
    """
    with path.open("r+b") as file:
        if file.read(9)[8] == 0:
            end = file.seek(0, os.SEEK_END)
            file.seek(40)
            file.write(end.to_bytes(8, "little"))
