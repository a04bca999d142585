"""Substeps of a frame that are recorded once and repeated by the device."""

from collections.abc import Callable

import warp as wp

from ...kernels.threads import count_down

DIFFERENT = 2
"""The first substeps of a frame differ from the others; so does the last one."""
ON_CPU, ON_GPU = 2, 16
"""How many substeps are repeated: recording each takes 1 ms, and a GPU's repetition 10 µs.

After an even number the state is again in the arrays where it began. A GPU's number is a multiple of the substeps
between two decisions whether to search for contact.
"""


def repetitions(substeps: int, repeated: int) -> int:
    """Return how often the device repeats `repeated` substeps of a frame; 0 if not more than once."""
    times = (substeps - DIFFERENT - 1) // repeated if repeated else 0
    return times if times > 1 else 0


def repeat(self, times: int, launch: Callable[[], None]) -> None:
        """Record launches that each thread runs this many times."""
        assert self.is_recording
        outer, self._launches = self._launches, []
        repeat(self._left[0], times, launch)
        inner, self._launches = self._launches, outer
        self._launches.append(lambda k: repeat(self._left[k], times, lambda: [one(k) for one in inner]))

    def _launch(self, launch: Callable[[int], None]) -> None:
        self._launches.append(launch)
        launch(0)

    def _launch_barrier(self, k: int) -> None:
        wp.launch(wait_for_all, 1, [self._parts[k]], device=self._barrier.device)

    def _launch_all(self, k: int) -> None:
        for launch in self._launches:
            launch(k)

    def record(self, launch_frame: Callable[[], None]) -> "PartitionedGraph":
        """Record a frame: all launches for the first thread, and the parts of the others."""
        self._launches, self.is_recording = [], True
        try:
            graphs = [record(launch_frame, self._barrier.device)]
        finally:
            self.is_recording = False
        for k in range(1, self.threads):
            graphs.append(record(partial(self._launch_all, k), self._barrier.device))
        return PartitionedGraph(graphs, self._barrier, self._launches)


class PartitionedGraph:
    """A recorded frame: a graph for each thread."""

    def __init__(self, graphs: list[Any], barrier: wp.array, launches: Any) -> None:
        self._graphs, self._barrier = graphs, barrier.numpy()
        self._alive = barrier, launches  # the graphs read this memory

    def replay(self) -> None:
        """Replay all graphs, each on a thread of its own; return when all are done."""
        replay_together(self._graphs, partial(self._barrier.fill, 0), self._abort)

    def _abort(self) -> None:
        """Make all threads leave their barriers, because one has failed."""
        self._barrier[ABORT] = 1


def repeat(left: wp.array, times: int, launch: Callable[[], object]) -> None:
    """Record launches that run `times` times, at least once; `left`, shape [1], counts down."""

    def launch_once() -> None:
        launch()
        wp.launch(count_down, 1, [left], device=left.device)

    left.fill_(times)
    wp.capture_while(left, launch_once)
