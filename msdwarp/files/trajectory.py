"""Trajectories: frames on disk, read on access, and the system."""

import json
import math
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from functools import cached_property
from pathlib import Path
from typing import Any, Self, overload

import numpy as np
from numpy.typing import NDArray

from .. import checks
from ..bodies import AXES, Frame, Series, System, broken_before, counted
from ..disk import TRAJECTORY
from .names import BROKEN_AT, CONTACT, COUNT, FORMAT, KINDS, OWN, POINTS, ROOT, STRAIN, SUBSTEPS, VELOCITY, load
from .reading_tables import ReadingTables
from .stored_system import read_system
from .validation import begins_as_hdf5, structure_fault, too_large

_ERRORS = (ArithmeticError, AttributeError, IndexError, KeyError, OSError, RuntimeError, TypeError, ValueError)
"""Errors that reading a damaged file may raise."""


class FrameArray:
    """An array on disk whose first axis is the frame; only indexed parts are read.

    Each index selects along its own axis: an integer, a slice, a list, an array or a mask.
    """

    def __init__(self, dataset: Any, frames: int, stride: int, count: int, axes: list[int] | None = None) -> None:
        self._dataset, self._stride, self._axes = dataset, stride, axes
        self.shape = (frames, count) if axes is None else (frames, count, len(axes))
        self.dtype, self.ndim = dataset.dtype, len(self.shape)

    def __len__(self) -> int:
        return self.shape[0]

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray:
        return np.asarray(self[:], dtype=dtype)

    def __getitem__(self, key: Any) -> NDArray:
        """Return the indexed part of the array as a new array in memory."""
        keys = key if isinstance(key, tuple) else (key,)
        dots = [k for k, one in enumerate(keys) if one is Ellipsis]
        if len(keys) - len(dots) > self.ndim or len(dots) > 1:
            raise IndexError(f"{len(keys)} indices are given; there are {self.ndim} axes")
        at = dots[0] if dots else len(keys)
        whole = [slice(None)] * (self.ndim - len(keys) + len(dots))
        frames, items, *coordinates = *keys[:at], *whole, *keys[at + 1 :]
        values = self._read(_chosen(self.shape[0], frames), _chosen(self.shape[1], items))
        values = values[..., coordinates[0]] if coordinates else values
        values = values[:, 0] if isinstance(items, int | np.integer) else values
        return values[0] if isinstance(frames, int | np.integer) else values

    def _read(self, frames: NDArray[np.intp], items: NDArray[np.intp]) -> NDArray:
        """Return the chosen items of the chosen frames."""
        values = np.empty((len(frames), len(items), *self.shape[2:]), dtype=self.dtype)
        if not values.size:
            return values
        low, high, start = items.min(), items.max() + 1, frames[0] * self._stride
        axes = ... if self._axes is None or len(self._axes) == 3 else (..., self._axes)
        step = frames[1] - frames[0] if len(frames) > 1 else 1
        if high - low == 1 and step > 0 and np.all(np.diff(frames) == step):  # one item over time
            stop = frames[-1] * self._stride + high
            values[:] = self._dataset[start + low : stop : step * self._stride][axes][:, None]
            return values
        every = len(items) == high - low and np.all(np.diff(items) == 1)
        for k, frame in enumerate(frames):
            rows = self._dataset[frame * self._stride + low : frame * self._stride + high][axes]
            values[k] = rows if every else rows[items - low]
        return values


def _chosen(count: int, key: Any) -> NDArray[np.intp]:
    return np.atleast_1d(np.arange(count)[key])


