"""Recording launches as a graph that is replayed by one call."""

import threading
from collections.abc import Callable
from typing import Any

from .turns import deferring_signals

CAPTURE_LOCK = threading.Lock()
"""Held while a graph is recorded: no thread may then wait for a device."""


def record(launch: Callable[[], None], device: Any, **how: Any) -> Any:
    """Return a graph of a function's launches on a device; keyword arguments are passed to `wp.ScopedCapture`.

    No signal's handler is called meanwhile: what it raises could leave Warp's recording open. Memory that is
    dropped meanwhile Warp frees after the recording.
    """
    import warp as wp

    with deferring_signals(), CAPTURE_LOCK, wp.ScopedCapture(device=device, **how) as capture:
        launch()
    return capture.graph
