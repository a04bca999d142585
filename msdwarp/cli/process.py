"""The process: a quiet start, exit codes, how far it is."""

import os
import signal
import sys
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, NoReturn

from cyclopts import App, CycloptsError

from .. import quiet
from .printable import printable, printable_lines
from .signals import ALL, Interrupted, Terminated, ask, at_once, heard, noted
from .usage_errors import usage_errors
from .user_tracebacks import told_by_line

if TYPE_CHECKING:
    from rich.console import Console
    from rich.progress import Progress


def finish(command: Callable[[], Any]) -> NoReturn:
    """Run a command and exit: with 0, or with one line that says what was wrong and 1.

    Flags that are not understood end as all errors do, so that there is one code to look for: `rerun` has always
    said by it that a result differs.
    """
    for number in heard(*ALL):
        signal.signal(number, ask)
    warnings.formatwarning = _in_a_line
    try:
        command()
    except BrokenPipeError:  # whoever read the output has read enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(1)
    except MemoryError as error:
        _fail(f"out of memory: {error}")
    except CycloptsError as error:
        _fail(usage_errors(error))
    except Interrupted as interruption:
        print(printable_lines(str(interruption)), file=sys.stderr)
        sys.exit(interruption.code)
    except Exception as error:
        said = told_by_line(error)
        if said is None and not _explains_itself(error):
            raise  # a mistake of ours, which its traceback explains
        _fail(said or str(error))
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        sys.exit(130)
    except Terminated as termination:
        print("terminated", file=sys.stderr)
        sys.exit(128 + termination.args[0])
    sys.exit(0)


def _in_a_line(message: Warning | str, *where: Any) -> str:
    """Return a warning as the command says it: where in our sources it was given tells nobody anything."""
    return f"warning: {printable(str(message))}\n"


def _explains_itself(error: Exception) -> bool:
    """Tell whether an error is what was asked for, not a mistake of ours."""
    if isinstance(error, ValueError | OSError):
        return True
    from ..simulation import SimulationDiverged

    return isinstance(error, SimulationDiverged)


def _fail(said: str) -> NoReturn:
    """Exit with what was wrong, which may be in words of a file or of a path."""
    print(f"error: {printable_lines(said)}", file=sys.stderr)
    sys.exit(1)


def understood(app: App, words: Sequence[str]) -> None:
    """Run the command that some words of the command line say; raise CycloptsError where they say none."""
    app(list(words), result_action="return_value", exit_on_error=False, print_error=False)


@contextmanager
def stop_asked_for(talk: "Console") -> Iterator[list[int]]:
    """Give a list in which Ctrl-C, SIGTERM and SIGHUP leave their number; a second one acts as it always does.

    What was not acted upon meanwhile is acted upon at the end.
    """

    def said() -> None:
        if talk.is_terminal:
            talk.print("stopping after this frame; press again to stop at once")

    with noted(said) as asked:
        yield asked


def progress_on(console: "Console", *, over: float = 30.0) -> "Progress":
    """Return bars that show how far something is, on a terminal; the pace of the last `over` seconds counts."""
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    columns = ("{task.description}", BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    columns = [TextColumn(c) if isinstance(c, str) else c for c in columns]
    return Progress(
        *columns, console=console, transient=True, speed_estimate_period=over, disable=not console.is_terminal
    )


@contextmanager
def telling(console: "Console", what: str) -> Iterator[Callable[[str], None]]:
    """Give a function that shows in a line how far something is: the last one on a terminal, else each."""
    with console.status(what) as status:

        def tell(line: str) -> None:
            if console.is_terminal:
                status.update(f"{what}: {line}")
            else:
                console.print(f"{what}: {line}", markup=False, highlight=False, soft_wrap=True)

        yield tell


def start_warp(verbose: bool) -> None:
    """Start Warp, and let it speak if `verbose`."""
    with at_once():
        import warp  # noqa: F401
    if verbose:
        quiet.verbose()
    with noted(lambda: None):  # not at once: standard error is turned aside meanwhile, and the word would be lost
        quiet.start_warp()
