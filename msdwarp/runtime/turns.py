"""Turns: threads use Warp one after the other, as Warp expects one thread at a time; and signals meanwhile."""

import _signal  # pyright: ignore[reportMissingImports]  # the functions of `signal` make enums, in 30 µs
import contextlib
import functools
import os
import threading
from collections.abc import Callable, Iterable, Iterator
from typing import Any, ParamSpec, TypeVar

P = ParamSpec("P")
T = TypeVar("T")
_turn, _next = threading.RLock(), threading.RLock()
"""Locks held by the thread whose turn it is, and by the next one."""
_dropped = list[Any]()
"""Objects to release when a turn ends."""
asked = list[int]()
"""Signals that wait for the end of a frame, or of one of the launches of a long frame."""
PATIENCE = 60.0
"""Longest wait of a fork for another thread's turn [s]: that thread could itself wait for the one that forks."""


def unseen(error: BaseException) -> None:
    """Take the calling function out of the traceback of an error that it has caught, before it raises this again.

    Users then see their own calls, and where the error came from, without functions that only pass calls on.
    """
    assert error.__traceback__ is not None
    error.__traceback__ = error.__traceback__.tb_next


def in_turn(function: Callable[P, T]) -> Callable[P, T]:
    """Return a function that waits for this thread's turn with Warp; nested calls belong to the same turn.

    While one thread records a graph, Warp adds other threads' launches on this device to it. Cached factories of
    kernels and Warp's dictionaries do not expect a second thread either.
    """

    @functools.wraps(function)
    def taking_turns(*args: P.args, **kwargs: P.kwargs) -> T:
        nested = _turn._is_owned()  # type: ignore[attr-defined]  # as `threading.Condition` asks
        try:
            if not nested:
                with _next:  # else a thread that steps in a loop would keep others waiting for hundreds of steps
                    _turn.acquire()
            return function(*args, **kwargs)
        except BaseException as error:
            unseen(error)
            raise
        finally:
            if not nested:
                try:
                    _end_turn()
                except BaseException:  # of a signal: other threads would wait for ever
                    _end_turn()
                    raise

    return taking_turns


def _end_turn() -> None:
    """End this thread's turn, if it has come; twice is once."""
    if _turn._is_owned():  # type: ignore[attr-defined]
        while _dropped:  # what is dropped by that, too
            _dropped.clear()
        _turn.release()


class ReleasedInTurn:
    """An object that holds device memory; this is freed at once if no thread has a turn, else at the turn's end.

    Memory that one thread frees just as another begins to record a graph can spoil the recording.
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


def exclusive(method: Callable[P, T]) -> Callable[P, T]:
    """Return a method that takes a turn; RuntimeError if its object is within another such method."""

    @in_turn
    @functools.wraps(method)
    def alone(*args: P.args, **kwargs: P.kwargs) -> T:
        try:
            return calling(args[0], method.__name__, method, *args, **kwargs)
        except BaseException as error:
            unseen(error)
            raise

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
    except BaseException as error:
        unseen(error)
        raise
    finally:
        own["_busy"] = None


def in_main_thread() -> bool:
    """Return whether this is the main thread, which alone gets signals."""
    return threading.current_thread() is threading.main_thread()


@contextlib.contextmanager
def handling(handler: Callable[[int, Any], Any], numbers: Iterable[int]) -> Iterator[None]:
    """Handle signals by a function of their number and the frame within a block."""
    before = {number: _signal.getsignal(number) for number in numbers}
    try:
        for number in before:
            _signal.signal(number, handler)
        yield
    finally:
        _handle_by(before)


def _handle_by(handlers: dict[int, Any]) -> None:
    """Set the handlers of signals, whatever the handler of another signal raises, which is called first."""
    try:
        for number, handler in handlers.items():
            _signal.signal(number, handler)
    except BaseException:
        for number, handler in handlers.items():
            _signal.signal(number, handler)
        raise


def stop_if_asked() -> None:
    """Raise KeyboardInterrupt if a signal waits for it."""
    if asked and in_main_thread():
        raise KeyboardInterrupt


@contextlib.contextmanager
def completing() -> Iterator[list[int]]:
    """Complete a block before Ctrl-C raises KeyboardInterrupt, so that no frame is left half done.

    Yields a list that is no longer empty once Ctrl-C was pressed: a long block should then end early. A second
    Ctrl-C raises at once. Handlers that a program has set itself, and other threads, are left alone.
    """
    usual = _signal.default_int_handler
    if not in_main_thread() or _signal.getsignal(_signal.SIGINT) is not usual:
        yield []
        return

    def note(number: int, frame: Any) -> None:
        if asked:
            usual(number, frame)
        asked.append(number)

    asked.clear()
    try:
        _signal.signal(_signal.SIGINT, note)  # not by `handling`, which takes 5 µs more
        yield asked
    finally:
        _handle_by({_signal.SIGINT: usual})
        if asked:
            asked.clear()
            raise KeyboardInterrupt


@contextlib.contextmanager
def deferring_signals() -> Iterator[None]:
    """Call the handlers of signals after a block instead of within it."""
    if not in_main_thread():
        yield
        return
    came, numbers = list[tuple[int, Any]](), range(1, _signal.NSIG)
    usual = {number: handler for number in numbers if callable(handler := _signal.getsignal(number))}
    try:
        with handling(lambda *call: came.append(call), usual):
            yield
    finally:  # also where one comes before all have been set, and its handler raises
        for number, frame in came:
            usual[number](number, frame)


def _wait_to_fork() -> None:
    """Take the turn before a fork: the new process would get another thread's work half done."""
    if _turn._is_owned():  # type: ignore[attr-defined]
        _turn.acquire()
    elif _next.acquire(timeout=PATIENCE):
        try:
            _turn.acquire(timeout=PATIENCE)
        finally:
            _next.release()


def _forget_turns() -> None:
    """Create new locks in a forked process, which does not inherit other threads."""
    global _turn, _next
    _turn, _next = threading.RLock(), threading.RLock()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(before=_wait_to_fork, after_in_parent=_end_turn, after_in_child=_forget_turns)
