"""Names in trajectory files; storing and loading arrays with checksums, for restart files as well."""

import json
import math
import zlib
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

FORMAT = 1
"""Version of the group `msdwarp` in a file; VTK's group has a version of its own."""
OWN, ROOT = "msdwarp", "VTKHDF"
POINTS, VELOCITY, STRAIN = "Points", "PointData/velocity", "CellData/strain"
CONTACT = "PointData/contact_force"
"""Contact force on each particle [N], the mean over the frame; optional."""
BROKEN_AT = "CellData/broken_at"
"""Time at which each connection broke, or each triangle parted (`Edges`) [s]; inf if it has not. One array serves
all frames, since later fracture does not change earlier frames."""
SUBSTEPS = "substeps"
"""Number of substeps of each frame, in the group `msdwarp`; 0 if unknown."""
READINGS = "readings"
"""Readings of probes, in the group `msdwarp`; see `msdwarp.files.reading_tables`."""
COUNT = "NumberOfCells"
KINDS = ("Vertices", "Lines", "Polygons", "Strips")
"""VTK's kinds of cells, in VTK's order."""
_SUM = "crc32"
"""Name of the attribute with an array's checksum."""
GZIP = {"compression": "gzip", "compression_opts": 1, "shuffle": True}


def store(group: Any, name: str, values: NDArray, compress: bool = False) -> None:
    """Store an array with a checksum; compress large arrays if `compress`."""
    # HDF5's own checksums need chunks, which texts and scalars cannot have.
    item = group.create_dataset(name, data=values, **(GZIP if compress and values.size > 1000 else {}))
    item.attrs[_SUM] = np.uint32(_sum(values))


class Growing(NamedTuple):
    """An array to which rows are added."""

    name: str
    width: tuple[int, ...]
    """Shape of one row."""
    dtype: Any
    chunk: int
    """Rows per chunk; HDF5 allocates whole chunks."""
    options: Mapping[str, Any] = MappingProxyType({})
    """Further options of HDF5."""

    def create(self, group: Any) -> Any:
        """Create the array with no rows."""
        shape = {"shape": (0, *self.width), "maxshape": (None, *self.width), "chunks": (self.chunk, *self.width)}
        options = {"fill_time": "never", **shape, **self.options}
        return group.create_dataset(self.name, dtype=self.dtype, **options)

    def open(self, group: Any) -> Any:
        """Return the array; raise ValueError if it is missing, or rows of this shape cannot be added."""
        item = group.get(self.name)
        shape, kind = getattr(item, "maxshape", None), np.dtype(self.dtype).kind
        if shape is None or (shape[:1], shape[1:]) != ((None,), self.width) or item.dtype.kind != kind:
            raise ValueError(
                f"{group.file.filename} is a damaged trajectory: no rows can be added to its {self.name}"
            )
        return item

    def growth(self, before: int, after: int) -> int:
        """Return the number of bytes that rows `before` to `after` add to the array."""
        chunks = -(-after // self.chunk) - -(-before // self.chunk)
        return chunks * self.chunk * math.prod(self.width) * np.dtype(self.dtype).itemsize


def load(item: Any) -> Any:
    """Return a stored array; raise ValueError if its checksum does not match. Early files have no checksums."""
    values = item[()]
    if _SUM in item.attrs and item.attrs[_SUM] != _sum(values):
        raise ValueError(f"{item.name} is damaged: it is not what its checksum is of")
    return values


def _sum(values: Any) -> int:
    return zlib.crc32(np.ascontiguousarray(values).data)


def same(there: NDArray, values: Any) -> bool:
    """Return whether a stored array equals given values bit for bit, in the array's precision."""
    given = np.asarray(values, dtype=there.dtype)
    return there.shape == given.shape and there.tobytes() == given.tobytes()


def store_text(group: Any, name: str, text: str) -> None:
    """Store a text as a string of fixed length."""
    # HDF5 stores strings of variable length in a heap without checksum, and reading a damaged heap may not end.
    store(group, name, np.array(np.bytes_(text.encode())))


def as_json(attributes: Mapping[str, Any]) -> dict[str, Any]:
    """Return attributes as JSON will return them; raise ValueError for one that JSON cannot store."""
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
