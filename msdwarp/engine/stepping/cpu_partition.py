"""CpuPartition: a body's particles divided among threads of the CPU, each of which has launches of its own."""

import ctypes
import os
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from ... import checks
from ...kernels.integrators import ABORT, Composition, PartOfParticles, in_partition, scene, wait_for_all
from ..device.thread_pool import replay_together
from ..model.model import Model
from .assemble import Assembly

LEAST_SHARE = 5_000
"""Connections for each thread, at least: some 50 µs of work, of which meeting the others is then a small part."""
MOST_BY_ITSELF = 16
"""More threads are taken only where they are asked for."""
THREADS = "MSDWARP_THREADS"
"""Environment variable: how many threads "auto" takes at most."""


class CpuPartition:
    """A body's particles divided among threads, and the launches of a frame as each thread has them.

    The first thread takes the frame as one thread does, but for its stages: of these it takes its share, and the
    others theirs. All of it is recorded, and then replayed at once; threads wait for each other inside kernels.

    Parameters
    ----------
    model
        The body.
    composition
        What its kernels are composed from.
    threads
        How many there are, at least 2.
    """

    def __init__(self, model: Model, composition: Composition, threads: int) -> None:
        self._composition, self.threads = composition, threads
        self.is_recording = False
        """Whether stages are to be launched by shares."""
        self._meeting = wp.zeros(2 * ABORT, dtype=int, device=model.device)
        self._launches: list[Callable[[int], None]] = []
        """What each thread launches, given its number."""
        ends = np.asarray(model.system.connections).reshape(-1, 2)
        bounds = divided(model.particle_count, ends, threads)
        begun = np.linspace(0, len(ends), threads + 1).astype(int)
        scatters = composition.force_algorithm.evaluate is not None
        self._shares = list[Any]()
        self._sums = list[wp.array | None]()
        """Where each thread sums forces, of an algorithm that scatters."""
        for k in range(threads):
            share: Any = PartOfParticles()
            share.threads, share.first, share.last = threads, int(bounds[k]), int(bounds[k + 1])
            share.first_begun, share.last_begun = int(begun[k]), int(begun[k + 1])
            runs, others = ending_in(ends, share.first, share.last) if scatters else (ends[:0], ends[:0, 0])
            share.runs = wp.array(runs, dtype=wp.vec2i, device=model.device)
            share.others = wp.array(others, dtype=int, device=model.device)
            share.meeting, share.yield_cpu = self._meeting, address_of_letting_others()
            self._shares.append(share)
            self._sums.append(model.vectors() if scatters else None)

    def kernel(self, method: Any) -> Any:
        """Return the kernel that takes a method's stages by shares."""
        return in_partition(self._composition, method)

    def launch(self, method: Any, around: Any, steps: wp.array, count: int) -> None:
        """Launch the first thread's share of `count` stages, and note it for the others."""
        assert self.is_recording
        kernel = self.kernel(method)
        now = scene(self._composition)()
        now.assign(around)  # which changes from launch to launch

        def launch(k: int) -> None:
            if self._sums[k] is not None:
                now.forces.f = self._sums[k]
            wp.launch(kernel, 1, [now, steps, count, self._shares[k]], device=self._meeting.device)

        self._launch(launch)

    def launch_parts(self, launch_part: Callable[[int, int], None]) -> None:
        """Launch the first thread's part of something, `launch_part(0, threads)`, and note it for the others.

        It begins when all threads have come, and none goes on before all parts are done.
        """
        assert self.is_recording

        def launch(k: int) -> None:
            self._meet(k)
            launch_part(k, self.threads)
            self._meet(k)

        self._launch(launch)

    def _launch(self, launch: Callable[[int], None]) -> None:
        self._launches.append(launch)
        launch(0)

    def _meet(self, k: int) -> None:
        wp.launch(wait_for_all, 1, [self._shares[k]], device=self._meeting.device)

    def _launch_all(self, k: int) -> None:
        for launch in self._launches:
            launch(k)

    def record(self, launch_frame: Callable[[], None]) -> "SharedFrame":
        """Record what a frame launches: the whole of it for the first thread, their shares for the others."""
        self._launches, self.is_recording = [], True
        try:
            graphs = [_recorded(launch_frame, self._meeting.device)]
        finally:
            self.is_recording = False
        for k in range(1, self.threads):
            graphs.append(_recorded(partial(self._launch_all, k), self._meeting.device))
        return SharedFrame(graphs, self._meeting, self._launches)


