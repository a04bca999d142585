"""Commands of msdwarp as forks of a process that has imported all: milliseconds each, in limits."""

import os
import resource
import signal
import subprocess
import sys
import time
import traceback
from pathlib import Path
from types import SimpleNamespace
from typing import NamedTuple, NoReturn

SECONDS = 60.0
"""After which a command counts as one that hangs; the longest of a sound file takes two."""
_MEMORY = 3 << 30
"""Bytes that a command may take beside those that the process has."""


class Ended(NamedTuple):
    """How a command ended."""

    code: int
    """The exit code, negative for a signal."""
    out: str
    err: str
    hung: bool
    seconds: float


def import_all() -> None:
    """Import what commands import when they need it, so that no fork has to."""
    import h5py  # noqa: F401
    import matplotlib.pyplot  # noqa: F401
    import pyvista  # noqa: F401

    import msdwarp.cli.app
    import msdwarp.cli.commands.draw
    import msdwarp.cli.commands.stored_runs
    import msdwarp.cli.commands.view  # noqa: F401


def probed_once() -> None:
    """Let `probe` ask its child once for each content of a file; forks made later know what it said.

    The child is a Python of its own, which takes longer to start than all that a command does.
    """
    from importlib import import_module

    module = import_module("msdwarp.files.validation")
    known: dict[bytes, subprocess.CompletedProcess] = {}

    def run(words: list[str], **options) -> subprocess.CompletedProcess:
        content = Path(words[3]).read_bytes()
        if content not in known:
            known.clear() if len(known) > 4 else None
            known[content] = subprocess.run(words, **options)
        return known[content]

    vars(module)["subprocess"] = SimpleNamespace(run=run, TimeoutExpired=subprocess.TimeoutExpired)


def ended(words: list[str], folder: Path) -> Ended:
    """Return how a command ends in a folder."""
    began = time.monotonic()
    child = os.fork()
    if not child:
        _command(words, folder)
    hung = False
    while not (found := os.waitpid(child, os.WNOHANG))[0]:
        if time.monotonic() - began > SECONDS:
            os.kill(child, signal.SIGKILL)
            hung = True
        time.sleep(0.002)
    said = [(folder / name).read_text(errors="replace") for name in ("out", "err")]
    return Ended(os.waitstatus_to_exitcode(found[1]), said[0], said[1], hung, time.monotonic() - began)


def _command(words: list[str], folder: Path) -> NoReturn:
    """Be the command."""
    os.chdir(folder)
    for number, name in ((1, "out"), (2, "err")):
        os.dup2(os.open(name, os.O_WRONLY | os.O_CREAT | os.O_TRUNC), number)
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    most = pages * resource.getpagesize() + _MEMORY
    resource.setrlimit(resource.RLIMIT_AS, (most, most))
    sys.argv = ["msdwarp", *words]
    code = 1
    try:
        from msdwarp.cli.app import app
        from msdwarp.cli.entry_points import finish

        finish(lambda: app(words))
    except SystemExit as stop:
        code = stop.code if isinstance(stop.code, int) else 1
    except BaseException:
        traceback.print_exc()
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code)
