"""Messages of errors: in the command line, in the user's own code, about files and paths."""

import os
import re
import traceback
from pathlib import Path
from types import UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from cyclopts import (
    CoercionError,
    CycloptsError,
    MissingArgumentError,
    UnknownCommandError,
    UnknownOptionError,
    UnusedCliTokensError,
)

_KINDS: dict[Any, str] = {int: "a whole number", float: "a number", str: "a text", bool: "true or false"}
_MEANT: dict[str | None, str] = {
    **dict.fromkeys(("--seconds", "--time", "--length"), "--duration"),
    "--film": "--video",
    "--movie": "--video",
    "--fit": "--parameters",
    "--format": "--to",
}
"""Names that other programs have for a flag."""
_NO_ROOM = re.compile("start new thread|shared library|shared object|allocat", re.IGNORECASE)
"""What libraries say where the address space is too small."""
_PACKAGE = Path(__file__).resolve().parents[1]
_folders: set[Path] = set()
"""Folders of scripts that have been run as scenes."""


def message_of(error: BaseException) -> str | None:
    """Return the message of an error for a user; None for an error within msdwarp, which needs a traceback."""
    if isinstance(error, CycloptsError):
        command = error.app.name[0] if error.app is not None else "msdwarp"
        if error.command_chain:
            command = " ".join(("msdwarp", *error.command_chain))
        return f"{_wrong(error)} (see `{command} --help`)"
    if isinstance(error, MemoryError):
        return f"out of memory: {error}"
    if isinstance(error, Exception) and not _has_working_directory():
        return f"the working directory no longer exists; change to one that does ({error})"
    if (found := user_message(error)) is not None:
        return found
    if isinstance(error, ValueError | OSError):
        return str(error)
    limit = _address_space() if isinstance(error, RuntimeError | ImportError) else 0
    if limit and _NO_ROOM.search(str(error)):
        return f"the address space is limited to {limit / 1e9:.3g} GB (ulimit -v), perhaps too little: {error}"
    from ..simulation import SimulationDiverged

    return str(error) if isinstance(error, SimulationDiverged) else None


def _address_space() -> int:
    """Return the process's limit of address space [B]; 0 if there is none."""
    try:
        import resource
    except ImportError:  # on Windows
        return 0
    limit, _ = resource.getrlimit(resource.RLIMIT_AS)
    return 0 if limit == resource.RLIM_INFINITY else limit


def _has_working_directory() -> bool:
    try:
        return bool(os.getcwd())
    except FileNotFoundError:
        return False


def printable(text: str) -> str:
    """Return a text with control characters escaped, since a terminal would interpret them."""
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


def printable_lines(text: str) -> str:
    """Return a text with control characters escaped in each line."""
    return "\n".join(map(printable, text.split("\n")))


def _wrong(error: CycloptsError) -> str:
    """Return a message about an invalid command line."""
    if isinstance(error, UnknownCommandError) and error.unused_tokens and error.app is not None:
        known = ", ".join(name for name in error.app if not name.startswith("-"))
        return f"command is {error.unused_tokens[0]!r}; it must be one of {known}"
    if isinstance(error, UnusedCliTokensError):
        return f"{' '.join(error.unused_tokens or ())!r} is one argument too many"
    if isinstance(error, MissingArgumentError) and error.argument is not None:
        if any(token.keyword for token in error.argument.tokens) or getattr(error, "keyword", None):
            return f"{error.argument.name} needs a value"
        guess = next((one for one in error.unused_tokens or () if _MEANT.get(one) == error.argument.name), None)
        return f"{error.argument.name} is missing" if guess is None else _unknown(guess)
    if isinstance(error, CoercionError) and error.msg is None and error.token is not None and error.target_type:
        name = error.token.keyword or (error.argument.name if error.argument is not None else "")
        return f"{name.lstrip('-')} is {error.token.value!r}; it must be {allowed(error.target_type)}"
    if isinstance(error, UnknownOptionError):
        word, known = error.token.keyword, [name for one in error.argument_collection for name in one.names]
        if _MEANT.get(word) in known:
            return _unknown(word)
    text = str(error).removesuffix(".")
    return text[:1].lower() + text[1:]


def _unknown(option: str | None) -> str:
    """Return a message about an option that other programs have."""
    return f"unknown option: {option}. Did you mean {_MEANT[option]}?"


def allowed(kind: Any) -> str:
    """Return the allowed values of a flag, given its type, as text."""
    if get_origin(kind) is Annotated:
        return allowed(get_args(kind)[0])
    if get_origin(kind) is Literal:
        values = [str(value) for value in get_args(kind)]
        return values[0] if len(values) == 1 else f"one of {', '.join(values)}"
    if get_origin(kind) is tuple:
        return allowed(get_args(kind)[0])
    if get_origin(kind) in (Union, UnionType):
        return " or ".join(allowed(one) for one in get_args(kind) if one is not type(None))
    return _KINDS.get(kind, f"a {getattr(kind, '__name__', kind)}")


def remember_script(script: Path) -> None:
    """Record that a script, and files in its folder, are the user's."""
    _folders.add(script.resolve().parent)


def user_message(error: BaseException) -> str | None:
    """Return the message of an error in the user's code, with file and line.

    None if msdwarp or another library raised the error: the error's own message is then enough.
    """
    root = error
    while isinstance(root.__cause__, Exception):
        root = root.__cause__
    if isinstance(root, SyntaxError) and root.filename and _is_users(root.filename):
        return f"{_shown(root.filename)}, line {root.lineno}: {root.msg}"
    frames = traceback.extract_tb(root.__traceback__)
    theirs = [frame for frame in frames if _is_users(frame.filename)]
    if not theirs or (isinstance(root, ValueError | OSError) and frames[-1] is not theirs[-1]):
        return None
    from .. import checks  # its NumPy would delay all commands

    return f"{_shown(theirs[-1].filename)}, line {theirs[-1].lineno}: {checks.message(error)}"


def _is_users(filename: str) -> bool:
    path = Path(filename).resolve()
    ours = path.is_relative_to(_PACKAGE) or "site-packages" in path.parts
    return path.is_file() and not ours and any(path.is_relative_to(folder) for folder in _folders)


def _shown(filename: str) -> str:
    path = Path(filename).resolve()
    return os.path.relpath(path) if path.is_relative_to(Path.cwd()) else str(path)