class Trajectory:
    """A trajectory on disk: its frames, which are read on access, and the system.

    It can be opened while it is being written, and then has the frames so far. Attributes that are read only on
    access raise ValueError if their part of the file is damaged.

    Parameters
    ----------
    path
        The file, or the folder of a run.

    Raises
    ------
    FileNotFoundError
        If it does not exist.
    ValueError
        If it is not a trajectory, is truncated or damaged, or has an unknown format.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path) / TRAJECTORY if Path(path).is_dir() else Path(path)
        self._file = _opened(self.path)
        with ExitStack() as opened, self._damage_named(""):
            opened.callback(self.close)
            own, root = self._file[OWN], self._file[ROOT]
            self._particles, self._dim = int(own.attrs["particle_count"]), int(own.attrs["dim"])
            self._points, self._lines = (int(load(root[n])[0]) for n in ("NumberOfPoints", f"Lines/{COUNT}"))
            checks.one_of("dim", self._dim, AXES)
            if not 0 < self._particles <= self._points:
                raise ValueError(f"it has {self._particles} particles among {self._points} points")
            self._cells = sum(int(load(root[kind][COUNT])[0]) for kind in KINDS)
            whole = min(len(root[name]) // self._points for name in (POINTS, VELOCITY))
            self._check_size(root, "Steps/Values", min(whole, int(root["Steps"].attrs["NSteps"])))
            self.times: NDArray[np.float64] = _times(root)[:whole]
            """Time of each frame [s], shape [frame_count]."""
            self._check_sizes(root)
            self.fps = checks.positive("fps", own.attrs["fps"])
            """Frames per second of simulated time."""
            self.attributes: dict[str, Any] = json.loads(load(own["attributes"]))
            """The run's scene, options and program versions."""
            if not isinstance(self.attributes, dict):
                raise ValueError(f"attributes is {self.attributes!r}; it must be a mapping")
            if "route" in self.attributes:  # the option's name in version 0.1
                self.attributes["force_algorithm"] = self.attributes.pop("route")
            opened.pop_all()

    @contextmanager
    def _damage_named(self, part: str) -> Iterator[None]:
        """Turn errors while reading into a ValueError that names the file and the damaged part."""
        try:
            yield
        except _ERRORS as error:
            raise ValueError(f"{self.path} is a damaged trajectory: {part}{error}") from error

    def _check_sizes(self, root: Any) -> None:
        """Raise ValueError unless all frames have their arrays, and the arrays fit into the file."""
        vectors = dict.fromkeys((POINTS, VELOCITY, CONTACT), (self._points, 3))
        for name, (rows, *width) in {**vectors, STRAIN: (self._cells,)}.items():
            if name not in root:
                continue
            shape = root[name].shape
            if shape[1:] != tuple(width) or shape[0] < len(self) * rows:
                raise ValueError(f"{name} has shape {shape}, for {len(self)} frames of {rows}")
            self._check_size(root, name, len(self) * rows * math.prod(width))

    def _check_size(self, root: Any, name: str, count: int) -> None:
        """Raise ValueError if `count` entries cannot fit into the file, which may still be growing."""
        if wrong := too_large(root[name], count, self.path.stat().st_size):
            raise ValueError(f"{name} {wrong}")

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __repr__(self) -> str:
        state = "" if self._file else ", closed"
        times = f" from {self.times[0]:.4g} to {self.times[-1]:.4g} s" if len(self) else ""
        lines = [
            f"Trajectory {self.path}{state}",
            f"{counted(len(self), 'frame')}{times}, {self.fps:.4g} a second",
            f"{counted(self._particles, 'particle')} in {counted(self._dim, 'dimension')}, "
            + counted(self._lines, "connection"),
        ]
        if "scene" in self.attributes:
            lines.append(f"of the scene {self.attributes['scene']}")
        return "\n  ".join(lines)

    def __len__(self) -> int:
        return len(self.times)

    @cached_property
    def system(self) -> System:
        """The system at the start."""
        with self._damage_named("its system cannot be read: "):
            return read_system(self._file)

    @cached_property
    def scene(self) -> tuple[dict[str, Any], dict[str, NDArray]] | None:
        """Data of the scene for pictures, as given to the writer; None if not stored."""
        own = self._file[OWN]
        if "scene" not in own:
            return None
        with self._damage_named("its scene cannot be read: "):
            described, names = json.loads(load(own["scene/description"]))
            return described, {name: load(own[f"scene/arrays/{k}"]) for k, name in enumerate(names)}

    @property
    def positions(self) -> FrameArray:
        """Particle positions [m], shape [frame_count, particle_count, d]; only indexed parts are read."""
        return self._of_particles(POINTS)

    @property
    def velocities(self) -> FrameArray:
        """Particle velocities [m/s], shape [frame_count, particle_count, d]; only indexed parts are read."""
        return self._of_particles(VELOCITY)

    @property
    def strains(self) -> FrameArray:
        """Strain of each connection, shape [frame_count, connection_count]; ValueError if not stored."""
        if STRAIN not in self._file[ROOT]:
            raise ValueError(f"{self.path} was written without strain")
        return FrameArray(self._file[ROOT][STRAIN], len(self), self._cells, self._lines)

    @property
    def contact_forces(self) -> FrameArray:
        """Contact force on each particle [N], shape [frame_count, particle_count, d]; ValueError if not stored.

        Averaged over the preceding frame interval, as in `Simulation.contact_force`; 0 in the first frame.
        """
        if CONTACT not in self._file[ROOT]:
            raise ValueError(f"{self.path} was written without contact forces")
        return self._of_particles(CONTACT)

    def _of_particles(self, name: str) -> FrameArray:
        return FrameArray(self._file[ROOT][name], len(self), self._points, self._particles, AXES[self._dim])

    @property
    def broken_at(self) -> NDArray[np.float32]:
        """Time at which each connection broke [s], shape [connection_count]: 0 from the start, inf if unbroken.

        `msdwarp.bodies.broken_before` returns the connections that are broken in a frame.
        """
        kept = self._file[ROOT].get(BROKEN_AT)
        if kept is None:  # no connection can break, or the file is from a version without fracture
            return np.full(self._lines, np.inf, dtype=np.float32)
        with self._damage_named("its broken_at: "):
            times = np.asarray(kept[: self._lines], dtype=np.float32)
        if times.shape != (self._lines,) or not (times >= 0).all():
            raise ValueError(f"{self.path} is a damaged trajectory: its broken_at are no times")
        # A frame exists once its time is written: connections that broke after the last frame count as unbroken.
        seen = broken_before(times, float(self.times[-1]) if len(self) else 0.0)
        return np.where(seen, times, np.float32(np.inf))

    @property
    def substeps(self) -> NDArray[np.int32] | None:
        """Number of substeps of each frame, shape [frame_count]; None in old files that lack it.

        Entry 0, at the start, repeats the number of frame 1; 0 means unknown.
        """
        kept = self._file[OWN].get(SUBSTEPS)
        if kept is None:
            return None
        with self._damage_named("its substeps: "):
            counts = np.asarray(kept[: len(self)], dtype=np.int32)
        if counts.shape != (len(self),) or (counts < 0).any():
            raise ValueError(f"{self.path} is a damaged trajectory: its substeps are no counts")
        return counts

    @cached_property
    def _tables(self) -> ReadingTables | None:
        """The tables of probe readings; None if the file has none."""
        with self._damage_named("its readings: "):
            return ReadingTables.of(self._file)

    @property
    def probes(self) -> dict[str, tuple[str, list[str]]] | None:
        """For each probe how often it was read ("frame" or "substep"), and its columns; None without readings."""
        return None if self._tables is None else self._tables.columns

    @cached_property
    def readings(self) -> dict[str, Series]:
        """Readings of the probes up to the last frame, by name: `times, values = trajectory.readings["foot"]`.

        Frames that were not stored have readings too; the mapping is empty if there are no readings.
        """
        if self._tables is None:
            return {}
        with self._damage_named("its readings: "):
            return self._tables.read(len(self), self.path.stat().st_size)

    def frame(self, k: int) -> Frame:
        """Return frame k, counted from the end if k is negative; raise IndexError if it does not exist."""
        return Frame(float(self.times[k]), self.positions[k], self.velocities[k])

    @overload
    def __getitem__(self, k: int) -> Frame: ...
    @overload
    def __getitem__(self, k: slice) -> Iterator[Frame]: ...
    def __getitem__(self, k: int | slice) -> Frame | Iterator[Frame]:
        """Return a frame, or an iterator over the frames of a slice."""
        return (self.frame(i) for i in range(len(self))[k]) if isinstance(k, slice) else self.frame(k)

    def __iter__(self) -> Iterator[Frame]:
        return self[:]


