"""A system advanced frame by frame: `Simulation`, divergence, checkpoints, frames on their way to the host."""

from .divergence import SimulationDiverged
from .readback import Readback
from .simulation import Simulation, frame_count

__all__ = ["Readback", "Simulation", "SimulationDiverged", "frame_count"]
