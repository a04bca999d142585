"""`Simulation` advances a system frame by frame, `Ensemble` many worlds at once.

Further contents: divergence errors, checkpoints, and transfer of frames to the host.
"""

from .arguments import frame_count as frame_count
from .divergence_error import SimulationDiverged as SimulationDiverged
from .ensemble import Ensemble as Ensemble
from .ensemble_results import ENERGIES as ENERGIES, GroupMean as GroupMean, observations as observations
from .gradient import ARRAYS as ARRAYS, Gradient as Gradient
from .gradient_run import Differentiated as Differentiated, Frames as Frames
from .readback import Readback as Readback
from .simulation import Simulation as Simulation
