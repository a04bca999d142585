"""The process: a quiet start, signals, exit codes, the lock on a folder."""

import importlib.util
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NoReturn

from cyclopts import App, CycloptsError
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from .. import quiet
from ..simulation import SimulationDiverged
from .misunderstood import misunderstood


class _Terminated(BaseException):
    """SIGTERM or a lost terminal: raised where the program is, so that files are closed and others removed."""


def _terminate(number: int, _: Any) -> NoReturn:
    raise _Terminated(number)


def finish(command: Callable[[], Any]) -> NoReturn:
    """Run a command and exit: with 0, or with one line that says what was wrong and 1.

    Flags that are not understood end as all errors do, so that there is one code to look for: `rerun` has always
    said by it that a result differs.
    """
    for number in heard("SIGTERM", "SIGHUP"):
        signal.signal(number, _terminate)
    try:
        command()
    except BrokenPipeError:  # whoever read the output has read enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(1)
    except MemoryError as error:
        print(f"error: out of memory: {error}", file=sys.stderr)
        sys.exit(1)
    except CycloptsError as error:
        print(f"error: {misunderstood(error)}", file=sys.stderr)
        sys.exit(1)
    except (ValueError, OSError, SimulationDiverged) as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(1)
    except Interrupted as interruption:
        print(interruption, file=sys.stderr)
        sys.exit(interruption.code)
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        sys.exit(130)
    except _Terminated as termination:
        print("terminated", file=sys.stderr)
        sys.exit(128 + termination.args[0])
    sys.exit(0)


def understood(app: App, words: Sequence[str]) -> None:
    """Run the command that some words of the command line say; raise CycloptsError where they say none."""
    app(list(words), result_action="return_value", exit_on_error=False, print_error=False)


class Interrupted(RuntimeError):
    """A signal asked the run to end, and it has ended between two frames."""

    def __init__(self, message: str, number: int) -> None:
        super().__init__(message)
        self.code = 128 + number
        """What the process should exit with."""


def heard(*names: str) -> list[int]:
    """Return those of some signals that this system has and that are not ignored, as nohup ignores SIGHUP."""
    numbers = [getattr(signal, name) for name in names if hasattr(signal, name)]
    return [number for number in numbers if signal.getsignal(number) != signal.SIG_IGN]


@contextmanager
def stop_asked_for(talk: Console) -> Iterator[list[int]]:
    """Give a list in which Ctrl-C, SIGTERM and SIGHUP leave their number; a second one acts as it always does."""
    asked: list[int] = []
    if threading.current_thread() is not threading.main_thread():
        yield asked  # only there signals are heard
        return
    before = {number: signal.getsignal(number) for number in heard("SIGINT", "SIGTERM", "SIGHUP")}

    def ask(number: int, _: Any) -> None:
        asked.append(number)
        for each, handler in before.items():
            signal.signal(each, handler)
        if talk.is_terminal:
            talk.print("ending after this frame; once more ends at once")

    for number in before:
        signal.signal(number, ask)
    try:
        yield asked
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextmanager
def alone_in(folder: Path | None) -> Iterator[None]:
    """Keep other runs from writing in a folder meanwhile; raise ValueError if one does already.

    The lock is on the folder, and goes with the process, however that ends. Where there are none it does nothing.
    """
    if folder is None or importlib.util.find_spec("fcntl") is None:
        yield
        return
    import fcntl

    number = os.open(folder, os.O_RDONLY)
    try:
        try:
            fcntl.flock(number, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise ValueError(f"another run is writing in {folder}; wait for it, or name another folder") from error
        except OSError:
            pass
        yield
    finally:
        os.close(number)


def progress_on(console: Console) -> Progress:
    """Return bars that show how far something is, on a terminal."""
    columns = ("{task.description}", BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    columns = [TextColumn(c) if isinstance(c, str) else c for c in columns]
    return Progress(*columns, console=console, transient=True, disable=not console.is_terminal)


def start_warp(verbose: bool) -> None:
    """Start Warp, and let it speak if `verbose`."""
    if verbose:
        quiet.verbose()
    quiet.start_warp()
