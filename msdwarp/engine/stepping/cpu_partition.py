"""CpuPartition: divides a body's particles among CPU threads; each thread has its own launches."""

import ctypes
import os
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from ... import checks
from ...kernels.integrators.composition import Composition, scene
from ...kernels.integrators.persistent import NOTHING_BEFORE, persistent
from ...kernels.threads import ABORT, Part, wait_for_all
from ...runtime import THREADS, cores, record
from ..device.launcher import Launcher
from ..device.thread_pool import replay_together
from ..model.model import Model
from .assemble import Assembly
from .repetition import repeat
from .stages import stages_for

LEAST_WORK = 5_000
"""Minimal number of springs per thread: about 50 µs of work, so that barriers cost little."""
MOST_THREADS = 1024
"""Maximal number of threads: more take long to start, and the system may have no more."""
MOST_BY_ITSELF = 16
"""Maximal number of threads for "auto"."""


class CpuPartition(Launcher):
    """Divides a body's particles among threads, and records the launches of each thread for a frame.

    The first thread launches the whole frame, but only its part of the stages; the others only their parts.
    The graphs of all threads run at the same time; threads wait for each other inside kernels.
    """

    def __init__(self, model: Model, composition: Composition, threads: int) -> None:
        self._composition, self.threads = composition, threads
        self.is_recording = False
        """Whether stages are launched in parts."""
        self._barrier = wp.zeros(2 * ABORT, dtype=int, device=model.device)
        self._launches: list[Callable[[int], None]] = []
        """The launches of a thread, as functions of its index."""
        ends = np.asarray(model.system.connections).reshape(-1, 2)
        bounds = divided(model.particle_count, ends, threads)
        begun = np.linspace(0, len(ends), threads + 1).astype(int)
        scatters = composition.force_algorithm.evaluate is not None
        self._left = [wp.zeros(1, dtype=int, device=model.device) for _ in range(threads)]
        """How many repetitions of launches each thread has left."""
        self._parts = list[Any]()
        self._sums = list[wp.array | None]()
        """Each thread's array of forces, for an algorithm that scatters."""
        for k in range(threads):
            part: Any = Part()
            part.threads, part.stride, part.first, part.last = threads, 1, int(bounds[k]), int(bounds[k + 1])
            part.first_spring, part.last_spring = int(begun[k]), int(begun[k + 1])
            runs, others = ending_in(ends, part.first, part.last) if scatters else (ends[:0], ends[:0, 0])
            part.runs = wp.array(runs, dtype=wp.vec2i, device=model.device)
            part.others = wp.array(others, dtype=int, device=model.device)
            part.meeting, part.yield_cpu = self._barrier, address_of_yield()
            self._parts.append(part)
            self._sums.append(model.vectors() if scatters else None)

    def kernel(self, method: Any) -> Any:
        """Return the kernel of a method's stages for one part of the particles."""
        return persistent(self._composition, method, in_parts=True)

    def launch(self, method: Any, data: Any, steps: wp.array, count: int) -> None:
        """Launch the first thread's part of `count` stages, and store the others' parts for later."""
        assert self.is_recording
        kernel = self.kernel(method)
        copy, own = scene(self._composition)(), stages_for(kernel, steps)
        copy.assign(data)  # the original changes from launch to launch

        def launch(k: int) -> None:
            if self._sums[k] is not None:
                copy.forces.f = self._sums[k]
            wp.launch(
                kernel, 1, [copy, own, count, self._parts[k], NOTHING_BEFORE.Data()], device=self._barrier.device
            )

        self._launch(launch)

    def launch_parts(self, launch_part: Callable[[int, int], None]) -> None:
        """Launch the first thread's part, `launch_part(0, threads)`, and store the others' parts for later.

        A barrier is before the parts, and another after them.
        """
        if not self.is_recording:
            super().launch_parts(launch_part)
            return

        def launch(k: int) -> None:
            self._launch_barrier(k)
            launch_part(k, self.threads)
            self._launch_barrier(k)

        self._launch(launch)

    def launch_if(self, condition: wp.array, launch: Callable[[], None]) -> None:
        """Record launches that each thread runs only if `condition`, shape [1], is not 0 in that frame.

        A barrier must precede, and the first of these launches must be a barrier: after it `condition` may change.
        """
        if not self.is_recording:
            super().launch_if(condition, launch)
            return
        outer, self._launches = self._launches, [self._launch_barrier]

        def launch_first() -> None:
            self._launch_barrier(0)
            launch()

        wp.capture_if(condition, launch_first)
        inner, self._launches = self._launches, outer
        self._launches.append(lambda k: wp.capture_if(condition, lambda: [one(k) for one in inner]))

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


