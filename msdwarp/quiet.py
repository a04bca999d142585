"""Warp's messages, quiet unless somebody asks for them, with nothing lost that matters; threads' turns with Warp.

Warp greets, and says of each module that it was loaded, on standard output. What it says there is governed by its
own setting `warp.config.log_level`, which is turned down from its default as soon as both Warp and msdwarp are
imported, in whichever order; warnings and errors are still heard. Whoever sets that setting is respected: before
to anything but the default, afterwards to anything at all.

Importing this does not import Warp, which takes longer than all else that a script or a command imports.
"""

import contextlib
import functools
import os
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from importlib.machinery import ModuleSpec, PathFinder
from types import ModuleType
from typing import Any, ParamSpec, TypeVar

P = ParamSpec("P")
T = TypeVar("T")


class _Finder:
    """Waits on `sys.meta_path` until anybody imports Warp, and turns its messages down then.

    It stays there afterwards: another thread may be going through that list.
    """

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Return how Warp is imported; nothing of any other module."""
        spec = PathFinder.find_spec(fullname, path, target) if fullname == "warp" else None
        if spec is not None and spec.loader is not None:
            execute = spec.loader.exec_module

            def execute_and_turn_down(module: ModuleType) -> None:
                execute(module)
                _turn_down()

            spec.loader.exec_module = execute_and_turn_down
        return spec


def _turn_down() -> None:
    """Turn Warp's messages down, if they are as loud as they are by default."""
    import warp as wp

    if wp.config.log_level == wp.LOG_INFO:
        wp.config.log_level = wp.LOG_WARNING


if "warp" in sys.modules:
    _turn_down()
else:
    sys.meta_path.insert(0, _Finder())

_NO_DRIVER = b"Warp CUDA warning: Could not find or load the NVIDIA CUDA driver."
"""What Warp's C++ says, whatever its settings, where there is no GPU: nothing that needs to be known."""
_OF_A_KERNEL = 1 << 20
"""Bytes of a large kernel."""
_lock, _started = threading.Lock(), False
_turn, _next, _mine = threading.RLock(), threading.Lock(), threading.local()
"""Held by the thread whose turn it is, and by the one that comes next; whether it is this thread's."""


def verbose(on: bool = True) -> None:
    """Print Warp's messages: its devices, and each module that it compiles or loads.

    `verbose(False)` turns this off. It is a shorthand for `warp.config.log_level = warp.LOG_INFO`.
    """
    import warp as wp

    level = wp.config.log_level
    wp.config.log_level = min(level, wp.LOG_INFO) if on else max(level, wp.LOG_WARNING)


def start_warp() -> None:
    """Start Warp, if nobody has, as quietly as its setting says.

    Raises
    ------
    OSError
        If there is nowhere to keep compiled kernels; later too, where a kernel is compiled and cannot be kept.
    """
    global _started
    import warp as wp

    with _lock, _told_where():
        if _started or wp.config.log_level <= wp.LOG_INFO:
            wp.init()
        else:
            with _without(_NO_DRIVER):
                wp.init()
        if not _started:
            kind: Any = wp.Module
            kind.load = _told_where()(kind.load)
        _started = True


def in_turn(function: Callable[P, T]) -> Callable[P, T]:
    """Have threads take turns in functions that use Warp; what such a function calls is of the same turn.

    While one thread records a graph, Warp takes what others launch on that device for a part of it. What makes,
    compiles and loads kernels does not expect a second thread either: cached factories, and Warp's dictionaries.
    """

    @functools.wraps(function)
    def taking_turns(*args: P.args, **kwargs: P.kwargs) -> T:
        if getattr(_mine, "turn", False):
            return function(*args, **kwargs)
        try:
            with _next:  # who has just had a turn comes behind who waits
                _turn.acquire()
            _mine.turn = True
            return function(*args, **kwargs)
        finally:
            _mine.turn = False
            with contextlib.suppress(RuntimeError):  # interrupted before it came
                _turn.release()

    return taking_turns


def _forget_turns() -> None:
    """Begin anew in a process that was forked, which has none of the other threads."""
    global _turn, _next
    _turn, _next = threading.RLock(), threading.Lock()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_forget_turns)


@contextlib.contextmanager
def _told_where() -> Iterator[None]:
    """Say of an error where compiled kernels are kept, if nothing can be written there.

    What the compiler says of a full disk depends on which of its files did not fit. A folder that cannot be
    written to does no harm as long as it has all kernels.
    """
    try:
        yield
    except Exception as error:
        import tempfile

        import warp as wp

        folder = wp.config.kernel_cache_dir
        try:
            with tempfile.TemporaryFile(dir=folder) as file:
                file.write(bytes(_OF_A_KERNEL))
        except OSError as reason:
            raise OSError(
                f"compiled kernels cannot be written to {folder}: {reason.strerror}; the environment variable "
                "WARP_CACHE_PATH must name a folder with room for them"
            ) from error
        raise


@contextlib.contextmanager
def _without(unwanted: bytes) -> Iterator[None]:
    """Leave out lines that begin in this way of what comes to standard error meanwhile, by whichever thread.

    C++ writes to the file descriptor itself. What comes is kept in a file, and all else of it is passed on at the
    end; where that cannot be done nothing is left out.
    """
    import tempfile

    try:
        if sys.__stderr__ is None:  # closed when Python started: 2 is nobody's, or another file's
            raise OSError
        with contextlib.ExitStack() as opened:
            with contextlib.suppress(AttributeError, OSError, ValueError):  # of whatever stands in its place
                sys.stderr.flush()
            there = os.dup(2)
            opened.callback(os.close, there)
            caught = opened.enter_context(tempfile.TemporaryFile(buffering=0))
            opened = opened.pop_all()
    except OSError:  # no standard error, or no room for a file
        yield
        return
    with opened:
        os.dup2(caught.fileno(), 2)
        try:
            yield
        finally:
            os.dup2(there, 2)
            caught.seek(0)
            for line in caught.read().splitlines(keepends=True):
                if not line.startswith(unwanted):
                    with contextlib.suppress(OSError):  # nobody listens any more
                        os.write(there, line)
