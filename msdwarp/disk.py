"""Files that get their final name only when they are complete, and locks on folders."""

import errno
import importlib.util
import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

TRAJECTORY = "trajectory.vtkhdf"
"""The file of frames in the folder of a run."""
_MARK = ".unfinished"


def writable_folder(name: str, value: Path, folder: Path) -> None:
    """Create a folder if it is missing; raise OSError, which names the argument, if it cannot be written to."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        reason = "it is no folder" if folder.exists() and not folder.is_dir() else error.strerror or error
        raise OSError(f"{name} is {value}, which cannot be written to: {reason}") from error


@contextmanager
def replacing(path: Path, *, durable: bool = False) -> Iterator[Path]:
    """Yield a temporary path beside `path`, with the same ending; a file written there becomes `path` at the end.

    After an error or a signal `path` stays unchanged, and no temporary file is left. If `durable`, a power cut
    also leaves either the whole old file or the whole new one.
    """
    unfinished = path.with_name(f".{path.stem}{_MARK}{path.suffix}")
    try:
        yield unfinished
        if durable:
            _sync(unfinished, os.O_RDWR)  # Windows syncs only files that are open for writing
        os.replace(unfinished, path)
    finally:
        unfinished.unlink(missing_ok=True)
    if durable and hasattr(os, "O_DIRECTORY"):  # sync the folder, which holds the name
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
    """Within this context, replace an OSError by one whose message names this file, unless it names one."""
    try:
        yield
    except OSError as error:
        if isinstance(error.__cause__, OSError):  # raised here before, of a file that is written meanwhile
            raise
        raise OSError(f"{path} {failed}: {error.strerror or error}") from error


@contextmanager
def writing(path: Path) -> Iterator[Path]:
    """Yield a temporary path as `replacing` does; an OSError names the file."""
    with failure_named(path), replacing(path) as unfinished:
        yield unfinished


def is_unfinished(path: Path) -> bool:
    """Return whether a killed process left this file unfinished."""
    return path.name.startswith(".") and _MARK in path.name


def reserve(number: int, start: int, size: int, folder: Path) -> None:
    """Reserve disk space for an open file in `folder`, from byte `start` on; raise OSError if the disk is full."""
    try:
        os.posix_fallocate(number, start, size)
        return
    except AttributeError:
        pass  # the system cannot reserve space
    except OSError as error:
        if error.errno not in (errno.EOPNOTSUPP, errno.ENOSYS, errno.EINVAL):  # the disk cannot reserve space
            raise
    if shutil.disk_usage(folder).free < size:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


@contextmanager
def alone_in(folder: Path | None) -> Iterator[None]:
    """Within this context, keep other runs from writing in a folder; raise ValueError if one is writing now.

    The lock is on the folder, and ends with the process, even if that is killed. On systems without locks nothing
    happens.
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
