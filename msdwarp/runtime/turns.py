"""Turns: threads use Warp one after the other, since Warp expects only one thread at a time."""

import _signal  # pyright: ignore[reportMissingImports]  # the functions of `signal` make enums, in 30 µs
import contextlib
import functools
import gc
import os
import threading
from collections import OrderedDict
from collections.abc import Callable, Iterator
from typing import Any, ParamSpec, TypeVar

P = ParamSpec("P")
T = TypeVar("T")
_turn, _next, _mine = threading.RLock(), threading.RLock(), threading.local()
"""Locks held by the thread whose turn it is, and by the next one; whether this thread is about to fork."""
_phases, _latest, _own = OrderedDict[str, None](start=None, stop=None), dict[str, Any](), threading.local()
"""Collections of garbage: the phases, the last one last; what was told of each, in any and in each thread."""
waiting = list[None]()
"""Not empty while a finalizer, within a collection, waits for a turn."""
_dropped = list[Any]()
"""Objects to release when a turn ends."""
asked = list[int]()
"""Signals that wait for the end of a frame, or of one of the launches of a long frame."""
PATIENCE = 60.0
"""Longest wait of a fork for another thread's turn [s]: that thread could itself wait for the one that forks."""


def in_turn(function: Callable[P, T]) -> Callable[P, T]:
    """Return a function that waits for this thread's turn with Warp; nested calls belong to the same turn.

    While one thread records a graph, Warp adds other threads' launches on this device to it. Cached factories of
    kernels and Warp's dictionaries do not expect a second thread either.
    """

    @functools.wraps(function)
    def taking_turns(*args: P.args, **kwargs: P.kwargs) -> T:
        if _turn._is_owned():  # type: ignore[attr-defined]  # as `threading.Condition` asks
            return function(*args, **kwargs)
        try:
            _wait_for_turn()
            return function(*args, **kwargs)
        finally:
            try:
                _end_turn()
            except BaseException:  # of a signal: other threads would wait for ever
                _end_turn()
                raise

    return taking_turns


def _wait_for_turn() -> None:
    held_up = is_collecting_here()  # a finalizer, for which nobody must wait
    if held_up:
        waiting.append(None)
    try:
        with _next:  # waiting threads come before the one that just had its turn
            _turn.acquire()
    finally:
        if held_up:
            waiting.clear()


def _end_turn() -> None:
    """End this thread's turn, if it has come; twice is once."""
    if _turn._is_owned():  # type: ignore[attr-defined]
        _free_dropped()
        _turn.release()


def exclusive(method: Callable[P, T]) -> Callable[P, T]:
    """Return a method that takes a turn; RuntimeError if its object is within another such method."""

    @in_turn
    @functools.wraps(method)
    def alone(*args: P.args, **kwargs: P.kwargs) -> T:
        return calling(args[0], method.__name__, method, *args, **kwargs)

    return alone


def calling(owner: Any, name: str, function: Callable[P, T], *args: P.args, **kwargs: P.kwargs) -> T:
    """Call a function, within which its thread may call no exclusive method of its owner; `name` is for messages.

    A function of time, a finalizer or a signal's handler could call one while a frame is half done.
    """
    own, me = owner.__dict__, threading.get_ident()
    within, thread = own.get("_busy") or ("", 0)
    if thread == me:
        raise RuntimeError(f"{name} is called within {within}, as by a function of time; call it afterwards")
    try:
        own["_busy"] = name, me
        return function(*args, **kwargs)
    finally:
        own["_busy"] = None


def stop_if_asked() -> None:
    """Raise KeyboardInterrupt if a signal waits for it; in the main thread, which alone gets signals."""
    if asked and threading.current_thread() is threading.main_thread():
        raise KeyboardInterrupt


