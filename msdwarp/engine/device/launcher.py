"""Launcher: makes launches that CPU threads may divide."""

from collections.abc import Callable

import warp as wp


class Launcher:
    """Makes launches for one thread; `CpuPartition` divides them among CPU threads while it records a frame."""

    def launch_if(self, condition: wp.array, launch: Callable[[], None]) -> None:
        """Make launches by `launch` that are run only if `condition`, shape [1], is not 0."""
        wp.capture_if(condition, launch)

    def launch_parts(self, launch_part: Callable[[int, int], None]) -> None:
        """Let each thread launch its part, by `launch_part(thread, thread_count)`."""
        launch_part(0, 1)
