"""A system advanced frame by frame: `Simulation`; many at once: `Ensemble`.

Divergence, checkpoints, frames on their way to the host.
"""

from .arguments import frame_count
from .divergence import SimulationDiverged
from .ensemble import Ensemble
from .ensemble_results import ENERGIES, GroupMean, observations
from .readback import Readback
from .simulation import Simulation

__all__ = [
    "ENERGIES",
    "Ensemble",
    "GroupMean",
    "Readback",
    "Simulation",
    "SimulationDiverged",
    "frame_count",
    "observations",
]
