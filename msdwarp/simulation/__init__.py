"""`Simulation` advances a system frame by frame, `Ensemble` many worlds at once.

Further contents: divergence errors, checkpoints, and transfer of frames to the host.
"""

from .arguments import frame_count
from .divergence_error import SimulationDiverged
from .ensemble import Ensemble
from .ensemble_results import ENERGIES, GroupMean, observations
from .gradient import ARRAYS, Gradient
from .gradient_run import Differentiated, Frames
from .modes import Modes, modes
from .readback import Readback
from .simulation import Simulation
from .substep_chooser import SubstepChooser
