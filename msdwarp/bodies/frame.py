"""Results of a simulation: the state at one time, and the readings of a probe over time."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray


class Frame(NamedTuple):
    """The state at one time, on the host.

    Attributes
    ----------
    time
        Simulated time [s].
    position
        Particle positions [m], shape [particle_count, d].
    velocity
        Particle velocities [m/s], shape [particle_count, d].
    """

    time: float
    position: NDArray
    velocity: NDArray


class Series(NamedTuple):
    """The readings of one probe, by frame or by substep.

    Attributes
    ----------
    times
        Ends of frames, or of substeps [s], shape [reading_count].
    values
        The readings in SI units, shape [reading_count, d]; strain has two columns, mean and largest.
    """

    times: NDArray[np.float64]
    values: NDArray[np.float64]
