"""Worker processes on this machine: one for each GPU, or for each core where there is none."""

import os
import signal
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import BrokenExecutor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from multiprocessing import get_context
from multiprocessing.connection import Connection
from queue import SimpleQueue
from typing import Any, Self

import warp as wp

from .. import checks
from ..engine import THREADS, cores
from ..quiet import start_warp

VISIBLE = "CUDA_VISIBLE_DEVICES"


class Workers:
    """An executor over processes of their own, as `concurrent.futures` has them: what is lost is one call.

    A process that ends in the midst of a call, killed or out of memory, fails that call alone; the next call has a
    new one. All of them end with this process, however it ends. They are spawned, never forked: CUDA does not
    survive a fork.

    Parameters
    ----------
    count
        How many processes.
    gpus
        GPUs that processes take in turn, as `CUDA_VISIBLE_DEVICES` names them; none: all processes see all.

    Raises
    ------
    ValueError
        If the count is no whole number of at least 1.
    """

    def __init__(self, count: int, gpus: Sequence[str] = ()) -> None:
        checks.count("jobs", count, 1)
        threads = max(1, cores() // count)  # of each process: together they have a core each
        self._slots = [_Slot(gpus[k % len(gpus)] if gpus else None, threads) for k in range(count)]
        self._free: SimpleQueue[_Slot] = SimpleQueue()
        for slot in self._slots:
            self._free.put(slot)
        self._threads = ThreadPoolExecutor(count)

    def submit(self, function: Callable[..., Any], /, *arguments: Any) -> Future:
        """Have a process call a function of a module; return what will become of it."""
        return self._threads.submit(self._call, function, arguments)

    def _call(self, function: Callable[..., Any], arguments: tuple[Any, ...]) -> Any:
        slot = self._free.get()
        try:
            return slot.call(function, arguments)
        finally:
            self._free.put(slot)

    def __enter__(self) -> Self:
        """Return itself."""
        return self

    def __exit__(self, *_: object) -> None:
        """End all processes, whatever they are at."""
        self._threads.shutdown(wait=False, cancel_futures=True)
        for slot in self._slots:
            slot.end()


class _Slot:
    """A process, and the next one where that has ended."""

    def __init__(self, gpu: str | None, threads: int) -> None:
        self._gpu, self._threads, self._lock, self._ended = gpu, threads, threading.Lock(), False
        self._pool: ProcessPoolExecutor | None = None
        self._held: Connection | None = None

    def call(self, function: Callable[..., Any], arguments: tuple[Any, ...]) -> Any:
        with self._lock:
            if self._ended:
                raise BrokenExecutor("the workers have been stopped")
            if self._pool is None:
                self._start()
            assert self._pool is not None
            future = self._pool.submit(function, *arguments)
        try:
            return future.result()
        except BrokenExecutor:
            with self._lock:
                self._let_go()
            raise

    def _start(self) -> None:
        context = get_context("spawn")
        watched, self._held = context.Pipe(duplex=False)
        how = (watched, self._gpu, self._threads)
        self._pool = ProcessPoolExecutor(1, context, initializer=_begin, initargs=how)

    def _let_go(self) -> None:
        if self._held is not None and self._pool is not None:
            self._held.close()
            self._pool.shutdown(wait=False, cancel_futures=True)
        self._held = self._pool = None

    def end(self) -> None:
        with self._lock:
            self._ended = True
            self._let_go()


def _begin(watched: Connection, gpu: str | None, threads: int) -> None:
    """Prepare a process: it sees its GPU, leaves Ctrl-C to the one that began it, and ends with that."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if gpu is not None:
        os.environ[VISIBLE] = gpu  # before Warp starts, which looks for GPUs then
    os.environ.setdefault(THREADS, str(threads))
    threading.Thread(target=_end_with, args=(watched,), daemon=True).start()
    start_warp()


def _end_with(watched: Connection) -> None:
    """End this process once the other end of a pipe is closed, by that process or by its end."""
    try:
        watched.recv()
    except (EOFError, OSError):
        os._exit(1)


def gpus_here() -> list[str]:
    """Return the GPUs that this process sees, as `CUDA_VISIBLE_DEVICES` names them."""
    start_warp()
    count = wp.get_cuda_device_count()
    visible = [one.strip() for one in os.environ.get(VISIBLE, "").split(",") if one.strip()]
    return visible[:count] if visible else [str(k) for k in range(count)]


def gpus_for(device: str | None) -> int:
    """Return how many GPUs runs are shared out to: all, or the one that is asked for."""
    return len(gpus_here()) if device is None else int(device.startswith("cuda"))


def workers_for(jobs: int | str, device: str | None, points: int) -> Workers:
    """Return so many workers, for "auto" one for each GPU, or else for each core; no more than there are points.

    Raises
    ------
    ValueError
        If `jobs` is neither "auto" nor a whole number of at least 1.
    """
    gpus = gpus_here() if device is None else []
    if jobs == "auto":
        jobs = gpus_for(device) or cores()
    elif isinstance(jobs, str):
        raise ValueError(f"jobs is {jobs!r}; it must be a whole number of at least 1, 'auto' or 'ensemble'")
    return Workers(min(checks.count("jobs", jobs, 1), max(points, 1)), gpus)
