"""Orbit: a camera that a mouse moves around what it looks at, z up."""

import math

import numpy as np
from numpy.typing import NDArray

from .stage import VIEW_ANGLE, Camera

STEEPEST = math.radians(89.0)
"""How far above or below the horizon the camera may be, short of where up is no direction."""
HALF_TURN = 1.0
"""Turns of half a circle for a mouse that moves by the window's height."""


class Orbit:
    """A camera that a mouse moves around what it looks at; z stays up.

    Parameters
    ----------
    camera
        Where it is at first.

    Attributes
    ----------
    target
        What it looks at [m], shape [3].
    distance
        How far it is from there [m].
    azimuth, elevation
        In which direction it is from there [rad]: anticlockwise from x seen from above, and above the horizon.
    """

    def __init__(self, camera: Camera) -> None:
        away = camera.eye - camera.target
        self.target, self.distance = np.array(camera.target), float(np.linalg.norm(away))
        self.azimuth = math.atan2(away[1], away[0]) if away[:2].any() else math.atan2(camera.up[1], camera.up[0])
        self.elevation = math.asin(away[2] / self.distance)
        self._start = self.distance
        self._keep()

    def _keep(self) -> None:
        self.elevation = min(max(self.elevation, -STEEPEST), STEEPEST)
        self.distance = min(max(self.distance, 1e-3 * self._start), 20.0 * self._start)

    @property
    def axes(self) -> tuple[NDArray, NDArray, NDArray]:
        """What is right, up and back for the camera: unit vectors, shape [3] each."""
        flat = math.cos(self.elevation)
        back = np.array([flat * math.cos(self.azimuth), flat * math.sin(self.azimuth), math.sin(self.elevation)])
        right = np.array([-math.sin(self.azimuth), math.cos(self.azimuth), 0.0])
        return right, np.cross(back, right), back

    @property
    def eye(self) -> NDArray:
        """Where the camera is [m], shape [3]."""
        return self.target + self.distance * self.axes[2]

    def turn(self, right: float, up: float) -> None:
        """Move around the target as a mouse that moves by these shares of the window's height turns it."""
        self.azimuth -= math.pi * HALF_TURN * right
        self.elevation -= math.pi * HALF_TURN * up
        self._keep()

    def shift(self, right: float, up: float) -> None:
        """Move the target so that what it was follows the mouse, by these shares of the window's height."""
        unit = 2.0 * self.distance * math.tan(math.radians(VIEW_ANGLE) / 2)
        rightwards, upwards, _ = self.axes
        self.target = self.target - unit * (right * rightwards + up * upwards)

    def zoom(self, by: float) -> None:
        """Come so many times nearer to the target."""
        self.distance /= by
        self._keep()

    def ray(self, right: float, up: float) -> tuple[NDArray, NDArray, NDArray]:
        """Return the ray through a point of the window: origin [m], direction, and the way into the screen.

        Parameters
        ----------
        right, up
            Where the point is from the middle, in heights of the window.
        """
        across, upright, back = self.axes
        unit = 2.0 * math.tan(math.radians(VIEW_ANGLE) / 2)
        way = -back + unit * (right * across + up * upright)
        return self.eye, way / np.linalg.norm(way), -back

    def pixels(self, points: NDArray, height: int, width: int) -> NDArray[np.float64] | None:
        """Return where points [m], shape [any, 3], are in the window: pixels from its lower left, shape [any, 2].

        None where one of them is behind the camera.
        """
        across, upright, back = self.axes
        offset = points - self.eye
        ahead = -(offset @ back)
        if ahead.min() <= 0:
            return None
        unit = height / (2.0 * math.tan(math.radians(VIEW_ANGLE) / 2) * ahead)
        return np.stack([width / 2 + unit * (offset @ across), height / 2 + unit * (offset @ upright)], axis=-1)
