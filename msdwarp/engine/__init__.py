"""One substep on a device: `Model` is constant, `State` moves, effects act, `Dynamics` launches, diagnostics tell.

The only room that composes the kernels that move particles, and all but the only one that launches them: linearly
implicit Euler launches its own solver.
"""

from .collision.body_contact import BodyContact
from .collision.body_contact_worlds import BodyContactWorlds
from .collision.contact_forces import ContactForces
from .diagnostics.divergence import Backup, Baseline, DivergenceMonitor
from .diagnostics.energies import Measures, measure, write_in_order, write_strain
from .diagnostics.energy_balance import (
    EnergyBalance,
    EnergySums,
    is_told_by_frames,
    potential,
    rounding_energy,
    size,
    weight,
)
from .diagnostics.frozen_worlds import FrozenWorlds, WorldStatus
from .diagnostics.rate_bounds import Rates, rate_bounds, resists, world_rates
from .diagnostics.readout import Found
from .diagnostics.sensors import GroupMeans, Sensors, sensors_of
from .model.effect import Effect, Steps
from .model.model import Model
from .model.state import State
from .springs.linearised import add_linearised, write_diagonal_blocks
from .stepping.assemble import Assembly, assemble, assemble_worlds
from .stepping.cpu_partition import THREADS, cores, threads_for
from .stepping.launcher import Dynamics
from .stepping.start_checks import starting_state, warn_of_start
from .stepping.substeps import Blocks, Stepper, check_blocks

__all__ = [
    "THREADS",
    "Assembly",
    "Backup",
    "Baseline",
    "Blocks",
    "BodyContact",
    "BodyContactWorlds",
    "ContactForces",
    "DivergenceMonitor",
    "Dynamics",
    "Effect",
    "EnergyBalance",
    "EnergySums",
    "Found",
    "FrozenWorlds",
    "GroupMeans",
    "Measures",
    "Model",
    "Rates",
    "Sensors",
    "State",
    "Stepper",
    "Steps",
    "WorldStatus",
    "add_linearised",
    "assemble",
    "assemble_worlds",
    "check_blocks",
    "cores",
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
    "warn_of_start",
    "weight",
    "world_rates",
    "write_diagonal_blocks",
    "write_in_order",
    "write_strain",
]
