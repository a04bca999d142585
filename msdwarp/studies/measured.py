"""Measured motion for a fit: tracked points, a trajectory, values of probes."""

from __future__ import annotations

import csv
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import checks
from ..files import Trajectory
from ..simulation import ENERGIES
from ..world import FRAME, UNITS, Probe, Scene

AXES = ("x", "y", "z")
ENERGY_WORDS = ("energy", *ENERGIES)
POINTS = "points"
"""Name of the channel of tracked points."""
HIGHEST_FPS = 1000.0
"""Highest frame rate that is derived from measured times."""
ON_FRAME = 1e-4
"""A time this close to the time of a frame, in frames, is taken as equal: times in files are rounded."""


@dataclass(frozen=True, eq=False)
class TrackedPoints:
    """Tracked points of a body: each row is the position of one particle at one time.

    Parameters
    ----------
    time
        [s] from the scene's start, shape [rows], in any order.
    particle
        Particle indices, shape [rows].
    position
        Positions [m], shape [rows, d]; NaN for a coordinate that was not measured.

    Raises
    ------
    ValueError
        If shapes do not match, a time is negative, or an entry is not a number.
    """

    time: ArrayLike
    particle: ArrayLike
    position: ArrayLike

    def __post_init__(self) -> None:
        time, position = checks.array("time", self.time), checks.array("position", self.position)
        particle = checks.array("particle", self.particle)
        if time.ndim != 1 or particle.shape != time.shape or position.ndim != 2 or len(position) != len(time):
            raise ValueError(
                f"time, particle and position have shapes {time.shape}, {particle.shape} and {position.shape}; "
                "they must be of shapes [rows], [rows] and [rows, d]"
            )
        checks.every("time", time, np.isfinite(time) & (time >= 0), "finite and at least 0")
        checks.every("particle", particle, (particle >= 0) & (particle % 1 == 0), "the number of a particle")
        checks.every("position", position, ~np.isinf(position), "finite, or NaN where it was not seen")
        for name, value in (("time", time), ("particle", particle.astype(int)), ("position", position)):
            object.__setattr__(self, name, value)

    def __repr__(self) -> str:
        return f"TrackedPoints: {np.shape(self.position)[0]} rows of {len(np.unique(self.particle))} particles"

    @classmethod
    def of(cls, trajectory: Trajectory) -> Self:
        """Return all particles in all frames of a trajectory as tracked points."""
        position = np.asarray([frame.position for frame in trajectory], dtype=float)
        frames, count, dim = position.shape
        time, particle = np.repeat(trajectory.times, count), np.tile(np.arange(count), frames)
        return cls(time, particle, position.reshape(-1, dim))


@dataclass(frozen=True, eq=False)
class Channel:
    """Measured data of one kind, and how to read the same quantity from a simulation."""

    name: str
    time: NDArray[np.float64]
    """Measured times [s], shape [rows]."""
    values: NDArray[np.float64]
    """Measured values, shape [rows, width]; NaN where nothing was measured."""
    what: Any
    """A `Probe`, the name of an energy, or the indices of the tracked particles."""
    noise: float = 1.0
    """The unit of residuals, in the unit of the values."""
    entry: NDArray[np.int64] | None = None
    """Index of each row's particle among the tracked particles, shape [rows]."""
    noise_given: bool = False
    """Whether `noise` is given; otherwise it is the variation of the values."""

    @property
    def unit(self) -> str:
        """The unit of the values."""
        if isinstance(self.what, Probe):
            return UNITS[self.what.what]
        return "J" if isinstance(self.what, str) else "m"

    @property
    def entries(self) -> NDArray[np.int64]:
        """Index of each row's particle among the tracked particles, shape [rows]."""
        return np.zeros(len(self.time), dtype=int) if self.entry is None else self.entry

    def until(self, end: float) -> NDArray[np.bool_]:
        """Return a mask of values measured after the start and until `end` [s], shape [rows, width]."""
        return np.isfinite(self.values) & ((self.time > 0) & (self.time <= end))[:, None]

    def at_times(self, frames: NDArray[np.float64], fps: float) -> NDArray[np.float64]:
        """Return simulated values at the measured times and points, shape [worlds, rows, width].

        `frames`, shape [frame_count, worlds, ...], begins with frame 0. Between frames values are interpolated by
        a cubic spline; after the last frame they stay constant.
        """
        found = interpolated(frames, np.minimum(self.time * fps, len(frames) - 1))
        if self.entry is not None:  # [rows, worlds, particles, d]
            found = found[np.arange(len(found)), :, self.entry]
        return np.moveaxis(found.reshape(len(found), frames.shape[1], -1), 0, 1)


