"""VTKHDF: the layout of frames and system in a trajectory's file; see docs/files.md.

Functions take open h5py files, so that HDF5 is imported only when a file is opened.
"""

import json
import math
from collections.abc import Iterator, Mapping
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..bodies import AXES, Edges, Frame, System, broken_before, lengths
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
    Growing,
    same,
    store,
    store_text,
)
from .reading_tables import Columns, ReadingTables, Rows
from .stored_system import arrays_of, write_system

Scene = tuple[Mapping[str, Any], Mapping[str, NDArray]]
"""Data of a scene for pictures: JSON data, and arrays by name."""
_TIMES, _SUBSTEPS = f"{ROOT}/Steps/Values", f"{OWN}/{SUBSTEPS}"
_LEAST_CHUNK, _MOST_CHUNK = 1 << 16, 1 << 31
"""Bounds of the size of a chunk [bytes]; HDF5 allows at most 4 GiB."""
FORESEEN = 1024
"""Number of frames whose offsets are written at once, if the total number of frames is unknown."""
_MOST_FORESEEN = 1 << 16
"""The limit of this number if it is known: offsets take space even if the run ends early."""


class Record(NamedTuple):
    """A frame and the arrays stored with it; if the frame is None, only readings of a frame that is not kept."""

    frame: Frame | None
    strain: NDArray | None = None
    """Strain of each connection; None to compute it."""
    substeps: int = 0
    broken_at: NDArray | None = None
    """Time at which each connection broke [s]."""
    contact_force: NDArray | None = None
    rows: Rows = MappingProxyType({})
    """Readings since the previous frame."""


