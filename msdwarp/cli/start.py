"""The start of the command: its signals and its streams, before anything large is imported."""

import os
import shutil
import signal
import sys
from collections.abc import Callable
from io import TextIOWrapper
from typing import Any, NoReturn

from . import signals

LEAST_COLUMNS = 40
"""Below this Rich lays out no help, and at 1 seeks a layout for ever."""


def main() -> NoReturn:
    """Run the `msdwarp` command."""
    with signals.at_once():
        _set_up()
        from .app import main as command
    if signals.heard("SIGINT"):  # what `import msdwarp` did for the command is over
        signal.signal(signal.SIGINT, signal.default_int_handler)
    _to_the_end(command)


def scene_main(build: Callable[..., Any]) -> NoReturn:
    """Run the scene that `build` makes, with flags for its parameters: what a scene script calls."""
    with signals.at_once():
        _set_up()
        from .app import scene_main as command
    _to_the_end(lambda: command(build))


def _to_the_end(command: Callable[[], NoReturn]) -> NoReturn:
    """Run what ends the process; a signal while its last word is told ends it at once, a later one nothing."""
    sys.unraisablehook = signals.lost
    try:
        command()
    except KeyboardInterrupt:
        signals.leave(signal.SIGINT)
    except signals.Terminated as termination:
        signals.leave(termination.args[0])
    finally:
        signals.ignore()


def _set_up() -> None:
    """Make the streams fit for what will be said."""
    _occupy_closed_streams()
    for stream in (sys.stdout, sys.stderr):
        # A unit or a name that the terminal's encoding lacks must not end a run that went well.
        if isinstance(stream, TextIOWrapper) and stream.errors in ("strict", "surrogateescape"):
            stream.reconfigure(errors="backslashreplace")
    columns = os.environ.get("COLUMNS", "")
    if (int(columns) if columns.isdecimal() else shutil.get_terminal_size().columns) < LEAST_COLUMNS:
        os.environ["COLUMNS"] = str(LEAST_COLUMNS)


def _occupy_closed_streams() -> None:
    """Give the numbers of closed standard streams to the null device.

    Else the next file that is opened gets such a number, and what a library in C says on standard error goes
    into a trajectory.
    """
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # takes the lowest number that is free: this one
