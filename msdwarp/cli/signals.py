"""Signals: Ctrl-C, SIGTERM and a lost terminal end the command with a short message, at any moment.

While modules are imported at the start, they end the process at once: in a partly imported C module an exception
may be replaced, lost, or cause a crash. During a run they are noted, and end it between two frames. Everywhere
else they raise an exception; late imports and h5py calls are completed first.
"""

import _thread
import contextlib
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from types import FrameType
from typing import Any, NoReturn

ALL = ("SIGINT", "SIGTERM", "SIGHUP")
_A_LITTLE = 0.02
"""Seconds after which a signal that cannot be handled yet is sent again."""
_IN_H5PY = os.path.join("h5py", "_hl", "")


class Terminated(BaseException):
    """SIGTERM or a lost terminal, raised so that files are closed and unfinished ones removed."""


class Interrupted(RuntimeError):
    """A signal has ended the command between two frames."""

    def __init__(self, message: str, number: int) -> None:
        super().__init__(message)
        self.number, self.code = number, 128 + number


def number_of(stop: BaseException) -> int:
    """Return the number of the signal that raised KeyboardInterrupt or Terminated."""
    return stop.args[0] if isinstance(stop, Terminated) else signal.SIGINT


def word(number: int) -> str:
    """Return the participle for a signal's effect in messages, such as "interrupted"."""
    return "interrupted" if number == signal.SIGINT else "terminated"


def heard(*names: str) -> list[int]:
    """Return the numbers of this system's signals that are not ignored; nohup, for example, ignores SIGHUP."""
    numbers = [getattr(signal, name) for name in names if hasattr(signal, name)]
    return [number for number in numbers if signal.getsignal(number) not in (signal.SIG_IGN, None)]


def leave(number: int, _: Any = None) -> NoReturn:
    """End the process at once, with a short message."""
    with contextlib.suppress(OSError):
        os.write(2, f"{word(number)}\n".encode())
    os._exit(128 + number)


def ask(number: int, frame: FrameType | None = None) -> None:
    """Raise an exception that ends the command; within an import or h5py, send the signal again later."""
    if _is_fragile(frame):
        _hear_again(number)
        return
    raise KeyboardInterrupt if number == signal.SIGINT else Terminated(number)


def lost(found: "sys.UnraisableHookArgs") -> None:
    """Send a signal again if Python ignored its exception, as in a `__del__`: a hook for unraisable exceptions."""
    if isinstance(found.exc_value, KeyboardInterrupt | Terminated):
        _hear_again(number_of(found.exc_value))
    else:
        sys.__unraisablehook__(found)


def _hear_again(number: int) -> None:
    """Send a signal to this thread again, a little later."""
    if hasattr(signal, "pthread_kill"):  # this also wakes a waiting thread
        later = threading.Timer(_A_LITTLE, signal.pthread_kill, (threading.get_ident(), number))
    else:
        later = threading.Timer(_A_LITTLE, _thread.interrupt_main, (number,))
    later.daemon = True
    later.start()


def _is_fragile(frame: FrameType | None) -> bool:
    """Return whether a frame was called from an import or from h5py."""
    while frame is not None:
        if frame.f_code.co_filename.startswith("<frozen importlib") or _IN_H5PY in frame.f_code.co_filename:
            return True
        frame = frame.f_back
    return False


@contextlib.contextmanager
def handled(handler: Callable[[int, Any], Any]) -> Iterator[None]:
    """Use a handler for signals; only the main thread receives any."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {number: signal.getsignal(number) for number in heard(*ALL)}
    for number in before:
        signal.signal(number, handler)
    try:
        yield
    finally:
        for number, own in before.items():
            signal.signal(number, own)


def at_once() -> contextlib.AbstractContextManager[None]:
    """Let signals end the process at once, while nothing needs to be closed or removed."""
    return handled(leave)


@contextlib.contextmanager
def noted(announce: Callable[[], Any]) -> Iterator[list[int]]:
    """Yield a list to which the first signal is added, after which `announce` is called.

    A second signal acts as usual. At the end, so does the first one, unless the list was emptied meanwhile.
    """
    requested: list[int] = []
    before = {number: signal.getsignal(number) for number in heard(*ALL)}

    def note(number: int, _: Any) -> None:
        requested.append(number)
        for each, handler in before.items():
            signal.signal(each, handler)
        announce()

    with handled(note):
        yield requested
    if requested:
        ask(requested[0])


def ignore() -> None:
    """Ignore signals from here on: the work is done, and Python is about to clean up."""
    for number in heard(*ALL):
        signal.signal(number, signal.SIG_IGN)
