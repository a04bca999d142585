"""Recording launches as a graph that is replayed by one call."""

import gc
import threading
import time
from collections.abc import Callable
from typing import Any

from .turns import deferring_signals, is_collecting, is_collecting_here, waiting

CAPTURE_LOCK = threading.Lock()
"""Held while a graph is recorded: no thread may then wait for a device."""
PATIENCE = 1.0
"""Longest wait for a collection of garbage [s]: one of its finalizers could itself wait for this thread."""


def record(launch: Callable[[], None], device: Any, **how: Any) -> Any:
    """Return a graph of a function's launches on a device; keyword arguments are passed to `wp.ScopedCapture`.

    No garbage is collected meanwhile, by any thread: that could free the memory of a dropped simulation, which
    spoils a recording. Nor is a signal's handler called: what it raises could leave Warp's recording open.
    """
    import warp as wp

    with deferring_signals(), CAPTURE_LOCK:
        collects = gc.isenabled()
        gc.disable()
        try:
            _wait_for_collection()
            with wp.ScopedCapture(device=device, **how) as capture:
                launch()
        finally:
            if collects:
                gc.enable()
    return capture.graph


def _wait_for_collection() -> None:
    """Wait while another thread collects garbage: as it frees memory, Python lets other threads run."""
    end = time.monotonic() + PATIENCE
    while is_collecting() and not is_collecting_here() and not waiting and time.monotonic() < end:
        time.sleep(1e-4)
