"""Signals: Ctrl-C, SIGTERM and a lost terminal end the command with a short message, at any time.

While modules are imported at the start, a signal ends the process at once: in a partly imported C module an
exception may be replaced, lost, or cause a crash. During a run signals are noted, and end it between frames. At
other times a signal raises an exception, after any late import or h5py call is complete.
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

from ..runtime import asked, handling, in_main_thread

ALL = ("SIGINT", "SIGTERM", "SIGHUP")
_A_LITTLE = 0.02
"""Delay before a signal that cannot be handled yet is sent again [s]."""
_owned = False
"""Whether this process is the command's."""
_IN_H5PY = os.path.join("h5py", "_hl", "")


class Terminated(BaseException):
    """Raised by SIGTERM or a lost terminal, so that files are closed and unfinished files removed."""


class Interrupted(RuntimeError):
    """Raised if a signal has ended the command between two frames."""

    def __init__(self, message: str, number: int) -> None:
        super().__init__(message)
        self.number, self.code = number, 128 + number


def number_of(stop: BaseException) -> int:
    """Return the number of the signal that caused KeyboardInterrupt or Terminated."""
    return stop.args[0] if isinstance(stop, Terminated) else signal.SIGINT


def word(number: int) -> str:
    """Return a word for a signal's effect in messages, such as "interrupted"."""
    return "interrupted" if number == signal.SIGINT else "terminated"


def heard(*names: str) -> list[int]:
    """Return the numbers of named signals that this system has and does not ignore; nohup ignores SIGHUP."""
    numbers = [getattr(signal, name) for name in names if hasattr(signal, name)]
    return [number for number in numbers if signal.getsignal(number) not in (signal.SIG_IGN, None)]


def leave(number: int, _: Any = None) -> NoReturn:
    """End the process at once, with a short message."""
    with contextlib.suppress(OSError):
        os.write(2, f"{word(number)}\n".encode())
    os._exit(128 + number)


def ask(number: int, frame: FrameType | None = None) -> None:
    """Raise a signal's exception, which ends the command; during an import or in h5py, send it again later."""
    if _is_fragile(frame):
        _hear_again(number)
        return
    raise KeyboardInterrupt if number == signal.SIGINT else Terminated(number)


def lost(found: "sys.UnraisableHookArgs") -> None:
    """Send a signal again whose exception Python has ignored, as it does in `__del__`; a `sys.unraisablehook`."""
    if isinstance(found.exc_value, KeyboardInterrupt | Terminated):
        _hear_again(number_of(found.exc_value))
    else:
        sys.__unraisablehook__(found)


def _hear_again(number: int) -> None:
    """Send a signal to this thread again after a short delay."""
    if hasattr(signal, "pthread_kill"):  # `pthread_kill` also wakes a waiting thread
        later = threading.Timer(_A_LITTLE, signal.pthread_kill, (threading.get_ident(), number))
    else:
        later = threading.Timer(_A_LITTLE, _thread.interrupt_main, (number,))
    later.daemon = True
    later.start()


def _is_fragile(frame: FrameType | None) -> bool:
    """Return whether a frame was called during an import or from h5py."""
    while frame is not None:
        if frame.f_code.co_filename.startswith("<frozen importlib") or _IN_H5PY in frame.f_code.co_filename:
            return True
        frame = frame.f_back
    return False


def handled(handler: Callable[[int, Any], Any]) -> contextlib.AbstractContextManager[Any]:
    """Use a handler for signals; in other threads than the main one do nothing, since they receive no signals."""
    return handling(handler, heard(*ALL)) if in_main_thread() else contextlib.nullcontext()


def own_process() -> None:
    """Let signals end this process from now on: it is the command's. Called from Python they only raise errors."""
    global _owned
    _owned = True


def at_once() -> contextlib.AbstractContextManager[None]:
    """Let signals end the command's process at once, while no file has to be closed or removed."""
    return handled(leave) if _owned else contextlib.nullcontext()


@contextlib.contextmanager
def noted(announce: Callable[[], Any]) -> Iterator[list[int]]:
    """Yield a list; the first signal is added to it, then `announce` is called.

    A second signal acts as usual. When the block ends, so does the first one, unless the list was emptied
    meanwhile. KeyboardInterrupt ends a long frame early.
    """
    before = {number: signal.getsignal(number) for number in heard(*ALL)}

    def note(number: int, _: Any) -> None:
        asked.append(number)
        for each, handler in before.items():
            signal.signal(each, handler)
        announce()

    try:
        with handled(note):
            yield asked
        if asked:
            ask(asked[0])
    finally:
        asked.clear()


def ignore() -> None:
    """Ignore signals from now on: the work is done, and Python is about to exit."""
    for number in heard(*ALL):
        signal.signal(number, signal.SIG_IGN)