def divided(particle_count: int, ends: NDArray[np.integer], threads: int) -> NDArray[np.int64]:
    """Return the first particle of each thread, followed by the particle count, shape [threads + 1].

    Each thread gets consecutive particles with about the same number of spring ends (`ends`, shape
    [connection_count, 2]).
    """
    work = 1 + np.bincount(ends.ravel(), minlength=particle_count)  # a particle without springs costs work, too
    done = np.concatenate(([0], np.cumsum(work)))
    return np.searchsorted(done, done[-1] * np.arange(threads + 1) / threads)


def ending_in(ends: NDArray[np.integer], first: int, last: int) -> tuple[NDArray[np.integer], NDArray[np.integer]]:
    """Return the springs with an end among particles first … last − 1, and the other particles of these springs.

    The springs are given as ranges [start, stop), shape [range_count, 2].
    """
    within = (ends >= first) & (ends < last)
    touching = within.any(axis=1)
    borders = np.flatnonzero(np.diff(touching, prepend=False, append=False))
    return borders.reshape(-1, 2), np.unique(ends[touching][~within[touching]])


def threads_for(assembly: Assembly, threads: int | str) -> int:
    """Return the number of CPU threads for a body; for "auto" one per core, fewer for small bodies.

    Raises ValueError unless `threads` is "auto" or a whole number of at least 1, which is 1 on a GPU.
    """
    on_gpu = assembly.model.device.is_cuda
    if not isinstance(threads, str):
        if checks.count("threads", threads, 1) > 1 and on_gpu:
            raise ValueError(f"threads is {threads}; it must be 1 or 'auto' on a GPU, which has its own")
        if threads > MOST_THREADS:
            raise ValueError(f"threads is {threads}; it must be at most {MOST_THREADS}")
        return threads
    if threads != "auto":
        raise ValueError(f"threads is {threads!r}; it must be a whole number of at least 1, or 'auto'")
    if on_gpu:
        return 1
    most = os.environ.get(THREADS, "")
    if most and not (most.isdecimal() and int(most) > 0):
        raise ValueError(f"{THREADS} is {checks.repr_short(most)}; it must be a whole number of at least 1")
    return max(1, min(int(most or MOST_BY_ITSELF), cores(), _work_to_divide(assembly) // LEAST_WORK))


def _work_to_divide(assembly: Assembly) -> int:
    """Return the number of springs and contact points, which threads can divide."""
    points = sum(one.shared_points for one in assembly.all)
    if assembly.begins_substeps and any(one.precedes for one in assembly.all):  # a single thread runs the stages
        return points
    return assembly.model.connection_count + points


def address_of_yield() -> int:
    """Return the address of the system function that yields the core to a waiting thread, or 0.

    A sleeping thread would wake about 70 µs late, which is longer than most waits. A busy thread might block the
    thread that it waits for: without yielding, two simultaneous runs were 10 times slower.
    """
    if os.name == "nt":
        function: Any = ctypes.WinDLL("kernel32").SwitchToThread
    else:
        function = ctypes.CDLL(None).sched_yield
    return ctypes.cast(function, ctypes.c_void_p).value or 0
