"""Launcher: the interface by which effects divide a launch among CPU threads."""

from collections.abc import Callable
from typing import Protocol


class Launcher(Protocol):
    """Divides launches among CPU threads; implemented by `CpuPartition`."""

    is_recording: bool
    """Whether launches are recorded for all threads."""

    def launch_parts(self, launch_part: Callable[[int, int], None]) -> None:
        """Let each thread launch its part, by `launch_part(thread, thread_count)`."""