class SharedFrame:
    """A frame that was recorded for several threads."""

    def __init__(self, graphs: list[Any], meeting: wp.array, read: Any) -> None:
        self._graphs, self._meeting, self._read = graphs, meeting.numpy(), (meeting, read)

    def replay(self) -> None:
        """Replay it: the graph of each thread on a thread of its own; return when all are done."""
        replay_together(self._graphs, self._begin, self._give_up)

    def _begin(self) -> None:
        """Count meetings from the first one on."""
        self._meeting[:] = 0

    def _give_up(self) -> None:
        """Have threads wait for nobody: one of them will never come."""
        self._meeting[ABORT] = 1


def _recorded(launch: Callable[[], None], device: Any) -> Any:
    with wp.ScopedCapture(device=device) as capture:
        launch()
    return capture.graph


def divided(particle_count: int, ends: NDArray[np.integer], threads: int) -> NDArray[np.int64]:
    """Return where each thread's particles begin, and the last one's end, shape [threads + 1].

    Threads get neighbouring numbers, and about as many ends of connections each: `ends`, shape
    [connection_count, 2].
    """
    work = 1 + np.bincount(ends.ravel(), minlength=particle_count)  # a particle alone has some, too
    done = np.concatenate(([0], np.cumsum(work)))
    return np.searchsorted(done, done[-1] * np.arange(threads + 1) / threads)


def ending_in(ends: NDArray[np.integer], first: int, last: int) -> tuple[NDArray[np.integer], NDArray[np.integer]]:
    """Return the connections that end in particles from `first` to before `last`, and where else these end.

    Connections are in runs, from one to before another, shape [run_count, 2].
    """
    within = (ends >= first) & (ends < last)
    concerned = within.any(axis=1)
    borders = np.flatnonzero(np.diff(concerned, prepend=False, append=False))
    return borders.reshape(-1, 2), np.unique(ends[concerned][~within[concerned]])


def threads_for(assembly: Assembly, threads: int | str) -> int:
    """Return how many threads a body is advanced by.

    Parameters
    ----------
    assembly
        The body, and what acts on it.
    threads
        How many, or "auto": one for each core, fewer for small bodies.

    Raises
    ------
    ValueError
        If it is neither "auto" nor a whole number of at least 1, or more than 1 on a GPU.
    """
    if threads != "auto":
        if isinstance(threads, str):
            raise ValueError(f"threads is {threads!r}; it must be a whole number of at least 1, or 'auto'")
        if checks.count("threads", threads, 1) > 1 and not assembly.model.device.is_cuda:
            return threads
        if threads > 1:
            raise ValueError(f"threads is {threads}; it must be 1 or 'auto' on a GPU, which has its own")
        return 1
    if assembly.model.device.is_cuda:
        return 1
    most = os.environ.get(THREADS, "")
    if most and not (most.isdecimal() and int(most) > 0):
        raise ValueError(f"{THREADS} is {checks.repr_short(most)}; it must be a whole number of at least 1")
    return max(1, min(int(most or MOST_BY_ITSELF), cores(), _work_to_share(assembly) // LEAST_SHARE))


def _work_to_share(assembly: Assembly) -> int:
    """Return how many connections, and points that may touch, threads can share."""
    points = sum(one.shared_points for one in assembly.all)
    if assembly.begins_substeps and any(one.precedes for one in assembly.all):  # then one thread takes the stages
        return points
    return assembly.model.connection_count + points


def cores() -> int:
    """Return how many cores this process may use."""
    found = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return min(found, _quota())


def _quota() -> int:
    """Return how many cores' time the container that this is in may use, as Linux's control groups say."""
    try:
        with open("/sys/fs/cgroup/cpu.max", encoding="ascii") as file:
            share, period = file.read().split()
        return max(1, int(share) // int(period))
    except (OSError, ValueError):  # not here, or "max": as much as there is
        return os.cpu_count() or 1


def address_of_letting_others() -> int:
    """Return the address of the system's function that lets another thread have the core, if one waits for it.

    Where nobody waits it returns at once. A thread that sleeps wakes some 70 µs late, which is longer than most
    waits; one that keeps the core may wait for a thread that needs it: two runs at once were 10 times slower.
    """
    if os.name == "nt":
        function: Any = ctypes.WinDLL("kernel32").SwitchToThread
    else:
        function = ctypes.CDLL(None).sched_yield
    return ctypes.cast(function, ctypes.c_void_p).value or 0
