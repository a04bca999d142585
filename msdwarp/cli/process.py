"""The process of the command: its progress, what stops it, and the start of Warp."""

import threading
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from typing import TYPE_CHECKING

from .. import runtime
from .signals import at_once, noted

if TYPE_CHECKING:
    from rich.console import Console
    from rich.progress import Progress

TELL_EVERY = 30.0
"""Seconds between two lines about progress, where output is no terminal."""

COMPILING = "compiling kernels; later runs find them compiled"


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