@contextlib.contextmanager
def completing() -> Iterator[list[int]]:
    """Complete a block before Ctrl-C raises KeyboardInterrupt, so that no frame is left half done.

    Yields a list that is no longer empty once Ctrl-C was pressed: a long block should then end early. A second
    Ctrl-C raises at once. Handlers that a program has set itself, and other threads, are left alone.
    """
    usual = _signal.default_int_handler
    in_main = threading.current_thread() is threading.main_thread()
    if not in_main or _signal.getsignal(_signal.SIGINT) is not usual:
        yield []
        return

    def note(number: int, frame: Any) -> None:
        if asked:
            usual(number, frame)
        asked.append(number)

    asked.clear()
    try:
        _signal.signal(_signal.SIGINT, note)
        yield asked
    finally:
        try:
            _signal.signal(_signal.SIGINT, usual)
        except BaseException:  # of the handler of another signal, which this calls first
            _signal.signal(_signal.SIGINT, usual)
            raise
        if asked:
            asked.clear()
            raise KeyboardInterrupt


@contextlib.contextmanager
def deferring_signals() -> Iterator[None]:
    """Call the handlers of signals after a block instead of within it."""
    if threading.current_thread() is not threading.main_thread():  # Python calls them in the main thread alone
        yield
        return
    usual = {number: one for number in range(1, _signal.NSIG) if callable(one := _signal.getsignal(number))}
    came = list[tuple[int, Any]]()
    try:
        for number in usual:
            _signal.signal(number, lambda number, frame: came.append((number, frame)))
        yield
    finally:
        try:
            _handle_by(usual)
        except BaseException:  # of one that has its handler again
            _handle_by(usual)
            raise
        for number, frame in came:
            usual[number](number, frame)


def _handle_by(handlers: dict[int, Any]) -> None:
    """Set the handlers of signals."""
    for number, handler in handlers.items():
        _signal.signal(number, handler)


class ReleasedInTurn:
    """An object that holds device memory; this is freed at once if no thread has a turn, else at the turn's end.

    Memory that is freed while a thread records a graph, by any thread, can spoil the recording.
    """

    def __del__(self) -> None:
        own = self.__dict__
        _dropped.append(own.copy())
        own.clear()  # it lives until after this method, and what it holds would be freed after the turn
        if not _turn._is_owned():  # type: ignore[attr-defined]
            try:
                _turn.acquire(blocking=False)
            finally:
                _end_turn()


def _free_dropped() -> None:
    """Release what was dropped, and what is dropped by that in turn."""
    while _dropped:
        _dropped.clear()


def _wait_to_fork() -> None:
    """Take the turn before a fork: the new process would get another thread's work half done."""
    if not _turn._is_owned() and _next.acquire(timeout=PATIENCE):  # type: ignore[attr-defined]
        try:
            _mine.forks = _turn.acquire(timeout=PATIENCE)
        finally:
            _next.release()


def _end_fork() -> None:
    """End the turn of a fork."""
    if getattr(_mine, "forks", False):
        _mine.forks = False
        _turn.release()


def _forget_turns() -> None:
    """Create new locks in a forked process, which does not inherit other threads."""
    global _turn, _next
    _mine.forks, _turn, _next = False, threading.RLock(), threading.RLock()
    _phases.move_to_end("stop")  # the thread that was collecting is none of this process
    waiting.clear()


def is_collecting() -> bool:
    """Return whether any thread collects garbage now."""
    return list(_phases)[-1] == "start"  # in one call, in which no other thread can begin


def is_collecting_here() -> bool:
    """Return whether this thread collects garbage now, so that a finalizer calls."""
    return is_collecting() and getattr(_own, "start", None) is _latest.get("start")


# These are in C, and take the phase and a new dictionary. An exception of a signal's handler would be lost in a
# callback in Python, where Python calls handlers after each collection: Ctrl-C would often do nothing.
gc.callbacks += [_phases.move_to_end, _latest.__setitem__, _own.__setattr__]
if hasattr(os, "register_at_fork"):
    os.register_at_fork(before=_wait_to_fork, after_in_parent=_end_fork, after_in_child=_forget_turns)
