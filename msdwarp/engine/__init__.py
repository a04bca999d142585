"""One substep on a device. The only room that composes and launches the kernels that move particles."""

from .dynamics import Dynamics
from .linearised import add_linearised, write_diagonal_blocks
from .measures import Measures, measure, write_strain
from .model import Model
from .rates import Rates, rate_bounds
from .start import doubt_start
from .state import State
from .stepper import Blocks, Stepper, check_blocks
from .watch import Backup, Watch

__all__ = [
    "Backup",
    "Blocks",
    "Dynamics",
    "Measures",
    "Model",
    "Rates",
    "State",
    "Stepper",
    "Watch",
    "add_linearised",
    "check_blocks",
    "doubt_start",
    "measure",
    "rate_bounds",
    "write_diagonal_blocks",
    "write_strain",
]
