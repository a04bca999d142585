"""A system advanced frame by frame: `Simulation`, divergence, checkpoints, frames on their way to the host."""

from .arguments import frame_count
from .divergence import SimulationDiverged
from .readback import Readback
from .simulation import Simulation

__all__ = ["Readback", "Simulation", "SimulationDiverged", "frame_count"]
