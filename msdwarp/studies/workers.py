"""Worker processes on this machine: one per GPU, or one per core without GPUs."""

import os
import signal
from collections.abc import Callable, Sequence
from concurrent.futures import BrokenExecutor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from multiprocessing import get_context
from multiprocessing.connection import Connection
from queue import SimpleQueue
from threading import Thread
from typing import Any

import warp as wp

from .. import checks
from ..runtime import THREADS, cores, start_warp

VISIBLE = "CUDA_VISIBLE_DEVICES"


class Workers(ThreadPoolExecutor):
    """An executor of processes. If a process dies, only its current call fails; the next call gets a new process.

    All of them end with this process, however it ends. They are spawned, because CUDA does not work after a fork.
    GPUs, named as in `CUDA_VISIBLE_DEVICES`, are assigned in turn; without `gpus` processes see all devices.
    """

    def __init__(self, count: int, gpus: Sequence[str] = ()) -> None:
        super().__init__(checks.count("jobs", count, 1))
        self._cpu_threads = max(1, cores() // count)  # so that all processes together have one per core
        self._context = get_context("spawn")
        self._watched, self._held = self._context.Pipe(duplex=False)
        self._idle: SimpleQueue[tuple[str | None, ProcessPoolExecutor | None]] = SimpleQueue()
        for k in range(count):
            self._idle.put((gpus[k % len(gpus)] if gpus else None, None))

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future:
        """Pass the call of a module's function to a process; return its future."""
        return super().submit(self._call, fn, args, kwargs)

    def _call(self, function: Callable[..., Any], args: tuple[Any, ...], kwargs: dict[str, Any]) -> Any:
        gpu, process = self._idle.get()
        try:
            if process is None:
                given = (self._watched, gpu, self._cpu_threads)
                process = ProcessPoolExecutor(1, self._context, initializer=_begin, initargs=given)
            return process.submit(function, *args, **kwargs).result()
        except BrokenExecutor:
            if process is not None:
                process.shutdown()
            process = None
            raise
        finally:
            self._idle.put((gpu, process))

    def __exit__(self, *_: object) -> None:
        """End all processes at once, and wait until they have ended, since otherwise Python's exit can fail."""
        self._held.close()
        self.shutdown(wait=True, cancel_futures=True)
        while not self._idle.empty():
            process = self._idle.get()[1]
            if process is not None:
                process.shutdown()


def _begin(watched: Connection, gpu: str | None, threads: int) -> None:
    """Prepare a process: restrict it to its GPU, leave Ctrl-C to the parent, and end it with the parent."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if gpu is not None:
        os.environ[VISIBLE] = gpu  # set before Warp starts and looks for GPUs
    os.environ.setdefault(THREADS, str(threads))
    Thread(target=_end_with, args=(watched,), daemon=True).start()
    start_warp()


def _end_with(watched: Connection) -> None:
    """End this process once its parent closes the pipe, or ends."""
    try:
        watched.recv()
    except (EOFError, OSError):
        os._exit(1)


def gpus_for(device: str | None) -> list[str]:
    """Return the GPUs for the runs: all, as `CUDA_VISIBLE_DEVICES` names them, or the requested one."""
    if device is not None:
        return [device] if device.startswith("cuda") else []
    start_warp()
    count = wp.get_cuda_device_count()
    visible = [one.strip() for one in os.environ.get(VISIBLE, "").split(",") if one.strip()]
    return visible[:count] if visible else [str(k) for k in range(count)]


def workers_for(jobs: int | str, device: str | None, points: int) -> Workers:
    """Return workers: for "auto" one per GPU, or one per core without GPUs; at most one per point."""
    gpus = gpus_for(device)
    if jobs == "auto":
        jobs = len(gpus) or cores()
    elif isinstance(jobs, str):
        raise ValueError(f"jobs is {jobs!r}; it must be a whole number of at least 1, 'auto' or 'ensemble'")
    return Workers(min(checks.count("jobs", jobs, 1), max(points, 1)), gpus if device is None else ())
