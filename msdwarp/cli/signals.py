"""Signals: Ctrl-C, SIGTERM and a lost terminal end the command with a word, wherever it is.

Where nothing is begun, as while modules are imported, they end it at once. An exception there may come out as
another one, or not at all, or with a crash: what is written in C has its own ways to fail half imported.
Where something is begun they are noted, and acted upon between two frames. Everywhere else they raise an
exception, but for what is imported late and for h5py, which are let come to their end.
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
"""Seconds until a signal that came at a bad moment is heard again."""
_IN_H5PY = os.path.join("h5py", "_hl", "")


class Terminated(BaseException):
    """SIGTERM or a lost terminal: raised where the program is, so that files are closed and others removed."""


class Interrupted(RuntimeError):
    """A signal asked the command to end, and it has ended between two frames."""

    def __init__(self, message: str, number: int) -> None:
        super().__init__(message)
        self.number = number
        self.code = 128 + number
        """What the process should exit with."""


def word(number: int) -> str:
    """Return what happened by a signal."""
    return "interrupted" if number == signal.SIGINT else "terminated"


def heard(*names: str) -> list[int]:
    """Return those of some signals that this system has and that are not ignored, as nohup ignores SIGHUP."""
    numbers = [getattr(signal, name) for name in names if hasattr(signal, name)]
    return [number for number in numbers if signal.getsignal(number) not in (signal.SIG_IGN, None)]


def leave(number: int, _: Any = None) -> NoReturn:
    """End the process at once, with the word."""
    with contextlib.suppress(OSError):
        os.write(2, f"{word(number)}\n".encode())
    os._exit(128 + number)


def ask(number: int, frame: FrameType | None = None) -> None:
    """End the command by an exception, so that what it has begun is closed and what is half written removed.

    What is being imported, PyVista for one, may not stand an exception, nor may what h5py's C code calls back: the
    signal is heard again a little later.
    """
    if _is_fragile(frame):
        _hear_again(number)
        return
    raise KeyboardInterrupt if number == signal.SIGINT else Terminated(number)


def lost(found: "sys.UnraisableHookArgs") -> None:
    """Hear a signal again whose exception was raised where Python lets none out, as in a `__del__`: its hook."""
    if isinstance(found.exc_value, KeyboardInterrupt | Terminated):
        _hear_again(found.exc_value.args[0] if found.exc_value.args else signal.SIGINT)
    else:
        sys.__unraisablehook__(found)


def _hear_again(number: int) -> None:
    """Have a signal come again to this thread, which hears them, a little later."""
    if hasattr(signal, "pthread_kill"):  # which wakes it too, where it waits for something
        later = threading.Timer(_A_LITTLE, signal.pthread_kill, (threading.get_ident(), number))
    else:
        later = threading.Timer(_A_LITTLE, _thread.interrupt_main, (number,))
    later.daemon = True
    later.start()


def _is_fragile(frame: FrameType | None) -> bool:
    """Tell whether Python's machinery of imports, or h5py, is among what a frame was called by."""
    while frame is not None:
        if frame.f_code.co_filename.startswith("<frozen importlib") or _IN_H5PY in frame.f_code.co_filename:
            return True
        frame = frame.f_back
    return False


@contextlib.contextmanager
def handled(handler: Callable[[int, Any], Any], *names: str) -> Iterator[None]:
    """Have signals, all or some, come to a handler meanwhile; only the main thread hears any."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {number: signal.getsignal(number) for number in heard(*(names or ALL))}
    for number in before:
        signal.signal(number, handler)
    try:
        yield
    finally:
        for number, own in before.items():
            signal.signal(number, own)


@contextlib.contextmanager
def at_once() -> Iterator[None]:
    """Have signals end the process at once: where nothing is begun that would have to be closed or removed."""
    with handled(leave):
        yield


@contextlib.contextmanager
def noted(said: Callable[[], Any]) -> Iterator[list[int]]:
    """Give a list in which signals leave their number, and call `said`; a second one acts as it always does.

    What has come and was not acted upon is acted upon at the end.
    """
    asked: list[int] = []
    before = {number: signal.getsignal(number) for number in heard(*ALL)}

    def note(number: int, _: Any) -> None:
        asked.append(number)
        for each, handler in before.items():
            signal.signal(each, handler)
        said()

    with handled(note):
        yield asked
    if asked:
        ask(asked[0])


def ignore() -> None:
    """Hear no signal from here on: all is done and said, and Python is about to tidy up, which no word may cut."""
    for number in heard(*ALL):
        signal.signal(number, signal.SIG_IGN)
