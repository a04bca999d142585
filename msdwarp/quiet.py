"""Starting Warp without what libraries say at their start."""

import contextlib
import os
import sys
from collections.abc import Iterator

import warp as wp


def start(verbose: bool) -> None:
    """Start Warp; keep off the terminal what is said then, some of it from C++, unless `verbose`."""
    with contextlib.nullcontext() if verbose else _silence():
        if not verbose:
            wp.config.log_level = 30  # warnings; what is compiled and loaded is not of interest
        wp.init()


@contextlib.contextmanager
def _silence() -> Iterator[None]:
    sys.stderr.flush()
    kept = os.dup(2)
    with open(os.devnull, "w") as nowhere:
        os.dup2(nowhere.fileno(), 2)
        try:
            yield
        finally:
            os.dup2(kept, 2)
            os.close(kept)
