"""Frame: what a run hands out, a file stores and a picture shows."""

from typing import NamedTuple

from numpy.typing import NDArray


class Frame(NamedTuple):
    """The state at one time, on the host."""

    time: float
    """Simulated time [s]."""
    position: NDArray
    """Particle positions [m], shape [particle_count, d]."""
    velocity: NDArray
    """Particle velocities [m/s], shape [particle_count, d]."""
