"""VTKHDF: how a trajectory is laid out in its file, and the system beside it; see docs/files.md.

Files come as open h5py files, so that HDF5 is loaded only where one is opened.
"""

import json
from collections.abc import Iterator, Mapping
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..bodies import AXES, Edges, System, broken_before
from .names import (
    BROKEN_AT,
    CONTACT,
    COUNT,
    FORMAT,
    GZIP,
    KINDS,
    OWN,
    POINTS,
    ROOT,
    STRAIN,
    SUBSTEPS,
    VELOCITY,
    same,
    store,
    store_text,
)
from .reading_tables import Columns, ReadingTables, Rows
from .stored_system import arrays_of, write_system

Scene = tuple[Mapping[str, Any], Mapping[str, NDArray]]
"""What pictures need of a scene: what JSON can hold, and arrays by name."""
_LEAST_CHUNK, _MOST_CHUNK = 1 << 16, 1 << 31
"""Bytes of a chunk; HDF5 takes no more than 4 GiB."""
_FORESEEN = 1024
"""Frames whose offsets are written at once, where it is unknown how many there will be."""
_MOST_FORESEEN = 1 << 16
"""The same where it is known: for what is never reached room is taken too."""
_BLOCK = 1 << 15
"""Connections whose strain is computed at a time: their coordinates fit into the cache."""


