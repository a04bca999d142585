"""Ways to damage a file: as disks do, and as someone does who knows how it is read."""

import json
import random
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from msdwarp.files import read_restart, write_restart

PAGE = 4096
Ranges = list[tuple[int, int]]
"""First byte and the one behind the last, of each part."""
_FRAMES = ("Points", "PointData/velocity", "CellData/strain", "Steps/Values")
_ESCAPES = "\x1b[2J\x1b]0;x\x07\u202e\r\x9b31m"
_ODD: list[Any] = [
    *(None, True, -1, 0, 10**9, 10**400, 1e308, float("nan"), float("inf"), "", "../..", _ESCAPES, "\ud800"),
    *([], {}, [None], {"": {}}, [[[[]]]], "x" * 100_000, [0] * 5000, {"a": [1, "b"]}),
]


def array_ranges(path: Path) -> tuple[Ranges, Ranges]:
    """Return where the numbers of frames lie, which have no checksums, and all other arrays and texts."""
    frames, others = [], []
    with h5py.File(path, "r") as opened:
        file: Any = opened
        names: list[str] = []
        file.visit(names.append)
        for name in names:
            item = file[name]
            if isinstance(item, h5py.Dataset):
                (frames if name.removeprefix("VTKHDF/") in _FRAMES else others).extend(_ranges(item))
    return frames, others


def _ranges(item: Any) -> Ranges:
    """Return where an array lies in its file."""
    if item.chunks is None:
        start = item.id.get_offset()
        return [] if start is None else [(start, start + item.id.get_storage_size())]
    chunks = [item.id.get_chunk_info(k) for k in range(item.id.get_num_chunks())]
    return [(one.byte_offset, one.byte_offset + one.size) for one in chunks]


def touches(ranges: Ranges, sound: bytes, damaged: bytes) -> bool:
    """Tell whether a byte within some ranges is another one now."""
    return any(sound[start:stop] != damaged[start:stop] for start, stop in ranges)


def damaged(sound: bytes, way: str, ranges: tuple[Ranges, Ranges], chance: random.Random) -> bytes:
    """Return a file's bytes as a disk may have damaged them: anywhere, in arrays beside frames, in structures."""
    whole = bytearray(sound)
    if way == "flip":
        whole[_place(len(whole), ranges, chance)] ^= 1 << chance.randrange(8)
    elif way == "flips":
        for _ in range(chance.choice((8, 64, 512))):
            whole[_place(len(whole), ranges, chance)] ^= 1 << chance.randrange(8)
    elif way == "cut":
        del whole[_place(len(whole), ranges, chance) :]
    elif way == "page":
        start = _place(len(whole), ranges, chance) // PAGE * PAGE
        whole[start : start + PAGE] = chance.choice((b"\0", b"\xff")) * len(whole[start : start + PAGE])
    elif way == "noise":
        start = _place(len(whole), ranges, chance)
        size = min(chance.choice((4, 16, 256, PAGE)), len(whole) - start)
        whole[start : start + size] = chance.randbytes(size)
    return bytes(whole)


def _place(size: int, ranges: tuple[Ranges, Ranges], chance: random.Random) -> int:
    frames, others = ranges
    where, place = chance.choice(("anywhere", "arrays", "structures")), chance.randrange(size)
    if where == "arrays" and others:
        return chance.randrange(*chance.choice(others))
    while where == "structures" and any(start <= place < stop for start, stop in frames + others):
        place = chance.randrange(size)
    return place


def craft(path: Path, script: Path, chance: random.Random) -> str:
    """Change something in an HDF5 file, knowing what it is; return what.

    Where a script is named, it is `script`, which nobody has allowed to run.
    """
    with h5py.File(path, "r+", locking=False) as opened:
        file: Any = opened
        things: list[str] = []
        file.visit(things.append)
        texts = [name for name in things if name.endswith(("attributes", "description"))]
        if chance.random() < 0.4 and texts:
            name = chance.choice(texts)
            try:
                value = json.loads(bytes(file[name][()]))
            except (ValueError, TypeError):
                value = {}
            said, value = _spoiled(value, script, chance)
            _put(file, name, np.bytes_(json.dumps(value).encode("utf-8", "surrogatepass")))
            return f"{name}: {said}"
        name = chance.choice(things)
        attributes = [(one, each) for one in things for each in file[one].attrs]
        ways: list[Callable[[Any, str, random.Random], str]] = [_links, _other, _removed, _sizes, _values]
        if chance.random() < 0.3 and attributes:
            name, attribute = chance.choice(attributes)
            value = chance.choice(_arrays(chance))
            file[name].attrs[attribute] = value
            return f"attribute {name} {attribute} = {str(value)[:30]!r}"
        return chance.choice(ways)(file, name, chance)


