"""Checks of an HDF5 file before its contents are used.

`structure_fault` reads metadata and texts, but no arrays. `probe` calls it in a separate process, which imports
only this file and h5py, and can be killed: on a damaged or malicious file HDF5 may not return, may ignore signals,
and may use all memory.
"""

import math
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

_SECONDS = 2.0
"""CPU time allowed to the process [s]; an undamaged file takes a few hundredths."""
_MOST_SECONDS = 120.0
"""Total time allowed to the process [s], enough for a slow disk."""
_MOST_OBJECTS = 10_000
_FILTERS = {1: "gzip", 2: "shuffle", 3: "fletcher32"}
_MOST_SQUEEZED = 1100
"""Maximal ratio of uncompressed to compressed size with gzip."""
_GROWING = ("VTKHDF/Points", "VTKHDF/PointData/", "VTKHDF/CellData/", "VTKHDF/Steps/", "msdwarp/substeps")
_GROWING += ("msdwarp/readings/by_", "msdwarp/readings/ends")
"""Arrays whose last rows may not be on disk yet while the file is being written."""


def probe(path: str | Path) -> None:
    """Raise ValueError unless HDF5 can traverse a file, and every array in it has the stated size.

    Contents are not checked. For a file that HDF5 itself refuses, opening the file raises the error instead.
    """
    path = Path(path)
    if not begins_as_hdf5(path):
        return
    words = [sys.executable, "-I", __file__, str(path.absolute())]
    env = os.environ | {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
    try:
        done = subprocess.run(words, capture_output=True, env=env, timeout=_MOST_SECONDS, check=False)
    except subprocess.TimeoutExpired as error:
        raise ValueError(f"{path} cannot be read: after {_MOST_SECONDS:g} s the check has not finished") from error
    if found := done.stdout.decode(errors="replace"):
        raise ValueError(f"{path} cannot be read: {found}")
    if done.returncode < 0:
        raise ValueError(f"{path} is damaged: reading its structures does not end, or crashes HDF5")


def begins_as_hdf5(path: Path) -> bool:
    """Return whether a file begins as HDF5 files do; a pipe, which might never answer, is not read."""
    if path.exists() and not path.is_file():
        return False
    with path.open("rb") as file:
        return file.read(8) == b"\x89HDF\r\n\x1a\n"


def structure_fault(file: Any) -> str | None:
    """Return why an open file cannot be read safely, such as external links, unknown filters, impossible sizes."""
    import h5py
    from h5py import h5o  # pyright: ignore[reportAttributeAccessIssue]

    seen = set()
    waiting = [("", file)]
    while waiting:
        place, group = waiting.pop()
        for name in group:
            path = f"{place}/{name}".lstrip("/")
            if not isinstance(group.get(name, getlink=True), h5py.HardLink):
                return f"{path!r} is a link, which may lead out of the file"
            item = group[name]
            if len(seen) >= _MOST_OBJECTS:
                return f"it holds more than {_MOST_OBJECTS} things"
            address = h5o.get_info(item.id).addr
            if address in seen:
                continue
            seen.add(address)
            if isinstance(item, h5py.Group):
                waiting.append((path, item))
            elif not isinstance(item, h5py.Dataset):
                return f"{path!r} is a type, which no run writes"
            elif wrong := _wrong(item, path):
                return f"{path!r} {wrong}"
            for attribute in item.attrs:
                if item.attrs.get_id(attribute).get_storage_size() > 1 << 20:
                    return f"{path!r} has an attribute {attribute!r} of more than a MiB"
                _ = item.attrs[attribute]
    return None


def _wrong(item: Any, path: str) -> str | None:
    """Return why an array cannot be read safely, according to its metadata; None if it can be read."""
    if item.is_virtual or item.external:
        return "lies in other files"
    plan = item.id.get_create_plist()
    found = [plan.get_filter(k)[0] for k in range(plan.get_nfilters())]
    if foreign := [code for code in found if code not in _FILTERS]:
        return f"needs filter {foreign[0]}; it may need {', '.join(_FILTERS.values())}"
    if item.dtype.hasobject:  # strings of variable length are in a heap that may be damaged
        if item.shape != ():
            return "is an array of texts or of what has any length, which no run writes"
        _ = item[()]
        return None
    if path.startswith(_GROWING):
        return None  # the reader checks the part that it reads
    return too_large(item, math.prod(item.shape or ()), item.id.get_storage_size())


def too_large(item: Any, count: int, stored: int) -> str | None:
    """Return a message if `count` entries of an array cannot fit in `stored` bytes of a file; None if they can."""
    size = count * item.dtype.itemsize
    most = stored * (_MOST_SQUEEZED if item.compression else 1)
    return f"should hold {size} bytes, and {stored} are there" if size > most else None


def _limit() -> None:
    """Limit this process: the system kills it after some seconds of CPU time and refuses it much memory."""
    try:
        import resource
    except ImportError:
        return
    spent, most = resource.getrusage(resource.RUSAGE_SELF), 1 << 36
    seconds = math.ceil(spent.ru_utime + spent.ru_stime + _SECONDS)
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds))
    if sys.platform == "linux":
        pages = int(Path("/proc/self/statm").read_text().split()[0])
        most = pages * resource.getpagesize() + (2 << 30)
    resource.setrlimit(resource.RLIMIT_AS, (most, most))


def main(path: str) -> None:
    """Print why a file cannot be read safely; print nothing if it can. HDF5 may crash or not return."""
    import h5py

    _limit()
    with h5py.File(path, "r", locking=False) as file:
        print(structure_fault(file) or "", end="")


if __name__ == "__main__":
    main(sys.argv[1])