class Layout:
    """How a system's frames are laid out: what there is once, and what each frame adds.

    Parameters
    ----------
    system
        What moves.
    dtype
        Numbers of the frames, float32 or float64.
    frame_count
        Frames that there will be, None if that is unknown.
    compress
        Whether arrays are compressed.
    strain
        Whether there is a strain of each connection.
    tears
        Whether there is a time at which each connection broke; by default where any can.
    readings
        What probes tell, if any do.
    contact_forces
        Whether there is a force of contact on each particle.
    """

    def __init__(
        self,
        system: System,
        dtype: np.dtype,
        frame_count: int | None,
        compress: bool,
        strain: bool,
        tears: bool | None = None,
        readings: Columns | None = None,
        contact_forces: bool = False,
    ) -> None:
        self._system, self._dtype, self._compress = system, dtype, compress
        surface = system.surface
        self._embedded = surface if surface is not None and surface.weights is not None else None
        n = system.particle_count
        self._points = n + (0 if self._embedded is None else len(self._embedded.particle))
        self._cells = _cells(system)
        self._per_frame = {POINTS: self._points, VELOCITY: self._points}
        if contact_forces:
            self._per_frame[CONTACT] = self._points
        if strain and system.connection_count:
            cells = sum(map(len, self._cells.values()))  # with no vertices before the connections
            self._per_frame[STRAIN] = cells
            self._no_connections = np.full(cells - system.connection_count, np.nan, dtype=dtype)
        self._tears = system.tears if tears is None else tears
        self._edges = Edges(system) if self._tears else None
        self._foreseen = min(frame_count or _FORESEEN, _MOST_FORESEEN)
        self._readings = ReadingTables(readings) if readings else None

    @classmethod
    def of(cls, file: Any, system: System) -> "Layout":
        """Return the layout of a file that has begun."""
        root = file[ROOT]
        values, times = cls._growing(root, POINTS, (3,), "f"), cls._growing(root, "Steps/Values", (), "f")
        compressed, strain, tears = values.compression is not None, STRAIN in root, BROKEN_AT in root
        contact_forces = CONTACT in root
        return cls(system, values.dtype, times.chunks[0], compressed, strain, tears, contact_forces=contact_forces)

    @property
    def static_size(self) -> int:
        """Bytes of what there is once."""
        own = sum(values.nbytes for values in arrays_of(self._system).values())
        own += 4 * sum(map(len, self._cells.values())) if self._tears else 0
        return own + sum(2 * cells.nbytes + cells.itemsize for cells in self._cells.values())

    def growth(self, k: int, rows: Rows) -> int:
        """Return by how many bytes frame k lets the arrays grow, at most, as chunks are taken whole."""
        size = self.growth_by(rows, k)
        if k % self._foreseen == 0:
            numbers = 2 + sum(stride.size for stride in self._offsets().values())
            size += self._foreseen * numbers * 8
        for name, count in self._per_frame.items():
            each = self._chunk(name)
            chunks = -(-(k + 1) * count // each) - -(-k * count // each)
            size += chunks * each * self._row_size(name)
        return size

    def growth_by(self, rows: Rows, k: int = 0) -> int:
        """Return the same of the tables of readings for more rows."""
        return 0 if self._readings is None else self._readings.growth(k, rows)

    def begin(self, file: Any, fps: float, attributes: Mapping[str, Any], scene: Scene | None) -> None:
        """Write what there is once: the attributes of the run among it, and its scene, which JSON can hold."""
        group = file.create_group(OWN)
        group.attrs["msdwarp_format"], group.attrs["fps"] = FORMAT, fps
        store_text(group, "attributes", json.dumps(attributes))
        if scene is not None:
            described, arrays = scene
            store_text(group, "scene/description", json.dumps([described, list(arrays)]))
            for k, values in enumerate(arrays.values()):
                store(group, f"scene/arrays/{k}", values, compress=True)  # images, for the most part
        write_system(group, self._system, self._compress)
        _create_growing(group, SUBSTEPS, (), np.int32, self._foreseen)
        if self._readings is not None:
            self._readings.begin(group, self._foreseen)
        root = file.create_group(ROOT)
        root.attrs["Version"] = np.array([2, 2])
        root.attrs["Type"] = np.bytes_("PolyData")
        store(root, "NumberOfPoints", np.array([self._points]))
        for name, cells in self._cells.items():
            group, corners = root.create_group(name), cells.shape[1]
            store(group, COUNT, np.array([len(cells)]))
            store(group, "NumberOfConnectivityIds", np.array([cells.size]))
            store(group, "Connectivity", cells.ravel(), self._compress)
            store(group, "Offsets", np.arange(0, cells.size + 1, corners, dtype=cells.dtype), self._compress)
        if self._edges is not None:
            at_start = np.where(self._system.broken, 0.0, np.inf)
            root.create_dataset(BROKEN_AT, data=self._broken_cells(at_start, self._edges))
        steps = root.create_group("Steps")
        steps.attrs["NSteps"] = np.int64(0)
        _create_growing(steps, "Values", (), np.float64, self._foreseen, fillvalue=np.nan, fill_time="ifset")
        for name, stride in self._offsets().items():
            _create_growing(steps, name, stride.shape, np.int64, self._foreseen)
        for name in self._per_frame:
            width = () if name == STRAIN else (3,)
            _create_growing(root, name, width, self._dtype, self._chunk(name), **(GZIP if self._compress else {}))

    def open(self, file: Any) -> None:
        """Get ready to append frames to a file that has begun; raise ValueError if it cannot grow by them."""
        self._file, self._steps = file, file[ROOT]["Steps"]
        self._times = self._growing(self._steps, "Values", (), "f")
        for name, stride in self._offsets().items():
            self._growing(self._steps, name, stride.shape, "i")
        widths = {name: () if name == STRAIN else (3,) for name in self._per_frame}
        self._datasets = {name: self._growing(file[ROOT], name, width, "f") for name, width in widths.items()}
        self._broken_at = file[ROOT].get(BROKEN_AT) if self._tears else None
        if self._broken_at is not None:
            self._known = self._broken_at[: self._system.connection_count]
        self._substeps = None  # which files of before have not
        if SUBSTEPS in file[OWN]:
            self._substeps = self._growing(file[OWN], SUBSTEPS, (), "i")
        self._readings = ReadingTables.of(file)  # those of a file to go on with are its own

    @staticmethod
    def _growing(group: Any, name: str, width: tuple[int, ...], kind: str) -> Any:
        """Return an array of numbers, to which rows of this shape can be added."""
        item = group.get(name)
        shape = getattr(item, "maxshape", None)
        if shape is None or (shape[:1], shape[1:]) != ((None,), width) or item.dtype.kind != kind:
            raise ValueError(f"{group.file.filename} is a damaged trajectory: no rows can be added to its {name}")
        return item

    def go_on_behind(self, k: int, until: float) -> None:
        """Go on behind the first k frames, and what probes told up to `until` [s], of frames not kept too."""
        if self._readings is not None:
            self._readings.go_on_behind(k, float(self._times[k - 1]), until)

    def truncate(self, k: int) -> None:
        """Let a file have its first k frames only; where the others were, the next ones will be written."""
        # VTK's reader writes past its memory where there are more times than frames.
        last = float(self._times[k - 1])
        self._times.resize(k, axis=0)
        if self._broken_at is not None and self._edges is not None:  # what broke behind them is whole again
            self._known = np.where(broken_before(self._known, last), self._known, np.float32(np.inf))
            self._broken_at[:] = self._broken_cells(self._known, self._edges)
        self._file.flush()
        self._steps.attrs.modify("NSteps", np.int64(k))
        self._file.flush()

    def holds(
        self,
        k: int,
        frame: tuple[float, NDArray, NDArray],
        strain: NDArray | None,
        substeps: int,
        broken_at: NDArray | None,
        rows: Rows,
        contact_force: NDArray | None,
    ) -> bool:
        """Tell whether frame k is this one, bit for bit, and what probes told up to it."""
        if self._times[k] != frame[0] or (self._substeps is not None and self._substeps[k] != substeps):
            return False
        if self._readings is not None and not self._readings.holds(rows, k):
            return False
        if self._broken_at is not None and broken_at is not None:
            seen = np.where(broken_before(self._known, frame[0]), self._known, np.float32(np.inf))
            if not same(seen, self._known_by(broken_at)):
                return False
        try:
            pieces = self._pieces(k, frame, strain, contact_force)
            return all(same(item[start : start + len(values)], values) for item, start, values in pieces)
        except OSError:  # HDF5's, of what is damaged
            return False

    def append(
        self,
        k: int,
        frame: tuple[float, NDArray, NDArray],
        strain: NDArray | None,
        substeps: int,
        broken_at: NDArray | None = None,
        rows: Rows = MappingProxyType({}),
        contact_force: NDArray | None = None,
    ) -> None:
        """Write frame k, behind the others, and what probes told up to it, and flush it."""
        if self._broken_at is not None and self._edges is not None and broken_at is not None:
            known = self._known_by(broken_at)
            if not np.array_equal(known, self._known):
                self._known = known
                self._broken_at[:] = self._broken_cells(known, self._edges)
        if k % self._foreseen == 0:
            until = k + self._foreseen
            for name, stride in self._offsets().items():
                _at_least(self._steps[name], until)
                offsets = np.multiply.outer(np.arange(k, until), stride)
                self._steps[name][k:until] = offsets + (name == "NumberOfParts")
            if self._substeps is not None:
                _at_least(self._substeps, until)
        if self._substeps is not None:
            self._substeps[k] = substeps
        if self._readings is not None:
            self._readings.add(rows)
            self._readings.note(k)
        for name, dataset in self._datasets.items():
            _at_least(dataset, (k + 1) * self._per_frame[name])
        for dataset, start, values in self._pieces(k, frame, strain, contact_force):
            dataset[start : start + len(values)] = values
        # VTK's reader writes past its memory where there are more times than frames.
        self._file.flush()
        self._steps.attrs.modify("NSteps", np.int64(k + 1))
        self._times.resize(k + 1, axis=0)
        self._times[k] = frame[0]
        self._file.flush()

    def holds_rows(self, rows: Rows) -> bool:
        """Tell whether what probes told next is this."""
        return self._readings is None or self._readings.holds(rows)

    def append_rows(self, rows: Rows) -> None:
        """Write what probes told in a frame that is not kept, and flush it."""
        if self._readings is not None:
            self._readings.add(rows)
            self._file.flush()

    def _offsets(self) -> dict[str, NDArray[np.int64]]:
        """Return what the arrays of offsets in Steps grow by from frame to frame."""
        strides = {"PartOffsets": 0, "NumberOfParts": 0, "CellOffsets": [0] * 4, "ConnectivityIdOffsets": [0] * 4}
        strides |= {"PointOffsets": self._points, "PointDataOffsets/velocity": self._points}
        if CONTACT in self._per_frame:
            strides["PointDataOffsets/contact_force"] = self._points
        if STRAIN in self._per_frame:
            strides["CellDataOffsets/strain"] = self._per_frame[STRAIN]
        if self._tears:
            strides["CellDataOffsets/broken_at"] = 0
        return {name: np.array(stride, dtype=np.int64) for name, stride in strides.items()}

    def _broken_cells(self, broken_at: NDArray, edges: Edges) -> NDArray[np.float32]:
        """Return when each cell broke [s]: connections, and behind them triangles."""
        before = np.full(len(self._cells["Vertices"]), np.inf)
        return np.concatenate([before, broken_at, edges.parted_at(broken_at)]).astype(np.float32)

    def _known_by(self, broken_at: NDArray) -> NDArray[np.float32]:
        """Return when each connection broke [s], those that were broken from the start at 0."""
        return np.where(self._system.broken, 0.0, broken_at).astype(np.float32)

    def _row_size(self, name: str) -> int:
        return self._dtype.itemsize * (1 if name == STRAIN else 3)

    def _chunk(self, name: str) -> int:
        """Return the rows of a chunk of an array."""
        count, size = self._per_frame[name], self._row_size(name)
        # What is compressed is compressed again whenever a part of it is written.
        frames = 1 if self._compress else max(1, _LEAST_CHUNK // (count * size))
        return min(frames * count, _MOST_CHUNK // size)

    def _in_space(self, values: NDArray) -> NDArray:
        """Return coordinates of particles as those of points in space, shape [point_count, 3]."""
        n, dim = values.shape
        if dim == 3 and self._embedded is None:
            return np.ascontiguousarray(values, dtype=self._dtype)
        result = np.zeros((self._points, 3), dtype=self._dtype)
        result[:n, AXES[dim]] = values
        if self._embedded is not None:
            result[n:, AXES[dim]] = self._embedded.points(values)
        return result

    def _pieces(
        self,
        k: int,
        frame: tuple[float, NDArray, NDArray],
        strain: NDArray | None,
        contact_force: NDArray | None,
    ) -> Iterator[tuple[Any, int, NDArray]]:
        """Yield the arrays of frame k, where in them its rows begin, and the rows."""
        for name, dataset in self._datasets.items():
            start = k * self._per_frame[name]
            for values in self._parts(name, frame, strain, contact_force):
                yield dataset, start, values
                start += len(values)

    def _parts(
        self,
        name: str,
        frame: tuple[float, NDArray, NDArray],
        strain: NDArray | None,
        contact_force: NDArray | None,
    ) -> list[NDArray]:
        """Return what a frame adds to an array, in parts that follow each other."""
        _, position, velocity = frame
        if name == CONTACT and contact_force is None:
            raise ValueError("contact_force is None; the file stores contact forces, so each frame needs them")
        of_points = {POINTS: position, VELOCITY: velocity, CONTACT: contact_force}
        if (values := of_points.get(name)) is not None:
            return [self._in_space(values)]
        # The strain of every cell: connections come first, and NaN for what is none. A part of what is compressed
        # would be compressed with the part before it, again.
        parts = [self._strain(position) if strain is None else strain, self._no_connections]
        return [np.concatenate(parts)] if self._compress else parts

    def _strain(self, position: NDArray) -> NDArray:
        """Return the strain of every connection, of the rest lengths at the start."""
        rest = self._system.rest_length
        result = np.empty(len(rest), dtype=self._dtype)
        axes = np.ascontiguousarray(position.T, dtype=self._dtype)
        for start in range(0, len(rest), _BLOCK):
            part = slice(start, start + _BLOCK)
            i, j = self._system.connections[part].T.astype(np.intp)
            squared = np.zeros(len(i), dtype=self._dtype)
            with np.errstate(over="ignore"):  # of a run about to diverge
                for x in axes:
                    apart = x.take(i, mode="clip") - x.take(j, mode="clip")  # quicker: none is out of range
                    squared += apart * apart
            result[part] = np.sqrt(squared) / rest[part].astype(self._dtype) - 1
        return result


def _cells(system: System) -> dict[str, NDArray]:
    """Return the points of each cell by VTK's names of kinds, in VTK's order, shape [any, corners] each."""
    n, surface = system.particle_count, system.surface
    vertices, triangles = np.empty((0, 1)), np.empty((0, 3))
    if surface is not None:
        own = surface.particle if surface.weights is None else n + np.arange(len(surface.particle))
        triangles = own[surface.triangles]
    elif not system.connection_count:
        vertices = np.arange(n)[:, None]  # or nothing would be seen
    cells = dict(zip(KINDS, (vertices, system.connections, triangles, np.empty((0, 3))), strict=True))
    wide = any(kind.size >= 2**31 for kind in cells.values())
    return {name: kind.astype(np.int64 if wide else np.int32, copy=False) for name, kind in cells.items()}


def _create_growing(group: Any, name: str, width: tuple[int, ...], dtype: Any, rows: int, **options: Any) -> None:
    """Create an array of no rows, whose chunks have so many."""
    shape = {"shape": (0, *width), "maxshape": (None, *width), "chunks": (rows, *width)}
    group.create_dataset(name, dtype=dtype, **{"fill_time": "never", **shape, **options})


def _at_least(dataset: Any, rows: int) -> None:
    """Let an array have so many rows, if it has less."""
    if len(dataset) < rows:
        dataset.resize(rows, axis=0)
