"""Files that have their name only once they are whole."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

_MARK = ".unfinished"


@contextmanager
def becoming(path: Path) -> Iterator[Path]:
    """Give another name beside `path`, with the same ending: what is written there becomes `path` at the end.

    Where that fails, by an error or a signal, `path` stays as it is, and nothing is left beside it.
    """
    unfinished = path.with_name(f".{path.stem}{_MARK}{path.suffix}")
    try:
        yield unfinished
        os.replace(unfinished, path)
    finally:
        unfinished.unlink(missing_ok=True)


def is_unfinished(path: Path) -> bool:
    """Tell whether a file is what a process that was killed was about to write."""
    return path.name.startswith(".") and _MARK in path.name
