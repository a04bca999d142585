"""Files that have their name only once they are whole; the lock on a folder."""

import errno
import importlib.util
import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

TRAJECTORY = "trajectory.vtkhdf"
"""The file in the folder of a run that has its frames."""
_MARK = ".unfinished"


def writable_folder(name: str, value: Path, folder: Path) -> None:
    """Create a folder where it is missing; raise OSError, which names the argument, if it cannot be written to."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        reason = "it is no folder" if folder.exists() and not folder.is_dir() else error.strerror or error
        raise OSError(f"{name} is {value}, which cannot be written to: {reason}") from error


@contextmanager
def replacing(path: Path, *, durable: bool = False) -> Iterator[Path]:
    """Give another name beside `path`, with the same ending: what is written there becomes `path` at the end.

    Where that fails, by an error or a signal, `path` stays as it is, and nothing is left beside it. If it is to be
    `durable`, a power cut leaves the whole old file or the whole new one too.
    """
    unfinished = path.with_name(f".{path.stem}{_MARK}{path.suffix}")
    try:
        yield unfinished
        if durable:
            _sync(unfinished, os.O_RDWR)  # Windows syncs only what is open for writing
        os.replace(unfinished, path)
    finally:
        unfinished.unlink(missing_ok=True)
    if durable and hasattr(os, "O_DIRECTORY"):  # the name is in the folder
        _sync(path.parent, os.O_RDONLY | os.O_DIRECTORY)


def _sync(path: Path, flags: int) -> None:
    """Write all buffers of a file or a folder to the disk."""
    number = os.open(path, flags)
    try:
        os.fsync(number)
    finally:
        os.close(number)


@contextmanager
def failure_named(path: Path, failed: str = "could not be written") -> Iterator[None]:
    """Raise OSError that names a file for one that does not."""
    try:
        yield
    except OSError as error:
        raise OSError(f"{path} {failed}: {error.strerror or error}") from error


def is_unfinished(path: Path) -> bool:
    """Tell whether a killed process left this file unfinished."""
    return path.name.startswith(".") and _MARK in path.name


def reserve(number: int, start: int, size: int, folder: Path) -> None:
    """Take room on the disk for an open file in `folder`, from byte `start` on; raise OSError if there is none."""
    try:
        os.posix_fallocate(number, start, size)
        return
    except AttributeError:
        pass  # a system that cannot reserve
    except OSError as error:
        if error.errno not in (errno.EOPNOTSUPP, errno.ENOSYS, errno.EINVAL):  # a disk that cannot
            raise
    if shutil.disk_usage(folder).free < size:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


@contextmanager
def alone_in(folder: Path | None) -> Iterator[None]:
    """Keep other runs from writing in a folder meanwhile; raise ValueError if one does already.

    The lock is on the folder, and goes with the process, however that ends. Where there are none it does nothing.
    """
    if folder is None or importlib.util.find_spec("fcntl") is None:
        yield
        return
    import fcntl

    number = os.open(folder, os.O_RDONLY)
    try:
        try:
            fcntl.flock(number, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise ValueError(f"another run is writing in {folder}; wait for it, or name another folder") from error
        except OSError:
            pass
        yield
    finally:
        os.close(number)
