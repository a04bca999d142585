"""Substeps on a device: a constant `Model`, a moving `State`, effects, launches by `Dynamics`, and diagnostics.

Only this room composes the kernels that move particles. It also launches them, except that linearly implicit Euler
launches its own solver.
"""

from .adjoint.adjoint import Adjoint as Adjoint, without_adjoint as without_adjoint
from .adjoint.stage_adjoint import StageAdjoint as StageAdjoint
from .adjoint.tape import Tape as Tape
from .collision.body_contact import BodyContact as BodyContact
from .collision.contact_forces import ContactForces as ContactForces
from .diagnostics.divergence_monitor import (
    Backup as Backup,
    Baseline as Baseline,
    DivergenceMonitor as DivergenceMonitor,
    FrozenWorlds as FrozenWorlds,
    WorldStatus as WorldStatus,
)
from .diagnostics.energies import (
    Measures as Measures,
    measure as measure,
    write_in_order as write_in_order,
    write_strain as write_strain,
)
from .diagnostics.energy_balance import (
    EnergyBalance as EnergyBalance,
    EnergySums as EnergySums,
    is_told_by_frames as is_told_by_frames,
    potential as potential,
    rounding_energy as rounding_energy,
    size as size,
    weight as weight,
)
from .diagnostics.probes import GroupMeans as GroupMeans, Sensors as Sensors, sensors_of as sensors_of
from .diagnostics.rate_bounds import (
    Rates as Rates,
    functions_of as functions_of,
    own_rates as own_rates,
    rate_bounds as rate_bounds,
    rates_by_part as rates_by_part,
    resists as resists,
    world_rates as world_rates,
)
from .diagnostics.readout import Found as Found
from .diagnostics.time_scales import LOOK as LOOK, time_rates as time_rates
from .model.effect import Effect as Effect, Steps as Steps
from .model.model import Model as Model
from .model.state import State as State, copy_vectors as copy_vectors
from .springs.linearised import add_linearised as add_linearised, write_diagonal_blocks as write_diagonal_blocks
from .stepping.assemble import Assembly as Assembly, assemble as assemble, assemble_worlds as assemble_worlds
from .stepping.cpu_partition import THREADS as THREADS
from .stepping.dynamics import Dynamics as Dynamics
from .stepping.pace import Pace as Pace
from .stepping.stages import Solve as Solve, Stage as Stage
from .stepping.start_checks import (
    caught as caught,
    starting_state as starting_state,
    warn_of_start as warn_of_start,
)
from .stepping.substeps import Blocks as Blocks, Stepper as Stepper, check_blocks as check_blocks
from .stepping.velocities import Velocities as Velocities, kicked as kicked
from .stepping.world_differences import threads_of_world as threads_of_world
