"""Results: the folder of a run, and the files in it."""

import os
from collections.abc import Collection, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

from .. import disk
from ..disk import TRAJECTORY, alone_in, is_unfinished

RESTART = "restart.h5"
MASKS = "masks.json"
"""The bodies' names, by their numbers in masks."""
PROBES, PROBES_BY_SUBSTEP = "probes.csv", "probes_by_substep.csv"


def wanted_folder(name: str, out: Path | None, force: bool, taken: Collection[Path] = ()) -> Path:
    """Return the folder for results; raise FileExistsError if `out` is not empty and `force` is False."""
    if out is None:
        return Path("out") / name if force else free_folder(Path("out") / name, taken)
    if not force and out.is_dir() and _holds_something(out):
        raise FileExistsError(f"out is {out}, which is not empty; name another folder or add --force")
    return out


def check_names(name: str, out: Path) -> None:
    """Raise ValueError if a file named after a scene would have a name too long for the file system."""
    there = next(folder for folder in (out.absolute(), *out.absolute().parents) if folder.exists())
    try:
        most = os.pathconf(there, "PC_NAME_MAX")
    except (AttributeError, OSError, ValueError):
        most = 255  # limit of most file systems
    length, most = len(os.fsencode(name)), most - len(".") - len(".unfinished.webp")
    if length > most:
        raise ValueError(
            f"the name of scene {name[:20]!r}... is {length} bytes long; it must be at most {most}, since files "
            "are named after it"
        )


@contextmanager
def own_folder(name: str, out: Path | None, force: bool) -> Iterator[Path]:
    """Create and lock the folder for results; by default the first folder that no other run uses.

    With `force` an earlier run's results in `out` are removed; otherwise FileExistsError is raised if `out` is not
    empty. Raise ValueError if another run uses the folder, and OSError if it cannot be written to.
    """
    taken: set[Path] = set()
    while True:
        folder = wanted_folder(name, out, force, taken)
        disk.writable_folder("out", folder, folder)
        with ExitStack() as stack:
            try:
                stack.enter_context(alone_in(folder))
            except ValueError:
                if out is not None or force:
                    raise
                taken.add(folder)
                continue
            if out is None and not force and _holds_something(folder):
                continue  # another run has begun and ended meanwhile
            if force:
                unfinished = [path for path in folder.iterdir() if is_unfinished(path)]
                written = [folder / one for one in (TRAJECTORY, RESTART, PROBES, PROBES_BY_SUBSTEP)]
                for path in (*pictures_in(folder, name), *written, *unfinished):
                    path.unlink(missing_ok=True)
            yield folder
            return


def _holds_something(folder: Path) -> bool:
    return not all(map(is_unfinished, folder.iterdir()))


def free_folder(wanted: Path, taken: Collection[Path] = ()) -> Path:
    """Return a missing or empty folder: `wanted`, or `wanted` with the next free number appended."""
    folder, k = wanted, 2
    while folder in taken or (folder.exists() and (not folder.is_dir() or _holds_something(folder))):
        folder, k = wanted.with_name(f"{wanted.name}-{k}"), k + 1
    return folder


def pictures_in(folder: Path, name: str) -> list[Path]:
    """Return the pictures in a folder that a run with this name would replace."""
    from ..pictures import FILM_FORMATS

    others = [folder / f"{name}.{end}" for end in FILM_FORMATS]
    others += [overlay_path(folder, name), still_path(folder, name), folder / MASKS]
    drawn = [folder.glob(f"{one}_[0-9]*.*") for one in ("frame", "depth", "mask")]
    return [*sorted(path for paths in drawn for path in paths), *(path for path in others if path.exists())]


def pass_path(folder: Path, kind: str, k: int) -> Path:
    """Return the path of a picture's pass: its depth or mask."""
    return folder / f"{kind}_{k:04d}.{'tif' if kind == 'depth' else 'png'}"


def still_path(folder: Path, name: str) -> Path:
    """Return the path of the still, a picture for print."""
    return folder / f"{name}_still.png"


def overlay_path(folder: Path, name: str) -> Path:
    """Return the path of the overlay, a picture of several poses."""
    return folder / f"{name}_overlay.png"
