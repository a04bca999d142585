"""Entry points: the command and scene scripts, their streams, signals and exit codes.

Only few modules are imported here: `main` and `scene_main` install signal handlers before any large import.
"""

import gc
import os
import shutil
import signal
import sys
import warnings
from collections.abc import Callable
from io import TextIOWrapper
from typing import Any, NoReturn

from . import signals
from .signals import Interrupted, Terminated, at_once, heard, number_of, word

LEAST_COLUMNS = 40
"""With fewer columns Rich shows no help, and with 1 column it never ends."""


def main() -> NoReturn:
    """Run the `msdwarp` command."""
    signals.own_process()
    with at_once():
        _set_up()
        from .app import app
    if heard("SIGINT"):  # restore the handler that `import msdwarp` replaced for the command
        signal.signal(signal.SIGINT, signal.default_int_handler)
    _run(lambda: app(sys.argv[1:]))


def scene_main(build: Callable[..., Any]) -> NoReturn:
    """Run the scene that `build` returns, with flags for its parameters; scene scripts call this."""
    signals.own_process()
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