def interpolated(frames: NDArray[np.float64], place: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a cubic spline through frames (first axis), evaluated at positions `place`, in frames."""
    if (np.abs(place - np.round(place)) < ON_FRAME).all():
        return frames[np.round(place).astype(int)]
    from scipy.interpolate import CubicSpline

    return CubicSpline(np.arange(len(frames)), frames, axis=0)(place)


def channels_of(measured: Any, scene: Scene, noise: Any) -> list[Channel]:
    """Return measured data as channels; raise ValueError if they are invalid."""
    if isinstance(measured, str | Path):
        measured = read_measured(Path(measured), scene)
    if isinstance(measured, Trajectory):
        measured = TrackedPoints.of(measured)
    if not isinstance(measured, TrackedPoints | Mapping):
        raise ValueError(
            f"measured is {checks.repr_short(measured)}; it must be the path of a CSV file or trajectory, "
            "TrackedPoints, a Trajectory, or a mapping from names of probes and energies to (times, values)"
        )
    found = [_tracked(measured, scene)] if isinstance(measured, TrackedPoints) else _series(measured, scene)
    given = noise if isinstance(noise, Mapping) else {one.name: noise for one in found}
    for name in given:
        checks.one_of("a name in noise", name, [one.name for one in found])
    for one in found:
        if not one.until(np.inf).any():
            raise ValueError(f"measured has nothing of {one.name} after time 0; it must have some")
    return [_with_noise(one, given.get(one.name)) for one in found]


def _with_noise(channel: Channel, noise: Any) -> Channel:
    if noise is None:
        return replace(channel, noise=spread(channel))
    return replace(channel, noise=checks.positive(f"noise of {channel.name}", noise), noise_given=True)


def spread(channel: Channel) -> float:
    """Return the variation of a channel's values over time: root mean square of deviations from the means."""
    sums = 0.0
    for k in np.unique(channel.entries):
        for column in channel.values[channel.entries == k].T:
            seen = column[np.isfinite(column)]
            sums += float(((seen - seen.mean()) ** 2).sum()) if len(seen) else 0.0
    return float(np.sqrt(sums / max(1, np.isfinite(channel.values).sum()))) or 1.0


def _tracked(measured: TrackedPoints, scene: Scene) -> Channel:
    time, particle, position = (np.asarray(getattr(measured, n)) for n in ("time", "particle", "position"))
    count, dim = scene.system.particle_count, scene.system.dim
    if position.shape[1] != dim:
        raise ValueError(f"measured has {position.shape[1]} coordinates; the scene has {dim}")
    checks.every("particle of measured", particle, particle < count, f"below {count}, the number of particles")
    numbers, entry = np.unique(particle, return_inverse=True)
    return Channel(POINTS, time, position, numbers, entry=entry)


def _series(measured: Mapping[str, Any], scene: Scene) -> list[Channel]:
    """Return measurements of probes and energies as channels."""
    found = []
    if not measured:
        raise ValueError("measured is empty; it must have a probe of the scene or an energy")
    for name, pair in measured.items():
        checks.one_of("a name in measured", name, [*scene.probes, *ENERGY_WORDS])
        what: Any = scene.probes.get(name, name)
        width = len(what.columns(scene.system.dim)) if isinstance(what, Probe) else 1
        if isinstance(what, Probe) and what.every != FRAME:
            raise ValueError(f"probe {name!r} of the scene is read by substep; to be fitted it must be by frame")
        given = f"measured[{name!r}]"
        try:
            times, values = pair
        except (TypeError, ValueError) as error:
            raise ValueError(f"{given} is {checks.repr_short(pair)}; it must be (times, values)") from error
        times, values = checks.array(f"times of {name!r}", times), checks.array(f"values of {name!r}", values)
        values = values[:, None] if values.ndim == 1 else values
        if times.ndim != 1 or values.shape != (len(times), width):
            raise ValueError(
                f"{given} has times of shape {times.shape} and values of shape {values.shape}; they must be of "
                f"shapes [rows] and [rows, {width}]"
            )
        checks.every(f"times of {name!r}", times, np.isfinite(times) & (times >= 0), "finite and at least 0")
        found.append(Channel(name, times, values, what))
    return found


def read_measured(path: Path, scene: Scene) -> Any:
    """Return the measurements in a file: tracked points (time, id, x, y, z), probes and energies, or a trajectory.

    Raises ValueError if the file has another form, or an entry is not a number.
    """
    if path.suffix == ".vtkhdf":
        with Trajectory(path) as trajectory:
            return TrackedPoints.of(trajectory)
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            lines = [(n, row) for n, row in enumerate(csv.reader(file), 1) if row and not row[0].startswith("#")]
    except (UnicodeDecodeError, csv.Error) as error:
        raise ValueError(f"measured is {path}, which is neither a CSV file nor a trajectory: {error}") from error
    head = [word.strip() for word in lines[0][1]] if lines else []
    own = AXES[: scene.system.dim]
    columns = {f"{name}_{c}": name for name, one in scene.probes.items() for c in one.columns(scene.system.dim)}
    columns |= {f"{word.replace(' ', '_')}_J": word for word in ENERGY_WORDS}
    points = head == ["time", "id", *own]
    if not points and (head[:1] != ["time_s"] or len(head) < 2 or not set(head[1:]) <= columns.keys()):
        raise ValueError(
            f"{path} begins with {', '.join(head) or 'nothing'}; its first line must be time,id,{','.join(own)}, "
            f"or time_s and columns from {', '.join(columns)}"
        )
    table = np.full((len(lines) - 1, len(head)), np.nan)
    for k, (n, row) in enumerate(lines[1:]):
        if len(row) != len(head):
            raise ValueError(f"line {n} of {path} has {len(row)} columns; its first line has {len(head)}")
        for c, word in enumerate(row):
            try:
                table[k, c] = float(word.strip() or "nan")
            except ValueError as error:
                raise ValueError(f"line {n} of {path} has {word!r}; it must be a number, or empty") from error
    if points:
        return TrackedPoints(table[:, 0], table[:, 1], table[:, 2:])
    measured: dict[str, Any] = {}
    for name in dict.fromkeys(columns[one] for one in head[1:]):
        wanted = [one for one, own_name in columns.items() if own_name == name]
        values = [table[:, head.index(one)] if one in head else np.full(len(table), np.nan) for one in wanted]
        measured[name] = (table[:, 0], np.column_stack(values))
    return measured


def frame_rate(channels: list[Channel]) -> float:
    """Return a frame rate for which every measured time is the end of a frame; 60 if there is none."""
    times = np.unique(np.concatenate([[0.0], *(one.time for one in channels)]))
    gaps = np.diff(times)
    gap = float(gaps[gaps > ON_FRAME * gaps.max()].min())
    number = np.round(times / gap)
    rate = float((number**2).sum() / (number * times).sum())
    for fps in (round(rate), rate):
        place = times * fps
        if 0 < fps <= HIGHEST_FPS and (np.abs(place - np.round(place)) < ON_FRAME).all():
            return float(fps)
    return 60.0
