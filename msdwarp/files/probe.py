"""A look at a file from another process, before this one opens it.

Where a disk has lost a part of a file, or someone has made it so, HDF5 may read it for ever, heed no signal, and
take all memory. So a child walks through all its structures first, and is ended where it does not come back.
"""

import os
import subprocess
import sys
from pathlib import Path

from . import validation as sound

_SECONDS = 2.0
"""Seconds of computing that a child has for the file; a sound one takes some hundredths."""
_MOST_SECONDS = 120.0
"""Seconds that it has in all, however slow the disk is."""


def probe(path: str | Path) -> None:
    """Return if HDF5 can walk through a file, and all that there is lies in it and has the size that it says.

    Nothing is said of what it holds. What HDF5 itself refuses, and comes back, is left to whoever opens it.

    Raises
    ------
    FileNotFoundError
        If there is none.
    ValueError
        If it is damaged, or not to be read; it says why.
    """
    path = Path(path)
    with path.open("rb") as file:
        if file.read(8) != b"\x89HDF\r\n\x1a\n":
            return
    words = [sys.executable, "-I", sound.__file__, str(path.absolute()), str(_SECONDS)]
    env = os.environ | {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
    try:
        done = subprocess.run(words, capture_output=True, env=env, timeout=_MOST_SECONDS, check=False)
    except subprocess.TimeoutExpired as error:
        raise ValueError(f"{path} cannot be read: after {_MOST_SECONDS:g} s the check has not finished") from error
    if said := done.stdout.decode(errors="replace"):
        raise ValueError(f"{path} cannot be read: {said}")
    if done.returncode < 0:
        raise ValueError(f"{path} is damaged: reading its structures does not end, or crashes HDF5")
