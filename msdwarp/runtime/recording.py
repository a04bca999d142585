"""Recording launches as a graph that is replayed by one call."""

import gc
import threading
from collections.abc import Callable
from typing import Any

CAPTURE_LOCK = threading.Lock()
"""Held while a graph is recorded: no thread may then wait for a device."""


def record(launch: Callable[[], None], device: Any, **how: Any) -> Any:
    """Return a graph of a function's launches on a device; keyword arguments are passed to `wp.ScopedCapture`.

    Python's garbage collector is off meanwhile: it could free the memory of a dropped simulation, which spoils a
    recording.
    """
    import warp as wp

    with CAPTURE_LOCK:
        collects = gc.isenabled()
        gc.disable()
        try:
            with wp.ScopedCapture(device=device, **how) as capture:
                launch()
        finally:
            if collects:
                gc.enable()
    return capture.graph