def craft_restart(path: Path, script: Path, chance: random.Random) -> str:
    """Spoil what a restart file says, with checksums that are right."""
    arrays, attributes = read_restart(path)
    if chance.random() < 0.4:
        name = chance.choice(list(arrays))
        arrays[name] = np.asarray(
            chance.choice([a for a in _arrays(chance) if np.asarray(a).dtype.kind in "biuf"])
        )
        said = f"array {name} of shape {arrays[name].shape}"
    else:
        said, attributes = _spoiled(attributes, script, chance)
    write_restart(path, arrays, attributes if isinstance(attributes, dict) else {"run": attributes})
    return said


def _spoiled(value: Any, script: Path, chance: random.Random) -> tuple[str, Any]:
    """Return what was changed somewhere within a value of JSON, and the value."""
    holders: list[tuple[Any, Any]] = []

    def walk(part: Any) -> None:
        for key in list(part) if isinstance(part, dict) else range(len(part)) if isinstance(part, list) else ():
            holders.append((part, key))
            walk(part[key])

    walk(value)
    if not holders or chance.random() < 0.03:
        return "another value", chance.choice(_ODD)
    part, key = chance.choice(holders)
    if isinstance(value, dict) and "scene" in value and chance.random() < 0.3:
        part, key, new = value, "scene", chance.choice((str(script), script.name, f"../{script.name}"))
    elif chance.random() < 0.2:
        del part[key]
        return f"without {key!r}", value
    else:
        new = chance.choice(_ODD)
    part[key] = new
    return f"{key!r} = {str(new)[:30]!r}", value


def _put(file: Any, name: str, value: Any) -> None:
    del file[name]
    file[name] = value


def _arrays(chance: random.Random) -> list[Any]:
    return [
        *(np.int64(-1), np.int64(0), np.int64(1 << 40), np.float64("nan"), np.float64("inf"), np.float64(1e300)),
        *(np.zeros(0), np.zeros((2, 3)), np.full((chance.randrange(1, 99), 3), np.nan), np.zeros((1, 1, 1, 1))),
        *(
            np.arange(7),
            -np.arange(9.0),
            np.ones(5, bool),
            np.ones(3, complex),
            np.bytes_(b"\x1b[2J"),
            np.zeros(27),
        ),
        np.zeros(3, [("a", "i4"), ("b", "f8")]),
    ]


def _links(file: Any, name: str, chance: random.Random) -> str:
    """Put a link in the place of something, or beside it: out, to nothing, to itself, or to what it is in."""
    kind = chance.choice(("external", "soft", "cycle", "hard"))
    if chance.random() < 0.5:
        del file[name]
    else:
        name += "_too"
        if "/" not in name or name.rpartition("/")[0] not in file:
            name = "beside"
    if kind == "hard":
        parent = file[name.rpartition("/")[0] or "/"]
        parent[name.rpartition("/")[2]] = chance.choice((parent, file["/"]))
    else:
        target = {"external": None, "soft": "/nothing", "cycle": f"/{name}"}[kind]
        file[name] = h5py.ExternalLink("/etc/passwd", "/") if target is None else h5py.SoftLink(target)
    return f"{kind} link {name}"


def _other(file: Any, name: str, chance: random.Random) -> str:
    """Put something of another kind in the place of something."""
    value = chance.choice(_arrays(chance))
    if chance.random() < 0.2:
        del file[name]
        file.create_group(name)
        return f"{name} is a group"
    _put(file, name, "a text of any length" if chance.random() < 0.1 else value)
    return f"{name} = {str(value)[:30]!r}"


def _removed(file: Any, name: str, chance: random.Random) -> str:
    del file[name]
    return f"without {name}"


def _sizes(file: Any, name: str, chance: random.Random) -> str:
    """Declare a huge size, with no bytes, or resize what can be resized."""
    item, count = file[name], chance.choice((1 << 24, 1 << 33, 1 << 50))
    if isinstance(item, h5py.Dataset) and item.maxshape and item.maxshape[0] is None and chance.random() < 0.7:
        item.resize(chance.choice((0, 1, 5, count)), axis=0)
        return f"{name} has shape {item.shape}"
    dtype = item.dtype if isinstance(item, h5py.Dataset) else np.dtype("f8")
    del file[name]
    options = {"compression": "gzip"} if chance.random() < 0.5 else {}
    file.create_dataset(name, shape=(count,), dtype=dtype, chunks=(1024,), **options)
    return f"{name} is huge: {count}"


def _values(file: Any, name: str, chance: random.Random) -> str:
    """Write numbers into an array that no run writes."""
    item = file[name]
    if not isinstance(item, h5py.Dataset) or item.dtype.kind not in "if" or not item.shape or not item.size:
        return _removed(file, name, chance)
    odd = [np.nan, np.inf, -1e30, 0.0, 1e38] if item.dtype.kind == "f" else [-1, 0, 2**31 - 1, 10**6]
    place, value = chance.randrange(item.shape[0]), chance.choice(odd)
    if chance.random() < 0.3:
        item[...] = value
        return f"{name} is all {value}"
    item[place] = value
    return f"{name}[{place}] = {value}"
