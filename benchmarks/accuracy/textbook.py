"""What textbook experiments share: numbers beside their closed forms, and how a frequency is measured."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

import msdwarp as msd
from msdwarp import Simulation, System

G = 9.82
"""Gravity [m/s²]."""


class Quantity(NamedTuple):
    """A number beside its closed form."""

    name: str
    unit: str
    exact: float
    measured: float

    @property
    def deviation(self) -> float:
        """Measured over exact, minus 1."""
        return self.measured / self.exact - 1.0


class Found(NamedTuple):
    """What an experiment found."""

    quantities: list[Quantity]
    points: tuple[NDArray, NDArray]
    """Measured points (x, y) of the chart."""
    curve: tuple[NDArray, NDArray]
    """The closed form (x, y) of the chart."""
    axes: tuple[str, str]
    """Labels of x and y."""


def simulation_of(system: System, device: str, **more: Any) -> Simulation:
    """Return a simulation by leapfrog in float64 without gravity, but for what `more` says."""
    how = {"gravity": 0.0, "integrator": msd.Leapfrog(), "precision": "float64", "device": device}
    return Simulation(system, **{**how, **more})


def line_of(count: int, spacing: float, **more: Any) -> System:
    """Return masses on the x axis from 0 on, joined in a row."""
    position = np.zeros((count, more.pop("dim", 3)))
    position[:, 0] = spacing * np.arange(count)
    ends = np.stack([np.arange(count - 1), np.arange(1, count)], axis=1)
    return System(position=position, connections=ends, **more)


def frequency_of(system: System, shape: NDArray, device: str, periods: float, guess: float, **more: Any) -> float:
    """Return the frequency [Hz] of a motion that starts at rest in a mode's `shape`.

    It is fitted to the motion's projection on the shape; `guess` [Hz] sets the frames, 40 in a period.
    """
    simulation = simulation_of(system, device, fps=40.0 * guess, **more)
    weight = np.where(np.isfinite(system.mass), system.mass, 0.0)[:, None] * shape
    middle = system.position - shape
    seen = [float((weight * (frame.position - middle)).sum()) for frame in simulation.frames(periods / guess)]
    seen, t = np.array(seen), np.arange(len(seen)) / simulation.fps

    def left(f: float) -> float:
        parts = np.stack([np.cos(2 * np.pi * f * t), np.sin(2 * np.pi * f * t)], axis=1)
        return float(np.linalg.lstsq(parts, seen, rcond=None)[1][0])

    tried = np.linspace(0.8 * guess, 1.2 * guess, 81)
    best = int(np.argmin([left(f) for f in tried]))
    low, high = tried[max(best - 1, 0)], tried[min(best + 1, 80)]
    for _ in range(60):  # golden section
        a, b = high - (high - low) / 1.618034, low + (high - low) / 1.618034
        low, high = (low, b) if left(a) < left(b) else (a, high)
    return 0.5 * (low + high)
