"""Space: coordinates in one, two and three dimensions, and rotations."""

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import checks

AXES = {1: [0], 2: [0, 2], 3: [0, 1, 2]}
"""Axes in space of a body's coordinates, by the number of coordinates: a line is along x, a plane upright."""


def rotation_matrix(dim: int, angle: float, axis: ArrayLike = (0, 0, 1)) -> NDArray[np.float64]:
    """Return the matrix of a rotation by `angle` [rad], in three dimensions about an axis; check both."""
    if np.ndim(angle):
        raise ValueError(
            f"angle is {checks.repr_short(angle)}; it must be a number [rad], with the axis as the second "
            "argument, such as rotate(np.pi / 2, (0, 0, 1))"
        )
    checks.between("angle", angle, -checks.LARGEST, checks.LARGEST)
    cosine, sine = np.cos(angle), np.sin(angle)
    if dim == 2:
        return np.array([[cosine, -sine], [sine, cosine]])
    if dim == 1:
        raise ValueError("a one-dimensional system cannot be rotated")
    checks.broadcast("axis", axis, (3,))
    return _about(np.array([checks.direction("axis", axis)]), np.array([cosine]), np.array([sine]))[0]


def rotation(turn: ArrayLike, dim: int, name: str) -> NDArray[np.float64]:
    """Return the matrix of a rotation vector, or in two dimensions an angle [rad]; raise ValueError if invalid."""
    if dim == 1:
        raise ValueError(f"{name} is {turn!r}; in one dimension nothing turns")
    if dim == 2:
        angle: Any = [turn]
        return rotations(checks.vector(name, angle, 1)[None], 2)[0]
    return rotations(checks.vector(name, turn, 3)[None], 3)[0]


def rotations(turns: NDArray, dim: int) -> NDArray[np.float64]:
    """Return the matrices of many rotations, shape [count, d, d], bit for bit equal to single rotations.

    Rotations are rotation vectors [rad], shape [count, 3], or in two dimensions angles, shape [count, 1]. Raises
    ValueError in one dimension, where there are no rotations.
    """
    if dim == 1:
        raise ValueError("in one dimension nothing turns")
    if dim == 2:
        cosine, sine = np.cos(turns[:, 0]), np.sin(turns[:, 0])
        return np.stack([cosine, -sine, sine, cosine], axis=-1).reshape(-1, 2, 2)
    angle = np.array([math.hypot(*turn) for turn in turns])  # hypot avoids squares that overflow or underflow
    u = np.ldexp(turns, -np.frexp(np.abs(turns).max(axis=1, keepdims=True))[1])
    x, y, z = u.T
    length = np.sqrt(x * x + y * y + z * z)
    x, y, z = u.T / np.where(length > 0, length, 1.0)  # without rotation the axis is undefined, but the sine is 0
    return _about(np.stack([x, y, z], axis=-1), np.cos(angle), np.sin(angle))


def _about(axis: NDArray[np.float64], cosine: NDArray, sine: NDArray) -> NDArray[np.float64]:
    """Return the matrices of rotations about unit vectors, shape [count, 3, 3], by Rodrigues' formula.

    Products are summed term by term, since a matrix library would sum one or many in different orders.
    """
    x, y, z = axis.T
    zero = np.zeros_like(x)
    cross = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=-1).reshape(-1, 3, 3)
    cosine, sine = cosine[:, None, None], sine[:, None, None]
    return cosine * np.eye(3) + sine * cross + (1 - cosine) * (axis[:, :, None] * axis[:, None, :])


def rotated(matrices: NDArray[np.float64], point: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return R y for matrices of shape [..., d, d] and a point y; bit for bit equal for one matrix or many."""
    result = matrices[..., 0] * point[0]
    for k in range(1, len(point)):
        result = result + matrices[..., k] * point[k]
    return result


def in_space(position: NDArray, dtype: type = np.float32) -> NDArray:
    """Return positions in three dimensions: a plane system is upright, a line is along x."""
    dim = position.shape[-1]
    if dim == 3:
        return np.ascontiguousarray(position, dtype=dtype)
    points = np.zeros((*position.shape[:-1], 3), dtype=dtype)
    points[..., AXES[dim]] = position
    return points
