"""A system advanced frame by frame: `Simulation`; many at once: `Ensemble`.

Divergence, checkpoints, frames on their way to the host.
"""

from .arguments import frame_count as frame_count
from .divergence_error import SimulationDiverged as SimulationDiverged
from .ensemble import Ensemble as Ensemble
from .ensemble_results import ENERGIES as ENERGIES, GroupMean as GroupMean, observations as observations
from .readback import Readback as Readback
from .simulation import Simulation as Simulation
