"""Errors in the user's own code: told by its line, without a traceback through ours."""

import os
import traceback
from pathlib import Path

_folders: set[Path] = set()
"""Where scripts lie that have been run as scenes."""
_PACKAGE = Path(__file__).resolve().parents[1]


def remember(script: Path) -> None:
    """Remember that a script, and what lies beside it, is the user's."""
    _folders.add(script.resolve().parent)


def told_by_line(error: Exception) -> str | None:
    """Return an error of the user's code by its file and line; None if it is none of theirs, or explains itself.

    What msdwarp says of a value that it was given explains itself.
    """
    root: BaseException = error
    while isinstance(root.__cause__, Exception):
        root = root.__cause__
    if isinstance(root, SyntaxError) and root.filename and _is_theirs(root.filename):
        return f"{_shown(root.filename)}, line {root.lineno}: {root.msg}"
    frames = traceback.extract_tb(root.__traceback__)
    theirs = [frame for frame in frames if _is_theirs(frame.filename)]
    if not theirs or (isinstance(root, ValueError | OSError) and frames[-1] is not theirs[-1]):
        return None
    kind = "" if isinstance(error, ValueError) else f"{type(error).__name__}: "
    return f"{_shown(theirs[-1].filename)}, line {theirs[-1].lineno}: {kind}{error}"


def _is_theirs(filename: str) -> bool:
    path = Path(filename).resolve()
    ours = path.is_relative_to(_PACKAGE) or "site-packages" in path.parts
    return not ours and any(path.is_relative_to(folder) for folder in _folders)


def _shown(filename: str) -> str:
    path = Path(filename).resolve()
    return os.path.relpath(path) if path.is_relative_to(Path.cwd()) else str(path)
