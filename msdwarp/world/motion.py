"""Motions: functions of time that say where what is moved by hand is, at one time or at many at once."""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import checks
from ..bodies import rotated, rotation, rotations
from .time_functions import sampled

Motion = Callable[[float], Any]
"""What moves a thing: at time t [s] it is displaced by so much from where it was given [m], shape [d], or, as a
pair (displacement, turn), also turned about its centre by a rotation vector [rad], shape [3] (in 2-D a number).
Of an array of times it may give the same with an array in place of each number."""


def displacement_and_turn(given: Any) -> tuple[Any, Any]:
    """Return the result of a motion as a pair; the rotation is None if it returned only a displacement."""
    # A displacement in 2-D may be a pair too, of numbers.
    turned = isinstance(given, tuple) and len(given) == 2 and np.ndim(given[0]) == 1
    return given if turned else (given, None)


def pose(motion: Motion, centre: NDArray, time: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return (R, o): at `time` a point y of what turns about `centre` lies at R y + o.

    Raises
    ------
    ValueError
        If `motion` returns neither a displacement nor a pair, or one that is not finite.
    """
    dim = len(centre)
    displacement, turn = displacement_and_turn(motion(time))
    name = f"motion({time:g})"
    shift = checks.vector(name, [displacement] if dim == 1 and np.ndim(displacement) == 0 else displacement, dim)
    matrix = np.eye(dim) if turn is None else rotation(turn, dim, f"turn of {name}")
    return matrix, shift + centre - rotated(matrix, centre)


def poses(
    name: str, motion: Motion, centre: NDArray, times: NDArray, furthest: float
) -> tuple[NDArray[np.float64] | None, NDArray[np.float64]]:
    """Return (R, o) for all of `times`, shapes [time_count, d, d] and [time_count, d]; no R where nothing turns.

    Bit for bit what `pose` returns for each, if the motion gives the same numbers whether asked once or often.

    Raises
    ------
    ValueError
        If the motion fails at one of the times, gives anything else than `pose` allows for, or moves it by more
        than `furthest` [m]; it names what moves and the time.
    """
    matrices, shifts = _at_once(motion, centre, times)
    if shifts is not None and np.abs(shifts).max() <= furthest:
        return matrices, shifts
    # Each for itself: what is wrong is named, and what is right is taken whatever its form.
    each = [near_pose(name, motion, centre, time, furthest) for time in map(float, times)]
    return np.array([one[0] for one in each]), np.array([one[1] for one in each])


def near_pose(name: str, motion: Motion, centre: NDArray, time: float, furthest: float) -> tuple[NDArray, NDArray]:
    """Return a pose; raise ValueError that names what moves if it has none, or one further than `furthest` [m]."""
    try:
        found = pose(motion, centre, time)
        checks.within("displacement", found[1], (lambda v: np.abs(v) <= furthest, f"at most {furthest:.2g}"))
        return found
    except Exception as error:
        raise ValueError(f"{name} has no place at {time:g} s: {error}") from error


def _at_once(motion: Motion, centre: NDArray, times: NDArray) -> tuple[NDArray | None, NDArray | None]:
    """Return the same, computed in whole arrays; no shifts if the motion gives not the same form each time."""
    dim, turned = len(centre), set[bool]()

    def numbers(time: Any) -> Any:
        given = motion(time)
        if not isinstance(time, float):
            return given
        displacement, turn = displacement_and_turn(given)
        turned.add(turn is not None)
        return displacement if turn is None else (displacement, turn)

    try:
        found = sampled(numbers, times)
        if turned == {False} and found.shape[1] == dim:
            return None, found + centre - centre
        right = turned == {True} and found.shape[1] == dim + (1 if dim == 2 else 3)
        if right and np.isfinite(found).all():
            matrices = rotations(found[:, dim:], dim)
            return matrices, found[:, :dim] + centre - rotated(matrices, centre)
    except Exception:  # raised again, with its time, where each time is asked for
        pass
    return None, None
