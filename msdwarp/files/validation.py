"""What an HDF5 file may hold before anything of it is believed: `unsound` says what speaks against that.

It reads structures, texts and no arrays, and needs HDF5 alone: `msdwarp.files.probe` runs this file by itself, in
a process that may be ended where HDF5 does not come back.
"""

import math
import sys
from typing import Any

_MOST_OBJECTS = 10_000
_FILTERS = {1: "gzip", 2: "shuffle", 3: "fletcher32"}
_MOST_SQUEEZED = 1100
"""How many bytes gzip can make of one, at most."""
_GROWING = ("VTKHDF/Points", "VTKHDF/PointData/", "VTKHDF/CellData/", "VTKHDF/Steps/", "msdwarp/substeps")
_GROWING += ("msdwarp/readings/by_", "msdwarp/readings/ends")
"""What may end with rows that are not on the disk yet, as it is read while it is written."""


def unsound(file: Any) -> str | None:
    """Return why an open file is not to be read: links out of it, foreign filters, sizes that it does not have."""
    import h5py
    from h5py import h5o  # pyright: ignore[reportAttributeAccessIssue]

    seen = set()
    waiting = [("", file)]
    while waiting:
        place, group = waiting.pop()
        for name in group:
            path = f"{place}/{name}".lstrip("/")
            link = group.get(name, getlink=True)
            if not isinstance(link, h5py.HardLink):
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
            elif isinstance(item, h5py.Dataset):
                if wrong := _wrong(item, path):
                    return f"{path!r} {wrong}"
            else:
                return f"{path!r} is a type, which no run writes"
            for attribute in item.attrs:
                if item.attrs.get_id(attribute).get_storage_size() > 1 << 20:
                    return f"{path!r} has an attribute {attribute!r} of more than a MiB"
                _ = item.attrs[attribute]
    return None


def _wrong(item: Any, path: str) -> str | None:
    """Return what is wrong with an array, by what it says of itself."""
    if item.is_virtual or item.external:
        return "lies in other files"
    plan = item.id.get_create_plist()
    found = [plan.get_filter(k)[0] for k in range(plan.get_nfilters())]
    if foreign := [code for code in found if code not in _FILTERS]:
        return f"needs filter {foreign[0]}; it may need {', '.join(_FILTERS.values())}"
    if item.dtype.hasobject:  # texts of any length, in a heap that may be damaged
        if item.shape != ():
            return "is an array of texts or of what has any length, which no run writes"
        _ = item[()]
        return None
    if path.startswith(_GROWING):
        return None  # what is read of it is compared with what is there by its reader
    return too_large(item, math.prod(item.shape or ()), item.id.get_storage_size())


def too_large(item: Any, count: int, stored: int) -> str | None:
    """Return that so many numbers of an array cannot be in so many bytes of a file; None if they can."""
    size = count * item.dtype.itemsize
    most = stored * (_MOST_SQUEEZED if item.compression else 1)
    return f"should hold {size} bytes, and {stored} are there" if size > most else None


def main(path: str) -> None:
    """Print what speaks against a file; nothing where nothing does. HDF5 may crash, or never end."""
    import h5py

    _limit()
    with h5py.File(path, "r", locking=False) as file:
        print(unsound(file) or "", end="")


def _limit() -> None:
    """Have the system end this process after some seconds of computing, or where it asks for much memory."""
    try:
        import resource
    except ImportError:
        return
    spent, most = resource.getrusage(resource.RUSAGE_SELF), 1 << 36
    seconds = math.ceil(spent.ru_utime + spent.ru_stime + float(sys.argv[2]))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds))
    with open("/proc/self/statm") if sys.platform == "linux" else open("/dev/null") as file:
        pages = file.read().split()
    if pages:
        most = int(pages[0]) * resource.getpagesize() + (2 << 30)
    resource.setrlimit(resource.RLIMIT_AS, (most, most))


if __name__ == "__main__":
    main(sys.argv[1])
