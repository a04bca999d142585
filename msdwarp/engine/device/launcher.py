"""Launcher: the interface by which effects divide a launch among CPU threads."""

from collections.abc import Callable
from typing import Protocol

import warp as wp


class Launcher(Protocol):
    """Divides launches among CPU threads; implemented by `CpuPartition`."""

    is_recording: bool
    """Whether launches are recorded for all threads."""

    def launch_if(self, condition: wp.array, launch: Callable[[], None]) -> None:
        """Call `launch` to record launches that each thread runs only if `condition`, shape [1], is not 0."""

    def launch_parts(self, launch_part: Callable[[int, int], None]) -> None:
        """Let each thread launch its part, by `launch_part(thread, thread_count)`."""
