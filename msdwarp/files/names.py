"""Names in the file of a trajectory, and how arrays are stored in it."""

import json
import zlib
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

FORMAT = 1
"""Version of the group `msdwarp` in a file; VTK's own has another."""
OWN, ROOT = "msdwarp", "VTKHDF"
POINTS, VELOCITY, STRAIN = "Points", "PointData/velocity", "CellData/strain"
CONTACT = "PointData/contact_force"
"""What contacts push each particle with [N], the mean over the frame; where that was asked for."""
BROKEN_AT = "CellData/broken_at"
"""When each connection broke [s], inf where it is whole; of a triangle, when it parted (`Edges`). There is
one for all frames, for what breaks in a later one does not change the earlier ones."""
SUBSTEPS = "substeps"
"""Of each frame how many it took, in the group `msdwarp`; 0 where that is unknown."""
READINGS = "readings"
"""What probes told, in the group `msdwarp`; see `msdwarp.files.reading_tables`."""
COUNT = "NumberOfCells"
KINDS = ("Vertices", "Lines", "Polygons", "Strips")
"""VTK's kinds of cells, in the order in which it counts them."""
_SUM = "crc32"
"""The attribute of an array that has its checksum."""
GZIP = {"compression": "gzip", "compression_opts": 1, "shuffle": True}


def store(group: Any, name: str, values: NDArray, compress: bool = False) -> None:
    """Store an array that there is once, with a checksum, compressed if it is large and that is asked for.

    HDF5's own checksums need chunks, which a text or a single number cannot have.
    """
    item = group.create_dataset(name, data=values, **(GZIP if compress and values.size > 1000 else {}))
    item.attrs[_SUM] = np.uint32(_sum(values))


def restored(item: Any) -> Any:
    """Return what `store` has stored; raise ValueError if it is no longer that.

    Earlier versions, and other programs, have stored no checksum.
    """
    values = item[()]
    if _SUM in item.attrs and item.attrs[_SUM] != _sum(values):
        raise ValueError(f"{item.name} is damaged: it is not what its checksum is of")
    return values


def _sum(values: Any) -> int:
    return zlib.crc32(np.ascontiguousarray(values).data)


def same(there: NDArray, values: Any) -> bool:
    """Tell whether an array has these numbers, bit for bit, in its own precision."""
    given = np.asarray(values, dtype=there.dtype)
    return there.shape == given.shape and there.tobytes() == given.tobytes()


def store_text(group: Any, name: str, text: str) -> None:
    """Store a text as one of a fixed length.

    HDF5 lays texts of any length into a heap that has no checksum; where a disk has lost a part of that, reading
    it never ends.
    """
    store(group, name, np.array(np.bytes_(text.encode())))


def as_json(attributes: Mapping[str, Any]) -> dict[str, Any]:
    """Return attributes as they will be read; raise ValueError that names one that JSON cannot hold."""
    result = {}
    for name, value in attributes.items():
        try:
            result[str(name)] = json.loads(json.dumps(value))
        except (TypeError, ValueError) as error:
            raise ValueError(
                f"attributes[{name!r}] is {value!r}; it must be a number, a text, a truth value, None, or a list "
                "or mapping of those"
            ) from error
    return result


def fault(file: Any) -> str | None:
    """Return what tells a file from a trajectory that can be read, None where nothing does."""
    if ROOT not in file:
        return f"it has no group {ROOT}"
    if OWN not in file:
        return f"it is {ROOT} of another program, without a group {OWN}"
    version = file[OWN].attrs.get("msdwarp_format")
    if version == FORMAT:
        return None
    advice = ": install a newer msdwarp" if isinstance(version, np.integer) and version > FORMAT else ""
    return f"it is of format {version}; this version reads {FORMAT}{advice}"
