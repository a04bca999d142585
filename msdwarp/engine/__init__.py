"""One substep on a device: `Model` is constant, `State` moves, `Dynamics` launches; effects, measures, the watch.

The only room that composes the kernels that move particles, and all but the only one that launches them: linearly
implicit Euler launches its own solver.
"""

from .balance import Balance, Ledger, is_told_by_frames, potential, rounding_energy, size, weight
from .dynamics import Dynamics
from .effect import Effect, Steps
from .ensemble_dynamics import EnsembleDynamics, EnsembleStepper
from .ensemble_model import EnsembleModel
from .ensemble_sums import GroupMean, WorldEnergies, world_rates
from .ensemble_watch import EnsembleWatch
from .feeling import Felt, felt_by
from .found import Found
from .linearised import add_linearised, write_diagonal_blocks
from .measures import Measures, measure, write_in_order, write_strain
from .model import Model
from .rates import Rates, rate_bounds, resists
from .sensing import Sensors, sensors_of
from .shares import THREADS, cores, threads_for
from .start import doubt_start, starting_state
from .state import State
from .stepper import Blocks, Stepper, check_blocks
from .touching import Touching
from .touching_worlds import TouchingWorlds
from .watch import Backup, Baseline, Watch

__all__ = [
    "THREADS",
    "Backup",
    "Balance",
    "Baseline",
    "Blocks",
    "Dynamics",
    "Effect",
    "EnsembleDynamics",
    "EnsembleModel",
    "EnsembleStepper",
    "EnsembleWatch",
    "Felt",
    "Found",
    "GroupMean",
    "Ledger",
    "Measures",
    "Model",
    "Rates",
    "Sensors",
    "State",
    "Stepper",
    "Steps",
    "Touching",
    "TouchingWorlds",
    "Watch",
    "WorldEnergies",
    "add_linearised",
    "check_blocks",
    "cores",
    "doubt_start",
    "felt_by",
    "is_told_by_frames",
    "measure",
    "potential",
    "rate_bounds",
    "resists",
    "rounding_energy",
    "sensors_of",
    "size",
    "starting_state",
    "threads_for",
    "weight",
    "world_rates",
    "write_diagonal_blocks",
    "write_in_order",
    "write_strain",
]
