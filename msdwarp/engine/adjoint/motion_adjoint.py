"""Derivatives by prescribed motions, computed from derivatives by the state of the driven particles."""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...bodies import rotations
from ...world import Driven, displacement_and_turn
from ..loads.drives import Drives
from ..model.model import Model
from .number_sums import NumberSums


class MotionAdjoint:
    """Derivatives by prescribed motions: by their displacements and turns at the times that frames use.

    Kernels sum derivatives by the pose (R, o) of each stage, and by its rate. Rates are computed from poses at
    several times, so derivatives by rates are converted to derivatives by these poses.

    Parameters
    ----------
    model, drives
        The system, and its drives.
    launch_once
        See `NumberSums`.

    Attributes
    ----------
    names
        The names of the derivatives.
    sums
        Sums of derivatives by poses; `add_up` must be called after each stage.
    """

    def __init__(self, model: Model, drives: Drives, launch_once: Callable[[Callable[[], Any]], None]) -> None:
        self._drives, self._dim, self.names = drives, model.dim, list(drives.parameters())
        size, stages = 2 * model.dim * (model.dim + 1), len(drives.steps.times(0.0))
        self.sums = NumberSums(model, drives.data.drive.numpy(), size, stages, launch_once)
        self.clear()

    def clear(self) -> None:
        """Set everything to 0."""
        self.sums.clear()
        self._found: list[tuple[NDArray, NDArray]] = []
        self._start: Any = 0.0

    def take_frame(self, time: float) -> None:
        """Take over from the device the sums of the frame that begins at `time` [s]."""
        rows = self._take()
        rows[:, -1] += self._start  # the state at a frame's start is that at the end of the frame before
        self._start = rows[:, 0].copy()
        rows[:, 0] = 0.0
        self._found.append(self._drives.propagate_frame(time, rows[..., 0, :, :], rows[..., 1, :, :]))

    def add_reading(self, time: float, lag: float, by_v: NDArray) -> None:
        """Add derivatives by the velocities that are read at `time` [s], shape [worlds, particle_count, d].

        The method's velocities are those `lag` [s] earlier.
        """
        by_acceleration = []
        for one in self._drives.motions:
            places = np.append(one.start, np.ones((len(one.start), 1)), axis=1)
            by_acceleration.append(lag * np.einsum("wia,ib->wab", by_v[:, one.held], places))
        self._found.append(self._drives.propagate_rates(time, None, np.stack(by_acceleration, axis=1)))

    def take_start(self, time: float, lag: float) -> None:
        """Take over the sums left for the start, `time` [s]; the method's velocities are `lag` [s] earlier."""
        own, given = self._start, self._take()[:, 0]
        if time == 0:  # a later start is a given state
            by_place, by_speed = np.moveaxis(own + given, -3, 0)
            self._found.append((np.array([time]), by_place[None]))
            self._found.append(self._drives.propagate_rates(time, by_speed, -lag * own[..., 1, :, :]))

    def _take(self) -> NDArray[np.float64]:
        """Return and reset the sums, shape [worlds, rows, drive_count, 2, d, d + 1]: by poses, and by rates."""
        found = self.sums.take()
        return found.reshape(*found.shape[:-1], 2, self._dim, self._dim + 1)

    def found(self, name: str) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return times, and derivatives by a motion's values at these times, shape [worlds, time_count, any]."""
        k, every = self.names.index(name), np.concatenate([times for times, _ in self._found])
        times, which = np.unique(every, return_inverse=True)
        by_poses = np.concatenate([values[:, :, k] for _, values in self._found])
        values = np.zeros((len(times), *by_poses.shape[1:]))
        np.add.at(values, which, by_poses)
        return times, _by_motion(self._drives.motions[k], times, np.moveaxis(values, 0, 1))


def _by_motion(one: Driven, times: NDArray, by_poses: NDArray) -> NDArray[np.float64]:
    """Return derivatives by displacements u and turns θ, from those by poses (R, o) with o = u + c − R c.

    A change of θ turns R on by J δθ, with the left Jacobian J of a rotation vector. Reference: Chirikjian,
    Stochastic Models, Information Theory, and Lie Groups 2 (2012), 10.3.
    """
    dim, motion = len(one.centre), one.motion
    assert motion is not None
    by_turn, by_shift = by_poses[..., :dim], by_poses[..., dim]
    turns = [displacement_and_turn(motion(float(time)))[1] for time in times]
    if all(turn is None for turn in turns):
        return by_shift
    size = 1 if dim == 2 else 3
    theta = np.array([np.zeros(size) if turn is None else np.ravel(turn) for turn in turns], dtype=np.float64)
    spun = (by_turn - by_shift[..., None] * one.centre) @ np.moveaxis(rotations(theta, dim), 1, 2)
    pairs = ((1, 0),) if dim == 2 else ((2, 1), (0, 2), (1, 0))
    torque = np.stack([spun[..., a, b] - spun[..., b, a] for a, b in pairs], axis=-1)
    if dim == 3:
        angle = np.linalg.norm(theta, axis=1)[:, None, None]
        x, y, z = theta.T
        zero, axis = np.zeros_like(x), theta / np.where(angle > 0, angle, 1.0)[:, 0]
        cross = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=-1).reshape(-1, 3, 3)
        along = np.sinc(angle / np.pi)  # sin θ / θ
        jacobian = along * np.eye(3) + 0.5 * np.sinc(angle / (2 * np.pi)) ** 2 * cross
        jacobian += (1 - along) * axis[:, :, None] * axis[:, None, :]
        torque = np.einsum("wta,tab->wtb", torque, jacobian)
    return np.concatenate([by_shift, torque], axis=-1)
