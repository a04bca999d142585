"""Drives: particles that follow prescribed motions."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from ...kernels.basis import vector
from ...kernels.loads.drives import driven
from ...world import Driven, Load, poses
from ..device.device import upload_fields
from ..device.frame_tables import Tables
from ..model.effect import Parameter
from ..model.model import Model
from ..model.stage_tables import FrameTables
from ..model.state import State

POINTS = 5
"""Number of points for a derivative, which is then exact for polynomials of degree 4."""
WINDOW = 1 / 16
"""Fraction of a frame that these points span, for derivatives at the frame's end."""


def drives_of(model: Model, loads: Sequence[Load]) -> "Drives | None":
    """Return the effect of the drives among bound loads; None if no drive holds a particle."""
    drives = [(f"loads[{k}]", one) for k, one in enumerate(loads) if isinstance(one, Driven) and len(one.held)]
    return Drives(model, drives) if drives else None


class Drives(FrameTables):
    """Moves driven particles along their prescribed motions.

    Positions are evaluated from the motion at the time of each stage, and rounded once. Velocities are differences
    of positions: means over the last substep if the method's velocities lag by half a substep, otherwise the
    derivative of the polynomial through five positions. Both have the method's order: 2 for leapfrog, 4 for RK4.
    """

    def __init__(self, model: Model, drives: Sequence[tuple[str, Driven]]) -> None:
        self._model, self._drives, self.timed = model, drives, True
        self.prescribed = [(name, one.motion, one.centre) for name, one in drives]
        self._wide = vector(model.dim, wp.float64)
        self._turn = wp.types.matrix((model.dim, model.dim), wp.float64)
        self.term = driven(model.dim, model.scalar, model.compensated)
        data = self.data = self.term.Data()
        held = np.concatenate([one.held for _, one in drives])
        entry = np.full(model.particle_count, -1)
        entry[held] = np.arange(len(held))
        drive = np.repeat(np.arange(len(drives)), [len(one.held) for _, one in drives])
        start = np.concatenate([one.start for _, one in drives])
        upload_fields(data, model.device, entry=entry, drive=drive, start=start)
        self.by_world = ("done",)
        self.done = data.done = wp.zeros((2 * model.worlds, len(held)), dtype=wp.float64, device=model.device)
        self._reach = [float(np.linalg.norm(one.start - one.centre, axis=1).max()) for _, one in drives]
        self._longest = [_shortest_attached(model, one) for _, one in drives]
        self._furthest = float(np.finfo(model.dtype).max) / 4

    def begin(self, substeps: int, dt: float) -> None:
        """Allocate tables for a frame's poses, and compute the weights of pose differences."""
        self.keep_work(dt)
        rows = np.append(np.add.outer(np.arange(substeps), self.steps.stage_times).ravel(), substeps)
        before_or_between = [-1.0] if self.steps.lag else np.linspace(0, substeps, POINTS)
        at = np.append(before_or_between, rows)
        self._at, pick = np.unique(at, return_inverse=True)
        self._rows = pick[-len(rows) :]
        each = len(self.steps.stage_times)
        self.data.ahead = int(self.steps.lag > 0.0)
        if self.steps.lag:  # differences over the preceding substep; only the work uses the first row
            weights = np.diff(np.eye(len(self._at)), axis=0)
        else:
            weights = np.array([_derivative(self._at, one) for one in rows])
        self._weights, self._substeps = weights / dt, self._rows[::each]
        drives = len(self._drives)
        shape, kinds = (len(rows), drives), {"turn": self._turn, "shift": self._wide}
        kinds |= {"turning": self._turn, "speed": self._wide}
        tables = {name: (shape, kind) for name, kind in kinds.items()}
        tables |= {"bending": ((drives,), self._turn), "push": ((drives,), self._wide)}
        self.make_tables(tables, wp.float64, self._model.device)

    def hold(self, time: float) -> None:
        """Upload the accelerations at `time` [s], for kicks between frames."""
        if self._frames is not None:
            self._frames.upload(lambda tables: self._fill_accelerations(time, tables))

    def place(self, state: State, time: float, fps: float) -> None:
        """Write the positions and velocities of driven particles at `time` [s]."""
        model = self._model
        held = np.zeros(model.particle_count, dtype=bool)
        places, speeds = np.zeros((2, 1, model.particle_count, model.dim))
        for name, one in self._drives:
            (turn, turning, _), (shift, speed, _) = self._around(name, one, time, fps)
            held[one.held] = True
            places[0, one.held] = one.start @ turn.T + shift
            speeds[0, one.held] = one.start @ turning.T + speed
        state.write("x", places, held)
        state.write("v", speeds, held)

    def displaced(self) -> str | None:
        """Return a message about a drive that displaces particles at time 0; None if no drive does."""
        for name, one in self._drives:
            turn, shift = one.pose(0.0)
            away = float(np.abs(one.start @ turn.T + shift - one.start).max())
            if away > 1e-6 * max(1.0, float(np.abs(one.start).max())):
                return (
                    f"{name} has displaced its particles by {away:.3g} m at time 0: they start there, away from "
                    "the particles that they are connected with; motion(0) should return 0"
                )
        return None

    def fill(self, time: float, tables: Tables) -> None:
        """Write the poses of the frame that begins at `time`, and their rates."""
        steps, dim, times = self.steps, self._model.dim, self._times(time)
        for k, (name, one) in enumerate(self._drives):
            turn, shift = self._poses(name, one, times)
            self._check_speed(name, k, turn[self._substeps], shift[self._substeps], times[self._substeps])
            tables["turn"][:, k], tables["shift"][:, k] = turn[self._rows], shift[self._rows]
            # Computed from differences, so that the velocity of particles at rest is exactly 0.
            off = np.concatenate([(turn - turn[0]).reshape(len(turn), -1), shift - shift[0]], axis=1)
            rates = self._weights @ off
            tables["turning"][:, k] = rates[:, : dim * dim].reshape(-1, dim, dim)
            tables["speed"][:, k] = rates[:, dim * dim :]
        if steps.lag:
            self._fill_accelerations(float(times[-1]), tables)

    def _times(self, time: float) -> NDArray[np.float64]:
        """Return the times [s] at which poses are evaluated for the frame that begins at `time`."""
        times = np.maximum(time + self.steps.dt * self._at, 0.0)  # a motion may be undefined before 0
        times[-1] = (round(time * self.steps.fps) + 1) / self.steps.fps
        return times

    def propagate_frame(self, time: float, by_place: NDArray, by_speed: NDArray) -> tuple[NDArray, NDArray]:
        """Convert derivatives by the tables of the frame from `time` to derivatives by poses, with their times.

        By tables they have the shape [worlds, rows, drive_count, ...], by poses [time_count, worlds, ...].
        """
        places = np.eye(len(self._at))[self._rows]
        values = np.tensordot(places, by_place, (0, 1)) + np.tensordot(self._weights, by_speed, (0, 1))
        return self._times(time), values

    def propagate_rates(self, time: float, *by_rates: NDArray | None) -> tuple[NDArray, NDArray]:
        """Convert derivatives by the first and second rates at `time` [s] to derivatives by poses, with times.

        Derivatives by rates have the shape [worlds, drive_count, ...], those by poses [time_count, worlds, ...].
        """
        points, step = self._window(time, self.steps.fps)
        parts = [
            np.multiply.outer(_derivative(points, 0, m) / step**m, each)
            for m, each in enumerate(by_rates, 1)
            if each is not None
        ]
        return time + step * points, np.asarray(sum(parts))

    @property
    def motions(self) -> list[Driven]:
        """The drives."""
        return [one for _, one in self._drives]

    def parameters(self) -> dict[str, Parameter]:
        """Return the motions as parameters, for gradients; `MotionAdjoint` has their derivatives."""
        return {f"{name}.motion": Parameter(lambda poses: poses, varies=True) for name, _ in self._drives}

    def _window(self, time: float, fps: float) -> tuple[NDArray, float]:
        """Return POINTS times that end or begin at `time`, relative to it and in steps, and the step [s]."""
        step = WINDOW / (fps * (POINTS - 1))
        return np.arange(POINTS - 1, -1, -1) * (-1 if round(time * fps) > 0 else 1), step

    def _fill_accelerations(self, time: float, tables: Tables) -> None:
        """Write the second derivatives of the poses at `time`."""
        for k, (name, one) in enumerate(self._drives):
            (_, _, tables["bending"][k]), (_, _, tables["push"][k]) = self._around(name, one, time, self.steps.fps)

    def _around(self, name: str, one: Driven, time: float, fps: float) -> tuple[list[NDArray], list[NDArray]]:
        """Return rotation and shift with two derivatives each at `time`, the end of a frame or the start."""
        points, step = self._window(time, fps)
        found = self._poses(name, one, time + step * points)
        result = []
        for values in found:
            off = values - values[-1]
            each = [np.tensordot(_derivative(points, 0, m), off, 1) / step**m for m in (1, 2)]
            result.append([values[-1], *each])
        return result[0], result[1]

    def _poses(self, name: str, one: Driven, times: NDArray) -> tuple[NDArray, NDArray]:
        motion: Any = one.motion
        return poses(name, motion, one.centre, times, self._furthest)

    def _check_speed(self, name: str, k: int, turn: NDArray, shift: NDArray, times: NDArray) -> None:
        """Raise ValueError if a drive moves further in a substep than the length of its shortest spring."""
        centre = turn @ self._drives[k][1].centre + shift
        # The largest singular value of a change of rotation occurs twice, in the plane of the turn.
        turned = np.sqrt((np.diff(turn, axis=0) ** 2).sum(axis=(1, 2)) / 2)
        ways = np.linalg.norm(np.diff(centre, axis=0), axis=1) + self._reach[k] * turned
        n = int(np.argmax(ways))
        if ways[n] > self._longest[k]:
            raise ValueError(
                f"{name} moves by {ways[n]:.3g} m in the substep of {self.steps.dt:.3g} s at {times[n]:g} s, "
                f"more than the length of the shortest connection that it pulls, {self._longest[k]:.3g} m: "
                "move it slower, or take more substeps"
            )


def _shortest_attached(model: Model, one: Driven) -> float:
    """Return the shortest rest length between driven and other particles [m]; inf without such a spring."""
    held = one.particles(model.system)
    ends = held[model.system.connections]
    attached = ends[:, 0] != ends[:, 1]
    return float(np.min(model.system.rest_length[attached], initial=np.inf))


def _derivative(points: NDArray, at: float, order: int = 1) -> NDArray[np.float64]:
    """Return weights: the sum of weighted values at `points` is the derivative of this order at the point `at`.

    The derivative is taken of the polynomial through the nearest points.
    """
    first = (
        int(np.clip(np.searchsorted(points, at) - POINTS // 2, 0, len(points) - POINTS))
        if len(points) > POINTS
        else 0
    )
    near = points[first : first + POINTS] - at
    powers = np.vander(near, increasing=True).T
    wanted = np.zeros(len(near))
    wanted[order] = float(order)  # m! for m = 1, 2
    weights = np.zeros(len(points))
    weights[first : first + POINTS] = np.linalg.solve(powers, wanted)
    return weights
