"""The process of the command: its streams, signals, exit codes and progress.

Only few modules are imported here: `main` and `scene_main` install signal handlers before any large import.
"""

import gc
import os
import shutil
import signal
import sys
import threading
import warnings
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from io import TextIOWrapper
from typing import TYPE_CHECKING, Any, NoReturn

from .. import runtime
from . import signals
from .signals import Interrupted, Terminated, at_once, heard, noted, number_of, word

if TYPE_CHECKING:
    from rich.console import Console
    from rich.progress import Progress

LEAST_COLUMNS = 40
"""With fewer columns Rich shows no help, and with 1 column it never ends."""

TELL_EVERY = 30.0
"""Seconds between two lines about progress, where output is no terminal."""

COMPILING = "compiling kernels; later runs find them compiled"


def main() -> NoReturn:
    """Run the `msdwarp` command."""
    with at_once():
        _set_up()
        from .app import app
    if heard("SIGINT"):  # restore the handler that `import msdwarp` replaced for the command
        signal.signal(signal.SIGINT, signal.default_int_handler)
    _run(lambda: app(sys.argv[1:]))


def scene_main(build: Callable[..., Any]) -> NoReturn:
    """Run the scene that `build` returns, with flags for its parameters; scene scripts call this."""
    with at_once():
        _set_up()
        from .app import run_script
    _run(lambda: run_script(build, sys.argv[1:]))


def _run(command: Callable[[], Any]) -> NoReturn:
    """Run a command and exit; while Python exits, signals are ignored."""
    sys.unraisablehook = signals.lost
    try:
        finish(command)
    except (KeyboardInterrupt, Terminated) as stop:
        signals.leave(number_of(stop))
    finally:
        signals.ignore()


def finish(command: Callable[[], Any]) -> NoReturn:
    """Run a command and exit with a code: 0; 1 after an error, with a message; 128 + n after signal n.

    Unknown flags are such errors.
    """
    from .error_messages import message_of, printable, printable_lines

    for number in heard(*signals.ALL):
        signal.signal(number, signals.ask)
    warnings.formatwarning = lambda message, *_, **__: f"warning: {printable(str(message))}\n"
    code = 0
    try:
        command()
    except BrokenPipeError:  # the reader of the output has closed it
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        code = 1
    except Interrupted as interruption:
        print(printable_lines(str(interruption)), file=sys.stderr)
        code = interruption.code
    except (Exception, SystemExit) as error:
        text = message_of(error)
        if text is None:  # a fault of ours, or the end of --help
            raise
        print(f"error: {printable_lines(text)}", file=sys.stderr)
        code = 1
    except (KeyboardInterrupt, Terminated) as stop:
        print(word(number_of(stop)), file=sys.stderr)
        code = 128 + number_of(stop)
    sys.exit(code)


def _set_up() -> None:
    """Prepare the standard streams."""
    gc.set_threshold(50_000)  # with the default threshold, garbage collection takes a fifth of import time
    # Open closed standard streams on the null device. Otherwise the next opened file would get such a number, and
    # C libraries would write error messages into a trajectory.
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # uses the lowest free number: `number`
    for stream in (sys.stdout, sys.stderr):
        # A character missing in the terminal's encoding must not make a successful run fail.
        if isinstance(stream, TextIOWrapper) and stream.errors in ("strict", "surrogateescape"):
            stream.reconfigure(errors="backslashreplace")
    columns = os.environ.get("COLUMNS", "")
    if (int(columns) if columns.isdecimal() else shutil.get_terminal_size().columns) < LEAST_COLUMNS:
        os.environ["COLUMNS"] = str(LEAST_COLUMNS)


def stop_requests(talk: "Console") -> AbstractContextManager[list[int]]:
    """Return the context `signals.noted`; on a terminal the first signal also shows a message."""

    def announce() -> None:
        if talk.is_terminal:
            talk.print("stopping after this frame, or within it if it takes long; press again to stop at once")

    return noted(announce)


@contextmanager
def progress_on(console: "Console", *, over: float = 30.0) -> Iterator["Progress"]:
    """Yield progress bars; the speed is averaged over the last `over` seconds.

    Where output is no terminal, a line tells every `TELL_EVERY` seconds how far the work has come.
    """
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    progress = Progress(
        *columns, console=console, transient=True, speed_estimate_period=over, disable=console.quiet
    )
    if console.is_terminal or console.quiet:
        with progress:
            yield progress
        return
    ended = threading.Event()

    def tell() -> None:
        while not ended.wait(TELL_EVERY):
            for task in progress.tasks:
                if not task.finished:
                    whole = "" if task.total is None else f" of {task.total:.0f}"
                    console.print(f"{task.description}: {task.completed:.0f}{whole} done", highlight=False)

    teller = threading.Thread(target=tell, daemon=True)
    teller.start()
    try:
        yield progress
    finally:
        ended.set()
        teller.join()


def tell_compiling(console: "Console") -> None:
    """From now on print one line when kernels are compiled."""

    def report() -> None:
        runtime.Compiling.report = lambda: None
        console.print(COMPILING)

    runtime.Compiling.report = report


@contextmanager
def status_on(console: "Console", what: str) -> Iterator[Callable[[str], None]]:
    """Yield a function that shows a line of progress; on a terminal the next line replaces it."""
    with console.status(what) as status:

        def show(line: str) -> None:
            if console.is_terminal:
                status.update(f"{what}: {line}")
            else:
                console.print(f"{what}: {line}", markup=False, highlight=False, soft_wrap=True)

        yield show


def start_warp(verbose: bool) -> None:
    """Start Warp; show its messages if `verbose`."""
    with at_once():
        import warp  # noqa: F401
    if verbose:
        runtime.verbose()
    with noted(lambda: None):  # not `at_once`: standard error is redirected here, so the message would be lost
        runtime.start_warp()
