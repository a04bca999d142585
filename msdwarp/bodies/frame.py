"""Results of a simulation: the state at one time, and the readings of a probe over time."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray


class Frame(NamedTuple):
    """The state at one time, on the host."""

    time: float
    """Simulated time [s]."""
    position: NDArray
    """Particle positions [m], shape [particle_count, d]."""
    velocity: NDArray
    """Particle velocities [m/s], shape [particle_count, d]."""


class Series(NamedTuple):
    """The readings of one probe, by frame or by substep."""

    times: NDArray[np.float64]
    """Ends of frames, or of substeps [s], shape [reading_count]."""
    values: NDArray[np.float64]
    """The readings in SI units, shape [reading_count, d]; strain has two columns, mean and largest."""
