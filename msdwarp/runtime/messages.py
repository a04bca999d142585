"""Warp's messages: quiet by default, except for warnings and errors.

Warp prints a greeting, and a line for each module that it loads. As soon as both Warp and msdwarp are imported, in
any order, the setting `warp.config.log_level` is lowered, if it has its default. A user's own setting stays,
whether made before or later. Importing this file does not import Warp, which takes long.
"""

import contextlib
import os
import sys
import threading
from collections.abc import Iterator, Sequence
from importlib.machinery import ModuleSpec, PathFinder
from types import ModuleType

from .kernel_cache import cache_named, watch_loading


class _Finder:
    """Reduces Warp's messages when it is imported.

    It stays on `sys.meta_path` afterwards, since another thread may be iterating over that list.
    """

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Return Warp's module specification, None for other modules."""
        spec = PathFinder.find_spec(fullname, path, target) if fullname == "warp" else None
        if spec is not None and spec.loader is not None:
            execute = spec.loader.exec_module

            def execute_and_turn_down(module: ModuleType) -> None:
                execute(module)
                _turn_down()

            spec.loader.exec_module = execute_and_turn_down
        return spec


def _turn_down() -> None:
    """Reduce Warp's messages, if their level is the default."""
    import warp as wp

    if wp.config.log_level == wp.LOG_INFO:
        wp.config.log_level = wp.LOG_WARNING


if "warp" in sys.modules:
    _turn_down()
else:
    sys.meta_path.insert(0, _Finder())

_NO_DRIVER = b"Warp CUDA warning: Could not find or load the NVIDIA CUDA driver."
"""A message of Warp's C++ on machines without a GPU, which its settings do not turn off."""
_lock, _started = threading.Lock(), False


def verbose(on: bool = True) -> None:
    """Print Warp's messages: its devices, and each module that it compiles or loads.

    `verbose(False)` turns this off. It is a shorthand for `warp.config.log_level = warp.LOG_INFO`.
    """
    import warp as wp

    level = wp.config.log_level
    wp.config.log_level = min(level, wp.LOG_INFO) if on else max(level, wp.LOG_WARNING)


def start_warp() -> None:
    """Start Warp, if it has not started, with the messages that its setting allows.

    Raises OSError if compiled kernels cannot be stored, now or when one is compiled later.
    """
    global _started
    import warp as wp

    with _lock, cache_named():
        if _started or wp.config.log_level <= wp.LOG_INFO:
            wp.init()
        else:
            with _without(_NO_DRIVER):
                wp.init()
        if not _started:
            watch_loading(wp.Module)
        _started = True


@contextlib.contextmanager
def _without(unwanted: bytes) -> Iterator[None]:
    """Within this context, remove lines with this beginning from standard error, of all threads.

    C++ writes directly to the file descriptor. So it is redirected to a file, whose other lines are passed on at
    the end. If that is not possible, nothing is removed.
    """
    import tempfile

    try:
        if sys.__stderr__ is None:  # closed when Python started: 2 may be another file's
            raise OSError
        with contextlib.ExitStack() as opened:
            with contextlib.suppress(AttributeError, OSError, ValueError):  # of whatever replaces it
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
                    with contextlib.suppress(OSError):  # it was closed
                        os.write(there, line)