def _opened(path: Path) -> Any:
    """Return a trajectory's open file; raise ValueError if the file is no trajectory."""
    import h5py

    if not begins_as_hdf5(path):
        raise ValueError(f"{path} is no trajectory: it is no HDF5 file")
    try:
        with ExitStack() as opened:  # close on errors, since HDF5 caches the metadata of open files
            file = opened.enter_context(h5py.File(path, "r", locking=False))
            if wrong := _format_fault(file):
                raise ValueError(f"{path} is no trajectory: {wrong}")
            if found := structure_fault(file):
                raise ValueError(f"{path} cannot be read: {found}")
            opened.pop_all()
            return file
    except (AttributeError, KeyError, OSError, RuntimeError, TypeError) as error:
        reason = "it is cut short" if "truncated" in str(error) else error
        raise ValueError(f"{path} cannot be read: {reason}") from error


def _format_fault(file: Any) -> str | None:
    """Return why this version cannot read a file as a trajectory; None if it can read the file."""
    if ROOT not in file:
        return f"it has no group {ROOT}"
    if OWN not in file:
        return f"it is {ROOT} of another program, without a group {OWN}"
    version = file[OWN].attrs.get("msdwarp_format")
    if version == FORMAT:
        return None
    advice = ": install a newer msdwarp" if isinstance(version, np.integer) and version > FORMAT else ""
    return f"it is of format {version}; this version reads {FORMAT}{advice}"


def _times(root: Any) -> NDArray[np.float64]:
    """Return the times [s] of the frames in the group VTKHDF, without frames that are not fully on disk."""
    values, count = root["Steps/Values"], int(root["Steps"].attrs["NSteps"])
    try:
        times = values[:count]
    except OSError:  # the array has been extended, but its last part is not on disk
        times = values[: len(values) - 1]
    return times[: np.append(np.isnan(times), True).argmax()]