class Layout:
    """The layout of a system's frames: data stored once, and data added by each frame.

    If `tears`, the time at which each connection broke is stored; by default if a connection can break.
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
            cells = sum(map(len, self._cells.values()))  # no vertices, which would precede connections
            self._per_frame[STRAIN] = cells
            self._no_connections = np.full(cells - system.connection_count, np.nan, dtype=dtype)
        self._edges = Edges(system) if (system.tears if tears is None else tears) else None
        self._foreseen = min(frame_count or FORESEEN, _MOST_FORESEEN)
        self._readings = ReadingTables(readings, self._foreseen) if readings else None

    @classmethod
    def of(cls, file: Any, system: System) -> "Layout":
        """Return the layout of an existing file, without readings."""
        root = file[ROOT]
        values = Growing(POINTS, (3,), np.float32, 0).open(root)
        times = Growing(_TIMES, (), np.float64, 0).open(file)
        compressed, strain, tears = values.compression is not None, STRAIN in root, BROKEN_AT in root
        contact = CONTACT in root
        return cls(system, values.dtype, times.chunks[0], compressed, strain, tears, contact_forces=contact)

    @property
    def static_size(self) -> int:
        """Size of the data stored once [bytes]."""
        own = sum(values.nbytes for values in arrays_of(self._system).values())
        own += 0 if self._edges is None else 4 * sum(map(len, self._cells.values()))
        return own + sum(2 * cells.nbytes + cells.itemsize for cells in self._cells.values())

    def growth(self, k: int, rows: Rows, kept: bool = True) -> int:
        """Return a bound of the bytes that readings, and frame k if kept, add; chunks are allocated whole."""
        size = 0 if self._readings is None else self._readings.growth(k, rows)
        return size + sum(one.growth(k * each, (k + 1) * each) for one, each in self._arrays() if kept)

    def begin(self, file: Any, fps: float, attributes: Mapping[str, Any], scene: Scene | None) -> None:
        """Write the data stored once: the run's attributes, the scene, the system and its cells."""
        group = file.create_group(OWN)
        group.attrs["msdwarp_format"], group.attrs["fps"] = FORMAT, fps
        store_text(group, "attributes", json.dumps(attributes))
        if scene is not None:
            described, arrays = scene
            store_text(group, "scene/description", json.dumps([described, list(arrays)]))
            for k, values in enumerate(arrays.values()):
                store(group, f"scene/arrays/{k}", values, compress=True)  # mostly images
        write_system(group, self._system, self._compress)
        if self._readings is not None:
            self._readings.begin(group)
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
            root.create_dataset(BROKEN_AT, data=self._broken_cells(np.where(self._system.broken, 0.0, np.inf)))
        root.create_group("Steps").attrs["NSteps"] = np.int64(0)
        for one, _ in self._arrays():
            one.create(file)

    def open(self, file: Any) -> None:
        """Prepare to append frames to a file; raise ValueError if an array in it cannot grow."""
        self._file, self._steps = file, file[ROOT]["Steps"]
        arrays = {one.name: one.open(file) for one, _ in self._arrays()}
        self._times, self._substeps = arrays[_TIMES], arrays[_SUBSTEPS]
        self._datasets = {name: arrays[f"{ROOT}/{name}"] for name in self._per_frame}
        self._broken_at = None if self._edges is None else file[ROOT].get(BROKEN_AT)
        if self._broken_at is not None:
            self._known = self._broken_at[: self._system.connection_count]
        self._readings = ReadingTables.of(file)

    def continue_after(self, k: int, until: float) -> None:
        """Continue after the first k frames, and after readings up to `until` [s]."""
        if self._readings is not None:
            self._readings.continue_after(k, float(self._times[k - 1]), until)

    def truncate(self, k: int) -> None:
        """Cut the file to its first k frames; new frames overwrite the rest."""
        # VTK's reader would write beyond its memory if there were more times than frames.
        last = float(self._times[k - 1])
        self._times.resize(k, axis=0)
        if self._broken_at is not None:  # connections that broke later become unbroken
            self._known = self._known_until(last)
            self._broken_at[:] = self._broken_cells(self._known)
        self._file.flush()
        self._steps.attrs.modify("NSteps", np.int64(k))
        self._file.flush()

    def holds(self, k: int, record: Record) -> bool:
        """Return whether the file's next readings and frame k equal this record, bit for bit."""
        frame = record.frame
        if self._readings is not None and not self._readings.holds(record.rows, None if frame is None else k):
            return False
        if frame is None:
            return True
        if self._times[k] != frame.time or self._substeps[k] != record.substeps:
            return False
        broken_at = None if self._broken_at is None else record.broken_at
        if broken_at is not None and not same(self._known_until(frame.time), self._known_by(broken_at)):
            return False
        try:
            pieces = self._pieces(k, frame, record)
            return all(same(item[start : start + len(values)], values) for item, start, values in pieces)
        except OSError:  # HDF5 found a damaged array
            return False

    def append(self, k: int, record: Record) -> None:
        """Write a record's readings, and its frame as frame k; flush both."""
        frame = record.frame
        if frame is None:
            self.append_rows(record.rows)
            return
        if self._broken_at is not None and record.broken_at is not None:
            known = self._known_by(record.broken_at)
            if not np.array_equal(known, self._known):
                self._known = known
                self._broken_at[:] = self._broken_cells(known)
        if k % self._foreseen == 0:
            until = k + self._foreseen
            for name, stride in self._offsets().items():
                _at_least(self._steps[name], until)
                offsets = np.multiply.outer(np.arange(k, until), stride)
                self._steps[name][k:until] = offsets + (name == "NumberOfParts")
            _at_least(self._substeps, until)
        self._substeps[k] = record.substeps
        if self._readings is not None:
            self._readings.add(record.rows)
            self._readings.note(k)
        for name, dataset in self._datasets.items():
            _at_least(dataset, (k + 1) * self._per_frame[name])
        for dataset, start, values in self._pieces(k, frame, record):
            dataset[start : start + len(values)] = values
        # VTK's reader would write beyond its memory if there were more times than frames.
        self._file.flush()
        self._steps.attrs.modify("NSteps", np.int64(k + 1))
        self._times.resize(k + 1, axis=0)
        self._times[k] = frame.time
        self._file.flush()

    def append_rows(self, rows: Rows) -> None:
        """Write readings, unless the file already has them; flush them."""
        if self._readings is not None:
            self._readings.add(rows)
            self._file.flush()

    def _arrays(self) -> Iterator[tuple[Growing, int]]:
        """Yield (growing array, number of its rows per frame)."""
        yield Growing(_SUBSTEPS, (), np.int32, self._foreseen), 1
        yield Growing(_TIMES, (), np.float64, self._foreseen, {"fillvalue": np.nan, "fill_time": "ifset"}), 1
        for name, stride in self._offsets().items():
            yield Growing(f"{ROOT}/Steps/{name}", stride.shape, np.int64, self._foreseen), 1
        for name, rows in self._per_frame.items():
            width: tuple[int, ...] = () if name == STRAIN else (3,)
            size = self._dtype.itemsize * math.prod(width)
            # A compressed chunk is compressed again after each write of a part.
            frames = 1 if self._compress else max(1, _LEAST_CHUNK // (rows * size))
            chunk = min(frames * rows, _MOST_CHUNK // size)
            yield Growing(f"{ROOT}/{name}", width, self._dtype, chunk, GZIP if self._compress else {}), rows

    def _offsets(self) -> dict[str, NDArray[np.int64]]:
        """Return the increment per frame of each array of offsets in the group Steps."""
        strides = {"PartOffsets": 0, "NumberOfParts": 0, "CellOffsets": [0] * 4, "ConnectivityIdOffsets": [0] * 4}
        strides |= {"PointOffsets": self._points, "PointDataOffsets/velocity": self._points}
        if CONTACT in self._per_frame:
            strides["PointDataOffsets/contact_force"] = self._points
        if STRAIN in self._per_frame:
            strides["CellDataOffsets/strain"] = self._per_frame[STRAIN]
        if self._edges is not None:
            strides["CellDataOffsets/broken_at"] = 0
        return {name: np.array(stride, dtype=np.int64) for name, stride in strides.items()}

    def _broken_cells(self, broken_at: NDArray) -> NDArray[np.float32]:
        """Return the time at which each cell broke [s]: connections first, then triangles."""
        assert self._edges is not None
        before = np.full(len(self._cells["Vertices"]), np.inf)
        return np.concatenate([before, broken_at, self._edges.parted_at(broken_at)]).astype(np.float32)

    def _known_until(self, time: float) -> NDArray[np.float32]:
        """Return the time at which each connection broke [s]; inf for times after `time` [s]."""
        return np.where(broken_before(self._known, time), self._known, np.float32(np.inf))

    def _known_by(self, broken_at: NDArray) -> NDArray[np.float32]:
        """Return the time at which each connection broke [s]; 0 for those broken at the start."""
        return np.where(self._system.broken, 0.0, broken_at).astype(np.float32)

    def _in_space(self, values: NDArray) -> NDArray:
        """Return vectors at particles as vectors at VTK's points, shape [point_count, 3]."""
        n, dim = values.shape
        if dim == 3 and self._embedded is None:
            return np.ascontiguousarray(values, dtype=self._dtype)
        result = np.zeros((self._points, 3), dtype=self._dtype)
        result[:n, AXES[dim]] = values
        if self._embedded is not None:
            result[n:, AXES[dim]] = self._embedded.points(values)
        return result

    def _pieces(self, k: int, frame: Frame, record: Record) -> Iterator[tuple[Any, int, NDArray]]:
        """Yield (array, first row, rows) for each piece of frame k."""
        vectors = {POINTS: frame.position, VELOCITY: frame.velocity, CONTACT: record.contact_force}
        for name, dataset in self._datasets.items():
            start = k * self._per_frame[name]
            if name in vectors:
                if (values := vectors[name]) is None:
                    raise ValueError(
                        "contact_force is None; the file stores contact forces, so each frame needs them"
                    )
                yield dataset, start, self._in_space(values)
                continue
            strain = self._strain(frame.position) if record.strain is None else record.strain
            if self._compress:  # one piece, since a second one would compress the chunk again
                yield dataset, start, np.concatenate([strain, self._no_connections])
            else:
                yield dataset, start, strain
                yield dataset, start + len(strain), self._no_connections

    def _strain(self, position: NDArray) -> NDArray:
        """Return the strain of every connection, relative to its rest length at the start."""
        with np.errstate(over="ignore"):  # in a run that is about to diverge
            result = lengths(np.asarray(position, dtype=self._dtype), self._system.connections)
        result /= self._system.rest_length
        result -= 1
        return result


def _cells(system: System) -> dict[str, NDArray]:
    """Return the points of cells by VTK's name of the kind, in VTK's order, each array of shape [any, corners]."""
    n, surface = system.particle_count, system.surface
    vertices, triangles = np.empty((0, 1)), np.empty((0, 3))
    if surface is not None:
        own = surface.particle if surface.weights is None else n + np.arange(len(surface.particle))
        triangles = own[surface.triangles]
    elif not system.connection_count:
        vertices = np.arange(n)[:, None]  # draw particles, since nothing else would be visible
    cells = dict(zip(KINDS, (vertices, system.connections, triangles, np.empty((0, 3))), strict=True))
    wide = any(kind.size >= 2**31 for kind in cells.values())
    return {name: kind.astype(np.int64 if wide else np.int32, copy=False) for name, kind in cells.items()}


def _at_least(dataset: Any, rows: int) -> None:
    if len(dataset) < rows:
        dataset.resize(rows, axis=0)
