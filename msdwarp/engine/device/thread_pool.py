"""A pool of threads that replay the graphs of a frame concurrently, frame after frame.

The graphs of a frame wait for each other, so all of them must run at once. One pool serves all simulations and
threads, and runs one frame at a time.
"""

import os
import threading
import time
from collections.abc import Callable
from queue import SimpleQueue
from typing import Any

import warp as wp


class _Frame:
    """The graphs of a frame, to be replayed concurrently, each by one thread."""

    def __init__(self, graphs: list[Any], begin: Callable[[], None], give_up: Callable[[], None]) -> None:
        self.graphs, self.begin, self._give_up = graphs, begin, give_up
        self.replayed, self.done = SimpleQueue[BaseException | None](), SimpleQueue[BaseException | None]()
        self.ended = False

    def replay(self, k: int) -> None:
        """Replay graph k, in Warp's native code, which releases Python's lock."""
        error = None
        try:
            wp.capture_launch(self.graphs[k])
        except BaseException as caught:
            error = caught
            self._give_up()
        self.replayed.put(error)


class _Pool:
    """Threads that wait for frames. The first thread begins a frame, and passes graphs to the other threads.

    Signals such as Ctrl-C reach only Python's main thread, so the pool completes a frame that has begun.
    """

    def __init__(self) -> None:
        self.frames = SimpleQueue[_Frame]()
        self._graphs: list[SimpleQueue[tuple[_Frame, int]]] = []
        _begin(self._lead)

    def _lead(self) -> None:
        while True:
            frame, error = self.frames.get(), None
            try:
                self._replay(frame)
            except BaseException as caught:
                error = caught
            frame.ended = True
            frame.done.put(error)
            del frame, error  # they would keep a dropped simulation's memory until the next frame

    def _replay(self, frame: _Frame) -> None:
        others = range(1, len(frame.graphs))
        while len(self._graphs) < len(others):  # before any graph waits for another without a thread
            graphs = SimpleQueue[tuple[_Frame, int]]()
            _begin(self._follow, graphs)
            self._graphs.append(graphs)
        frame.begin()
        for k in others:
            self._graphs[k - 1].put((frame, k))
        frame.replay(0)
        for error in [frame.replayed.get() for _ in frame.graphs]:
            if error is not None:
                raise error

    def _follow(self, graphs: SimpleQueue[tuple[_Frame, int]]) -> None:
        while True:
            frame, k = graphs.get()
            frame.replay(k)
            del frame


def _begin(function: Callable[..., None], *arguments: Any) -> None:
    threading.Thread(target=function, args=arguments, name="msdwarp", daemon=True).start()


_pool: list[_Pool] = []
_choosing = threading.Lock()


def replay_together(graphs: list[Any], begin: Callable[[], None], give_up: Callable[[], None]) -> None:
    """Replay graphs that wait for each other, each on its own thread; return when all have ended.

    `begin` is called first. `give_up` is called if a graph cannot be replayed, and must make the other graphs end.
    Exceptions of the threads are raised here.
    """
    with _choosing:
        if not _pool:
            _pool.append(_Pool())
    frame = _Frame(graphs, begin, give_up)
    _pool[0].frames.put(frame)
    error = _awaited(frame)
    if error is not None:
        raise error


def _awaited(frame: _Frame) -> BaseException | None:
    """Wait until a frame is done, and return its error, if any; a Ctrl-C meanwhile is raised afterwards."""
    try:
        return frame.done.get()
    except BaseException:  # perhaps after it got the frame's error
        _wait_for_end(frame)
        raise


def _wait_for_end(frame: _Frame) -> None:
    """Wait until a frame has ended, whatever signals are raised meanwhile."""
    try:
        while not frame.ended:
            time.sleep(1e-4)
    except BaseException:
        _wait_for_end(frame)
        raise


def _forget() -> None:
    """Reset the pool in a forked process, which does not inherit the threads."""
    global _choosing
    _pool.clear()
    _choosing = threading.Lock()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_forget)
