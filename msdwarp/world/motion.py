"""Motions: poses of colliders and drives as functions of time, at one time or many times."""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import checks
from ..bodies import rotated, rotation, rotations
from .time_functions import sampled

Motion = Callable[[float], Any]
"""A function of time [s] that returns a displacement or a pair, as `Collider` describes it. For an array of times
it may return arrays over time in place of numbers."""


def displacement_and_turn(given: Any) -> tuple[Any, Any]:
    """Return the result of a motion as a pair; the rotation is None if there is only a displacement."""
    # In 2-D a displacement may itself be a pair of numbers.
    turned = isinstance(given, tuple) and len(given) == 2 and np.ndim(given[0]) == 1
    return given if turned else (given, None)


def pose(motion: Motion, centre: NDArray, time: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return (R, o): a point y of a body that rotates about `centre` is at R y + o at `time`.

    Raises ValueError if `motion` returns neither a displacement nor a pair, or the result is not finite.
    """
    dim = len(centre)
    displacement, turn = displacement_and_turn(motion(time))
    name = f"motion({time:g})"
    shift = checks.vector(name, [displacement] if dim == 1 and np.ndim(displacement) == 0 else displacement, dim)
    matrix = np.eye(dim) if turn is None else rotation(turn, dim, f"turn of {name}")
    return matrix, shift + centre - rotated(matrix, centre)


def poses(
    name: str, motion: Motion, centre: NDArray, times: NDArray, furthest: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return (R, o) at all `times`, shapes [time_count, d, d] and [time_count, d].

    Equal to the results of `pose` bit for bit. Raises ValueError, with name and time, if a pose is undefined or a
    displacement exceeds `furthest` [m].
    """
    found = _at_once(motion, centre, times)
    if found is not None and np.abs(found[1]).max() <= furthest:
        return found
    near: checks.Limit = (lambda shift: np.abs(shift) <= furthest, f"at most {furthest:.2g}")
    each = []  # one time after the other, so that an error names the time, and forms may vary
    for time in map(float, times):
        try:
            each.append(pose(motion, centre, time))
            checks.within("displacement", each[-1][1], near)
        except Exception as error:
            raise ValueError(f"{name} has no place at {time:g} s: {checks.message(error)}") from error
    return np.array([one[0] for one in each]), np.array([one[1] for one in each])


def _at_once(motion: Motion, centre: NDArray, times: NDArray) -> tuple[NDArray, NDArray] | None:
    """Return all poses from one call; None if the form of the result varies over time."""
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
            return np.broadcast_to(np.eye(dim), (len(times), dim, dim)), found + centre - centre
        right = turned == {True} and found.shape[1] == dim + (1 if dim == 2 else 3)
        if right and np.isfinite(found).all():
            matrices = rotations(found[:, dim:], dim)
            return matrices, found[:, :dim] + centre - rotated(matrices, centre)
    except Exception:  # raised again, with the time, when each time is evaluated
        pass
    return None
