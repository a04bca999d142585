"""Pace: how long substeps take decides in how many launches a frame is taken, and by how many CPU threads."""

import math
from collections.abc import Callable
from time import perf_counter, process_time

import warp as wp

from ...runtime import stop_if_asked
from .assemble import Assembly

LONGEST, WANTED, LEAST = 1.0, 0.5, 0.02
"""A launch that is expected to take longer [s] is divided into some of `WANTED`; very short ones are joined."""
ITEMS_A_SECOND = {False: 1e7, True: 1e9}
"""Connections, particles and points of contact a second on a slow CPU, and on a slow GPU: a first guess."""
ENOUGH = 0.1
"""Threads are judged by launches that have taken so long together [s]."""
WAITING, FREE = 0.8, 0.9
"""Fewer threads are tried if they compute in less than this fraction of the time, more threads if in more."""
FASTER = 0.9
"""Their number is kept if substeps then take less than this fraction of the time before."""
MOST_PATIENCE = 64
"""Most judgements from one trial to the next; each that fails doubles them."""

Launch = Callable[[], None]


class Pace:
    """How long a substep takes: at first a guess, rather too long; later as measured.

    Between the launches of a frame signals are heard. From `least` to `most` CPU threads share the body. They wait
    for each other several times a substep; where another program has the core of one of them, all others wait.
    """

    def __init__(self, assembly: Assembly, least: int, most: int) -> None:
        model, points = assembly.model, sum(effect.shared_points for effect in assembly.all)
        items = points + model.worlds * (model.particle_count + model.connection_count)
        self.substep = items / ITEMS_A_SECOND[model.device.is_cuda]
        """How long a substep takes [s]."""
        self.launches = 1
        """In how many launches, about, a frame is divided."""
        self._device, self._began = model.device, 0.0
        self._least, self._most, self._threads = least, most, most
        self._seconds, self._computing, self._substeps = 0.0, 0.0, 0
        self._patience, self._rest = 1, 0
        self._before: tuple[int, float] | None = None
        """During a trial the number of threads before it, and how long a substep took then [s]."""

    def part(self, first: int, substeps: int) -> range:
        """Return the substeps of a frame's next launch, from `first` on: an even number of them, or the last ones.

        After an even number of substeps the state is again in the arrays where it began.
        """
        seconds = substeps * self.substep
        if not LEAST * (self.launches - 1) <= seconds <= LONGEST * self.launches:
            self.launches = 2 ** math.ceil(math.log2(seconds / WANTED)) if seconds > LONGEST else 1
        stop = first - 2 * (-substeps // (2 * self.launches))
        return range(first, stop if stop < substeps else substeps)

    def take(
        self,
        substeps: int,
        part: range,
        launch: Launch,
        launch_from: Callable[[int], tuple],
        is_in_vain: Callable[[], bool],
    ) -> None:
        """Launch a frame: its first part by `launch`, then the parts and launches that `launch_from` returns.

        It ends early where the frame `is_in_vain`.
        """
        self._launch(launch, part)
        spent = 0.0
        while part.stop < substeps:
            wp.synchronize_stream(self._device)
            last = perf_counter() - self._began
            spent += last
            self.substep = max(spent / part.stop, last / len(part))  # in contact a frame may slow down
            stop_if_asked()
            if is_in_vain():
                return
            part, launch = launch_from(part.stop)
            self._launch(launch, part)

    def _launch(self, launch: Launch, part: range) -> None:
        adapts, self._began = self._least < self._most, perf_counter()
        computing = process_time() if adapts else 0.0
        launch()
        if adapts:
            self._seconds += perf_counter() - self._began
            self._computing += process_time() - computing
            self._substeps += len(part)

    def learn(self, substeps: int) -> None:
        """Measure a frame that has just ended, unless it was measured while it was taken."""
        if self.launches == 1:
            self.substep = (perf_counter() - self._began) / substeps

    def threads(self) -> int:
        """Return how many threads share the body in the next launch."""
        if self._seconds < ENOUGH:
            return self._threads
        each, computes = self._seconds / self._substeps, self._computing / (self._seconds * self._threads)
        self._seconds, self._computing, self._substeps = 0.0, 0.0, 0
        if self._before is not None:
            failed = each > FASTER * self._before[1]
            self._threads = self._before[0] if failed else self._threads
            self._rest = self._patience = min(2 * self._patience, MOST_PATIENCE) if failed else 1
            self._before = None
        elif self._rest > 0:
            self._rest -= 1
        elif computes < WAITING or computes > FREE:
            tried = self._threads // 2 if computes < WAITING else 2 * self._threads
            tried = min(max(tried, self._least), self._most)
            self._before = (self._threads, each) if tried != self._threads else None
            self._threads = tried
        return self._threads
